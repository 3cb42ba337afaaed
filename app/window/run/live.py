"""The running trial in two measures: path error and tip force, each a number and a curve, and the time since go."""

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

    def __init__(self, title: str, unit: str, colour: str, least: float) -> None:
        super().__init__(title, unit, [colour], least, 1)
        self.setObjectName("clear")
        self.rows.setContentsMargins(0, 6, 0, 0)


class Live:
    """What the panel of a running trial shows of its movement."""

    def __init__(self) -> None:
        self.time = Figures(theme.HEAD, right=True, bold=True)
        self.time.setFixedHeight(LINE_PX)
        self.error = LargeTrace("Path error", "mm", COLOURS.trace, 2.0)
        self.force = LargeTrace("Tip force", "N", COLOURS.good, 4.0)
        self.force.item.showAxis("bottom")
        head = row(text_label("Time since go", bold=True), self.time)
        self.panel = holder(column(head, (self.error, 1), (self.force, 1), spacing=8))
        self.clear()

    def clear(self) -> None:
        """Another trial begins."""
        for trace in (self.error, self.force):
            trace.clear()
        self._show_time(NOTHING)

    def add(self, t: np.ndarray, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH), n > 0, of the movement, and their times since "go" (n,), s."""
        self.force.add(t, np.hypot(rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY])[None])
        self.error.add(t, 1e3 * np.abs(rows[:, tick_log.PATH_DISTANCE])[None])

    def refresh_text(self) -> None:
        """The values of the last tick that was added."""
        for trace in (self.error, self.force):
            trace.show_newest()
        if len(self.error.t):
            self._show_time(f"{self.error.t[-1]:.1f}")

    def rest(self) -> None:
        """The trial is over: its curves and its time stay, and no value is one of now."""
        for trace in (self.error, self.force):
            trace.rest()

    def _show_time(self, seconds: str) -> None:
        self.time.show_parts((seconds, COLOURS.text), ("s", COLOURS.quiet))
