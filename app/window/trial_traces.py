"""The curves of a whole trial, one above the other, with one axis of time and one cursor."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.window.painting import theme
from app.window.plots import HIDDEN, NOTHING, Plot, envelope, range_for
from core import tick_log
from core.mechanism import JOINTS
from experiments.session.playback import Beside, Playback

BESIDE = theme.WEDGE  # the colour of the hand through another controller
DUTY_S = 0.05  # currents are read over so much time about the cursor: they chatter at 1 kHz
BAND = 0.22  # how much of its colour the envelope of a current has


class TrialTrace(Plot):
    """One measure over a trial; the other controller's beside it. A click says where the cursor is to go."""

    asked = Signal(float)  # s

    def __init__(self, title: str, unit: str, colour: str, least: float, digits: int) -> None:
        super().__init__(title)
        self._unit, self._least, self._digits = unit, least, digits
        self.t, self.values = np.empty(0), np.empty(0)
        self._beside = np.empty(0), np.empty(0)
        self._colour = colour
        self.curve = self.item.plot(pen=pg.mkPen(colour, width=1), connect="finite")
        self.curve_beside = self.item.plot(pen=pg.mkPen(BESIDE, width=1), connect="finite")
        pens = (pg.mkPen(colour, width=1) for colour in (theme.HANDLE, theme.ACCENT))
        self.cursor = pg.InfiniteLine(movable=True, **dict(zip(("pen", "hoverPen"), pens, strict=True)))
        self.cursor.sigDragged.connect(lambda line: self.asked.emit(float(line.value())))
        self.item.addItem(self.cursor, ignoreBounds=True)
        self.item.setMouseEnabled(x=True, y=False)
        self.item.vb.sigXRangeChanged.connect(lambda *_: self.draw())
        self.graph.scene().sigMouseClicked.connect(self._clicked)
        self.graph.setMinimumHeight(36)

    def show_trial(self, t: np.ndarray, values: np.ndarray) -> None:
        """Times (n,) s and values (n,) in the unit, NaN where there is none."""
        self.t, self.values, self._beside = t, values, (np.empty(0), np.empty(0))
        self._scale()

    def show_beside(self, t: np.ndarray, values: np.ndarray) -> None:
        """The same of the other controller."""
        self._beside = t, values
        self._scale()

    def show_cursor(self, at: int) -> None:
        """The cursor stands at a tick."""
        self.cursor.setValue(self.t[at])
        self.show_value(at)

    def show_value(self, at: int) -> None:
        """The value at a tick, beside the title."""
        value = self.values[at]
        figure = f"{value:.{self._digits}f}" if value == value else NOTHING
        self.figures.show_parts((figure, theme.TEXT), (self._unit, theme.QUIET))

    def draw(self) -> None:
        """What is seen of it now, at most two points a pixel."""
        for curve, (t, values) in ((self.curve, (self.t, self.values)), (self.curve_beside, self._beside)):
            seen, bin_s = self._seen(t)
            times, found = envelope(t[seen], values[seen][None], bin_s)
            curve.setData(times, found[0])

    def _seen(self, t: np.ndarray) -> tuple[slice, float]:
        begin, end = self.item.viewRange()[0]
        first, last = np.searchsorted(t, (begin, end))
        return slice(max(int(first) - 1, 0), int(last) + 1), (end - begin) / max(self.graph.width(), 1)

    def _scale(self) -> None:
        highest = max((float(np.nanmax(v, initial=0.0)) for v in (self.values, self._beside[1])), default=0.0)
        end = range_for(highest, self._least)
        self.item.setYRange(0.0, end, padding=0.12)
        self.item.getAxis("left").setTicks([[(0.0, "0"), (end, f"{end:g}")]])
        self.draw()

    def _clicked(self, event) -> None:
        place = self.item.vb.mapSceneToView(event.scenePos())
        if event.button() == Qt.MouseButton.LeftButton and not event.double():
            self.asked.emit(float(place.x()))


class CurrentTrace(TrialTrace):
    """The current of each brake: its mean, as a line, within its envelope, as a band. A chatter is no solid block."""

    def __init__(self, braked: str) -> None:
        super().__init__("Currents", "A", theme.QUIET, 1.0, 2)
        self.braked, self.hidden = braked, False
        self.means, self.bands = [], []
        for joint in braked:
            ends = [pg.PlotDataItem(pen=None) for _ in range(2)]
            band = pg.FillBetweenItem(*ends, brush=theme.colour(theme.JOINT[joint], BAND))
            self.item.addItem(band)
            self.bands.append(ends)
            self.means.append(self.item.plot(pen=pg.mkPen(theme.JOINT[joint], width=1)))
        self.currents = np.empty((len(braked), 0))

    def show_currents(self, t: np.ndarray, currents: np.ndarray, hidden: bool) -> None:
        """Times (n,) s, currents (brakes, n) A. hidden: the session is blind."""
        self.currents, self.hidden = currents, hidden
        self.show_trial(t, currents.max(axis=0, initial=0.0))

    def show_value(self, at: int) -> None:
        if self.hidden:
            self.figures.show_parts((HIDDEN, theme.QUIET))
            return
        near = np.abs(self.t - self.t[at]) <= 0.5 * DUTY_S
        parts = []
        for joint, current in zip(self.braked, self.currents[:, near], strict=True):
            duty = 100.0 * np.count_nonzero(current) / current.size
            parts.append((f"{joint} {current.max():.2f} A {duty:.0f} %", theme.JOINT[joint]))
        self.figures.show_parts(*parts)
        self.figures.setToolTip(f"Largest current and share of the time with current, in {DUTY_S} s about the cursor")

    def draw(self) -> None:
        seen, bin_s = self._seen(self.t)
        t = self.t[seen]
        if self.hidden or not len(t):
            starts = np.empty(0, dtype=int)
        else:
            starts = np.flatnonzero(np.diff(np.floor(t / max(2.0 * bin_s, 0.002)), prepend=-1.0))
        sizes = np.diff(starts, append=len(t))
        for current, ends, mean in zip(self.currents[:, seen], self.bands, self.means, strict=True):
            if not len(starts):
                for curve in (*ends, mean):
                    curve.setData([], [])
                continue
            ends[0].setData(t[starts], np.minimum.reduceat(current, starts))
            ends[1].setData(t[starts], np.maximum.reduceat(current, starts))
            mean.setData(t[starts], np.add.reduceat(current, starts) / sizes)


class TrialTraces(QWidget):
    """Path error, hand force and currents of one trial."""

    asked = Signal(float)  # s: the cursor is to go there

    def __init__(self) -> None:
        super().__init__()
        self.error = TrialTrace("Path error", "mm", theme.TRACE, 2.0, 1)
        self.force = TrialTrace("Hand force", "N", theme.GOOD, 4.0, 1)
        self.currents: CurrentTrace | None = None
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        for trace in (self.error, self.force):
            layout.addWidget(trace, 1)
            trace.asked.connect(self.asked)
            trace.item.hideAxis("bottom")
        self.force.item.setXLink(self.error.item)

    def all(self) -> Sequence[TrialTrace]:
        """From top to bottom."""
        return tuple(t for t in (self.error, self.force, self.currents) if t is not None)

    def show_trial(self, trial: Playback) -> None:
        """Another trial, all of it."""
        ticks, t = trial.ticks, trial.t
        self._put_currents(trial.device.braked)
        self.error.show_trial(t, 1e3 * trial.error)
        self.force.show_trial(t, np.hypot(ticks[:, tick_log.HAND_FX], ticks[:, tick_log.HAND_FY]))
        columns = [tick_log.CURRENT + JOINTS.index(joint) for joint in trial.device.braked]
        self.currents.show_currents(t, ticks[:, columns].T, trial.blind)
        self._end = float(t[-1])
        self.show_all()

    def show_beside(self, other: Beside | None, began_s: float) -> None:
        """The same hand through another controller; began_s: time of the trial's first tick in its recording."""
        ticks = other.ticks if other is not None else np.empty((0, tick_log.WIDTH))
        t = ticks[:, tick_log.T] - began_s
        self.error.show_beside(t, 1e3 * other.error if other is not None else np.empty(0))
        self.force.show_beside(t, np.hypot(ticks[:, tick_log.HAND_FX], ticks[:, tick_log.HAND_FY]))

    def show_all(self) -> None:
        """Zoom out to the whole trial."""
        self.error.item.setXRange(0.0, self._end, padding=0.01)

    def show_cursor(self, at: int) -> None:
        """The cursor stands at a tick."""
        for trace in self.all():
            trace.show_cursor(at)

    def mouseDoubleClickEvent(self, event) -> None:
        self.show_all()
        super().mouseDoubleClickEvent(event)

    def _put_currents(self, braked: str) -> None:
        if self.currents is not None and self.currents.braked == braked:
            return
        if self.currents is not None:
            self.currents.setParent(None)
            self.currents.deleteLater()
        self.currents = CurrentTrace(braked)
        self.currents.asked.connect(self.asked)
        axis = self.currents.item.getAxis("bottom")
        axis.tickStrings = lambda values, scale, spacing: [f"{value:g} s" for value in values]
        self.currents.item.setXLink(self.error.item)
        self.layout().insertWidget(2, self.currents, 2)  # with the axis of time
