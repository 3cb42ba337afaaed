"""The running trial in two measures: path error and tip force, each a number and a curve, and the time since go."""

import math

import numpy as np

from app.window.widgets import theme
from app.window.widgets.parts import Figures, column, holder, row, text_label
from app.window.widgets.plots import NOTHING, Trace
from app.window.widgets.theme import COLOURS
from core import tick_log

LINE_PX = 30  # high, the line of the time


class LargeTrace(Trace):
    """A live measure with a large number, on the ground of the panel that it stands in."""

    figures_px, figures_bold = theme.HEAD, True

    def __init__(self, title: str, unit: str, colour: str) -> None:
        super().__init__(title, unit, [colour], 10.0, 1)
        self.setObjectName("clear")
        self.rows.setContentsMargins(0, 6, 0, 0)


class Live:
    """What the panel of a running trial shows of its ticks."""

    def __init__(self) -> None:
        self.time = Figures(theme.HEAD, right=True, bold=True)
        self.time.setFixedHeight(LINE_PX)
        self.error = LargeTrace("Path error", "mm", COLOURS.trace)
        self.force = LargeTrace("Tip force", "N", COLOURS.good)
        self.force.item.showAxis("bottom")
        head = row(text_label("Time", bold=True), self.time)
        self.panel = holder(column(head, (self.error, 1), (self.force, 1), spacing=8))
        self.clear()

    def clear(self) -> None:
        """Another trial begins."""
        for trace in (self.error, self.force):
            trace.clear()
        self._began_s = math.nan  # time of "go"
        self._show_time(NOTHING)

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH), n > 0, of the running trial; error and time count from go to the end."""
        t, moves = rows[:, tick_log.T], rows[rows[:, tick_log.PHASE] == tick_log.MOVE]
        if len(moves):
            self._began_s = moves[0, tick_log.T] if math.isnan(self._began_s) else self._began_s
            self._time_s = moves[-1, tick_log.T] - self._began_s
        self.force.add(t, np.hypot(rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY])[None])
        self.error.add(t, 1e3 * np.abs(rows[:, tick_log.PATH_DISTANCE])[None])

    def refresh_text(self) -> None:
        """The values of the last tick that was added."""
        for trace in (self.error, self.force):
            trace.show_newest()
        if not math.isnan(self._began_s):
            self._show_time(f"{self._time_s:.1f}")

    def rest(self) -> None:
        """The trial is over: its curves and its time stay, and no value is one of now."""
        for trace in (self.error, self.force):
            trace.rest()

    def _show_time(self, seconds: str) -> None:
        self.time.show_parts((seconds, COLOURS.text), ("s", COLOURS.quiet))
