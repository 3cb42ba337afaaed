"""The app: both windows on their screens, and 60 times a second what the session server has sent since."""

import gc
import math
import threading
import time
from functools import partial
from importlib import import_module

import numpy as np
from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QApplication

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.main_window import MainWindow
from app.window.picture_light import PictureLight
from app.window.second_screen import SecondScreen
from app.window.widgets import memory, palette, theme, words
from app.window.widgets.keys import bind
from app.window.widgets.work import BackgroundTask
from core import tick_log

FRAME_S = 1.0 / 60.0


class Windows(QObject):
    """Main window and participant's window, on one session server at a time."""

    framed = Signal(object)  # a frame is there, with these ticks (n, tick_log.WIDTH); it is painted next

    def __init__(self, client: Client) -> None:
        super().__init__()
        self.client = client
        self.main = MainWindow(client)
        self.participant = self.main.participant
        self.second_screen = SecondScreen(self.main, self.participant, self.main.cards.show_message)
        self.over, self._theme = False, ""  # theme: that was chosen and is not shown yet
        self._warm_up: BackgroundTask | None = None
        self._ending: threading.Thread | None = None  # ends a session server, after which the next is started
        self._next: tuple[Setup, object] = client.setup, None
        self.participant.installEventFilter(self)
        main, shown = self.main, self.participant
        main.participant_asked.connect(self.show_or_hide_participant)
        main.restart_asked.connect(self.restart)
        main.setting_changed.connect(self._follow_setting)
        main.closed.connect(self.close)
        shown.view.pointer_moved.connect(lambda *hand: self.client.ring.aim(*hand))
        shown.view.pointer_left.connect(lambda: self.client.ring.let_go())
        shown.questions.answered.connect(lambda values: main.send(m.Answers(dict(values))))
        for answered in (shown.questions.answered, shown.consent.answered):
            answered.connect(self._hand_back)
        shown.close_asked.connect(self._close_asked)
        bind(shown, self._keys_of_participant())
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        for changed in (application.screenAdded, application.screenRemoved):
            changed.connect(self._screens_changed)
        self._shown_s = math.inf  # time of the newest tick that was shown, in its trial
        #: trials whose ticks have begun to come, less those that the server has announced: -1, 0 or 1
        self._ticks_ahead = 0
        self._due_s = 0.0  # when the next frame is due
        self._light = PictureLight()
        self._snapshot: m.Snapshot | None = None  # the newest, as it came, while the light is on
        self._timer = QTimer(self, singleShot=True)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._on_time)

    def _keys_of_participant(self) -> dict:
        """The same keys; what leads to a question brings the main window to the front first."""
        main = self.main
        direct = {
            "start": self._start,
            "brakes on": main.allow_brakes,
            "pause": lambda: main.do("pause"),
            "participant": self.show_or_hide_participant,
        }
        asking = ("redo", "skip", "abort", "note")
        return direct | {name: partial(self._at_main, name) for name in asking}

    def _start(self) -> None:
        if not self.participant.start():
            self.main.do("start")

    def _at_main(self, action: str) -> None:
        if self.one_screen:
            self.participant.hide()
        self.main.activateWindow()
        self.main.raise_()
        self.main.do(action)

    def restart(self, setup: Setup | None, then: object = None) -> None:
        """End the session server and start another one, as `Page.setup_asked` says.

        The window goes on meanwhile: the old one may have something to keep.
        """
        setup = setup or self.client.setup._replace(participant="")
        if self._ending is None:
            if setup.data_dir != self.client.setup.data_dir:
                memory.remember(memory.DATA_FOLDER, str(setup.data_dir))  # the next start begins there
            self._next = setup, then
            self._ending = threading.Thread(target=self.client.stop, args=("another setup was chosen",))
            self._ending.start()
            self.main.show_snapshot(m.Snapshot(m.PREPARING))

    def _start_next(self) -> None:
        """Start the next session server: the old one has ended."""
        setup, then = self._next
        self.client, self._ending, self._shown_s = Client(setup), None, math.inf
        self.main.show_client(self.client, then)
        self.participant.show_snapshot(self.main.snapshot)

    # ------------------------------------------------------------------------------------------- screens

    @property
    def one_screen(self) -> bool:
        """Whether the participant has no screen of their own."""
        return self.second_screen.other() is None

    def _follow_setting(self, key: str) -> None:
        """Another theme was chosen, or another screen for the participant."""
        if key == memory.DARK_OR_LIGHT:
            self._theme = memory.remembered(key)
            self._change_theme()
        elif key == memory.SCREEN:
            self.participant.hide()
            if not self.one_screen:
                self._show_participant()

    def _change_theme(self) -> None:
        """Give all windows the chosen theme: half a second, for which a trial that counts is not made to wait."""
        now = self.main.snapshot
        if self._theme and (now.running is None or now.sandbox is not None):
            palette.choose(self._theme)
            self._theme = ""
            theme.colour_all()
            self._show_snapshot(now)

    def _screens_changed(self) -> None:
        QTimer.singleShot(0, self._follow_screens)  # once Qt has moved its windows

    def _follow_screens(self) -> None:
        """A screen was plugged in, or is gone: without one of their own the participant is asked in the main window."""
        if self.over or not self.main.isVisible():
            return
        if not self.one_screen:
            self._show_participant()
        elif self.participant.isVisible() and not self.participant.own_start:
            self.participant.hide()

    def show(self) -> None:
        """The main window; the participant's window at once where there is a second screen."""
        self.main.show()
        if not self.one_screen:
            self._show_participant()
        self._due_s = time.perf_counter()
        self._timer.start(0)

    def show_or_hide_participant(self) -> None:
        """F11: on the second screen, else over the main window until F11 is pressed again."""
        if self.participant.isVisible():
            self.participant.hide()
            self.main.activateWindow()
        else:
            self._show_participant()

    def _show_participant(self) -> None:
        alone = self.one_screen
        self.participant.own_start = alone
        self.participant.setAttribute(Qt.WidgetAttribute.WA_ShowWithoutActivating, not alone)
        self.second_screen.show()
        if alone:
            self.participant.activateWindow()
        self.participant.show_snapshot(self.main.snapshot)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The participant's window was given the keyboard, because it is new or was clicked."""
        if event.type() == QEvent.Type.WindowActivate and not self.participant.asks:
            QTimer.singleShot(0, self._hand_back)
        return super().eventFilter(watched, event)

    def _hand_back(self) -> None:
        """Where both windows are seen the keyboard is the experimenter's, whose cards are answered by Enter."""
        if self.participant.isVisible() and not self.one_screen and not self.over:
            self.main.activateWindow()

    # ------------------------------------------------------------------------------------------- frames

    def _on_time(self) -> None:
        """A frame, and the next one on the next sixtieth of a second: a timer knows whole milliseconds only."""
        late_s = time.perf_counter() - self._due_s
        self._due_s += FRAME_S * (1.0 + max(late_s, 0.0) // FRAME_S)
        self._timer.start(max(round(1e3 * (self._due_s - time.perf_counter())), 0))
        if self.main.snapshot.running is not None and self._light.take(late_s):
            self._snapshot = self._snapshot or self.main.snapshot
            self._show_snapshot(self._snapshot)
        elif self._snapshot is not None and not self._light.is_on:
            self._show_snapshot(self._snapshot)
            self._snapshot = None
        self.frame()

    def _show_snapshot(self, snapshot: m.Snapshot) -> None:
        """In both windows, with the light of the picture."""
        self.main.show_snapshot(self._light.over(snapshot))
        self.participant.show_snapshot(snapshot)

    def frame(self) -> None:
        """Take in what has come, and see whether the session server lives."""
        if self._ending is not None:
            if not self._ending.is_alive():
                self._start_next()
            return
        alive = self.client.alive  # asked first: what it sent before it died is still read
        messages = self.client.receive()
        rows = self.client.ticks()
        trials = by_trial(rows) if len(rows) else []
        if trials and self._goes_on(trials[0]) and self._ticks_ahead < 1:  # first: a message may be that it has ended
            self._show_ticks(trials.pop(0))
        for message in messages:
            begins = isinstance(message, m.Snapshot) and message.running not in (None, self.main.snapshot.running)
            match message:
                case m.Opened():
                    self.main.show_opened(message)
                    self.participant.show_opened(message)
                case m.Snapshot():
                    self._warm(message)
                    self._snapshot = message if self._light.is_on else None
                    self._show_snapshot(message)
                    self._change_theme()
                case m.Pulse():
                    self.main.show_pulse(message)
            if begins:
                self._ticks_ahead = max(self._ticks_ahead - 1, -1)
                if trials:
                    self._show_ticks(trials.pop(0))
        for ticks in trials:
            self._show_ticks(ticks)
        self.participant.show_time()
        self.participant.view.follow_pointer()
        self.main.show_time(time.perf_counter())
        if not alive and not self.main.dead:
            plan = self.main.opened.plan if self.main.opened is not None else ()
            self.main.show_dead(words.server_died(self.main.snapshot, plan))
            self.participant.show_dead()
        self.framed.emit(rows)
        QCoreApplication.sendPostedEvents(self.participant, QEvent.Type.UpdateRequest)  # first: the hand looks at it

    def _goes_on(self, rows: np.ndarray) -> bool:
        """Whether ticks are of the trial of those that were shown last."""
        return bool(rows[0, tick_log.T] > self._shown_s)

    def _show_ticks(self, rows: np.ndarray) -> None:
        """Ticks (n, tick_log.WIDTH) of one trial, n > 0."""
        if not self._goes_on(rows):
            self._ticks_ahead = min(self._ticks_ahead + 1, 1)
        taken, self._shown_s = self.client.taken, float(rows[-1, tick_log.T])
        self.participant.show_ticks(rows, taken)
        self.main.show_ticks(rows, taken)

    def _warm(self, snapshot: m.Snapshot) -> None:
        """Once the server is ready, which needs the processors more: load what the other pages need, beside.

        Kernels, plots and statistics take a second and a half to import.
        """
        if self._warm_up is None and snapshot.stage != m.PREPARING:
            self._warm_up = BackgroundTask(lambda _: gc.freeze())  # as `garbage.Collector` does
            self._warm_up.ask(import_module, "app.window.analyse.analyse_page")

    # ------------------------------------------------------------------------------------------- the end

    def _close_asked(self) -> None:
        if self.one_screen:
            self.participant.hide()
        self.main.close()

    def close(self, reason: str = "the window was closed") -> None:
        """End the session server, whatever it does, and both windows."""
        if self.over:
            return
        self.over = True
        self._timer.stop()
        self.participant.leaving = True
        self.participant.close()
        self.main.close_anyway()
        if self._ending is not None:  # it was asked to end already, and no other was started
            self._ending.join()
        else:
            self.client.stop(reason)


def by_trial(rows: np.ndarray) -> list[np.ndarray]:
    """Ticks (n, tick_log.WIDTH) of one trial after the other, trial by trial."""
    begin = np.flatnonzero(rows[1:, tick_log.T] <= rows[:-1, tick_log.T]) + 1
    return np.split(rows, begin) if len(begin) else [rows]
