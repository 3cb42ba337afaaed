"""The loop's lateness, tick by tick, on a logarithmic scale; its percentiles, missed ticks and scheduling in words."""

import numpy as np
from PySide6.QtCore import QRect, QRectF
from PySide6.QtGui import QFontMetricsF, QPainter, Qt
from PySide6.QtWidgets import QWidget

from app.ipc.messages import Timing
from app.window.painting import theme
from app.window.painting.panel import HEAD, LEFT, PAD, RIGHT, Panel
from app.window.painting.strip import Strip
from app.window.painting.theme import font, shade
from core import tick_log

LEAST_US, DECADES = 1.0, 4.0  # the scale: 1 us at the bottom, 100 us in the middle, 10 ms at the top
LATE_US, MISSED_US = 100.0, 1000.0  # from here on orange; red: a tick was missed
FOOT = 18.0  # px, for the scheduling
NOT_YET = "no trial yet"


def share_of(lateness_us: np.ndarray) -> np.ndarray:
    """Where a lateness (us) is on the scale, 0 to 1."""
    return np.clip(np.log10(np.maximum(lateness_us, LEAST_US)) / DECADES, 0.0, 1.0)


class Bars(Strip):
    """A bar for each bin, as high as its highest tick, in the colour of how late that is."""

    bin_px = 3.0

    def paint_series(
        self, painter: QPainter, x: list[float], low: np.ndarray, high: np.ndarray, falls: np.ndarray, colour: str
    ) -> None:
        width, bottom = max(self._step - max(round(self._ratio), 1), 1), self.y(0.0)
        late, missed = share_of(np.array([LATE_US, MISSED_US])).tolist()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        for place, value, top in zip(x, high.tolist(), self.y(high).tolist(), strict=True):
            level = colour if value < late else theme.CAUTION if value < missed else theme.BAD
            painter.fillRect(
                QRectF(round(place - 0.5 * self._step), round(top), width, max(round(bottom - top), 1)),
                shade(level),
            )


class TimingStrip(Panel):
    """Proof that the loop keeps its time."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Loop lateness", parent)
        self.strip = Bars([theme.GOOD])
        self.timing: Timing | None = None
        self.setMinimumHeight(88)

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, tick_log.WIDTH) of the running trial."""
        if self.strip.add(rows[:, tick_log.T], share_of(rows[:, tick_log.LATENESS_US])[None]):
            self.update(self.plot.toAlignedRect())

    def clear(self) -> None:
        """A new trial."""
        self.strip.clear()
        self.update()

    def show_timing(self, timing: Timing | None) -> None:
        """Percentiles, missed ticks, scheduling."""
        before, self.timing = (self.said, self.foot), timing
        if (self.said, self.foot) != before:
            self.update()

    @property
    def said(self) -> str:
        """The line beside the title."""
        if self.timing is None:
            return NOT_YET
        now = self.timing
        return f"p99 {now.p99_us:.0f} · max {now.max_us:.0f} µs · {now.missed} missed"

    @property
    def foot(self) -> str:
        """The line under the bars."""
        return f"p50 {self.timing.p50_us:.0f} µs · {self.timing.scheduling}" if self.timing is not None else ""

    @property
    def plot(self) -> QRectF:
        """Where the bars are, px."""
        return super().plot.adjusted(0.0, 0.0, 0.0, -FOOT)

    def _fit(self) -> None:
        plot = self.plot
        self.strip.fit(plot.width(), plot.height(), self.devicePixelRatioF())

    def paint_still(self, painter: QPainter) -> None:
        self._fit()
        painter.setFont(font(theme.SMALL))
        painter.setPen(shade(theme.QUIET))
        for share, says in ((1.0, "10 ms"), (0.5, "100 µs"), (0.0, "1 µs")):
            y = self.plot.y() + self.strip.y(share) / self.devicePixelRatioF()
            self.paint_scale(painter, y, says)

    def covers(self, dirty: QRect) -> bool:
        return self.plot.contains(QRectF(dirty))

    def paint_moving(self, painter: QPainter, dirty: QRect) -> None:
        plot = self.plot
        self._fit()
        painter.drawPixmap(plot, self.strip.pixmap, QRectF(self.strip.pixmap.rect()))
        foot = QRectF(PAD, plot.bottom() + 4.0, self.width() - 2.0 * PAD, FOOT)
        if self.timing is not None and dirty.intersects(foot.toAlignedRect()):
            painter.setFont(font(theme.SMALL))
            painter.setPen(shade(theme.QUIET))
            room = QFontMetricsF(painter.font()).elidedText(self.foot, Qt.TextElideMode.ElideRight, foot.width())
            painter.drawText(foot, LEFT, room)

    def _paint_value(self, painter: QPainter) -> None:
        painter.setFont(font(theme.SMALL))
        missed = self.timing is not None and self.timing.missed > 0
        painter.setPen(shade(theme.CAUTION if missed else theme.QUIET))
        painter.drawText(QRectF(PAD, 2.0, self.width() - 2.0 * PAD, HEAD - 2.0), RIGHT, self.said)
