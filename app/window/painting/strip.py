"""The last seconds of some series as a picture that scrolls: each frame paints only the columns that are new.

One bin a device pixel (or a few, for bars), from the lowest to the highest of its ticks, so a spike of one tick is
never lost. Times are in s, rising; a range stays until it must grow.
"""

import math
from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRect, QRectF
from PySide6.QtGui import QPainter, QPixmap, QPolygonF

from app.window.painting import theme
from app.window.painting.layers import by_bin
from app.window.painting.theme import pen, shade

WINDOW_S = 6.0
LINE_PX = 1.3
LEAST_RISE_PX = 1.0  # device px
LEAST_NEW_PX = 2.0  # fewer wait for the next frame: a strip is painted about twenty-five times a second
PADDING = 0.04  # of the range, above and below: a line at its end is not cut
STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def range_for(value: float, least: float) -> float:
    """The end of a range from 0 that holds a value: `least`, or a round number above it."""
    if not value > least:
        return least
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in STEPS if step * decade >= value * (1.0 - 1e-12))


class Strip:
    """Some series (one colour each) over the last seconds, 0 at the bottom, `end` near the top."""

    bin_px = 0.0  # how wide a bin is; 0: one device pixel

    def __init__(self, colours: Sequence[str], end: float = 1.0, seconds: float = WINDOW_S) -> None:
        self.colours, self.end, self._seconds = tuple(colours), end, seconds
        self._t, self._values = np.empty(16_384), np.empty((len(self.colours), 16_384))
        self._count = 0
        self._size, self._ratio = (1, 1), 1.0  # device px; device px / px
        self._step, self._bins = 1, 1  # device px of a bin; how many there are
        self._next = 0  # the bin that is drawn next
        self.pixmap = QPixmap(1, 1)

    # what to show

    def fit(self, width: float, height: float, ratio: float) -> None:
        """The room for the picture, px, and device pixels in one."""
        size = max(int(width * ratio), 1), max(int(height * ratio), 1)
        if (size, ratio) != (self._size, self._ratio) or self.pixmap.width() != size[0]:
            self._size, self._ratio = size, ratio
            self._step = max(round(self.bin_px * ratio), 1)
            self._bins = -(-size[0] // self._step)
            self.redraw()

    def set_range(self, end: float) -> None:
        """Show values from 0 to `end`."""
        self.end = end
        self.redraw()

    def clear(self) -> None:
        """Nothing to show yet."""
        self._count = 0
        self.redraw()

    def add(self, t: np.ndarray, values: np.ndarray) -> bool:
        """Ticks: times (n,) after all before, values (series, n), NaN where there is none; whether it looks new."""
        n = len(t)
        if not n:
            return False
        if self._count + n > len(self._t):
            self._forget(n)
        if not self._count:
            self._next = self._bin(float(t[0]))
        self._t[self._count : self._count + n] = t
        self._values[:, self._count : self._count + n] = values
        self._count += n
        now = self._bin(float(t[-1]))
        if (now - self._next) * self._step < LEAST_NEW_PX * self._ratio:
            return False
        self._scroll(self._next, now)
        self._next = now
        return True

    def redraw(self) -> None:
        """Everything anew: another size or range."""
        self.pixmap = QPixmap(*self._size)
        self._next = self._bin(float(self._t[self._count - 1])) if self._count else 0
        self._paint(self._next - self._bins, self._next)

    # bins

    def _bin(self, t: float) -> int:
        return math.floor(t * self._bins / self._seconds + 1e-9)

    def _forget(self, n: int) -> None:
        """Make room for n ticks: those out of the window are dropped."""
        t = self._t[: self._count]
        old = int(np.searchsorted(t, t[-1] - 1.1 * self._seconds)) if self._count else 0
        kept, values = t[old:].copy(), self._values[:, old : self._count].copy()
        if 2 * (len(kept) + n) > len(self._t):
            self._t, self._values = (np.empty((*a.shape[:-1], 4 * (len(kept) + n))) for a in (self._t, self._values))
        self._count = len(kept)
        self._t[: self._count], self._values[:, : self._count] = kept, values

    def _scroll(self, first: int, last: int) -> None:
        shift = min(last - first, self._bins)
        if shift < self._bins:
            self.pixmap.scroll(-shift * self._step, 0, QRect(0, 0, *self._size))
        self._paint(last - shift, last)

    # painting, in device pixels

    def y(self, value):
        """Where a value, or an array of them, is in the picture, device px from its top."""
        room = self._size[1] / (1.0 + 2.0 * PADDING)
        return room * (1.0 + PADDING - value / self.end)

    def _paint(self, first: int, last: int) -> None:
        """The columns of the bins first .. last - 1, at the right edge; and the few before that their lines reach."""
        width, height = self._size
        first -= 1 + math.ceil(LINE_PX * self._ratio / self._step)
        x0 = width - (last - first) * self._step
        painter = QPainter(self.pixmap)
        painter.fillRect(x0, 0, width - x0, height, shade(theme.PANEL))
        painter.setPen(pen(theme.LINE, max(1.0, math.floor(self._ratio))))
        for share in (0.0, 0.5, 1.0):
            y = math.floor(self.y(share * self.end)) + 0.5
            painter.drawLine(QLineF(x0, y, width, y))
        if self._count:
            self._paint_columns(painter, first, last, x0 - first * self._step)
        painter.end()

    def _paint_columns(self, painter: QPainter, first: int, last: int, x0: int) -> None:
        """The series over the bins first .. last - 1; bin b begins at the pixel x0 + b step."""
        t = self._t[: self._count]
        rate = self._bins / self._seconds
        begin, end = np.searchsorted(t, ((first - 2) / rate - 1e-9, last / rate - 1e-9)).tolist()
        if begin >= end:
            return
        bins, shape = np.empty(end - begin), (len(self.colours), end - begin)
        low, high, falls = np.empty(shape), np.empty(shape), np.empty(shape, dtype=bool)
        count = by_bin(self._t, self._values, begin, end, rate, bins, low, high, falls)
        x = (x0 + (0.5 + bins[:count]) * self._step).tolist()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setClipRect(QRectF(x0 + first * self._step, 0, self._size[0] + self._step, self._size[1]))
        for i, colour in enumerate(self.colours):
            self.paint_series(painter, x, low[i, :count], high[i, :count], falls[i, :count], colour)

    def paint_series(
        self, painter: QPainter, x: list[float], low: np.ndarray, high: np.ndarray, falls: np.ndarray, colour: str
    ) -> None:
        """One series: from the lowest to the highest tick of each column at x, the other way where it falls."""
        painter.setPen(pen(colour, LINE_PX * self._ratio))
        run: list[QPointF] = []
        bottom, top = self.y(low).tolist(), self.y(high).tolist()
        for place, a, b, fall in zip(x, bottom, top, falls.tolist(), strict=True):
            if a != a:  # NaN: the line is interrupted
                painter.drawPolyline(QPolygonF(run))
                run = []
                continue
            if a - b < LEAST_RISE_PX:  # up and down in so little room would only thicken the line
                run.append(QPointF(place, 0.5 * (a + b)))
                continue
            run.append(QPointF(place, b if fall else a))
            run.append(QPointF(place, a if fall else b))
        painter.drawPolyline(QPolygonF(run))
