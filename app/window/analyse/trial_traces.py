"""The curves of a whole trial, one above the other, with one axis of time and one cursor."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from app.window.widgets import theme
from app.window.widgets.parts import column
from app.window.widgets.plots import HIDDEN, TimePlot, currents_of, line, start_of_hold
from app.window.widgets.theme import COLOURS
from core import tick_log
from core.mechanism import JOINTS
from experiments.study.playback import Comparison, Playback

BESIDE = COLOURS.wedge  # the colour of the hand through another controller
DUTY_S = 0.05  # currents are read over so much time about the cursor: they chatter at 1 kHz
BAND = 0.22  # how much of its colour the envelope of a current has
NONE = np.empty(0), np.empty(0)  # no times (n,) s, no values (n,)


class TrialTrace(TimePlot):
    """A measure over a trial; the other controller's beside it. A click asks for the cursor."""

    asked = Signal(float)  # s
    padding = 0.12

    def __init__(self, title: str, unit: str, colours: Sequence[str], least: float, digits: int) -> None:
        super().__init__(title, unit, colours, least, digits)
        self.beside = self.add_curve(BESIDE)
        self.marker = pg.InfiniteLine(movable=True, pen=line(COLOURS.handle), hoverPen=line(COLOURS.accent))
        self.marker.sigDragged.connect(lambda line: self.asked.emit(float(line.value())))
        self.item.addItem(self.marker, ignoreBounds=True)
        self.graph.scene().sigMouseClicked.connect(self._clicked)

    def colour(self) -> None:
        super().colour()
        self.marker.setPen(line(COLOURS.handle))
        self.marker.setHoverPen(line(COLOURS.accent))

    def show_trial(self, t: np.ndarray, values: np.ndarray) -> None:
        """Times (n,) s and values (curves, n) in the unit, NaN where there is none."""
        self.t, self.values = t, values
        self.draw()
        self.show_beside(*NONE)

    def show_beside(self, t: np.ndarray, values: np.ndarray) -> None:
        """The same of the other controller: values (n,)."""
        self.beside.setData(t, values)
        self.scale_to(max(float(np.nanmax(series, initial=0.0)) for series in (self.values, values)))

    def show_cursor(self, at: int) -> None:
        """The cursor stands at a tick, whose value is beside the title."""
        self.marker.setValue(self.t[at])
        self.show_value(at)

    def show_value(self, at: int) -> None:
        self.figures.show_parts((self.figure(self.values[0, at]), COLOURS.text), (self.unit, COLOURS.quiet))

    def _clicked(self, event: MouseClickEvent) -> None:
        place = self.item.vb.mapSceneToView(event.scenePos())
        if event.button() == Qt.MouseButton.LeftButton and not event.double():
            self.asked.emit(float(place.x()))


class CurrentTrace(TrialTrace):
    """The current of each brake: its mean as a line, over a faint band from its lowest to its highest tick."""

    alpha = BAND
    figures_px = theme.SMALL  # whatever they are: else their size would change while the trial plays

    def __init__(self) -> None:
        super().__init__("Currents", "A", [theme.JOINT[joint] for joint in JOINTS], 1.0, 2)
        self.rows.insertWidget(1, self.figures)  # of four brakes: they need the whole width
        self.graph.setMinimumHeight(58)  # with the axis of time
        self.means = [self.add_curve(theme.JOINT[joint], per_px=0.5) for joint in JOINTS]
        for mean in self.means:
            mean.setDownsampling(method="mean")  # now that it is added: a plot gives what is added its own method

    def show_value(self, at: int) -> None:
        if self.hidden:
            self.figures.show_parts((HIDDEN, COLOURS.quiet))
            return
        near = np.abs(self.t - self.t[at]) <= 0.5 * DUTY_S
        parts = []
        for joint, current in zip(JOINTS, self.values[:, near], strict=True):
            if current[0] == current[0]:
                duty = 100.0 * np.count_nonzero(current) / current.size
                on = f" on {duty:.0f} %" if duty else ""
                parts.append((f"{self.names[joint]} {current.max():.2f}{on}", theme.as_text(theme.JOINT[joint])))
        self.figures.show_parts(*parts)
        self.figures.setToolTip(f"Largest current and share of the time with current, in {DUTY_S} s about the cursor")

    def draw(self) -> None:
        super().draw()
        for mean, current in zip(self.means, self.values, strict=True):
            mean.setData(self.t, current)
            mean.setVisible(not self.hidden)


class TrialTraces(QWidget):
    """Path error, tip force and currents of one trial."""

    asked = Signal(float)  # s: the cursor is to go there

    def __init__(self) -> None:
        super().__init__()
        self._began_s = 0.0  # of the trial's first tick in its recording
        self.error = TrialTrace("Path error", "mm", [COLOURS.trace], 2.0, 1)
        self.force = TrialTrace("Tip force", "N", [COLOURS.good], 4.0, 1)
        self.currents = CurrentTrace()
        self.all = (self.error, self.force, self.currents)
        self.setLayout(column((self.error, 3), (self.force, 3), (self.currents, 4)))
        for trace in self.all:
            trace.asked.connect(self.asked)
            trace.item.showAxis("bottom", trace is self.currents)  # it has the axis of time
        for trace in (self.force, self.currents):
            trace.item.setXLink(self.error.item)

    def show_trial(self, trial: Playback) -> None:
        ticks, t = trial.ticks, trial.t
        self._began_s = float(ticks[0, tick_log.T])
        self.error.show_trial(t, 1e3 * trial.error[None])
        self.force.show_trial(t, np.hypot(ticks[:, tick_log.HAND_FX], ticks[:, tick_log.HAND_FY])[None])
        self.currents.show_device(trial.device)
        self.currents.hidden = trial.blind
        self.currents.show_trial(t, currents_of(ticks, trial.device.braked))
        # with room for the last number of the axis; a double click shows all
        self.error.item.setXRange(t[start_of_hold(ticks)], t[-1], padding=0.03)

    def show_beside(self, other: Comparison | None) -> None:
        """The same hand through another controller."""
        if other is None:
            self.error.show_beside(*NONE)
            self.force.show_beside(*NONE)
            return
        t = other.ticks[:, tick_log.T] - self._began_s
        self.error.show_beside(t, 1e3 * other.error)
        self.force.show_beside(t, np.hypot(other.ticks[:, tick_log.HAND_FX], other.ticks[:, tick_log.HAND_FY]))

    def show_cursor(self, at: int) -> None:
        for trace in self.all:
            trace.show_cursor(at)
