"""Error against force on screen, as the printed figure: each controller on each device, with quartiles and names."""

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt

from app.window.widgets import theme
from app.window.widgets.parts import OneLine
from app.window.widgets.plots import Plot, line
from app.window.widgets.theme import colour_at
from experiments.analysis.charts import View
from experiments.analysis.error_against_force import (
    ERROR,
    FORCE,
    SMOOTHNESS,
    Mark,
    diameter,
    halvings,
    joined,
    largest_smoothness,
    marks_of,
    ranges,
)
from experiments.analysis.trials_table import Trials

CIRCLE_PX = 22.0  # the largest diameter
HEAD = f"Error ({ERROR.shown_unit}, log scale) against force ({FORCE.shown_unit})"
ABOUT = "Best: low and left. Each horizontal line halves the error."
GLASS = 0.4  # of its colour, a filled circle: what lies under it is seen


class ForcePlot(Plot):
    """Median path error over median tip force; the error on a logarithmic axis."""

    def __init__(self) -> None:
        super().__init__(OneLine(HEAD, "", theme.NORMAL, bold=True))
        self.figures.hide()
        self.title.setToolTip(ABOUT)
        self.marks: list[Mark] = []
        self.circles = pg.ScatterPlotItem(hoverable=True, tip=lambda x, y, data: data)
        self._largest = 0.0
        self.item.showGrid(y=True, alpha=0.6)
        self.setMinimumSize(180, 150)

    def show_marks(self, trials: Trials, view: View) -> None:
        """The marks of these trials."""
        self.marks = marks_of(trials, view)
        self._largest = largest_smoothness(self.marks)
        self.item.clear()
        large_first = sorted(self.marks, key=lambda mark: -diameter(mark.smoothness, self._largest))
        for first, second in joined(self.marks):
            colour = colour_at(view.colours.get(first.controller))
            ends = zip(*((m.force.median, math.log2(m.error.median)) for m in (first, second)), strict=True)
            self.item.plot(*map(list, ends), pen=line(colour, style=Qt.PenStyle.DotLine))
        for mark in self.marks:
            x, y = self._quartiles(mark)
            colour = colour_at(view.colours.get(mark.controller))
            self.item.addItem(pg.PlotCurveItem(x, y, pen=line(colour), connect="pairs"))
        self.circles.setData([
            {
                "pos": (mark.force.median, math.log2(mark.error.median)),
                "data": f"{view.name(mark.controller)}, {mark.text}",
                "size": CIRCLE_PX * diameter(mark.smoothness, self._largest), "pen": line(colour, 2),
                "brush": theme.shade(colour, 0.0 if mark.look else GLASS),
            }
            for mark in large_first
            for colour in (colour_at(view.colours.get(mark.controller)),)
        ])  # fmt: skip
        self.item.addItem(self.circles)
        self.show_all()

    def meaning(self) -> str:
        """What its marks say, in short."""
        area = f"; area: {SMOOTHNESS.title}, up to {self._largest:.3g} {SMOOTHNESS.shown_unit}" if self._largest else ""
        joins = " Dotted: the devices of one controller." if joined(self.marks) else ""
        return f"Error against force: median, cross of quartiles{area}.{joins}" if self.marks else ""

    def _quartiles(self, mark: Mark) -> tuple[np.ndarray, np.ndarray]:
        """Two lines: of force, and of the error as far as it is on the axis."""
        low = max(mark.error.q1, ranges(self.marks)[1][0])
        error = np.log2([mark.error.median, mark.error.median, low, mark.error.q3])
        return np.array([mark.force.q1, mark.force.q3, mark.force.median, mark.force.median]), error

    def show_all(self) -> None:
        if not self.marks:
            return
        across, up = ranges(self.marks)
        lines = [(math.log2(value), f"{value:g}") for value in halvings(*up)]
        self.item.getAxis("left").setTicks([lines])
        self.item.setXRange(*across, padding=0.0)
        self.item.setYRange(*(math.log2(end) for end in up), padding=0.0)
