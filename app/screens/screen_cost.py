"""What the windows cost: every layer on, ticks at 1 kHz, for a while in Qt's own event loop. Figures to report, never
to pass or fail. As a program it measures one case, for Qt takes its scale when it starts; `screen_bench` runs them all.
"""

import gc
import json
import sys
import time
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QAbstractEventDispatcher, QEvent, QObject, QPointF, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from app.screens import theme
from app.screens.layers import compile_kernels
from app.screens.synthetic_bench import SyntheticBench
from app.screens.windows import Windows

WARM_UP_S = 1.0
SLICE_S = 2.0  # the share of a core is given as the least and the middle one of slices so long
POINTER_MS = 8  # a mouse says 125 times a second where it is


class ScreenCost(NamedTuple):
    """Of one run. A frame is the time from when the window wakes for it until all is painted."""

    windows: str  # "console", "console and participant"
    width: int  # px, of each window
    height: int
    scale: float  # device px / px
    platform: str  # Qt's: "xcb", "offscreen" ..
    seconds: float
    frames_per_s: float
    core_share: float  # of one core, of this process: the least slice
    core_share_middle: float  # the median slice
    p50_ms: float
    p99_ms: float
    max_ms: float
    max_cpu_ms: float  # the same frame's processor time: what the machine gave to others is not in it


class BusySpans(QObject):
    """How long the event loop was busy, each time that it woke for a frame."""

    def __init__(self, windows: Windows) -> None:
        super().__init__()
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []
        self._woke, self._cpu, self._framed = time.perf_counter(), time.thread_time(), False
        windows.framed.connect(self._frame)
        self._dispatcher = QAbstractEventDispatcher.instance()
        self._dispatcher.awake.connect(self._awake)
        self._dispatcher.aboutToBlock.connect(self._block)

    def close(self) -> None:
        """Measure no more."""
        self._dispatcher.awake.disconnect(self._awake)
        self._dispatcher.aboutToBlock.disconnect(self._block)

    def _awake(self) -> None:
        self._woke, self._cpu = time.perf_counter(), time.thread_time()

    def _frame(self) -> None:
        self._framed = True

    def _block(self) -> None:
        if self._framed:
            self.wall_s.append(time.perf_counter() - self._woke)
            self.cpu_s.append(time.thread_time() - self._cpu)
            self._framed = False


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
        place = QPointF(view.width() * (0.5 + 0.2 * np.cos(angle)), view.height() * (0.4 + 0.2 * np.sin(angle)))
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
    compile_kernels(bench.opened.devices[0])
    windows = Windows(bench)
    console, participant = windows.console, windows.participant
    console.resize(width, height)
    windows.show()
    windows.frame()
    assert console.centre.workspace is not None
    for button in console.centre.workspace.buttons.values():
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
    spans = BusySpans(windows)
    shares, began = [], time.perf_counter()
    for _ in range(max(round(seconds / SLICE_S), 1)):
        wall, cpu = time.perf_counter(), time.process_time()
        _run(application, min(SLICE_S, seconds))
        shares.append((time.process_time() - cpu) / (time.perf_counter() - wall))
    elapsed = time.perf_counter() - began
    spans.close()
    gc.unfreeze()
    del waver
    ratio, size = console.devicePixelRatioF(), (console.width(), console.height())
    windows.close()
    for window in (console, participant):
        window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    wall, cpu = 1e3 * np.array(spans.wall_s), 1e3 * np.array(spans.cpu_s)
    p50, p99 = np.percentile(wall, (50, 99)).tolist()
    name = "console and participant" if both else "console"
    return ScreenCost(
        name, *size, ratio, application.platformName(), elapsed, len(wall) / elapsed,
        min(shares), float(np.median(shares)), p50, p99, float(wall.max()), float(cpu.max()),
    )  # fmt: skip


def _run(application: QApplication, seconds: float) -> None:
    QTimer.singleShot(round(1e3 * seconds), application.quit)
    application.exec()


def main() -> None:
    """One case: seconds, width, height, 0 or 1 (both windows); a line of JSON on the standard output."""
    seconds, width, height, both = sys.argv[1:]
    application = QApplication(sys.argv[:1])
    theme.dress(application)
    application.setQuitOnLastWindowClosed(False)
    print(json.dumps(measure(float(seconds), int(width), int(height), both == "1")._asdict()))


if __name__ == "__main__":
    main()
