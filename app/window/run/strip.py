"""The strip under the workspace: while a trial runs its currents, speed, lateness and energy in a line each, which
open to curves; between two trials how far the session is; the plan; and what is wrong, in the place of all that."""

import numpy as np
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QPushButton

from app.ipc import messages as m
from app.window.run.energy import Ledger, Parts
from app.window.run.plan_bar import PlanBar
from app.window.widgets import theme
from app.window.widgets.parts import (
    NO_FOCUS,
    PART,
    Figures,
    OneLine,
    Panel,
    column,
    holder,
    row,
    stack,
)
from app.window.widgets.plots import NOTHING, TimingStrip, Trace, currents_of
from app.window.widgets.preflight import Banner, wrong
from app.window.widgets.theme import COLOURS, text_width
from app.window.widgets.words import LACKING, minutes, to_go
from core import tick_log
from core.device import Device
from core.mechanism import JOINTS
from experiments.analysis.punctuality import Punctuality
from experiments.store.cells import finished_cells

BASE_PX, CURVES_PX, OPEN_PX = 66, 150, 30  # high: the lines, the curves, the button


class Strip(Panel):
    """Lines that open to curves. `curves` is what opens."""

    def __init__(self) -> None:
        super().__init__()
        self.ledger = Ledger()
        colours = [theme.JOINT[joint] for joint in JOINTS]
        self.currents = Trace("Currents", "A", colours, 1.0, 2)
        self.speed = Trace("Tip speed", "m/s", [COLOURS.text], 0.2, 2)
        self.timing, self.late = TimingStrip(), Punctuality()
        for plot in (self.currents, self.speed, self.timing):
            plot.setObjectName("clear")
            plot.item.showAxis("bottom")
        plots = row((self.currents, 1), (self.speed, 1), (self.timing, 1), spacing=theme.GAP)
        self.curves = holder(plots)
        self.curves.setFixedHeight(CURVES_PX)
        self.curves.hide()
        self.figures, self.progress = Figures(theme.NORMAL), OneLine("", "", theme.NORMAL)
        self.plan, self.banner = PlanBar(), Banner()
        self.open = QPushButton("Details  ▴", objectName="small", checkable=True, focusPolicy=NO_FOCUS)
        self.open.setFixedHeight(OPEN_PX)
        self.open.toggled.connect(self._unfold)
        self._opened_by_itself = False  # in this trial
        self._lines = stack(holder(row(self.progress)), holder(row(self.figures)))
        self._lines.setFixedHeight(OPEN_PX)
        line = holder(column(row((self._lines, 1), self.open), self.plan, spacing=2))
        self._base = stack(line, self.banner)
        self._base.setFixedHeight(BASE_PX)
        self.setLayout(column(self.curves, self._base, spacing=6, margins=(14, 8, 14, 10)))

    def _unfold(self, unfolded: bool) -> None:
        self.curves.setVisible(unfolded)
        self._show_lines()
        self.open.setText("Details  ▾" if unfolded else "Details  ▴")

    # what the session says

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        self.plan.show_session(opened, snapshot)
        done, lacking = map(len, finished_cells(snapshot.rows))
        left = len(opened.plan) - done
        so_far = to_go(left, len(opened.plan), lacking) if opened.participant else ""
        self.progress.setText(PART.join(filter(None, (so_far, minutes(snapshot.seconds_left) if left else ""))))
        self.progress.setToolTip(LACKING if lacking else "")
        self.banner.show_text(said := wrong(snapshot))
        self._base.setCurrentIndex(int(bool(said)))
        self._lines.setCurrentIndex(int(snapshot.running is not None))
        if snapshot.running is not None and any(c.name == "Loop" and c.state == m.BAD for c in snapshot.checks):
            self._unfold_by_itself()

    def _unfold_by_itself(self) -> None:
        """Something is wrong with the running trial that the curves show; once a trial, for it may be closed again."""
        if not self._opened_by_itself:
            self._opened_by_itself = True
            self.open.setChecked(True)

    def set_blind(self, blind: bool) -> None:
        """Leave out what would tell the controllers apart."""
        self.currents.setHidden(blind)

    # what the ticks of a trial say

    def show_trial(self, device: Device) -> None:
        """Another trial begins."""
        self.currents.show_device(device)
        self._opened_by_itself = False
        self.clear()

    def clear(self) -> None:
        self.ledger, self.late = Ledger(), Punctuality()
        for plot in (self.currents, self.speed, self.timing):
            plot.clear()
        self.refresh_text()

    def balance(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH), n > 0, of the running trial."""
        self.ledger.add(rows)
        self.late = self.late.plus(rows)
        if self.ledger.is_violated:
            self._unfold_by_itself()

    def add(self, t: np.ndarray, rows: np.ndarray) -> None:
        """As `Live.add`."""
        self.speed.add(t, np.hypot(rows[:, tick_log.TIP_VX], rows[:, tick_log.TIP_VY])[None])
        self.currents.add(t, currents_of(rows, self.currents.names))
        self.timing.add_ticks(t, rows[:, tick_log.LATENESS_US])

    def rest(self) -> None:
        """The trial is over."""
        for trace in (self.currents, self.speed):
            trace.rest()

    def refresh_text(self) -> None:
        """The values of the last tick that was added."""
        for trace in (self.currents, self.speed):
            trace.show_newest()
        self._show_lines()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._show_lines()

    def _show_lines(self) -> None:
        """In a line each what no curve shows; where none is shown, speed and currents too."""
        unfolded = not self.curves.isHidden()
        colour = COLOURS.text if self.late.usable else COLOURS.caution
        in_time = "in time since go" if self.late.ticks else NOTHING
        lines: list[Parts] = [[("Loop", COLOURS.quiet), (self.late.words or in_time, colour)]]
        if not unfolded:
            speed = self.speed.figures.parts[0]
            lines.append([("Speed", COLOURS.quiet), speed, ("m/s", COLOURS.quiet)])
        if not self.currents.isHidden():
            if not unfolded:
                lines.append([(f"Currents, {self.currents.unit}:", COLOURS.quiet), *self.currents.figures.parts])
            energy = self.ledger.whole if unfolded else self.ledger.short
            lines.append([("Energy", COLOURS.quiet), *energy])
        self.figures.show_parts(*self._fitting(lines))

    def _fitting(self, lines: list[Parts]) -> Parts:
        """As many of the lines as have room side by side."""
        shown: Parts = []
        for line in lines:
            longer = [*shown, *([("·", COLOURS.quiet)] if shown else []), *line]
            if text_width(" ".join(text for text, _ in longer), theme.LEAST_PX) > self.figures.width():
                break
            shown = longer
        return shown
