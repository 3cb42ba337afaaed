"""Error against force on screen, as the printed figure: each controller on each device, with quartiles and names."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt

from app.window.widgets import theme
from app.window.widgets.parts import OneLine
from app.window.widgets.plots import Plot
from app.window.widgets.theme import COLOURS, colour_at
from experiments.analysis.charts import View
from experiments.analysis.error_against_force import (
    ERROR,
    FORCE,
    SMOOTHNESS,
    TITLE,
    Mark,
    between,
    by_controller,
    diameter,
    drawn_rectangles,
    halvings,
    joined,
    largest_smoothness,
    marks_of,
    name_places,
    ranges,
)
from experiments.analysis.trials_table import Controller, Trials

CIRCLE_PX = 22.0  # the largest diameter
ABOUT = "A circle's area is the DFT of acceleration. Each line across halves the error. Best: low and left."


class ForcePlot(Plot):
    """Median path error over median tip force; the error on a logarithmic axis."""

    def __init__(self) -> None:
        super().__init__(OneLine(f"{TITLE}, {ERROR.shown_unit} over {FORCE.shown_unit}", "", theme.NORMAL, bold=True))
        self.head.setStretch(0, 3)
        self.head.setStretch(1, 2)
        self.title.setToolTip(ABOUT)
        self.marks: list[Mark] = []
        self.names: dict[Controller, pg.TextItem] = {}
        self.circles = pg.ScatterPlotItem(hoverable=True, tip=lambda x, y, data: data)
        self._largest = 0.0
        self.item.showGrid(y=True, alpha=0.6)
        self.item.vb.sigResized.connect(self._place_names)
        self.item.vb.sigRangeChanged.connect(self._place_names)
        self.setMinimumSize(180, 150)

    def show_marks(self, trials: Trials, view: View) -> None:
        """The marks of these trials."""
        self.marks = marks_of(trials, view)
        self._largest = largest_smoothness(self.marks)
        size = f"Circle: DFT, up to {self._largest:.3g} {SMOOTHNESS.shown_unit}" if self._largest else ""
        self.figures.show_parts((size, COLOURS.quiet))
        self.item.clear()
        colours = [colour_at(view.colours.get(mark.controller)) for mark in self.marks]
        for first, second in joined(self.marks):
            colour = colour_at(view.colours.get(first.controller))
            ends = zip(*((m.force.median, math.log2(m.error.median)) for m in (first, second)), strict=True)
            self.item.plot(*map(list, ends), pen=pg.mkPen(colour, width=1, style=Qt.PenStyle.DotLine))
        for mark, colour in zip(self.marks, colours, strict=True):
            x, y = self._quartiles(mark)
            self.item.addItem(pg.PlotCurveItem(x, y, pen=pg.mkPen(colour, width=1), connect="pairs"))
        self.circles.setData([
            {
                "pos": (mark.force.median, math.log2(mark.error.median)),
                "data": f"{view.name(mark.controller)}, {mark.text}",
                "size": CIRCLE_PX * diameter(mark.smoothness, self._largest), "pen": pg.mkPen(colour, width=2),
                "brush": pg.mkBrush(COLOURS.panel if mark.look else colour),
            }
            for mark, colour in zip(self.marks, colours, strict=True)
        ])  # fmt: skip
        self.item.addItem(self.circles)
        self._add_names({mark.controller: view.name(mark.controller) for mark in self.marks}, view)
        self.show_all()

    def _quartiles(self, mark: Mark) -> tuple[np.ndarray, np.ndarray]:
        """Two lines: of force, and of the error as far as it is on the axis."""
        low = max(mark.error.q1, ranges(self.marks)[1][0])
        error = np.log2([mark.error.median, mark.error.median, low, mark.error.q3])
        return np.array([mark.force.q1, mark.force.q3, mark.force.median, mark.force.median]), error

    def _add_names(self, names: Mapping[Controller, str], view: View) -> None:
        self.names = {}
        for controller, name in names.items():
            text = pg.TextItem(name, theme.as_text(colour_at(view.colours.get(controller))), anchor=(0.0, 1.0))
            text.setFont(theme.font(theme.SMALL, bold=True))
            self.names[controller] = text
            self.item.addItem(text, ignoreBounds=True)

    def show_all(self) -> None:
        if not self.marks:
            return
        across, up = ranges(self.marks)
        lines = [(math.log2(value), f"{value:g}") for value in halvings(*up)]
        self.item.getAxis("left").setTicks([lines])
        self.item.setXRange(*across, padding=0.0)
        self.item.setYRange(*(math.log2(end) for end in up), padding=0.0)
        self._place_names()

    def _place_names(self, *_: object) -> None:
        """Beside their circles, in px with y upwards, clear of what is drawn."""
        if not self.marks:
            return

        def at(x: float, y: float) -> tuple[float, float]:
            place = self.item.vb.mapViewToScene(QPointF(x, y))
            return place.x(), -place.y()

        placed: list[tuple[float, float, float]] = []
        covered = []
        for mark in self.marks:
            x, y = at(mark.force.median, math.log2(mark.error.median))
            (left, right, *_), (*_, low, high) = (ends.tolist() for ends in self._quartiles(mark))
            reach = (at(left, 0.0)[0], at(right, 0.0)[0]), (at(0.0, low)[1], at(0.0, high)[1])
            placed.append((x, y, 0.5 * CIRCLE_PX * diameter(mark.smoothness, self._largest)))
            covered += drawn_rectangles(placed[-1], reach, 1.0)
        groups = by_controller(self.marks)
        for of_one in groups.values():
            for one, other in zip(of_one, of_one[1:], strict=False):
                covered += between(placed[one][:2], placed[other][:2])
        sizes = [self._size_of(text) for text in self.names.values()]
        centres = [[placed[at] for at in groups[controller]] for controller in self.names]
        box = self.item.vb.sceneBoundingRect()
        page = box.left(), -box.bottom(), box.right(), -box.top()
        for text, (x, y) in zip(self.names.values(), name_places(sizes, centres, covered, page), strict=True):
            text.setPos(self.item.vb.mapSceneToView(QPointF(x, -y)))

    def _size_of(self, text: pg.TextItem) -> tuple[float, float]:
        box: Sequence[float] = text.boundingRect().getRect()
        return box[2], box[3]
