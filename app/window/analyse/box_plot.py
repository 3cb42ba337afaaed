"""The charts of results on screen, with each trial as a point that can be read and opened."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QPointF, Qt, Signal
from PySide6.QtGui import QBrush, QPen

from app.window.widgets import theme
from app.window.widgets.parts import OneLine
from app.window.widgets.plots import Plot, line
from app.window.widgets.theme import COLOURS, colour_at, shade
from experiments.analysis.charts import Chart, Point
from experiments.analysis.trials_table import TrialRow

POINT_PX, RING_PX, CROSS_PX = 6, 15, 11
SYMBOLS = "o", "t1", "s", "d", "t"  # of the points of the first path, the second, ..; as in print
SHAPES = "○△□◇▽"  # their pictures
APART_PX = 3.0  # between two names along an axis
FOOT = 0.1  # of the scale, under it: the name of its low end is seen in a low plot, too
TICKS = 3  # names along the axis of values, at least
#: digits of the names of a logarithmic axis: as few as give that many names
DIGITS = (1.0,), (1.0, 2.0, 5.0), tuple(map(float, range(1, 10))), tuple(0.1 * n for n in range(10, 100))
BAND = 0.08  # of the plot's height, above the scale: crosses of trials whose time was up


def body_brush(look: int, colour: str) -> QBrush:
    """The body of a box, as `charts.LOOKS`."""
    style = Qt.BrushStyle
    looks = (0.4, style.SolidPattern), (0.06, style.SolidPattern), (0.7, style.BDiagPattern), (0.7, style.Dense6Pattern)
    alpha, pattern = looks[look]
    return QBrush(shade(colour, alpha), pattern)


class ChartPlot(Plot):
    """One chart. A click on a point emits `chosen` with its trial; a double click zooms out."""

    chosen = Signal(object)  # a TrialRow

    def __init__(self) -> None:
        super().__init__(OneLine("", "", theme.NORMAL, bold=True))
        self.chart = Chart("", "", "", (), "", (0.0, 1.0), ())  # nothing
        self._ringed: tuple[str, int] | None = None  # participant, run
        self.head.setStretch(0, 3)
        self.head.setStretch(1, 2)
        self.points, self.crosses = (pg.ScatterPlotItem(hoverable=True, tip=self._tip) for _ in range(2))
        self.ring = pg.ScatterPlotItem(size=RING_PX, brush=None)
        for marks in (self.points, self.crosses):
            marks.sigClicked.connect(self._clicked)
        for follow in (self._place_crosses, self._name_values):
            self.item.vb.sigYRangeChanged.connect(follow)
        for changed in (self.item.vb.sigXRangeChanged, self.item.vb.sigResized):
            changed.connect(self.name_ticks)
        self.item.showGrid(y=True, alpha=0.6)
        self.setMinimumSize(180, 150)

    def show_chart(self, chart: Chart) -> None:
        """Another chart, or the same with other trials."""
        self.chart = chart
        self.title.setText(chart.title)
        self.figures.show_parts((chart.scale, COLOURS.quiet))
        self.item.clear()
        if chart.boxes:
            self._add_boxes()
        if chart.curve:
            x, y = np.array(chart.curve).T
            self.item.addItem(pg.PlotCurveItem(x, self._scaled(y), pen=line(COLOURS.handle)))
        self.points.setData([self._spot(point) for point in (*chart.points, *chart.others) if self._fits(point)])
        for marks in (self.points, self.crosses, self.ring):
            self.item.addItem(marks)
        bottom = self.item.getAxis("bottom")
        bottom.setLabel(chart.x_title or None)
        bottom.showLabel(bool(chart.x_title))
        self.name_ticks()
        self.show_all()
        self.show_ring(self._ringed)

    def name_ticks(self, *_: object) -> None:
        """The names along the axis, as far as they do not lie on another or reach over the edge, and room for them."""
        axis, ends = self.item.getAxis("bottom"), dict[int, float]()  # of each line of the names so far, px
        (begin, end), named = self.item.viewRange()[0], []
        edge = self.item.vb.width() + 0.5 * theme.SMALL
        apart = self.item.vb.width() / (end - begin)
        ticks = [(x, fitted(text, apart - APART_PX)) for x, text in self.chart.ticks]
        for x, text in ticks:
            middle = (x - begin) / (end - begin) * self.item.vb.width()
            reach = {at: 0.5 * theme.text_width(line, theme.SMALL) for at, line in enumerate(text.split("\n"))}
            if all(ends.get(at, -math.inf) < middle - half and middle + half <= edge for at, half in reach.items()):
                ends |= {at: middle + half + APART_PX for at, half in reach.items()}
                named.append((x, text))
        lines = max((text.count("\n") + 1 for _, text in ticks), default=1)
        high = lines * (theme.SMALL + 3) + theme.SMALL * bool(self.chart.x_title)
        axis.setHeight(4 + high)  # pyqtgraph's own changes as it is painted
        axis.resizeEvent()  # else a new title stands where the one before began
        axis.setTicks([named] if named else None)

    def show_all(self) -> None:
        low, high = self.chart.lowest, self.chart.highest
        high = high if high > low else 1.0
        if self.chart.logarithmic:
            least = min((point.y for point in self.chart.points if self._fits(point)), default=0.1)
            low, high = np.log10(0.8 * least), np.log10(1.1 * high)
        self.item.setYRange(low - FOOT * (high - low), low + (high - low) / (1.0 - BAND), padding=0.0)
        self.item.setXRange(*self.chart.span, padding=0.0)
        self._place_crosses()

    def show_ring(self, trial: tuple[str, int] | None) -> None:
        """Ring a trial, by participant and run; None: none."""
        self._ringed = trial
        marks = (*self.points.points(), *self.crosses.points())
        found = [m for m in marks if (row := m.data().row) is not None and (row.participant, row.run) == trial]
        self.ring.setData([{"pos": mark.pos(), "data": None, "pen": line(COLOURS.handle, 2)} for mark in found])

    def colour_of(self, controller: int | str) -> str:
        """The controller's own colour; a code of a blind session has none."""
        return colour_at(self.chart.colours.get(controller))

    def _name_values(self, *_: object) -> None:
        """Round values along the left axis, whatever part of the scale is seen."""
        low, high = self.item.viewRange()[1]
        if self.chart.logarithmic:
            powers = range(math.floor(low), math.ceil(high) + 1)
            finer = ([power + math.log10(digit) for power in powers for digit in digits] for digits in DIGITS)
            seen = ([place for place in places if low <= place <= high] for places in finer)
            ticks = [(at, f"{10.0**at:.3g}") for at in next((places for places in seen if len(places) >= TICKS), ())]
        else:
            decade = 10.0 ** math.floor(math.log10((high - low) / TICKS))
            step = max(digit * decade for digit in DIGITS[1] if digit * decade * TICKS <= high - low)
            places = range(math.ceil(low / step), math.floor(high / step) + 1)
            ticks = [(place * step, f"{place * step:.6g}") for place in places]
        self.item.getAxis("left").setTicks([ticks])

    def _scaled(self, value: Any) -> Any:
        """A value of the chart, or several, where they are on the axis."""
        return np.log10(value) if self.chart.logarithmic else value

    def _fits(self, point: Point) -> bool:
        return point.y > 0.0 or not self.chart.logarithmic

    def _spot(self, point: Point) -> dict:
        counts = point.row is None or point.row.status in ("done", "timeout")
        colour = self.colour_of(point.controller) if counts else COLOURS.quiet
        return {
            "pos": (point.x, self._scaled(point.y)), "data": point, "size": POINT_PX,
            "symbol": symbol_of(point.row) if counts else "+", "pen": line(colour),
            "brush": shade(COLOURS.panel if point.look else colour),
        }  # fmt: skip

    def _place_crosses(self, *_: object) -> None:
        """They stay above whatever part of the scale is seen."""
        low, high = self.item.viewRange()[1]
        y, look = high - 0.4 * BAND * (high - low), {"pen": line(COLOURS.caution, 2), "brush": shade(COLOURS.caution)}
        self.crosses.setData([
            {"pos": (point.x, y), "data": point, "symbol": "x", "size": CROSS_PX, **look}
            for point in self.chart.timeouts
        ])  # fmt: skip
        if self._ringed is not None:
            self.show_ring(self._ringed)

    def _add_boxes(self) -> None:
        """All bodies in one item, whiskers and medians in one for each colour: hundreds of boxes cost no more."""
        boxes = [at for at in self.chart.boxes if at.box.low > 0.0 or not self.chart.logarithmic]
        ends = [self._scaled(np.array([b.box.low, b.box.q1, b.box.median, b.box.q3, b.box.high])) for b in boxes]
        fill = [body_brush(b.look, self.colour_of(b.controller)) for b in boxes]
        pens = [line(self.colour_of(b.controller)) for b in boxes]
        self.item.addItem(pg.BarGraphItem(
            x0=[b.x - b.half for b in boxes], x1=[b.x + b.half for b in boxes],
            y0=[y[1] for y in ends], y1=[y[3] for y in ends], pens=pens, brushes=fill,
        ))  # fmt: skip
        for controller in dict.fromkeys(b.controller for b in boxes):
            own_boxes = [(b, y) for b, y in zip(boxes, ends, strict=True) if b.controller == controller]
            x = [2 * [b.x, b.x, b.x - 0.5 * b.half, b.x + 0.5 * b.half] for b, _ in own_boxes]
            y = [[q1, low, low, low, q3, high, high, high] for _, (low, q1, _, q3, high) in own_boxes]
            self._add_pairs(x, y, line(self.colour_of(controller)))
        middles = [2 * [y[2]] for y in ends]
        self._add_pairs([[b.x - b.half, b.x + b.half] for b in boxes], middles, line(COLOURS.handle, 2))

    def _add_pairs(self, x: list, y: list, pen: QPen) -> None:
        """Lines, each between two points that follow each other."""
        self.item.addItem(pg.PlotCurveItem(np.ravel(x), np.ravel(y), pen=pen, connect="pairs"))

    def read_at(self, place: QPointF) -> str:
        """The numbers of the box that is there; what a point says stands before them."""
        value = 10.0 ** place.y() if self.chart.logarithmic else place.y()
        for placed in self.chart.boxes:
            box, unit = placed.box, self.chart.unit
            if abs(place.x() - placed.x) <= placed.half and box.q1 <= value <= box.q3:
                return f"Box of {box.n}: median {box.median:.3g} {unit}, quartiles {box.q1:.3g} and {box.q3:.3g} {unit}"
        return ""

    def _tip(self, x: float, y: float, data: Point) -> str:
        return data.text

    def _clicked(self, _points: object, found: Sequence, event: MouseClickEvent) -> None:
        """The trial of the point that is nearest to the click, of those that lie over each other."""
        at = event.scenePos()
        near = sorted(found, key=lambda mark: (self.item.vb.mapViewToScene(mark.pos()) - at).manhattanLength())
        if near and near[0].data().row is not None and event.button() == Qt.MouseButton.LeftButton:
            self.chosen.emit(near[0].data().row)


def fitted(name: str, room: float) -> str:
    """A controller's name in lines that have room (px); where a word has none, what stands behind its comma."""

    def widest(text: str) -> float:
        return max(theme.text_width(line, theme.SMALL) for line in text.split("\n"))

    broken = name if widest(name) <= room else name.replace(" ", "\n", 1)
    return broken if widest(broken) <= room else name.replace("\n", " ").rpartition(", ")[2].capitalize()


def symbol_of(row: TrialRow | None) -> str:
    """The shape of a trial's point: that of its path; an answer has that of the first."""
    return SYMBOLS[0 if row is None else (row.path - 1) % len(SYMBOLS)]


def trial_of(row: TrialRow | None) -> tuple[str, int] | None:
    """What tells a trial from all others of a data folder."""
    return None if row is None else (row.participant, row.run)
