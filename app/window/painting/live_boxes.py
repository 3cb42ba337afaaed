"""Box plots on the screen, growing trial by trial; the numbers are those of the figures for print."""

from collections.abc import Mapping, Sequence

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QFontMetricsF, QPainter
from PySide6.QtWidgets import QWidget

from app.window.painting import theme
from app.window.painting.panel import CENTRE, LEFT, RIGHT, Panel
from app.window.painting.strip import range_for
from app.window.painting.theme import font, pen, shade
from experiments.analysis.boxplots import Box, boxes
from experiments.analysis.metrics import Metric
from experiments.analysis.trials_table import TrialRow

#: short names of Table I's controllers; others stand under their boxes as the protocol names them
SHORT = {
    "SDOF with gap": "SDOF gap", "Proportional, high gain": "Prop. high", "Proportional, low gain": "Prop. low"
}  # fmt: skip
STEPS = {1.0: 0.2, 1.5: 0.5, 2.0: 0.5, 3.0: 1.0, 4.0: 1.0, 5.0: 1.0, 6.0: 2.0, 8.0: 2.0}  # of the scale, by its end
AXIS_PX, NAMES_PX, FOOT_PX = 34.0, 20.0, 18.0
BOX_MOST_PX, APART_PX = 26.0, 5.0


def colour_of(controller: int | str) -> str:
    """Table I's five colours, which begin again for further controllers; a code has none of its own."""
    if isinstance(controller, str):
        return theme.QUIET
    return theme.CONTROLLER[(controller - 1) % len(theme.CONTROLLER) + 1]


def ticks_to(end: float) -> list[float]:
    """Round values from 0 to the end of a range."""
    power = 1.0
    while end / power >= 10.0 * (1.0 - 1e-9):
        power *= 10.0
    while end / power < 1.0 - 1e-9:
        power /= 10.0
    step = power * STEPS.get(round(end / power, 6), 1.0)
    return [i * step for i in range(round(end / step) + 1)]


class LiveBoxes(Panel):
    """One measure: a group for each controller, a box for each configuration (the first filled, the second open).

    controllers: number -> the protocol's name of it.
    """

    def __init__(
        self,
        metric: Metric,
        configurations: Sequence[str],
        controllers: Mapping[int, str],
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(metric.title, parent)
        self._metric, self._configurations = metric, tuple(configurations)
        self._names = {number: SHORT.get(name, name) for number, name in controllers.items()}
        self.found: dict[tuple[int | str, str], Box] = {}
        self.controllers: tuple[int | str, ...] = tuple(self._names)
        self._end = 1.0
        self.setMinimumSize(240, 170)
        self.show_value("", metric.shown_unit)

    def show_rows(self, rows: Sequence[TrialRow]) -> None:
        """The boxes of these trials; codes of a blind session stand in place of controllers."""
        self.found = boxes(rows, self._metric.name, self._configurations, self._metric.scale)
        there = tuple(dict.fromkeys(controller for controller, _ in self.found))
        coded = tuple(controller for controller in there if controller not in self._names)
        self.controllers = coded if there and coded == there else (*self._names, *coded)
        highest = max((max(box.high, *box.outliers, box.q3) for box in self.found.values()), default=0.0)
        self._end = range_for(1.02 * highest, 1.0)
        self.repaint_still()

    @property
    def said(self) -> str:
        """What the boxes are, under them."""
        drawn = zip(("filled", "open", "third", "fourth"), self._configurations, strict=False)
        parts = [f"{how} {name}" for how, name in drawn]
        counts = {box.count for box in self.found.values()}
        if len(counts) == 1:
            parts.append(f"{min(counts)} trial{'s' if counts != {1} else ''} a box")
        elif counts:
            parts.append("number of trials under each box")
        return " · ".join(parts)

    def paint_still(self, painter: QPainter) -> None:
        inside = self.inside
        plot = inside.adjusted(AXIS_PX, 8.0, 0.0, -NAMES_PX - FOOT_PX)
        counted = len({box.count for box in self.found.values()}) > 1
        if counted:
            plot.setBottom(plot.bottom() - 14.0)
        each = plot.width() / len(self.controllers)
        painter.setFont(font(theme.SMALL))
        for value in ticks_to(self._end):
            y = round(self._y(plot, value)) + 0.5
            painter.setPen(pen(theme.LINE, 1.0))
            painter.drawLine(QPointF(plot.left(), y), QPointF(plot.right(), y))
            painter.setPen(shade(theme.QUIET))
            painter.drawText(QRectF(inside.left(), y - 8.0, AXIS_PX - 8.0, 16.0), RIGHT, f"{value:.6g}")
        for i, controller in enumerate(self.controllers):
            name = QRectF(plot.left() + i * each, inside.bottom() - FOOT_PX - NAMES_PX, each, NAMES_PX)
            painter.drawText(name, CENTRE, self._name(controller, each))
        said = painter.fontMetrics().elidedText(self.said, Qt.TextElideMode.ElideRight, int(inside.width()))
        painter.drawText(QRectF(inside.left(), inside.bottom() - FOOT_PX + 2.0, inside.width(), FOOT_PX), LEFT, said)
        count = len(self._configurations)
        width = min(0.8 * each / count - APART_PX, BOX_MOST_PX)
        for (controller, configuration), box in self.found.items():
            j = self._configurations.index(configuration)
            middle = plot.left() + (self.controllers.index(controller) + 0.5) * each
            x = middle + (j - 0.5 * (count - 1)) * (width + APART_PX)
            self._paint_box(painter, plot, box, x, width, colour_of(controller), j == 0)
            if counted:
                painter.setPen(shade(theme.QUIET))
                painter.drawText(QRectF(x - 15.0, plot.bottom() + 2.0, 30.0, 14.0), CENTRE, f"{box.count}")

    def _name(self, controller: int | str, room: float) -> str:
        name = self._names.get(controller, f"{controller}")
        return QFontMetricsF(font(theme.SMALL)).elidedText(name, Qt.TextElideMode.ElideRight, room)

    def _y(self, plot: QRectF, value: float) -> float:
        return plot.bottom() - plot.height() * value / self._end

    def _paint_box(
        self, painter: QPainter, plot: QRectF, box: Box, x: float, width: float, colour: str, filled: bool
    ) -> None:
        half = 0.5 * width
        if box.count == 1:  # its box would be a line, neither filled nor open
            painter.setPen(pen(colour, 1.4))
            painter.setBrush(shade(colour) if filled else shade(theme.PANEL))
            painter.drawRect(QRectF(x - 4.0, self._y(plot, box.median) - 4.0, 8.0, 8.0))
            return
        low, q1, median, q3, high = (self._y(plot, v) for v in (box.low, box.q1, box.median, box.q3, box.high))
        painter.setPen(pen(colour, 1.4))
        for inner, outer in ((q1, low), (q3, high)):
            painter.drawLine(QPointF(x, inner), QPointF(x, outer))
            painter.drawLine(QPointF(x - 0.5 * half, outer), QPointF(x + 0.5 * half, outer))
        painter.setBrush(shade(colour, 0.75 if filled else 0.12))
        painter.drawRoundedRect(QRectF(x - half, q3, width, max(q1 - q3, 1.0)), 1.5, 1.5)
        flat = q1 - q3 < 4.0  # one trial: a line in the controller's colour
        painter.setPen(pen(theme.HANDLE if filled and not flat else colour, 2.0))
        painter.drawLine(QPointF(x - half, median), QPointF(x + half, median))
        painter.setPen(pen(colour, 1.4))
        painter.setBrush(shade(theme.PANEL))
        for value in box.outliers:
            painter.drawEllipse(QPointF(x, self._y(plot, value)), 2.5, 2.5)
