"""From the pointer to the picture: how long it takes until a place that the pointer was moved to is in a tick of the
control loop, and until the participant's picture with that tick is painted. Over a whole live bench, with a trial that
runs and the main window beside it.

The pointer is moved from here, through the window system; the time counts from before that. On its way are noted: the
place in the memory that the loop reads, the tick that used it (by the loop's own clock, to within a tick), the end of
painting. As a program it measures one case (Qt takes its scale when it starts).
"""

import gc
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer
from PySide6.QtGui import QCursor
from PySide6.QtWidgets import QApplication

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.widgets import theme
from app.window.widgets.garbage import Collector
from app.window.windows import Windows
from core import tick_log

MOVE_MS = 61  # in no step with the frames, and so long that a late move is seen to its end
SAME_M = 1e-9
READY_S, TAKE_S = 120.0, 20.0  # longest waits: for the bench, for the pointer to have hold of the handle
FRAME_MS, TICK_MS = 1e3 / 60.0, 1.0
LIMIT_MS = 2.0 * FRAME_MS + TICK_MS  # what we hold to


class PointerLag(NamedTuple):
    """Of the moves of one run, ms."""

    platform: str
    width: int
    height: int
    moves: int  # of which the way was seen to its end
    lost: int  # overtaken by the next move, or by the trial's end
    aimed_p50_ms: float  # from the move until the place is where the loop reads it
    tick_p50_ms: float  # from there to the tick that used it
    drawn_p50_ms: float  # from there to the end of painting the participant's picture
    p50_ms: float  # all the way
    p95_ms: float
    max_ms: float
    limit_ms: float  # two frames and one tick
    within: float  # share of all moves within that: one that was lost is not


class Moves(QObject):
    """Moves the pointer round the middle of a view, and times each move on its way.

    newest_tick_s: when the loop made its newest tick, by time.perf_counter.
    """

    def __init__(self, windows: Windows, newest_tick_s: Callable[[], float]) -> None:
        super().__init__()
        self.aimed_s: list[float] = []  # each since the move
        self.tick_s: list[float] = []
        self.painted_s: list[float] = []
        self.lost = 0
        self.measuring = False
        self._view, self._newest_tick_s, self._turn = windows.participant.view, newest_tick_s, 0
        self._moved_s: float | None = None  # of the move that is on its way; none is
        self._aimed: tuple[float, float] | None = None
        self._view.pointer_moved.connect(self._aim)
        windows.framed.connect(self._frame)
        self._in_picture = False
        self._view.painted.connect(self._end)
        self._timer = QTimer(self, interval=MOVE_MS)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._move)
        self._timer.start()

    def _move(self) -> None:
        view = self._view
        if self._moved_s is not None and self.measuring:
            self.lost += 1
        place = view.to_screen(view.tip) if view.tip and not view.taken else self._round(view)
        self._aimed, self._in_picture = None, False
        self._moved_s = time.perf_counter()
        QCursor.setPos(view.mapToGlobal(place).toPoint())

    def _round(self, view) -> QPointF:
        """Some pixels on each time, round a place off the path: a hand that moves, and never holds still at a start."""
        self._turn += 1
        reach, angle = 0.06 * view.height(), 0.4 * self._turn
        middle = QPointF(0.35 * view.width(), 0.35 * view.height())
        return middle + QPointF(np.cos(angle), np.sin(angle)) * reach

    def _aim(self, x: float, y: float, _grip: float) -> None:
        if self._moved_s is not None and self._aimed is None:
            self._aimed, self._aimed_at_s = (x, y), time.perf_counter()

    def _frame(self, rows: np.ndarray) -> None:
        if self._aimed is None or not len(rows):
            return
        off = np.abs(rows[:, tick_log.TARGET_X : tick_log.TARGET_Y + 1] - self._aimed).max(axis=1)
        if off.min() < SAME_M:
            t = rows[:, tick_log.T]
            self._tick_at_s = self._newest_tick_s() - float(t[-1] - t[np.argmax(off < SAME_M)])
            self._in_picture = True

    def _end(self) -> None:
        if not self._in_picture:
            return
        if self._moved_s is not None and self.measuring:
            self.aimed_s.append(self._aimed_at_s - self._moved_s)
            self.tick_s.append(max(self._tick_at_s, self._aimed_at_s) - self._moved_s)
            self.painted_s.append(time.perf_counter() - self._moved_s)
        self._moved_s, self._aimed, self._in_picture = None, None, False


def measure(seconds: float, width: int, height: int) -> PointerLag | str:
    """With both windows, for so long; needs a QApplication. Else why it cannot be measured."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    with tempfile.TemporaryDirectory() as folder:
        bench = Client(Setup(Path(folder) / "data", "paper", None, None, None, None))
        windows = Windows(bench)
        main, participant = windows.main, windows.participant
        try:
            main.resize(width, height)
            windows.show()
            for stage, then in ((m.NO_SESSION, m.Open("01")), (m.READY, m.Start())):
                if refused := _until(application, lambda: main.snapshot.stage == stage, READY_S):  # noqa: B023
                    return f"the bench is not ready: {main.snapshot.notice or refused}"
                bench.send(then)
            participant.setGeometry(0, 0, width, height)
            participant.show()
            participant.raise_()
            control = bench.ring.control  # type: ignore[union-attr]  # it is ready
            moves = Moves(windows, lambda: 1e-9 * int(control.loop_beat))
            if _until(application, lambda: participant.view.taken, TAKE_S):
                return "the window system does not let the pointer be moved"
            gc.collect()
            gc.freeze()  # as the app does
            moves.measuring = True
            _run(application, seconds)
            moves.measuring = False
        finally:
            gc.unfreeze()
            windows.close()
            for window in (main, participant):
                window.deleteLater()
            QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    if not moves.painted_s:
        return "no move of the pointer came into a picture"
    aimed, ticked, painted = (1e3 * np.array(times) for times in (moves.aimed_s, moves.tick_s, moves.painted_s))
    parts = [float(np.median(part)) for part in (aimed, ticked - aimed, painted - ticked)]
    p50, p95 = np.percentile(painted, (50, 95)).tolist()
    return PointerLag(
        application.platformName(), width, height, len(painted), moves.lost, *parts, p50, p95, float(painted.max()),
        LIMIT_MS, float(np.count_nonzero(painted <= LIMIT_MS) / (len(painted) + moves.lost)),
    )  # fmt: skip


def _run(application: QApplication, seconds: float) -> None:
    QTimer.singleShot(round(1e3 * seconds), lambda: application.exit(0))
    application.exec()


def _until(application: QApplication, done: Callable[[], bool], longest_s: float) -> str:
    """Wait; "" or that it took too long."""
    deadline = time.perf_counter() + longest_s
    while not done():
        if time.perf_counter() > deadline:
            return f"nothing for {longest_s:.0f} s"
        _run(application, 0.05)
    return ""


def main() -> None:
    """One case: seconds, width, height; a line of JSON on the standard output."""
    seconds, width, height = sys.argv[1:]
    application = QApplication(sys.argv[:1])
    Collector(application)
    theme.apply_theme(application)
    application.setQuitOnLastWindowClosed(False)
    found = measure(float(seconds), int(width), int(height))
    print(json.dumps({"refused": found} if isinstance(found, str) else found._asdict()))


if __name__ == "__main__":
    main()
