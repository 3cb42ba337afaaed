"""A newcomer at Try: how long it takes, with the pointer alone, from the first window to a table of all controllers.

The whole app with its processes. The hand sees what a person sees (the large line and the handle) and does what the
page asks for; for each controller it leaves the canvas, clicks, comes back and touches the handle again. Clicking
itself takes no time here; a person needs a second or two for each.
`python -m tests.benchmarks.newcomer [PICTURE.png]` prints a line of JSON.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.sandbox.try_page import TryPage
from app.window.widgets import theme
from app.window.widgets.page import TRY
from app.window.windows import Windows

LONGEST_S = 180.0  # what we hold to
SPEED_M_S, STRETCH_M = 0.15, 0.03  # of the hand; it is at most so far ahead of the handle while that comes along
PUSH_M_S = 0.05  # it leans further out while the handle does not move
FRAME_S = 1.0 / 60.0


class Hand:
    """Moves the pointer over the canvas as the large line asks."""

    def __init__(self, page: TryPage) -> None:
        self._page, self._at = page, np.zeros(2)
        self._lean = 0.0

    def leave(self) -> None:
        """To the buttons."""
        QApplication.sendEvent(self._page.canvas, QEvent(QEvent.Type.Leave))

    def move(self, dt: float) -> None:
        """One frame on."""
        canvas, asked = self._page.canvas, self._page.large.text()
        if canvas.tip is None or not len(canvas.outline):
            return
        tip = np.array(canvas.tip)
        if not canvas.taken:
            self._at, self._lean = tip, 0.0
        goal = canvas.outline[-1] if asked == "Go" else canvas.outline[0]
        way = goal - tip
        far = float(np.hypot(*way))
        ahead = way / far * min(far, STRETCH_M) if far > 0.0 else way
        self._lean = 0.0 if asked == "Hold" or far < 0.002 else min(self._lean + PUSH_M_S * dt, 0.1)
        wanted = tip + ahead * (1.0 + self._lean / STRETCH_M) if asked != "Hold" else goal
        step = wanted - self._at
        self._at = self._at + step * min(1.0, SPEED_M_S * dt / max(float(np.hypot(*step)), 1e-9))
        self._point(canvas.to_screen(self._at.tolist()))

    def _point(self, place: QPointF) -> None:
        canvas, none = self._page.canvas, Qt.MouseButton.NoButton
        event = QMouseEvent(
            QEvent.Type.MouseMove, place, canvas.mapToGlobal(place), none, none, Qt.KeyboardModifier.NoModifier
        )
        QApplication.sendEvent(canvas, event)


def measure(picture: str = "") -> dict[str, object]:
    """All controllers of the paper, one pass each; needs a QApplication."""
    with tempfile.TemporaryDirectory() as folder:
        client = Client(Setup(Path(folder) / "data"))
        windows = Windows(client)
        began = time.perf_counter()
        try:
            windows.main.resize(1280, 720)
            windows.show()
            QTest.mouseClick(windows.main.tabs[TRY], Qt.MouseButton.LeftButton)
            page = windows.main.pages[TRY]
            assert isinstance(page, TryPage)
            _until(lambda: page.snapshot.sandbox is not None and page.snapshot.running is not None)
            ready, hand, used_s = time.perf_counter(), Hand(page), time.process_time()
            for done, guide in enumerate(list(page.controls.guides.values())):
                hand.leave()
                QTest.mouseClick(guide, Qt.MouseButton.LeftButton)
                _until(lambda done=done: page.table.rowCount() > done, hand)
            ended, used_s = time.perf_counter(), time.process_time() - used_s
            if picture:
                windows.main.grab().save(picture)
            table = page.table
            rows = [[table.item(row, column).text() for column in range(7)] for row in range(table.rowCount())]
            bars = [table.item(row, 3).data(Qt.ItemDataRole.UserRole) is not None for row in range(table.rowCount())]
        finally:
            windows.close()
    return {
        "until_try_s": round(ready - began, 1), "five_controllers_s": round(ended - ready, 1),
        "window_share_of_core": round(used_s / (ended - ready), 2), "table": rows,
        "within": ended - began < LONGEST_S and all(bars),
    }  # fmt: skip


def _until(done: Callable[[], bool], hand: Hand | None = None) -> None:
    deadline, last = time.perf_counter() + LONGEST_S, time.perf_counter()
    while not done():
        assert time.perf_counter() < deadline, f"not done in {LONGEST_S:.0f} s"
        QTest.qWait(round(1e3 * FRAME_S))
        now = time.perf_counter()
        if hand is not None:
            hand.move(min(now - last, 0.05))
        last = now


def main() -> None:
    application = QApplication(sys.argv[:1])
    theme.apply_theme(application)
    application.setQuitOnLastWindowClosed(False)
    print(json.dumps(measure(*sys.argv[1:])))


if __name__ == "__main__":
    main()
