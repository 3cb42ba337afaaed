"""Box plots on screen, with each trial as a point; the numbers are those of the figures for print."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal

from app.window.painting import theme
from app.window.painting.labels import OneLine
from app.window.plots import Plot, range_for
from experiments.analysis.boxplots import Box, boxes
from experiments.analysis.metrics import Metric
from experiments.analysis.trials_table import COUNTED, TrialRow

#: short names of Table I's controllers; others stand under their boxes as the protocol names them
SHORT = {
    "SDOF with gap": "SDOF gap", "Proportional, high gain": "Prop. high", "Proportional, low gain": "Prop. low"
}  # fmt: skip
LEAST_IN_A_BOX = 5  # Our choice: fewer values are points without a box
GOLDEN = 0.6180339887  # run * GOLDEN modulo 1: a jitter that is fixed and even


def colour_of(controller: int | str) -> str:
    """Table I's five colours, which begin again for further controllers; a code has none of its own."""
    if isinstance(controller, str):
        return theme.QUIET
    return theme.CONTROLLER[(controller - 1) % len(theme.CONTROLLER) + 1]


class BoxPlot(Plot):
    """One measure: a group for each controller, a box for each configuration (the first filled, the second open).

    controllers: number -> the protocol's name of it. Each trial is a point; a click on it emits `chosen`.
    """

    chosen = Signal(object)  # a TrialRow

    def __init__(self, metric: Metric, configurations: Sequence[str], controllers: Mapping[int, str]) -> None:
        super().__init__(metric.title)
        self._metric, self._configurations = metric, tuple(configurations)
        self._names = {number: SHORT.get(name, name) for number, name in controllers.items()}
        self.found: dict[tuple[int | str, str], Box] = {}
        self.controllers: tuple[int | str, ...] = tuple(self._names)
        self.caption = OneLine("", "quiet", theme.SMALL)
        self.rows.addWidget(self.caption)
        self.points = pg.ScatterPlotItem(size=5, hoverable=True, hoverSize=9, tip=self._tip)
        self.points.sigClicked.connect(self._clicked)
        self.figures.show_parts((metric.shown_unit, theme.QUIET))
        self.setMinimumSize(240, 170)

    def show_rows(self, rows: Sequence[TrialRow]) -> None:
        """The trials of these rows; codes of a blind session stand in place of controllers."""
        self.found = boxes(rows, self._metric.name, self._configurations, self._metric.scale)
        there = tuple(dict.fromkeys(controller for controller, _ in self.found))
        coded = tuple(controller for controller in there if controller not in self._names)
        self.controllers = coded if there and coded == there else (*self._names, *coded)
        self.item.clear()
        for (controller, configuration), box in self.found.items():
            if box.count >= LEAST_IN_A_BOX:
                self._add_box(box, self._place(controller, configuration), self._width, controller, configuration)
        self._add_points(rows)
        highest = max((max(box.high, *box.outliers, box.q3) for box in self.found.values()), default=0.0)
        self.item.setYRange(0.0, range_for(1.02 * highest, 1.0), padding=0.02)
        self.item.setXRange(-0.5, max(len(self.controllers), 1) - 0.5, padding=0.0)
        self.item.getAxis("bottom").setTicks(
            [[(i, self._names.get(controller, f"{controller}")) for i, controller in enumerate(self.controllers)]]  # type: ignore[call-overload]
        )
        self.caption.setText(self.said)

    @property
    def said(self) -> str:
        """What the boxes are, under them."""
        drawn = zip(("filled", "open", "third", "fourth"), self._configurations, strict=False)
        parts = [f"{how} {name}" for how, name in drawn]
        counts = {box.count for box in self.found.values()}
        if len(counts) == 1:
            parts.append(f"{min(counts)} trial{'s' if counts != {1} else ''} a box")
        elif counts:
            parts.append(f"{min(counts)} to {max(counts)} trials a box")
        if counts and min(counts) < LEAST_IN_A_BOX:
            parts.append(f"no box below {LEAST_IN_A_BOX} trials")
        return " · ".join(parts)

    @property
    def _width(self) -> float:
        return 0.76 / len(self._configurations)

    def _place(self, controller: int | str, configuration: str) -> float:
        j = self._configurations.index(configuration)
        return self.controllers.index(controller) + (j - 0.5 * (len(self._configurations) - 1)) * self._width

    def _add_box(self, box: Box, x: float, width: float, controller: int | str, configuration: str) -> None:
        colour = colour_of(controller)
        filled = configuration == self._configurations[0]
        line, half = pg.mkPen(colour, width=1), 0.42 * width
        brush = pg.mkBrush(theme.colour(colour, 0.45 if filled else 0.08))
        self.item.addItem(
            pg.BarGraphItem(x0=[x - half], x1=[x + half], y0=[box.q1], y1=[box.q3], pen=line, brush=brush)
        )
        ends_x, ends_y = [], []
        for inner, outer in ((box.q1, box.low), (box.q3, box.high)):
            ends_x += [x, x, x - 0.5 * half, x + 0.5 * half]
            ends_y += [inner, outer, outer, outer]
        self.item.addItem(pg.PlotCurveItem(np.array(ends_x), np.array(ends_y), pen=line, connect="pairs"))
        median = pg.mkPen(theme.HANDLE if filled else colour, width=2)
        self.item.addItem(pg.PlotCurveItem(np.array([x - half, x + half]), np.full(2, box.median), pen=median))

    def _add_points(self, rows: Sequence[TrialRow]) -> None:
        spots = []
        for row in rows:
            value = getattr(row, self._metric.name)
            if value is None or row.status not in COUNTED or (row.controller, row.configuration) not in self.found:
                continue
            jitter = (row.run * GOLDEN % 1.0 - 0.5) * 0.6 * self._width
            colour = colour_of(row.controller)
            filled = row.configuration == self._configurations[0]
            spots.append({
                "pos": (self._place(row.controller, row.configuration) + jitter, self._metric.scale * value),
                "symbol": "x" if row.status == "timeout" else "o", "data": row, "pen": pg.mkPen(colour, width=1),
                "brush": pg.mkBrush(colour if filled else theme.PANEL),
            })  # fmt: skip
        self.points.setData(spots)
        self.item.addItem(self.points)

    def _tip(self, x: float, y: float, data: TrialRow) -> str:
        timed_out = " · timed out" if data.status == "timeout" else ""
        return f"Participant {data.participant} · run {data.run} · {y:.3g} {self._metric.shown_unit}{timed_out}"

    def _clicked(self, _points: object, found: Sequence, _event: object) -> None:
        if len(found):
            self.chosen.emit(found[0].data())
