"""The card of a trial that has ended: its three measures beside the earlier ones, its flags, and what becomes of it."""

import time
from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.ipc import messages as m
from app.window.run.actions import Actions
from app.window.run.session_panel import key_button
from app.window.widgets import theme
from app.window.widgets.parts import OneLine, Panel, column, row, text_label, wrapped_label
from app.window.widgets.plots import Graph, range_for
from app.window.widgets.theme import COLOURS, colour_of
from app.window.widgets.words import SHORT, in_colour
from experiments.analysis.metrics import DRAWN, Metric
from experiments.analysis.trials_table import COUNTED, TrialRow, trial_flags
from experiments.store.cells import place

IGNORE_SPACE_S = 0.5  # Space is not heard for so long after a trial: it may be meant for something else
EARLIER_ALPHA = 0.5
NO_FLAGS = "No flags"


class Measure(QWidget):
    """One measure as a number, and as a point on an axis among the earlier trials."""

    def __init__(self, metric: Metric) -> None:
        super().__init__()
        self._metric = metric
        self.value, self.unit = text_label("", size=theme.HEAD, bold=True), text_label(metric.shown_unit, "quiet")
        self.graph = Graph()
        self.graph.setMouseEnabled(x=False, y=False)
        self.graph.hideAxis("left")
        self.graph.setYRange(-1.0, 1.0)
        self.points = pg.ScatterPlotItem()
        self.graph.addItem(self.points)
        self.end = 0.0  # of the axis: it grows and never shrinks, so that cards compare
        about = column(
            OneLine(SHORT.get(metric.title, metric.title), "quiet"), row(self.value, self.unit, 1), spacing=0
        )
        self.setLayout(row((about, 1), (self.graph, 1), spacing=6, margins=(0, 2, 0, 2)))
        self.graph.setFixedHeight(52)

    def show_values(self, now: TrialRow, earlier: Sequence[TrialRow], others: Sequence[TrialRow], colour: str) -> None:
        """This trial, the earlier ones of its controller, and those of other controllers on the same device."""
        name, scale = self._metric.name, self._metric.scale
        value = now.value(name)
        self.value.setText("–" if value is None else f"{scale * value:.3g}")
        ring = pg.mkPen(COLOURS.text, width=2)
        groups = (
            (others, 7, theme.shade(COLOURS.brake_off), None), (earlier, 9, theme.shade(colour, EARLIER_ALPHA), None),
            ([now], 13, theme.shade(colour), ring),
        )  # fmt: skip
        self.points.clear()
        highest = 0.0
        for rows, size, brush, pen in groups:
            values = [scale * value for value in (row.value(name) for row in rows) if value is not None]
            self.points.addPoints(x=values, y=[0.0] * len(values), size=size, brush=brush, pen=pen)
            highest = max(highest, *values, 0.0)
        self.end = max(self.end, range_for(1.05 * highest, 1.0))
        self.graph.setXRange(0.0, self.end, padding=0.03)


class TrialCard(Panel):
    """Keep, repeat or exclude a trial."""

    def __init__(self) -> None:
        super().__init__()
        self.row: TrialRow | None = None
        self._since_s = 0.0
        self.dot, self.title = text_label("●", size=theme.TITLE), text_label("", size=theme.TITLE, bold=True)
        self.what = wrapped_label("", size=theme.SMALL)
        self.legend = wrapped_label("", "quiet", theme.SMALL)
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.measures = [Measure(metric) for metric in DRAWN]
        self.flags = wrapped_label("", "quiet")
        self.keep = key_button("Keep", "start", "main")
        self.redo, self.exclude = key_button("Repeat …", "redo"), key_button("Exclude …", "exclude")
        self.asks = {"redo": self.redo, "exclude": self.exclude}
        decide = column(self.keep, self.redo, self.exclude)
        head = row(self.dot, self.title, 1)
        self._layout = column(
            head, self.what, self.legend, *self.measures, 1, self.flags, decide,
            margins=(14, 10, 14, 12),
        )  # fmt: skip
        self.setLayout(self._layout)

    @property
    def ready(self) -> bool:
        """Whether Space is heard yet."""
        return time.perf_counter() - self._since_s > IGNORE_SPACE_S

    def show_row(
        self, row: TrialRow, rows: Sequence[TrialRow], ticks: np.ndarray | None, opened: m.Opened, snapshot: m.Snapshot
    ) -> None:
        """The newest trial, among the rows of its session; ticks (n, tick_log.WIDTH) of it, if they are known."""
        if self.row is None or row.run != self.row.run:
            self._since_s = time.perf_counter()
        self.row = row
        colour = COLOURS.quiet if snapshot.blind else colour_of(row.controller, opened.protocol.controllers)
        counted = [other for other in rows if other.status in COUNTED and other.run != row.run]
        here = [other for other in counted if other.configuration == row.configuration]
        same = [other for other in here if other.controller == row.controller]
        self.dot.setStyleSheet(f"color: {colour}")
        self.title.setText(f"Trial {place(row, opened.plan)} of {len(opened.plan)}")
        duration_s = row.value("duration_s")
        took = f" in {duration_s:.1f} s" if duration_s is not None else ""
        ended = {"done": f"done{took}", "timeout": "time was up"}.get(row.status, row.status)
        own = [f"{name} {value:.3g}" for name, value in row.own.items()]  # by their names, which end in their units
        name = opened.protocol.controller_name(row.controller)
        self.what.setText(" · ".join((ended, name, f"path {row.segment}", *own)))
        faint = theme.mixed(COLOURS.panel, colour, EARLIER_ALPHA).name()
        shown = [("◉", colour, "this trial", True), ("●", faint, "same controller", bool(same))]
        shown.append(("●", COLOURS.brake_off, "others", len(here) > len(same)))
        self.legend.setText(" &nbsp; ".join(f"{in_colour(dot, of)} {name}" for dot, of, name, there in shown if there))
        for measure in self.measures:
            measure.show_values(row, same, [other for other in here if other not in same], colour)
        flags = trial_flags(row, ticks)
        theme.set_style(self.flags, "caution" if flags else "quiet")
        self.flags.setText("\n".join(f"▲ {flag}" for flag in flags) or NO_FLAGS)
        self._make_room()

    def _make_room(self) -> None:
        """Hide what a low window has no room for: the legend, then the last measures."""
        least = (self.legend, *reversed(self.measures))
        for part in least:
            part.show()
        for part in least:
            part.setVisible(self._layout.minimumHeightForWidth(self.width()) <= self.height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._make_room()

    def offer(self, can: Actions, keep: str, has_space: bool) -> None:
        """What can be done with the trial now. keep: the words of its first button; has_space: Space presses it."""
        self.keep.setText(keep)
        self.keep.key.setVisible(has_space)
        for (action, pressed), text in zip(self.asks.items(), ("Repeat …", "Exclude …"), strict=True):
            pressed.setText(text)
            pressed.setEnabled(can.of(action) is not None)
