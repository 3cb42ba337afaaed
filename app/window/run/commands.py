"""What the experimenter can ask for, as buttons with their keys, and the field for a note.

The buttons show what `Actions` allows; the page does what they ask for.
"""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.ipc import messages as m
from app.window.run.actions import Actions
from app.window.widgets.keys import KEYS
from app.window.widgets.parts import KeyButton, column

MAIN_PX, LEAST_PX = 44, 32  # high, the first button and the field


def key_button(text: str, action: str, name: str = "key") -> KeyButton:
    """A button that does the same as the key of an action in `KEYS`, and names it."""
    return KeyButton(text, KEYS[action].keys[0], name)


class Commands(QWidget):
    """Start, pause, abort, repeat, skip, close and a note: those that the stage has, rare ones behind *More*."""

    noted = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self.start = key_button("Start", "start", "main")
        self.start.setMinimumHeight(MAIN_PX)
        self.pause = key_button("Pause", "pause")
        self.pause.setCheckable(True)
        self.abort = key_button("Abort trial …", "abort")
        self.redo = key_button("Repeat last trial …", "redo")
        self.skip = key_button("Skip next trial …", "skip")
        self.leave = KeyButton("Close session …")
        self.more = KeyButton("More  ▾")
        self.more.setCheckable(True)
        self.note = QLineEdit(accessibleName="Note, kept with the time", maxLength=500)
        self.note.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self.note.setMinimumHeight(LEAST_PX)
        self.note.returnPressed.connect(self._keep_note)
        parts = (self.start, self.more, self.pause, self.abort, self.redo, self.skip, self.leave, self.note)
        self.setLayout(column(*parts))
        self.asks = {"redo": self.redo, "skip": self.skip, "abort": self.abort}
        self._texts = {pressed: pressed.text() for pressed in (self.start, *self.asks.values(), self.leave)}
        self._on_card = False
        self.more.toggled.connect(lambda _: self._fold())
        self._runs = False
        self.setEnabled(False)  # until there is a protocol
        self._fold()

    def write_note(self) -> None:
        if self.note.isEnabled():
            self.more.setChecked(self.more.isChecked() or self._on_card)
            self.note.setFocus()

    def _keep_note(self) -> None:
        if text := self.note.text().strip():
            self.noted.emit(text)
        self.note.clear()
        self.note.clearFocus()

    def offer(self, snapshot: m.Snapshot, can: Actions, on_card: bool, reads: bool) -> None:
        """What can be done now. on_card: a trial's card has its own buttons; reads: the participant has a page of
        instructions."""
        self.setEnabled(True)
        runs = snapshot.stage == m.RUNNING
        for pressed, offered in (
            (self.start, can.start and not on_card), (self.pause, can.pause), (self.leave, can.leave),
            (self.note, can.note), *((pressed, can.of(action)) for action, pressed in self.asks.items()),
        ):  # fmt: skip
            pressed.setEnabled(bool(offered))
        for pressed, text in self._texts.items():
            pressed.setText(text)
        self.start.setText("Next page" if reads else "Start")
        self.pause.setChecked(snapshot.paused)
        self.pause.setText(
            "Resume" if snapshot.paused and not runs else "Paused after this trial" if snapshot.paused else
            "Pause after this trial" if runs else "Pause"
        )  # fmt: skip
        self.note.setToolTip("\n".join(snapshot.notes))
        kept = f"Kept: {snapshot.notes[-1]}" if snapshot.notes else "Note …"
        self.note.setPlaceholderText(f"{kept}  {KEYS['note'].keys[0]}")
        if on_card and not self._on_card:  # a note that is being written is not folded away
            self.more.setChecked(bool(self.note.text()) or self.note.hasFocus())
        self._on_card, self._runs = on_card, runs
        self._fold()

    def _fold(self) -> None:
        """Show the buttons of the stage: beside a card all but *More* only once that is pressed."""
        between, unfolded = not self._runs, self.more.isChecked() or not self._on_card
        self.more.setText("More  ▴" if self.more.isChecked() else "More  ▾")
        for pressed, shown in (
            (self.start, between and not self._on_card), (self.more, self._on_card), (self.pause, unfolded),
            (self.abort, self._runs), (self.redo, between and not self._on_card), (self.skip, between and unfolded),
            (self.leave, between and unfolded), (self.note, unfolded),
        ):  # fmt: skip
            pressed.setVisible(shown)
