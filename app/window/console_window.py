"""The experimenter's window: pre-flight, plan, workspace, traces, proof of recording; questions and notices in cards.

It shows what the bench says and asks the bench for what the experimenter wants; it decides nothing.
"""

import time

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtGui import QCloseEvent, QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.cards import Cards
from app.window.centre import Centre
from app.window.commands import Commands
from app.window.device_page import DevicePage
from app.window.keys import bind
from app.window.painting import theme
from app.window.painting.energy_panel import EnergyPanel
from app.window.painting.labels import breakable, line
from app.window.painting.timing_strip import TimingStrip
from app.window.painting.traces import Traces
from app.window.preflight import Preflight
from app.window.proof_line import ProofLine
from app.window.questionnaire import Questionnaire
from app.window.session_panel import SessionPanel
from app.window.start_page import StartPage
from app.window.words import feedback
from experiments.plan import PlannedTrial

RIGHT_PX = 372
#: Our choice: curves, energies and lateness go on with every third frame, twenty times a second and by two or three
#: pixels, which is as smooth as they can be read; only what follows the hand goes on with every frame.
PANELS_EVERY = 3
SMALLEST = (1240, 660)
LARGEST = (1920, 1080)


class ConsoleWindow(QWidget):
    """The whole window."""

    participant_asked = Signal()  # show or hide the participant's window
    closed = Signal()

    def __init__(self, bench, parent: QWidget | None = None) -> None:
        """bench: the window's end of the live bench."""
        super().__init__(parent)
        self.setWindowTitle("phd")
        self.bench = bench
        self.opened: m.Opened | None = None
        self.snapshot = m.Snapshot(m.PREPARING)
        self.preflight, self.proof = Preflight(), ProofLine()
        self.energy, self.timing, self.traces = EnergyPanel(), TimingStrip(), Traces()
        self.panel, self.centre = SessionPanel(), Centre()
        self.start_page = StartPage()
        self.questions = Questionnaire()
        self.device = DevicePage()
        self.device_shown = False  # the device page is looked at
        self.participant_answers = False  # the questions stand on the participant's own window
        self.banner = line("", "banner", theme.TITLE, bold=True)
        self.banner.hide()
        self.trying = False  # a practice trial without a session is looked at
        self._shown: PlannedTrial | None = None  # the trial that the workspace is set up for
        self._waiting: list[np.ndarray] = []  # ticks that the panels have not had yet
        self._lay_out()
        self.cards = Cards(self.centre)
        self.commands = Commands(self)
        self._connect()
        self.dead = self._closing = False
        self._refresh()

    def _lay_out(self) -> None:
        right = QWidget()
        right.setFixedWidth(RIGHT_PX)
        column = QVBoxLayout(right)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(10)
        column.addWidget(self.traces, 4)
        column.addWidget(self.timing, 1)
        left = QVBoxLayout()
        left.setSpacing(10)
        left.addWidget(self.panel, 1)
        left.addWidget(self.energy)
        desk = QWidget()
        middle = QHBoxLayout(desk)
        middle.setContentsMargins(0, 0, 0, 0)
        middle.setSpacing(theme.GAP)
        middle.addLayout(left)
        middle.addWidget(self.centre, 1)
        middle.addWidget(right)
        self.desk = desk
        self.pages = QStackedWidget()
        self.pages.addWidget(self.start_page)
        self.pages.addWidget(desk)
        self.pages.addWidget(self.questions)
        self.pages.addWidget(self.device)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(theme.GAP, theme.GAP, theme.GAP, theme.GAP)
        layout.setSpacing(10)
        layout.addWidget(self.banner)
        layout.addWidget(self.preflight)
        layout.addWidget(self.pages, 1)
        layout.addWidget(self.proof)
        room = QGuiApplication.primaryScreen().availableSize()
        self.setMinimumSize(min(SMALLEST[0], room.width()), min(SMALLEST[1], room.height()))
        self.resize(min(LARGEST[0], room.width()), min(LARGEST[1], room.height()))

    def _connect(self) -> None:
        do = self.commands
        for signal, command in (
            (self.preflight.brakes_off_asked, lambda: do.brakes_off("the button of the console")),
            (self.preflight.brakes_allowed, do.allow_brakes),
            (self.preflight.device_asked, do.device),
            (self.device.rig_asked, do.rig),
            (self.device.reset_asked, do.allow_brakes),
            (self.device.back_asked, do.device),
            (self.panel.start_asked, do.start),
            (self.panel.redo_asked, do.redo),
            (self.panel.skip_asked, do.skip),
            (self.panel.pause_asked, do.pause),
            (self.panel.abort_asked, do.abort),
            (self.panel.noted, do.note),
            (self.start_page.session_asked, do.open_session),
            (self.start_page.practice_asked, do.practice),
            (self.start_page.device_asked, do.device),
            (self.questions.answered, do.answer),
            (self.centre.results_asked, do.results),
            (self.centre.participant_asked, self.participant_asked),
            (self.centre.back_asked, do.back),
            (self.centre.aimed, self.bench.aim),
        ):
            signal.connect(command)
        bind(self, self.keys())

    def keys(self) -> dict:
        """What each key does here."""
        do = self.commands
        return {
            "start": do.start,
            "escape": lambda: do.escape("Esc on the console"),
            "allow brakes": do.allow_brakes,
            "redo": do.redo,
            "skip": do.skip,
            "pause": do.pause,
            "abort": do.abort,
            "note": do.write_note,
            "results": do.results,
            "device": do.device,
            "participant": self.participant_asked.emit,
        }

    # ------------------------------------------------------------------------------------------- what the bench says

    def show_opened(self, opened: m.Opened) -> None:
        """A session, or a protocol before one or after one."""
        if not opened.participant and (self.opened is None or self.opened.participant):
            self.start_page.offer(opened.next_participant)
        self.opened = opened
        self._shown = None
        self.centre.show_opened(opened)
        self.proof.show_opened(opened)
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """Where the session is now."""
        before, self.snapshot = self.snapshot, snapshot
        if snapshot.stage not in (m.NO_SESSION, m.RUNNING, m.PREPARING):
            self.trying = False
        self.device_shown &= snapshot.stage not in (m.RUNNING, *m.OVER)
        self.commands.follow(before, snapshot)
        if snapshot.stage == m.QUESTIONS != before.stage:
            self.questions.clear()
        self._refresh()
        self._show_trial(before)

    def _show_trial(self, before: m.Snapshot) -> None:
        """The workspace: the running trial, else the coming one unless there is a trail to look at."""
        snapshot, opened = self.snapshot, self.opened
        if opened is None:
            return
        now = snapshot.running
        begins = now is not None and (before.running != now or before.stage != m.RUNNING)
        coming = snapshot.coming
        if (
            now is None
            and coming is not None
            and self._shown is None
            or (
                now is None and coming is not None and self._shown.configuration != coming.configuration  # type: ignore[union-attr]
            )
        ):
            now, begins = coming, True
        if begins and now is not None:
            self._shown = now
            self._waiting.clear()
            device = next(device for device in opened.devices if device.name == now.configuration)
            self.centre.begin(now, snapshot.tip)
            self.traces.show_trial(device, opened.paths[now.segment])
            self.energy.clear()
            self.timing.clear()
        elif snapshot.running is None:
            self.show_panels()
            self.centre.rest(snapshot.tip)

    def show_pulse(self, pulse: m.Pulse) -> None:
        """Proof of recording, and timing."""
        self.proof.show_pulse(pulse)
        self.timing.show_timing(pulse.timing)
        self.device.show_linked(pulse.linked)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """Ticks (n, row.WIDTH) of the running trial; taken: the pointer has hold of the handle."""
        if not len(rows) or self.dead or self.snapshot.running is None:
            return
        self.centre.show_ticks(rows, taken)
        self._waiting.append(rows)
        if len(self._waiting) >= PANELS_EVERY:
            self.show_panels()

    def show_panels(self) -> None:
        """The panels go on; at the end of a trial up to its last tick."""
        if self._waiting:
            rows = np.concatenate(self._waiting)
            self._waiting.clear()
            for panel in (self.traces, self.energy, self.timing):
                panel.add(rows)

    def show_device(self, shown: bool) -> None:
        """The device page over everything else, or away again."""
        self.device_shown = shown and self.snapshot.stage not in (m.RUNNING, *m.OVER)
        self.device.leave()
        self._refresh()

    def show_time(self) -> None:
        """What only the clock changes: the countdown of a break."""
        self.cards.show_time(time.monotonic())

    def show_dead(self, sentence: str) -> None:
        """There is no bench any more."""
        self.dead = True
        last = self.snapshot
        stage = last.stage if last.stage in m.OVER else m.FAILED
        self.snapshot = m.Snapshot(stage, last.rows, blind=last.blind, notes=last.notes, said=sentence, said_bad=True)
        self.proof.show_dead(elsewhere=stage == m.ELSEWHERE)
        self.show_panels()
        if self.centre.workspace is not None and self.centre.workspace.view.tip is not None:
            self.centre.rest(self.centre.workspace.view.tip)
        self._refresh()

    def _refresh(self) -> None:
        """Everything that Opened and Snapshot say."""
        snapshot, opened = self.snapshot, self.opened
        over = snapshot.stage in m.OVER
        self.banner.setText(breakable(snapshot.said) if over else "")
        self.banner.setVisible(over)
        self.preflight.show_session(opened, snapshot)
        self.start_page.show_session(opened, snapshot)
        before_session = opened is None or not opened.participant
        at_start = before_session and not self.trying and snapshot.stage != m.RUNNING
        asks = snapshot.stage == m.QUESTIONS and not self.participant_answers
        page = self.start_page if at_start else self.questions if asks else self.desk
        self.device.show_session(opened, snapshot)
        self.pages.setCurrentWidget(self.device if self.device_shown else page)
        if opened is None:
            return
        self.questions.show_feedback(feedback(snapshot, opened))
        self.panel.show_session(opened, snapshot, self.trying)
        self.centre.show_session(opened, snapshot, self.trying)
        self.traces.set_blind(snapshot.blind)
        self.energy.setVisible(not snapshot.blind)  # what the brakes took would tell the controllers apart
        self.cards.show_session(opened, snapshot, self.commands)

    # ------------------------------------------------------------------------------------------- the end

    def closeEvent(self, event: QCloseEvent) -> None:
        """While something is recorded, ask first."""
        if self.snapshot.stage == m.RUNNING and not self.snapshot.practice and not self._closing and not self.dead:
            event.ignore()
            self.showNormal() if self.isMinimized() else self.show()
            self.raise_()
            self.cards.ask_to_close(self.close_anyway)
            return
        event.accept()
        self.closed.emit()

    def close_anyway(self) -> None:
        """The question has been answered."""
        self._closing = True
        self.close()
