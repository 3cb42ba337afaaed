"""The left panel: the plan, what comes next, what can be asked for, the notes.

It shows the snapshot; the page does what its buttons ask for.
"""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLineEdit, QPlainTextEdit, QSizePolicy

from app.ipc import messages as m
from app.window.participant.tone import NO_SOUND, player
from app.window.run.actions import Actions
from app.window.run.plan_grid import PlanGrid
from app.window.widgets import theme
from app.window.widgets.keys import KEYS
from app.window.widgets.parts import (
    NO_FOCUS,
    KeyButton,
    OneLine,
    Panel,
    breakable,
    column,
    scrolled,
    text_label,
    wrapped_label,
)
from app.window.widgets.preflight import advice
from app.window.widgets.words import LACKING, cell, done_of
from experiments.store.cells import finished_cells, place

WIDTH_PX = 256
LEAST_PLAN_PX = 60  # high, of the plan
NO_SESSION = "No session is open"
READS = "The participant reads the instructions; after the last page the first trial can be started."


class SessionPanel(Panel):
    """Plan, next, Start, Redo, Skip, Pause, Abort, notes, Close session, Go on in another folder."""

    noted = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.head = OneLine(NO_SESSION, "", theme.HEAD, bold=True)
        self.done, self.time = text_label("", "quiet", theme.SMALL), OneLine("", "quiet")
        self.grid = PlanGrid()
        self.coming = text_label("", bold=True)
        self.cell = OneLine("", "quiet")
        self.notice = wrapped_label("", "caution", theme.SMALL)
        self.start = key_button("Start", "start", "main")
        self.redo = key_button("Repeat last trial …", "redo")
        self.skip = key_button("Skip next trial …", "skip")
        self.pause = key_button("Pause", "pause")
        self.pause.setCheckable(True)
        self.abort = key_button("Abort trial …", "abort")
        self.leave = KeyButton("Close session …")  # between trials, in the place of Abort
        self.note = QLineEdit(
            placeholderText=f"Note …  {KEYS['note'].keys[0]}", accessibleName="Note, kept with the time", maxLength=500
        )
        self.note.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self.note.returnPressed.connect(self._keep_note)
        self.notes = QPlainTextEdit(readOnly=True, focusPolicy=NO_FOCUS, minimumHeight=24, maximumHeight=150)
        self.notes.setFont(theme.font(theme.SMALL))
        self.notes.setStyleSheet("padding: 2px 4px")
        self.notes.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self.notes.hide()
        self.scroll_area = scrolled(self.grid)
        self.scroll_area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.scroll_area.setFocusPolicy(NO_FOCUS)
        self.scroll_area.setMinimumHeight(LEAST_PLAN_PX)
        self.setLayout(column(
            self.head, self.done, (self.scroll_area, 1000), self.time, self.coming, self.cell,
            self.start, self.pause, self.abort, self.leave, self.redo, self.skip, self.note,
            self.notice, (self.notes, 20), 1, spacing=5, margins=(14, 10, 14, 12),
        ))  # fmt: skip
        self.asks = {"redo": self.redo, "skip": self.skip, "abort": self.abort}
        self._texts = {pressed: pressed.text() for pressed in (*self.asks.values(), self.leave)}
        self.abort.hide()
        self.setEnabled(False)  # until there is a protocol
        self.setFixedWidth(WIDTH_PX)
        self._fit_plan()

    def _fit_plan(self) -> None:
        """As high as the plan needs it, where there is room."""
        self.scroll_area.setMaximumHeight(max(self.grid.sizeHint().height() + 2, LEAST_PLAN_PX))

    def write_note(self) -> None:
        if self.note.isEnabled():
            self.note.setFocus()

    def _keep_note(self) -> None:
        if text := self.note.text().strip():
            self.noted.emit(text)
        self.note.clear()
        self.note.clearFocus()

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, can: Actions, reads: bool) -> None:
        """Where the session stands and what can be done. reads: the participant has a page of instructions."""
        self.setEnabled(True)
        self.head.setText(f"Participant {opened.participant}" if opened.participant else NO_SESSION)
        self.grid.show_session(opened, snapshot)
        self._fit_plan()
        done, lacking = map(len, finished_cells(snapshot.rows))
        self.done.setText(done_of(done, len(opened.plan), lacking) if opened.participant else "")
        self.done.setToolTip(LACKING if lacking else "")
        self._show_coming(opened, snapshot)
        self._show_status(opened, snapshot, reads)
        self._offer(snapshot, can)
        self.start.setText("Next page" if reads else "Start")
        text = "\n".join(snapshot.notes)
        if text != self.notes.toPlainText():
            self.notes.setPlainText(text)
            bar = self.notes.verticalScrollBar()
            bar.setValue(bar.maximum())
        self.notes.setVisible(bool(text))

    def _show_coming(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        now = snapshot.running or snapshot.coming
        self.cell.setText(cell(now, opened, snapshot.blind) if now is not None else "")
        if now is None:
            self.coming.setText("Session complete" if snapshot.stage == m.FINISHED else "")
        else:
            trial = "practice" if now.block == 0 else f"trial {place(now, opened.plan)}"
            self.coming.setText(f"{'Now' if snapshot.running else 'Next'}: {trial}")

    def _show_status(self, opened: m.Opened, snapshot: m.Snapshot, reads: bool) -> None:
        """What happened, and else why no trial can be started, unless the banner says it already."""
        notice, bad = snapshot.notice, snapshot.notice_bad
        if snapshot.not_written and notice == f"{snapshot.not_written}.":  # the banner says it, as far as it has room
            notice = f"Lost if this program ends: {snapshot.in_memory}." if snapshot.in_memory else ""
        if not notice and snapshot.stage == m.READY and not advice(snapshot):
            silent = (
                opened.protocol.tones and not snapshot.rows and player() is None
            )  # said once, before the first trial
            notice = snapshot.trial_blocker or (READS if reads else NO_SOUND if silent else "")
        theme.set_style(self.notice, "bad" if bad else "hint" if snapshot.notice else "caution")
        self.notice.setText(breakable(notice))
        self.notice.setVisible(bool(notice) and snapshot.stage != m.FAILED)  # there the banner says it

    def _offer(self, snapshot: m.Snapshot, can: Actions) -> None:
        runs = snapshot.stage == m.RUNNING
        for pressed, offered in (
            (self.start, can.start), (self.pause, can.pause), (self.leave, can.leave),
            (self.note, can.note), *((pressed, can.of(action)) for action, pressed in self.asks.items()),
        ):  # fmt: skip
            pressed.setEnabled(bool(offered))
        for pressed, text in self._texts.items():
            pressed.setText(text)
        self.pause.setChecked(snapshot.paused)
        self.pause.setText(
            "Resume" if snapshot.paused and not runs else "Paused after this trial" if snapshot.paused else
            "Pause after this trial" if runs else "Pause"
        )  # fmt: skip
        self.abort.setVisible(runs)
        self.leave.setVisible(not runs)


def key_button(text: str, action: str, name: str = "key") -> KeyButton:
    """A button that does the same as the key of an action in `KEYS`, and names it."""
    return KeyButton(text, KEYS[action].keys[0], name)
