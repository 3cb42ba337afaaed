"""The app's window: workspace, console, live figures. It reads what the loop tells and sends what the person wants."""

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QGuiApplication, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QApplication,
    QFileDialog,
    QHBoxLayout,
    QMessageBox,
    QVBoxLayout,
    QWidget,
)

from app import theme, words
from app.console import Console
from app.export import Export
from app.figures_panel import FiguresPanel
from app.labels import breakable, line
from app.loop_process import LoopProcess
from app.messages import Abort, Aim, Begun, Ended, Failed, Prepared, Refused, Start, Ticks
from app.status_line import StatusLine
from app.workspace_view import WorkspaceView
from core.device import Device
from core.errors import InputError
from experiments.plan import SEGMENTS, PlannedTrial, make_plan
from experiments.session import Choices, refuse_existing, session_folder
from experiments.trials_table import TrialRow

FRAME_MS = 16


class Window(QWidget):
    """The whole window. `ask`: whether to close while a trial is recorded."""

    def __init__(
        self,
        loop: LoopProcess,
        devices: Sequence[Device],
        data_dir: Path,
        participant: str,
        choices: Choices,
        ask: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__()
        self._loop, self._data_dir, self._choices = loop, data_dir, choices
        self._devices = {device.name: device for device in devices}
        self._ask = ask or self._ask_to_close
        self.rows: list[TrialRow] = []
        self._plan: tuple[PlannedTrial, ...] = ()
        self._coming: PlannedTrial | None = None
        self._prepared = self._asked = self._running = self._over = False

        self.setWindowTitle("phd")
        self.console = Console(participant)
        self.view = WorkspaceView(devices)
        self.figures = FiguresPanel(tuple(self._devices))
        self.status = StatusLine()
        self.banner = line("", "banner", theme.TITLE, bold=True)
        self.banner.hide()
        self._export = Export(self)
        self._lay_out()

        self.console.participant_changed.connect(self._choose_participant)
        self.console.start_asked.connect(self.start)
        self.console.abort_asked.connect(self.abort)
        self.view.pointer_moved.connect(lambda x, y: self._loop.send(Aim(x, y)))
        self.figures.export_asked.connect(self.export)
        self._export.finished.connect(self.figures.say)
        self._export.refused.connect(self.figures.say)
        for key, do in ((Qt.Key.Key_Space, self.start), (Qt.Key.Key_Escape, self.abort)):
            shortcut = QShortcut(QKeySequence(key), self)
            shortcut.setAutoRepeat(False)
            shortcut.activated.connect(do)
        self._choose_participant(participant)
        self.view.setFocus()
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)
        self._timer.start(FRAME_MS)

    def _lay_out(self) -> None:
        middle = QHBoxLayout()
        middle.setSpacing(theme.GAP)
        middle.addWidget(self.console)
        middle.addWidget(self.view, 1)
        middle.addWidget(self.figures)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(theme.GAP, theme.GAP, theme.GAP, theme.GAP)
        layout.setSpacing(theme.GAP)
        layout.addWidget(self.banner)
        layout.addLayout(middle, 1)
        layout.addWidget(self.status)
        room = QGuiApplication.primaryScreen().availableSize()
        self.resize(min(1440, room.width()), min(810, room.height()))

    # what the person asks for

    def start(self) -> None:
        """Start the next trial."""
        if self.console.start.isEnabled():
            self.console.say("")
            self._asked = True
            self._allow()
            self.view.setFocus()
            self._loop.send(Start(self.console.participant.text()))

    def abort(self) -> None:
        """Stop the running trial at once, brakes off."""
        if self._running:
            self._loop.send(Abort(self.console.reason.currentText().strip() or "no reason given"))

    def export(self) -> None:
        """Ask for a new folder and write the results so far into it."""
        name, _ = QFileDialog.getSaveFileName(self, "Export into a new folder", str(Path.cwd() / "results"))
        if name:
            self.export_to(Path(name))

    def export_to(self, folder: Path) -> None:
        """Write figures and table into a new folder, beside the window's own work."""
        if self._export.busy:
            return
        note = self._choices.note(any(device.assumed for device in self._devices.values())) + ", hand at the mouse"
        session = session_folder(self._data_dir, self.console.participant.text())
        self.figures.say("Writing ..")
        self._export.start(self.rows, session, folder, note, tuple(self._devices))

    def _choose_participant(self, label: str) -> None:
        """Lay out the plan of this participant, or say why there can be none."""
        self._plan, self._coming = (), None
        try:
            if not (label.isascii() and label.isalnum()):
                raise InputError("A participant is named by letters and digits.")
            refuse_existing(self._data_dir, label)
            self._plan = make_plan(label, self._choices.seed, tuple(self._devices))
            self._coming = self._plan[0]
            self.console.say("")
        except InputError as error:
            self.console.say(str(error), bad=True)
        self._show_plan()
        if self._coming:
            start, end = SEGMENTS[1]
            self._show_coming((0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])))

    # what the loop tells

    def _tick(self) -> None:
        """Take in what has come, and see whether the loop lives."""
        alive = self._loop.alive  # asked first: what it said before it died is still read
        rows = []
        for message in self._loop.receive():
            match message:
                case Ticks():
                    rows.append(message)
                case Prepared():
                    self._prepared = True
                    self._allow()
                case Begun():
                    self._begin(message)
                case Ended():
                    self._show_ticks(rows)
                    rows = []
                    self._end(message)
                case Refused(sentence):
                    self._asked = False
                    self.console.say(sentence, bad=True)
                    self._allow()
                case Failed(sentence):
                    self._stop(f"{sentence[0].upper()}{sentence[1:]}")
        self._show_ticks(rows)
        if not alive and not self._over:
            self._stop(words.LOOP_DIED)

    def _begin(self, message: Begun) -> None:
        self._asked, self._running, self._coming = False, True, message.planned
        self.figures.clear()
        self.status.begin()
        self.view.show_trial(
            self._devices[message.planned.configuration], SEGMENTS[message.planned.segment], message.tip
        )
        self._show_plan()

    def _show_ticks(self, messages: list[Ticks]) -> None:
        for message in messages:
            self.view.show_ticks(message.rows, message.taken)
            if self._coming:
                self.figures.add(message.rows, SEGMENTS[self._coming.segment])
            self.status.add(message)
        if messages and (said := words.during(messages[-1])):
            self.view.say(*said)

    def _end(self, message: Ended) -> None:
        self._running, self._coming = False, message.next
        self.rows.append(message.row)
        if words.changes_configuration(message):
            self._show_coming(message.tip)
        else:
            self.view.show_rest(message.tip)  # path and trail stay to be looked at
        self.view.say(*words.after(message))
        self.figures.show_results(self.rows)
        self.status.end(len(self.rows), session_folder(self._data_dir, message.row.participant))
        self.console.say(words.for_experimenter(message))
        self._show_plan()

    def _stop(self, sentence: str) -> None:
        """No more trials: say so in red."""
        self._over, self._running, self._asked = True, False, False
        self.banner.setText(breakable(sentence))
        self.banner.show()
        self.view.show_rest(self.view.tip)
        self.view.say("")
        self.status.stop()
        self._show_plan()

    # what is shown

    def _show_coming(self, tip: tuple[float, float]) -> None:
        assert self._coming is not None
        self.view.show_trial(self._devices[self._coming.configuration], SEGMENTS[self._coming.segment], tip)

    def _show_plan(self) -> None:
        statuses = {trial.run: trial.status for trial in self.rows}
        self.console.show_plan(self._plan, statuses, self._coming, self._running)
        self._allow()

    def _allow(self) -> None:
        idle = not (self._running or self._asked or self._over)
        self.console.allow(
            start=idle and self._prepared and self._coming is not None,
            abort=self._running,
            participant=idle and not self.rows,
        )
        self.figures.allow_export(bool(self.rows) and not self._running)
        if idle and not self.rows:
            ready = words.FIRST if self._prepared else words.PREPARING
            self.view.say("", ready if self._coming else "")

    # the end

    def closeEvent(self, event: QCloseEvent) -> None:
        if self._running and not self._ask():
            event.ignore()
            return
        self.shut("the window was closed")
        event.accept()

    def shut(self, reason: str) -> None:
        """End the loop, whatever it does, and what runs beside the window."""
        if self._timer.isActive():
            self._timer.stop()
            self.hide()
            self._loop.stop(reason)
            self._export.wait()

    def _ask_to_close(self) -> bool:
        asked = QMessageBox.question(
            self,
            "A trial is being recorded",
            "Close the window? The trial is aborted, its recording is kept.",
            QMessageBox.StandardButton.Close | QMessageBox.StandardButton.Cancel,
            QMessageBox.StandardButton.Cancel,
        )
        return asked == QMessageBox.StandardButton.Close


def run(args: argparse.Namespace) -> int:
    """Open the window and stay until it closes; the exit code."""
    choices = Choices()
    loop = LoopProcess(args.devices, args.data_dir, choices)
    code = 0
    try:
        application = QApplication.instance() or QApplication(sys.argv[:1])
        theme.dress(application)
        window = Window(loop, args.devices, args.data_dir, args.participant, choices)

        def leave(number: int, _frame: object) -> None:
            nonlocal code
            code = 128 + number
            window.shut("the program was interrupted")
            application.quit()

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, leave)
        window.show()
        application.exec()
    finally:
        loop.stop("the window was closed")
    return code
