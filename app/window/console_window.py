"""The experimenter's window: pre-flight, plan, workspace, traces, proof of recording; questions and notices in cards.

It shows what the session server says and asks it for what the experimenter wants; it decides nothing.
"""

import time

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QCloseEvent, QGuiApplication, QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from app import __version__
from app.ipc import messages as m
from app.window import words
from app.window.cards import Cards
from app.window.commands import Commands
from app.window.device_page import DevicePage
from app.window.energy_panel import EnergyPanel
from app.window.keys import bind
from app.window.painting import theme
from app.window.painting.labels import OneLine, breakable, line, word
from app.window.painting.linkage_view import Workspace
from app.window.plots import TimingStrip, Traces
from app.window.preflight import Preflight
from app.window.questionnaire import Questionnaire
from app.window.session_panel import SessionPanel
from app.window.start_page import StartPage
from app.window.words import feedback, grouped, hand_is_mouse, size
from core import tick_log
from experiments.plan import PlannedTrial

STALE_S = 1.0  # a last write longer ago than this is worth a look


class ProofLine(QFrame):
    """Name, rows, bytes and age of the recording; earlier runs verified; seed, plan and version."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.lamp, self.recording = word("●", size=theme.SMALL), OneLine("Nothing recorded yet")
        self.origin = word("", "quiet", theme.SMALL)
        self._folder = ""
        layout = QHBoxLayout(self)
        layout.setContentsMargins(12, 7, 12, 7)
        layout.setSpacing(8)
        layout.addWidget(self.lamp)
        layout.addWidget(self.recording, 1)
        layout.addWidget(self.origin)
        self._light(theme.BRAKE_OFF)

    def _light(self, colour: str) -> None:
        if (sheet := f"color: {colour}") != self.lamp.styleSheet():  # each one makes the window lay itself out anew
            self.lamp.setStyleSheet(sheet)

    def show_opened(self, opened: m.Opened) -> None:
        """Seed, plan and version: with them the same session can be laid out again."""
        parts = [f"seed {opened.seed}", f"phd {__version__}"]
        if opened.plan_sha256:
            parts.insert(1, f"plan {opened.plan_sha256[:4]}…{opened.plan_sha256[-2:]}")
        self.origin.setText(" · ".join(parts))
        self.origin.setToolTip(f"Plan {opened.plan_sha256}\n{opened.note}" if opened.plan_sha256 else opened.note)
        self._folder = opened.folder

    def show_pulse(self, pulse: m.Pulse) -> None:
        """The newest proof."""
        several = f"all {pulse.verified} earlier runs verified"
        verified = {0: "", 1: "the earlier run verified"}.get(pulse.verified, several)
        proof = pulse.proof
        if proof is None:
            self._light(theme.GOOD if pulse.verified else theme.BRAKE_OFF)
            trials = "1 run" if pulse.verified == 1 else f"{pulse.verified} runs"
            said = f"Not recording · {trials} recorded and verified in {self._folder}"
            self.recording.setText(said if pulse.verified else "Nothing recorded yet")
            return
        fresh = proof.age_s < STALE_S
        self._light(theme.BAD if fresh else theme.CAUTION)
        parts = [
            f"Recording {proof.name}",
            f"{grouped(proof.rows)} rows",
            size(proof.bytes),
            f"last write {proof.age_s:.1f} s ago",
            verified,
        ]
        self.recording.setText(" · ".join(filter(None, parts)))

    def show_dead(self) -> None:
        """The session server has ended."""
        self._light(theme.BAD)
        self.recording.setText("Not recording")


class Centre(QWidget):
    """Head and workspace."""

    results_asked = Signal()
    participant_asked = Signal()
    back_asked = Signal()
    aimed = Signal(float, float)  # m
    left = Signal()  # the pointer has left the workspace: the hand lets the handle go

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.large = word("", size=theme.HEAD, bold=True)
        self.small = line("", "quiet")  # a line of its own: the participant reads all of it
        self.small.setIndent(2)
        policy = self.small.sizePolicy()
        policy.setHeightForWidth(False)  # `_fit` says how high it is: the window's own height must not hang on it
        self.small.setSizePolicy(policy)
        self.results, self.participant, self.back = (
            QPushButton(text, objectName="small") for text in ("Results  F2", "Participant's view  F11", "Back  Esc")
        )
        for button, asked in (
            (self.results, self.results_asked),
            (self.participant, self.participant_asked),
            (self.back, self.back_asked),
        ):
            button.setFont(theme.font(theme.SMALL))
            button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            button.clicked.connect(asked)
        self.workspace: Workspace | None = None
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        head = QHBoxLayout()
        head.setContentsMargins(2, 0, 0, 0)
        head.setSpacing(10)
        head.addWidget(self.large)
        head.addStretch(1)
        for button in (self.results, self.participant, self.back):
            head.addWidget(button)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(6)
        self._layout.addLayout(head)
        self._layout.addWidget(self.small)

    def show_opened(self, opened: m.Opened) -> None:
        """Another session or protocol: its devices and paths decide the scale."""
        before, self._opened = self._opened, opened
        if self.workspace is not None:
            if before is not None and same_places(before, opened):
                return
            self._layout.removeWidget(self.workspace)
            self.workspace.deleteLater()
        self.workspace = Workspace(opened.devices, opened.paths)
        self.workspace.view.setMouseTracking(True)
        self.workspace.view.installEventFilter(self)
        self._layout.addWidget(self.workspace, 1)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """As many lines as the text needs, at least one, so that the workspace stays where it is."""
        lines = self.small.heightForWidth(self.width())
        self.small.setFixedHeight(max(lines, self.small.fontMetrics().height()))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The pointer over the workspace is the hand."""
        if event.type() == QEvent.Type.MouseMove and isinstance(event, QMouseEvent) and self.workspace is not None:
            self.aimed.emit(*self.workspace.view.to_plane(event.position()))
        elif event.type() == QEvent.Type.Leave:
            self.left.emit()
        return super().eventFilter(watched, event)

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, trying: bool) -> None:
        """Between trials: what the participant reads now."""
        self._snapshot = snapshot
        self.results.setVisible(bool(opened.participant) and snapshot.stage != m.RUNNING)
        self.back.setVisible(trying and snapshot.stage == m.NO_SESSION)
        if self.workspace is not None:
            self.workspace.set_blind(snapshot.blind)
        if snapshot.running is None:
            said = words.practised(snapshot) if trying else words.between(snapshot, opened, hand_is_mouse(opened))
            self._say(said)

    def begin(self, planned: PlannedTrial, tip: m.Point) -> None:
        """A trial, running or to come."""
        if self._opened is None or self.workspace is None:
            return
        device = next(device for device in self._opened.devices if device.name == planned.configuration)
        self.workspace.show_trial(device, self._opened.paths[planned.segment], tip, self._opened.rules)
        if self._snapshot.running is not None:
            self._say(words.moving(tick_log.APPROACH, not hand_is_mouse(self._opened)) or words.Said(""))

    def rest(self, tip: m.Point) -> None:
        """Between trials: the handle stands here."""
        if self.workspace is not None:
            self.workspace.rest(tip)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """Ticks (n, tick_log.WIDTH) of the running trial; taken: the pointer has hold of the handle."""
        if self._snapshot.running is None or self.workspace is None:
            return
        self.workspace.add(rows)
        if (said := words.moving(int(rows[-1, tick_log.PHASE]), taken or not hand_is_mouse(self._opened))) is not None:
            self._say(said)

    def _say(self, said: words.Said) -> None:
        self.large.setText(said.large)
        if said.small != self.small.text():
            self.small.setText(said.small)
            self._fit()


def same_places(a: m.Opened, b: m.Opened) -> bool:
    """Whether two sessions have the same devices and paths."""
    return [device.text for device in a.devices] == [device.text for device in b.devices] and a.paths == b.paths


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

    def __init__(self, client, parent: QWidget | None = None) -> None:
        """client: this window's end of the session server."""
        super().__init__(parent)
        self.setWindowTitle("phd")
        self.client = client
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
            (self.centre.aimed, self.client.aim),
            (self.centre.left, self.client.let_go),
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

    # ------------------------------------------------------------------------------------------- what the server says

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
        self.device_shown &= snapshot.stage not in (m.RUNNING, m.FAILED)
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
        self.device.show_status(pulse.device)

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
        self.device_shown = shown and self.snapshot.stage not in (m.RUNNING, m.FAILED)
        self.device.leave()
        self._refresh()

    def show_time(self) -> None:
        """What only the clock changes: the countdown of a break."""
        self.cards.show_time(time.monotonic())

    def show_dead(self, sentence: str) -> None:
        """The session server has ended."""
        self.dead = True
        last = self.snapshot
        self.snapshot = m.Snapshot(
            m.FAILED, last.rows, blind=last.blind, notes=last.notes, said=sentence, said_bad=True
        )
        self.proof.show_dead()
        self.show_panels()
        if self.centre.workspace is not None and self.centre.workspace.view.tip is not None:
            self.centre.rest(self.centre.workspace.view.tip)
        self._refresh()

    def _refresh(self) -> None:
        """Everything that Opened and Snapshot say."""
        snapshot, opened = self.snapshot, self.opened
        over = snapshot.stage == m.FAILED
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
