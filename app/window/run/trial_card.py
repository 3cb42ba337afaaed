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
from app.window.run.commands import MAIN_PX, key_button
from app.window.widgets import theme
from app.window.widgets.parts import OneLine, column, row, text_label, wrapped_label
from app.window.widgets.plots import Graph, line, range_for
from app.window.widgets.theme import COLOURS, colour_of
from app.window.widgets.words import in_colour, measured
from experiments.analysis.metrics import DRAWN, Metric
from experiments.analysis.punctuality import Punctuality
from experiments.analysis.trials_table import COUNTED, TrialRow, trial_flags

IGNORE_SPACE_S = 0.5  # Space is not heard for so long after a trial: it may be meant for something else
EARLIER_ALPHA = 0.5
UNREAD = "Its ticks are not here: whether they came in time is not known"
GRAPH_PX = 52  # high, of a measure's axis


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
        name = OneLine(metric.title, "", theme.NORMAL)
        head = row(name, self.value, self.unit, spacing=6)
        self.setLayout(column(head, self.graph, spacing=0))
        self.graph.setFixedHeight(GRAPH_PX)

    def show_values(self, now: TrialRow, earlier: Sequence[TrialRow], others: Sequence[TrialRow], colour: str) -> None:
        """This trial, the earlier ones of its controller, and those of other controllers on the same device."""
        name, scale = self._metric.name, self._metric.scale
        value = now.value(name)
        self.value.setText(measured(None if value is None else scale * value))
        ring = line(COLOURS.text, 2)
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
        self.graph.getPlotItem().getAxis("bottom").setTicks([[(0.0, "0"), (self.end, f"{self.end:g}")]])


def nothing_amiss(row: TrialRow, ticks: np.ndarray | None) -> str:
    """What is said of a trial without a flag."""
    if ticks is None or not len(ticks):
        return UNREAD
    return f"{'Usable: nothing' if row.status == 'done' else 'Nothing'} was late or flagged"


class TrialCard(QWidget):
    """Keep, repeat or exclude a trial."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self.row: TrialRow | None = None
        self._shown: tuple | None = None  # what `show_row` was given last
        theme.follow(self._colour)
        self._since_s = 0.0
        self.own = wrapped_label("", "quiet", theme.SMALL)
        self.legend = wrapped_label("", "quiet", theme.SMALL)
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.measures = [Measure(metric) for metric in DRAWN]
        self.flags = wrapped_label()
        self.keep = key_button("Keep", "start", "main")
        self.keep.setMinimumHeight(MAIN_PX)
        self.redo, self.exclude = key_button("Repeat …", "redo"), key_button("Exclude …", "exclude")
        self.asks = {"redo": self.redo, "exclude": self.exclude}
        self._decide = column(self.keep, self.redo, self.exclude)
        self._layout = column(*self.measures, self.own, self.legend, 1, self.flags, self._decide, spacing=10)
        self.setLayout(self._layout)
        self.setMinimumHeight(1)  # it hides what has no room, and asks for none

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
        self.row, self._shown = row, (row, rows, ticks, opened, snapshot)
        colour = COLOURS.quiet if snapshot.blind else colour_of(row.controller, opened.protocol.controllers)
        counted = [other for other in rows if other.status in COUNTED and other.run != row.run]
        here = [other for other in counted if other.configuration == row.configuration]
        same = [other for other in here if other.controller == row.controller]
        self.own.setText("\n".join(f"{name} {value:.3g}" for name, value in row.own.items()))  # ends in its unit
        self.own.setVisible(bool(row.own))
        faint = theme.mixed(COLOURS.panel, colour, EARLIER_ALPHA).name()
        shown = [("◉", colour, "this trial", True), ("●", faint, "same controller", bool(same))]
        shown.append(("●", COLOURS.brake_off, "other controllers", len(here) > len(same)))
        legend = " &nbsp; ".join(f"{in_colour(dot, of)} {name}" for dot, of, name, there in shown if there)
        self.legend.setText(f"{legend}<br>All paths, {row.configuration}" if here else legend)
        for measure in self.measures:
            measure.show_values(row, same, [other for other in here if other not in same], colour)
        flags = [f"▲ {flag}" for flag in trial_flags(row, ticks)]
        theme.set_style(self.flags, "caution" if flags else "")
        late = Punctuality().plus(ticks) if ticks is not None else Punctuality()
        if late.usable and late.missed:
            flags.append(late.words)
        self.flags.setText("\n".join(flags) or nothing_amiss(row, ticks))
        self._make_room()

    def _colour(self) -> None:
        if self._shown is not None:
            self.show_row(*self._shown)

    def _make_room(self) -> None:
        """Hide what a low window has no room for: the legend first, then the last measures."""
        room, gap = self.height() - self._decide.sizeHint().height(), self._layout.spacing()
        for part in (self.flags, *filter(lambda part: bool(part.text()), (self.own,)), *self.measures, self.legend):
            needed = part.heightForWidth(self.width()) if part.hasHeightForWidth() else part.sizeHint().height()
            room -= needed + gap
            part.setVisible(room >= 0 or part is self.flags)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._make_room()

    def offer(self, can: Actions, keep: str, has_space: bool) -> None:
        """What can be done with the trial now. keep: the words of its first button, "": it has none; has_space: Space
        presses it.
        """
        self.keep.setText(keep)
        self.keep.setVisible(bool(keep))
        self.keep.key.setVisible(has_space)
        for (action, pressed), text in zip(self.asks.items(), ("Repeat …", "Exclude …"), strict=True):
            pressed.setText(text)
            pressed.setEnabled(can.of(action) is not None)
