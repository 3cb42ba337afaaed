"""What the experimenter can ask for, as buttons with their keys or entries of a menu, and the field for a note.

The buttons show what `Actions` allows; the page does what they ask for.
"""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLineEdit, QMenu, QWidget

from app.ipc import messages as m
from app.window.run.actions import Actions
from app.window.widgets.keys import KEYS
from app.window.widgets.parts import KeyButton, column

MAIN_PX, LEAST_PX = 44, 32  # high, the first button and the field


def key_button(text: str, action: str, name: str = "key") -> KeyButton:
    """A button that does the same as the key of an action in `KEYS`, and names it."""
    return KeyButton(text, KEYS[action].keys[0], name)


class Commands(QWidget):
    """Start, pause, abort, repeat, skip, close and a note: those that the stage has; beside a card rare ones behind
    *More*."""

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
        self.more, self.behind = KeyButton("More  ▾"), (self.pause, self.skip, self.leave)
        self.more.clicked.connect(self._unfold)
        self.note = QLineEdit(accessibleName="Note, kept with the time", maxLength=500)
        self.note.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self.note.setMinimumHeight(LEAST_PX)
        self.note.returnPressed.connect(self._keep_note)
        parts = (self.start, self.more, self.pause, self.abort, self.redo, self.skip, self.leave, self.note)
        self.setLayout(column(*parts))
        self.asks = {"redo": self.redo, "skip": self.skip, "abort": self.abort}
        self._texts = {pressed: pressed.text() for pressed in (self.start, *self.asks.values(), self.leave)}
        self.setEnabled(False)  # until there is a protocol
        self._show(runs=False, on_card=False)

    def _unfold(self) -> None:
        """The buttons behind *More*, as they are now, as a menu."""
        menu = QMenu(self.more)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for pressed in self.behind:
            menu.addAction(f"{pressed.text()}\t{pressed.key.text()}", pressed.click).setEnabled(pressed.isEnabled())
        menu.popup(self.more.mapToGlobal(self.more.rect().bottomLeft()))

    def write_note(self) -> None:
        if self.note.isEnabled():
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
        self._show(runs, on_card)

    def _show(self, runs: bool, on_card: bool) -> None:
        """Show the buttons of the stage."""
        plain = not runs and not on_card
        for pressed, shown in (
            (self.start, plain), (self.more, on_card), (self.pause, not on_card), (self.abort, runs),
            (self.redo, plain), (self.skip, plain), (self.leave, plain),
        ):  # fmt: skip
            pressed.setVisible(shown)
