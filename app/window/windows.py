"""The app: both windows on their screens, and 60 times a second what the session server has said since."""

import gc
import signal
import sys
import threading
import time

import numpy as np
from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication, QScreen
from PySide6.QtWidgets import QApplication

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import PREPARING, RUNNING
from app.ipc.process import spare_scipy
from app.window import words
from app.window.console_window import LARGEST, ConsoleWindow
from app.window.keys import bind
from app.window.painting import theme
from app.window.painting.layers import needles
from app.window.painting.linkage_view import Workspace
from app.window.painting.theme import show_whole
from app.window.participant_window import ParticipantWindow
from core import tick_log
from core.device import Device
from core.path import Segment, build_path, line, outline

LOOK_MS = 100
#: Where the session server takes longer than this its kernels are being compiled, and ours must be too. Our choice.
FIRST_USE_S = 3.0


class WarmUp(QObject):
    """Waits until the server is ready (it needs the processors more), or until it is clear that this takes long."""

    def __init__(self, console: ConsoleWindow) -> None:
        super().__init__()
        self._console, self._since_s = console, time.monotonic()
        self.beside: threading.Thread | None = None
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(LOOK_MS)

    def _look(self) -> None:
        console = self._console
        if console.opened is None:
            return
        if self.beside is not None:
            if not self.beside.is_alive():
                self._timer.stop()
                if console.snapshot.stage != RUNNING:
                    paint_once(console)
        elif console.snapshot.stage != PREPARING or time.monotonic() > self._since_s + FIRST_USE_S:
            device = console.opened.devices[0]
            self.beside = threading.Thread(target=prepare_drawing, args=(device,), name="warm-up")
            self.beside.start()

    def close(self) -> None:
        """Nothing is begun any more; wait for what was."""
        self._timer.stop()
        if self.beside is not None:
            self.beside.join()


def prepare_drawing(device: Device) -> None:
    """All of it; about two seconds."""
    needles(line((-0.1, 0.4), (0.1, 0.4)), 1.0, device, (-0.05, 0.35), (0.05, 0.4), 0.02)  # loads the path's kernels
    import app.window.results_window  # noqa: F401  (its statistics take a second and a half)

    gc.collect()
    gc.freeze()  # else looking through all that was imported holds a frame for 50 ms now and then


def paint_once(console: ConsoleWindow) -> None:
    """A picture of the desk, and of a workspace in which a trial begins, with every layer; thrown away."""
    opened, desk = console.opened, console.desk
    assert opened is not None
    if not desk.isVisible():
        desk.resize(console.pages.size())
        desk.grab()
    workspace = Workspace(opened.devices, opened.paths)
    for button in workspace.buttons.values():
        button.setChecked(True)
    path = next(iter(opened.paths.values()))
    x0, y0, x1, y1 = build_path(path, "path")[1:5]
    tip = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    workspace.show_trial(opened.devices[0], path, tip)
    tick = np.zeros((1, tick_log.WIDTH))
    tick[0, [tick_log.PHASE, tick_log.TIP_X, tick_log.TIP_Y, tick_log.TIP_VX, tick_log.HAND_FX]] = (
        tick_log.MOVE,
        *tip,
        0.1,
        2.0,
    )
    workspace.add(tick)
    workspace.resize(desk.size())
    workspace.grab()
    workspace.deleteLater()


FRAME_S = 1.0 / 60.0
HAND_BACK_S = 2.0  # after the participant's window was shown beside the console


class Windows(QObject):
    """Console and participant's window on one session server."""

    framed = Signal(object)  # a frame is there, with these ticks (n, row.WIDTH); it is painted next

    def __init__(self, client) -> None:
        super().__init__()
        self.client = client
        self.console = ConsoleWindow(client)
        self.participant = ParticipantWindow()
        self._dead = self._over = False
        self._hand_back_until_s = 0.0
        self.participant.installEventFilter(self)
        console, shown = self.console, self.participant
        console.participant_asked.connect(self.show_or_hide_participant)
        console.closed.connect(self.close)
        shown.aimed.connect(client.aim)
        shown.left.connect(client.let_go)
        shown.answered.connect(console.commands.answer)
        shown.close_asked.connect(self._close_asked)
        bind(shown, self._keys_of_participant())
        self._due_s = 0.0  # when the next frame is due
        self._timer = QTimer(self, singleShot=True)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._on_time)

    def _keys_of_participant(self) -> dict:
        """The same keys; what leads to a question brings the console to the front first."""
        do = self.console.commands
        return {
            "start": do.start,
            "escape": self._escape_on_participant,
            "allow brakes": do.allow_brakes,
            "pause": do.pause,
            "participant": self.show_or_hide_participant,
            "redo": lambda: self._at_console(do.redo),
            "skip": lambda: self._at_console(do.skip),
            "abort": lambda: self._at_console(do.abort),
            "note": lambda: self._at_console(do.write_note),
            "results": lambda: self._at_console(do.results),
        }

    def _escape_on_participant(self) -> None:
        tried = self.console.trying
        self.console.commands.escape("Esc on the participant's screen")
        if tried and not self.console.trying:
            self.participant.leave_practice()
            if self.one_screen:
                self.show_or_hide_participant()

    def _at_console(self, do) -> None:
        if self.one_screen:
            self.participant.hide()
        self.console.activateWindow()
        self.console.raise_()
        do()

    # ------------------------------------------------------------------------------------------- screens

    @property
    def one_screen(self) -> bool:
        """Whether the participant has no screen of their own."""
        return self._other_screen() is None

    def _other_screen(self) -> QScreen | None:
        mine = self.console.screen()
        return next((screen for screen in QGuiApplication.screens() if screen != mine), None)

    def show(self) -> None:
        """The console; the participant's window at once where there is a second screen."""
        self.console.show()
        if not self.one_screen:
            self._show_participant()
        self._due_s = time.monotonic()
        self._timer.start(0)

    def show_or_hide_participant(self) -> None:
        """F11: on the second screen, else over the console until F11 is pressed again."""
        if self.participant.isVisible():
            self.participant.hide()
            self.console.activateWindow()
        else:
            self._show_participant()
        self.console.participant_answers = self.participant.isVisible()
        self.console.show_snapshot(self.console.snapshot)

    def _show_participant(self) -> None:
        other = self._other_screen()
        self.participant.own_start = other is None
        self.participant.setAttribute(Qt.WidgetAttribute.WA_ShowWithoutActivating, other is not None)
        self.participant.setGeometry((other or self.console.screen()).geometry())
        self.participant.showFullScreen()
        if other is None:
            self.participant.activateWindow()
        else:
            self._hand_back_until_s = time.monotonic() + HAND_BACK_S
        if not self.console.trying:
            self.participant.leave_practice()
        self.participant.show_snapshot(self.console.snapshot)
        self.console.participant_answers = True

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Where both windows are seen the keyboard is the experimenter's: some window systems give it to the newest."""
        if event.type() == QEvent.Type.WindowActivate and time.monotonic() < self._hand_back_until_s:
            QTimer.singleShot(0, self.console.activateWindow)
        return super().eventFilter(watched, event)

    # ------------------------------------------------------------------------------------------- frames

    def _on_time(self) -> None:
        """A frame, and the next one on the next sixtieth of a second: a timer knows whole milliseconds only."""
        late_s = time.monotonic() - self._due_s
        self._due_s += FRAME_S * (1.0 + max(late_s, 0.0) // FRAME_S)
        self._timer.start(max(round(1e3 * (self._due_s - time.monotonic())), 0))
        self.frame()

    def frame(self) -> None:
        """Take in what has come, and see whether the session server lives."""
        alive = self.client.alive  # asked first: what it said before it died is still read
        for message in self.client.receive():
            match message:
                case m.Opened():
                    self.console.show_opened(message)
                    self.participant.show_opened(message)
                case m.Snapshot():
                    self.console.show_snapshot(message)
                    self.participant.show_snapshot(message)
                case m.Pulse():
                    self.console.show_pulse(message)
        rows = self.client.ticks()
        if len(rows):
            taken = self.client.taken
            if self.participant.isVisible():
                self.participant.show_ticks(rows, taken)
            self.console.show_ticks(rows, taken)
        self.participant.view.follow_pointer()
        self.console.show_time()
        if not alive and not self._dead:
            self._dead = True
            said = self.console.snapshot
            self.console.show_dead(said.said if said.said_bad and said.said else words.SERVER_DIED)
            self.participant.show_dead()
        self.framed.emit(rows)
        QCoreApplication.sendPostedEvents(self.participant, QEvent.Type.UpdateRequest)  # first: the hand looks at it

    # ------------------------------------------------------------------------------------------- the end

    def _close_asked(self) -> None:
        if self.one_screen:
            self.participant.hide()
        self.console.close()

    def close(self, reason: str = "the window was closed") -> None:
        """End the session server, whatever it does, and both windows."""
        if self._over:
            return
        self._over = True
        self._timer.stop()
        self.console.commands.close_results()
        self.participant.leaving = True
        self.participant.close()
        self.console.close_anyway()
        self.client.stop(reason)


def make_ready() -> QApplication:
    """What need not wait for the server: the application, and a first kernel, which loads most of the compiler."""
    spare_scipy()
    outline(Segment((0.0, 0.0), (0.0, 0.1)), 0.1)
    application = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(application, QApplication)
    theme.dress(application)
    application.setQuitOnLastWindowClosed(False)
    return application


def run(client: Client) -> int:
    """Open the app, which has been made ready, on a session server and stay until it closes; the exit code."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    code = 0
    try:
        windows = Windows(client)
        windows.console.closed.connect(application.quit)

        def leave(number: int, _frame: object) -> None:
            nonlocal code
            code = 128 + number
            windows.close("the program was interrupted")
            application.quit()

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, leave)
        show_whole(windows.console, *LARGEST)
        windows.show()
        warm_up = WarmUp(windows.console)
        application.exec()
    except BaseException:
        client.stop("the window failed")
        raise
    windows.close()
    warm_up.close()
    return code
