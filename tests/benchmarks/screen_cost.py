"""What the windows cost: every layer on, ticks at 1 kHz, for a while in Qt's own event loop. Figures to report, never
to pass or fail. As a program it measures one case, for Qt takes its scale when it starts; `screen_bench` runs them all.
"""

import gc
import json
import math
import sys
import time
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from app.window.run.run_page import RunPage
from app.window.widgets import theme
from app.window.widgets.garbage import Collector
from app.window.widgets.page import RUN
from app.window.windows import Windows
from tests.benchmarks.synthetic_bench import SyntheticBench

WARM_UP_S = 1.0
SLICE_S = 1.0  # the share of a core is also given as the least one of slices so long: what else runs adds to it
LONG_MS = 50.0  # no frame in a trial should last longer
POINTER_MS = 8  # a mouse says 125 times a second where it is


class ScreenCost(NamedTuple):
    """Of one run. A frame lasts from asking the bench what is new until all is painted."""

    windows: str  # "main window", "both windows"
    width: int  # px, of each window
    height: int
    scale: float  # device px / px
    platform: str  # Qt's: "xcb", "offscreen" ..
    seconds: float
    frames_per_s: float
    core_share: float  # of one core, of this process with all its threads
    core_share_least: float  # in the least slice
    p50_ms: float
    p99_ms: float
    max_ms: float
    max_cpu_ms: float  # processor time of the frame with most of it: what the machine gave to others is not in it
    long_frames: int  # of more than LONG_MS


class FrameTimes(QObject):
    """How long each frame holds the event loop, from asking the bench until all is painted."""

    def __init__(self, windows: Windows, bench: SyntheticBench) -> None:
        super().__init__()
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []
        self._bench = bench
        self._painted = QTimer(self, singleShot=True, interval=0)  # Qt paints what is due first
        self._painted.timeout.connect(self._end)
        windows.framed.connect(lambda _: self._painted.start())

    def _end(self) -> None:
        self.wall_s.append(time.perf_counter() - self._bench.asked_s)
        self.cpu_s.append(time.thread_time() - self._bench.asked_cpu_s)


class Waver(QObject):
    """A pointer over the participant's view that is never still."""

    def __init__(self, windows: Windows) -> None:
        super().__init__()
        self._view, self._turn = windows.participant.view, 0
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._move)
        self._timer.start(POINTER_MS)

    def _move(self) -> None:
        self._turn += 1
        view, angle = self._view, 0.05 * self._turn
        place = QPointF(view.width() * (0.5 + 0.2 * math.cos(angle)), view.height() * (0.4 + 0.2 * math.sin(angle)))
        none = Qt.MouseButton.NoButton
        here = view.mapToGlobal(place)
        QApplication.sendEvent(
            view, QMouseEvent(QEvent.Type.MouseMove, place, here, none, none, Qt.KeyboardModifier.NoModifier)
        )


def measure(seconds: float, width: int, height: int, both: bool = False, device: str = "four-brake") -> ScreenCost:
    """Draw made-up trials for so long, in windows of this size (px); needs a QApplication. both: the participant's
    window too, with a moving pointer."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    bench = SyntheticBench(device)
    windows = Windows(bench)
    main, participant = windows.main, windows.participant
    main.resize(width, height)
    main.show_page(RUN)
    windows.show()
    windows.frame()
    run = main.page(RUN)
    assert isinstance(run, RunPage) and run.workspace is not None
    for button in run.workspace.buttons.values():
        button.setChecked(True)
    if both:
        participant.setGeometry(0, 0, width, height)
        participant.show()
    else:
        participant.hide()
    waver = Waver(windows) if both else None
    _run(application, WARM_UP_S)
    gc.collect()
    gc.freeze()  # as the app does
    times = FrameTimes(windows, bench)
    shares, began, began_cpu = [], time.perf_counter(), time.process_time()
    slices = max(round(seconds / SLICE_S), 1)
    for _ in range(slices):
        wall, cpu = time.perf_counter(), time.process_time()
        _run(application, seconds / slices)
        shares.append((time.process_time() - cpu) / (time.perf_counter() - wall))
    while not times.wall_s:  # a machine with much else to do
        _run(application, SLICE_S)
    elapsed, used = time.perf_counter() - began, time.process_time() - began_cpu
    gc.unfreeze()
    del waver
    ratio, size = main.devicePixelRatioF(), (main.width(), main.height())
    windows.close()
    for window in (main, participant):
        window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    wall, cpu = 1e3 * np.array(times.wall_s), 1e3 * np.array(times.cpu_s)
    p50, p99 = np.percentile(wall, (50, 99)).tolist()
    name = "both windows" if both else "main window"
    return ScreenCost(
        name, *size, ratio, application.platformName(), elapsed, len(wall) / elapsed,
        used / elapsed, min(shares), p50, p99, float(wall.max()), float(cpu.max()),
        int(np.count_nonzero(wall > LONG_MS)),
    )  # fmt: skip


def _run(application: QApplication, seconds: float) -> None:
    QTimer.singleShot(round(1e3 * seconds), lambda: application.exit(0))
    application.exec()


def main() -> None:
    """One case: seconds, width, height, 0 or 1 (both windows); a line of JSON on the standard output."""
    seconds, width, height, both = sys.argv[1:]
    application = QApplication(sys.argv[:1])
    Collector(application)
    theme.apply_theme(application)
    application.setQuitOnLastWindowClosed(False)
    print(json.dumps(measure(float(seconds), int(width), int(height), both == "1")._asdict()))


if __name__ == "__main__":
    main()
