"""Live traces: path error and hand force over the last seconds of the trial.

pyqtgraph with what keeps it cheap: `setData` only, pen width 1, fixed ranges that step up when they must, lowest and
highest value of each message instead of every tick, no live grid.
"""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from app import theme

WINDOW_S = 10.0  # shown
PADDING = 0.04  # of the range, above and below
RANGES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)  # times a power of ten: where a range can end


def range_for(value: float, least: float) -> float:
    """The end of a round range that holds `value`, at least `least`."""
    if value <= least:
        return least
    power = 10.0 ** np.floor(np.log10(value))
    return float(next((step * power for step in RANGES if step * power >= value), 10.0 * power))


class Trace(QFrame):
    """One quantity over time, with its name, its newest value and the end of its range."""

    def __init__(self, title: str, unit: str, colour: str, least: float, parent: QWidget | None = None) -> None:
        """least: the end of the range at first, in `unit`."""
        super().__init__(parent, objectName="panel")
        self._unit, self._least = unit, least
        self._range = least
        self._times: list[float] = []
        self._values: list[float] = []
        name, self._value = QLabel(title), QLabel("")
        name.setFont(theme.font(theme.NORMAL, bold=True))
        self._value.setFont(theme.font(theme.NORMAL, bold=True))
        head = QHBoxLayout()
        head.addWidget(name)
        head.addStretch(1)
        head.addWidget(self._value)
        self._plot = _Plot(colour)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(12, 8, 12, 8)
        layout.setSpacing(2)
        layout.addLayout(head)
        layout.addWidget(self._plot, 1)
        self.clear()

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        """The ticks of one message: times (n,) s, values (n,) in the unit."""
        if not len(t):
            return
        first, last = sorted((int(np.argmin(values)), int(np.argmax(values))))
        for i in dict.fromkeys((first, last)):
            self._times.append(float(t[i]))
            self._values.append(float(values[i]))
        old = next(i for i, time in enumerate(self._times) if time >= self._times[-1] - WINDOW_S)
        del self._times[:old], self._values[:old]
        self._value.setText(f"{values[-1]:.1f} {self._unit}")
        if (wanted := range_for(float(np.max(values)), self._least)) > self._range:
            self._range = wanted
            self._plot.set_range(wanted)
        now = self._times[-1]
        self._plot.curve.setData(np.array(self._times) - now, np.array(self._values))

    def clear(self) -> None:
        """A new trial: nothing to show yet."""
        self._times, self._values, self._range = [], [], self._least
        self._value.setText(f"– {self._unit}")
        self._plot.set_range(self._least)
        self._plot.curve.setData([], [])

    @property
    def newest(self) -> float | None:
        """The last value shown."""
        return self._values[-1] if self._values else None


class _Plot(pg.PlotWidget):
    """The curve over three still lines: the end of the range, its half, zero."""

    def __init__(self, colour: str) -> None:
        super().__init__(background=None)
        self.end = 1.0
        self.hideAxis("left")
        self.hideAxis("bottom")
        self.hideButtons()
        self.setMenuEnabled(False)
        self.setMouseEnabled(False, False)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setStyleSheet("background: transparent")
        self.setMinimumHeight(48)
        self.getPlotItem().setContentsMargins(0, 0, 0, 0)
        self.setXRange(-WINDOW_S, 0.0, padding=0.0)
        self.curve = self.plot(pen=pg.mkPen(colour, width=1))

    def set_range(self, end: float) -> None:
        """Show values from 0 to `end`."""
        self.end = end
        self.setYRange(0.0, end, padding=PADDING)
        self.resetCachedContent()
        self.viewport().update()

    def drawBackground(self, painter: QPainter, rect: QRectF) -> None:
        """The still lines; painted once for each size and range."""
        super().drawBackground(painter, rect)
        painter.save()
        painter.resetTransform()
        painter.setFont(theme.font(theme.SMALL))
        for share in (0.0, 0.5, 1.0):
            y = round(self.height() * (1.0 + PADDING - share) / (1.0 + 2.0 * PADDING)) - 0.5
            painter.setPen(theme.colour(theme.LINE))
            painter.drawLine(QPointF(0.0, y), QPointF(float(self.width()), y))
        painter.setPen(theme.colour(theme.QUIET))
        painter.drawText(QPointF(0.0, y + 13.0), f"{self.end:g}")
        painter.restore()
