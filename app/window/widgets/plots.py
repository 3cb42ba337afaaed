"""Every plot on screen, by pyqtgraph; here the live ones: traces of the running trial and the loop's lateness.

All of them can be zoomed with the wheel, moved with the mouse and read under the pointer. A live plot follows the
newest tick until it is zoomed or moved; a double click, or the next trial, lets it follow again.

Our choice: pens one pixel wide, without antialiasing or a live grid, either of which takes a whole core at 60 Hz.
"""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QMouseEvent, QPen
from PySide6.QtWidgets import QFrame, QLabel

from app.window.widgets import theme
from app.window.widgets.parts import Figures, Panel, column, row, text_label
from app.window.widgets.theme import COLOURS
from core import tick_log
from core.device import Device
from core.mechanism import JOINTS

WINDOW_S = 6.0  # what a live plot shows while it follows
NOTHING = "–"
HIDDEN = "hidden: the session is blind"
NO_TRIAL = "no trial yet"
STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # round ends of a range, times a power of ten
LEAST_GRAPH_PX = 30  # high: the names of both ends of an axis
AXIS_PX = 40  # wide, of the values at the left


def range_for(value: float, least: float) -> float:
    """The end of a range from 0 that holds a value: `least`, or a round number above it."""
    if not value > least:
        return least
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in STEPS if step * decade >= value * (1.0 - 1e-12))


def start_of_hold(ticks: np.ndarray) -> int:
    """The tick with which the hold before the movement begins: what comes before may be of any length; 0: none."""
    approach = np.flatnonzero(ticks[:, tick_log.PHASE] == tick_log.APPROACH)
    return int(approach[-1] + 1) % len(ticks) if len(approach) else 0


pg.setConfigOptions(mouseRateLimit=0)  # else the last place of a fast pointer is skipped, and what is there not read


def line(colour: str, width: int = 1, alpha: float = 1.0, style: Qt.PenStyle = Qt.PenStyle.SolidLine) -> QPen:
    """A pen of a plot, which is as wide wherever it is zoomed to."""
    return pg.mkPen(theme.shade(colour, alpha), width=width, style=style)


class Graph(pg.PlotWidget):
    """A plot in the colours and the typeface of the screens."""

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.hideButtons()
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        for axis in self._axes():
            axis.setStyle(tickLength=-3, hideOverlappingLabels=False)
            axis.enableAutoSIPrefix(False)
            axis.setStyle(tickFont=theme.font(theme.SMALL))
            axis.label.setFont(theme.font(theme.SMALL))
        self._axes()[0].setWidth(AXIS_PX)
        half = theme.SMALL / 2  # of the words at the ends of the axes, which are not to be cut
        self.getPlotItem().setContentsMargins(0, half, half, half)
        self.setMinimumHeight(LEAST_GRAPH_PX)
        self._colour()
        theme.follow(self._colour)

    def _colour(self) -> None:
        self.setBackground(theme.shade(COLOURS.panel))
        for axis in self._axes():
            axis.setPen(theme.shade(COLOURS.line))
            axis.setTextPen(theme.shade(COLOURS.quiet))

    def _axes(self) -> list[pg.AxisItem]:
        return [self.getPlotItem().getAxis(side) for side in ("left", "bottom")]


class Plot(Panel):
    """A panel with a title, a value at the right of it, and a plot under them."""

    figures_px, figures_bold = theme.NORMAL, False

    def __init__(self, title: QLabel) -> None:
        super().__init__()
        self.title, self.figures = title, Figures(self.figures_px, right=True, bold=self.figures_bold)
        self.graph = Graph()
        self.item = self.graph.getPlotItem()
        self.head = row(self.title, self.figures)
        self.rows = column(self.head, (self.graph, 1), spacing=2, margins=(10, 4, 8, 4))
        self.setLayout(self.rows)
        self._pointer = pg.SignalProxy(self.graph.scene().sigMouseMoved, rateLimit=30, slot=self._pointed)

    def read_at(self, place: QPointF) -> str:
        """What the plot says at a place (in its own units), for the tip at the pointer; "": nothing."""
        return ""

    def show_all(self) -> None:
        """Undo what was zoomed or moved, as a double click does."""

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.show_all()
        super().mouseDoubleClickEvent(event)

    def _pointed(self, moved: tuple) -> None:
        box = self.item.vb
        inside = box.sceneBoundingRect().contains(moved[0])
        self.graph.setToolTip(self.read_at(box.mapSceneToView(moved[0])) if inside else "")


class TimePlot(Plot):
    """A measure over time, one curve or several, drawn as far as it is seen; 0 is at the bottom."""

    padding, alpha = 0.04, 1.0  # of its height; of the colours of its curves
    hidden = False  # the session is blind: neither curve nor value

    def __init__(self, title: str, unit: str, colours: Sequence[str], least: float, digits: int) -> None:
        """least: the end of the scale, at least. digits: of a value, after the point."""
        super().__init__(text_label(title, bold=True))
        self.unit, self.least, self.digits, self.end = unit, least, digits, least
        self.colours = colours
        self.names: Mapping[str, str] = {}  # of several curves, by joint: each value is shown with its name
        self.t, self.values = np.empty(0), np.empty((len(colours), 0))  # s; in the unit, NaN where there is none
        self.item.setDownsampling(auto=True, mode="peak")  # the lowest and highest tick of each pixel: no spike is lost
        self.item.setClipToView(True)
        self._coloured: list[tuple[pg.PlotDataItem, str, float]] = []  # curve, colour, alpha
        self.curves = [self.add_curve(colour, alpha=self.alpha) for colour in colours]
        theme.follow(self.colour)
        self.item.setMouseEnabled(x=True, y=False)
        self.item.getAxis("bottom").tickStrings = lambda values, scale, spacing: [f"{value:g} s" for value in values]

    def add_curve(self, colour: str, per_px: float = 1.0, alpha: float = 1.0) -> pg.PlotDataItem:
        """A curve of so many pieces a pixel, interrupted where there is no value."""
        curve = self.item.plot(pen=line(colour, alpha=alpha), connect="finite", autoDownsampleFactor=per_px)
        self._coloured.append((curve, colour, alpha))
        return curve

    def colour(self) -> None:
        """The palette has changed."""
        for curve, colour, alpha in self._coloured:
            curve.setPen(line(colour, alpha=alpha))

    def show_device(self, device: Device) -> None:
        """Of currents: a curve for each joint of the device that has a brake, in its unit."""
        self.names, self.unit = device.labels, device.command_unit
        self.title.setText(f"Currents, {device.command_unit}")

    def draw(self) -> None:
        """Hand its values to the curves."""
        for curve, series in zip(self.curves, self.values, strict=True):
            curve.setData(self.t, series)
            curve.setVisible(not self.hidden)

    def show_all(self) -> None:
        if len(self.t):
            self.item.setXRange(self.t[0], self.t[-1], padding=0.04)  # room for the last number of the axis

    def scale_to(self, highest: float) -> None:
        """Let the scale end at a round number that holds this value."""
        self.end = range_for(highest, self.least)
        self.item.setYRange(0.0, self.end, padding=self.padding)
        self.item.getAxis("left").setTicks([[(0.0, "0"), (self.end, f"{self.end:g}")]])

    def read_at(self, place: QPointF) -> str:
        if self.hidden:
            return HIDDEN
        k = int(np.searchsorted(self.t, place.x()))
        return f"{self.t[k]:.3f} s: {self.values_at(k)}" if 0 < k < len(self.t) else ""

    def values_at(self, k: int) -> str:
        """The values of a tick, with their names and unit."""
        found = [(joint, value) for joint, value in zip(JOINTS, self.values[:, k], strict=False) if value == value]
        values = (f"{self.names.get(joint, '')} {self.figure(value)} {self.unit}" for joint, value in found)
        return ", ".join(value.strip() for value in values) or NOTHING

    def figure(self, value: float) -> str:
        """A value without its unit."""
        return f"{value:.{self.digits}f}" if value == value else NOTHING


class LivePlot(TimePlot):
    """A measure of the running trial: all of it is kept, the newest seconds are shown."""

    def __init__(self, title: str, unit: str, colours: Sequence[str], least: float, digits: int) -> None:
        super().__init__(title, unit, colours, least, digits)
        self._room = np.empty((1 + len(colours), 8192))  # times and values begin it; what is left, later ones
        self._following = True
        self.item.hideAxis("bottom")
        self.item.getAxis("bottom").setStyle(hideOverlappingLabels=True)  # a number that scrolls out is never cut
        self.item.vb.sigRangeChangedManually.connect(self._stop_following)
        self.clear()

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        """Ticks of the running trial, n > 0: times (n,) s, values (curves, n) in the unit, NaN where there is none."""
        begin, end = len(self.t), len(self.t) + len(t)
        while end > self._room.shape[1]:
            self._room = np.tile(self._room, 2)
        self._room[0, begin:end], self._room[1:, begin:end] = t, values
        self._keep(end)
        self.draw()

    def clear(self) -> None:
        """Begin a new trial: there is nothing to show yet."""
        self._keep(0)
        self.scale_to(self.least)
        self.show_all()

    def _keep(self, count: int) -> None:
        self.t, self.values = self._room[0, :count], self._room[1:, :count]

    def show_all(self) -> None:
        """Follow the newest tick again."""
        self._following = True
        self.draw()

    def draw(self) -> None:
        if self._following:
            now = max(self.t[-1] if len(self.t) else 0.0, WINDOW_S)
            self.item.setXRange(now - WINDOW_S, now, padding=0.0)
        super().draw()

    def _stop_following(self, *_: object) -> None:
        self._following = False


class Trace(LivePlot):
    """A live measure with its newest value beside the title; its scale grows with what comes."""

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        highest = float(np.fmax.reduce(values, axis=None, initial=0.0))
        if highest > self.end:
            self.scale_to(highest)
        super().add(t, values)

    def clear(self) -> None:
        super().clear()
        self.show_newest()

    @property
    def newest(self) -> tuple[float, ...]:
        return tuple(self.values[:, -1].tolist()) if len(self.t) else ()

    def show_newest(self) -> None:
        """The newest value beside the title, or each with its name."""
        self._show_values(self.newest)

    def rest(self) -> None:
        """The trial is over: its curve stays, and no value is one of now."""
        self._show_values(())

    def _show_values(self, values: tuple[float, ...]) -> None:
        """(): none."""
        values = values or (math.nan,) * len(self.curves)
        if not self.names:
            self.figures.show_parts((self.figure(values[0]), COLOURS.text), (self.unit, COLOURS.quiet))
            return
        named = [
            (f"{self.names[name]} {self.figure(value)}", theme.as_text(colour))
            for name, value, colour in zip(JOINTS, values, self.colours, strict=True) if name in self.names
        ]  # fmt: skip
        self.figures.show_parts(*named)


def currents_of(rows: np.ndarray, braked: Collection[str]) -> np.ndarray:
    """The currents (4, n), A, of the joints in the order A, E, B, C; NaN for one without a brake."""
    has_brake = np.array([joint in braked for joint in JOINTS])
    return np.where(has_brake[:, None], rows[:, tick_log.CURRENT : tick_log.CURRENT + 4].T, math.nan)


class TimingStrip(LivePlot):
    """How late each tick of the movement comes, on a logarithmic scale."""

    LEAST_US, DECADES = 1.0, 4.0  # the scale: 1 us at the bottom, 10 ms at the top
    LATE_US = 100.0  # a point in the colour of a caution from here on; red: the tick was missed

    def __init__(self) -> None:
        self.late = pg.ScatterPlotItem(size=5, pen=None)
        super().__init__("Ticks late, µs", "", [COLOURS.good], self.DECADES, 0)
        self.item.addItem(self.late)

    def add_ticks(self, t: np.ndarray, lateness: np.ndarray) -> None:
        """Times (n,), s, and lateness (n,), us, of ticks."""
        share = np.clip(np.log10(np.maximum(lateness, self.LEAST_US)), 0.0, self.DECADES)
        late = lateness >= self.LATE_US
        if late.any():
            colours = [COLOURS.bad if us >= tick_log.MISSED_US else COLOURS.caution for us in lateness[late]]
            brushes = [theme.shade(colour) for colour in colours]
            self.late.addPoints(x=t[late], y=share[late], data=colours, brush=brushes)
        self.add(t, share[None])

    def colour(self) -> None:
        super().colour()
        self.late.setBrush([theme.shade(point.data()) for point in self.late.points()])

    def clear(self) -> None:
        self.late.clear()
        super().clear()

    def read_at(self, place: QPointF) -> str:
        return f"{10.0 ** place.y():.0f} µs"

    def scale_to(self, highest: float) -> None:
        """Keep the scale: it is always the same."""
        self.end = self.DECADES
        self.item.setYRange(0.0, self.DECADES, padding=self.padding)
        self.item.getAxis("left").setTicks([[(0.0, "1"), (4.0, "10⁴")]])
