"""Live traces of the running trial: path error, hand force, brake currents, tip speed, each with its value now."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRect, QRectF
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.window.painting import theme
from app.window.painting.layers import errors
from app.window.painting.panel import CENTRE, HEAD, LEFT, PAD, RIGHT, WORDS_EVERY_S, Panel
from app.window.painting.strip import Strip, range_for
from app.window.painting.theme import font, shade, text_width
from core import tick_log
from core.device import Device
from core.mechanism import JOINTS
from core.path_file import PathFile, build_path

JOINT_COLOURS = theme.JOINT
NOTHING = "–"
HIDDEN = "hidden: the session is blind"


class Trace(Panel):
    """One measure over the last seconds, from 0 to a range that steps up when it must."""

    def __init__(
        self, title: str, unit: str, colours: Sequence[str], least: float, digits: int, parent: QWidget | None = None
    ) -> None:
        super().__init__(title, parent)
        self._least, self._digits, self._measured_in = least, digits, unit
        self.strip = Strip(colours, least)
        self.newest: tuple[float, ...] = ()
        self._worded_s = -np.inf
        self.hidden = False
        self.setMinimumHeight(74)
        self.clear()

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        """Ticks: times (n,) s, values (series, n) in the unit, NaN where there is none."""
        if not len(t):
            return
        self.newest = tuple(values[:, -1].tolist())
        highest = float(np.fmax.reduce(values, axis=None))
        if highest > self.strip.end:
            self.strip.set_range(range_for(highest, self._least))
            self.repaint_still()
        if self.strip.add(t, values) and not self.hidden:
            self.update(self.plot.toAlignedRect())
        if t[-1] >= self._worded_s + WORDS_EVERY_S or t[-1] < self._worded_s:
            self._worded_s = float(t[-1])
            self.show_newest()

    def clear(self) -> None:
        """A new trial: nothing to show yet."""
        self.newest, self._worded_s = (), -np.inf
        if self.strip.end != self._least:
            self.strip.end = self._least
            self.repaint_still()
        self.strip.clear()
        self.show_newest()
        self.update()

    def hide_values(self, hidden: bool) -> None:
        """Blind: neither curve nor value."""
        if hidden != self.hidden:
            self.hidden = hidden
            self.show_newest()
            self.repaint_still()

    def show_newest(self) -> None:
        """The value beside the title."""
        known = self.newest and not self.hidden and self.newest[0] == self.newest[0]
        self.show_value(f"{self.newest[0]:.{self._digits}f}" if known else NOTHING, self._measured_in)

    def paint_still(self, painter: QPainter) -> None:
        if self.hidden:
            painter.setFont(font(theme.SMALL))
            painter.setPen(shade(theme.QUIET))
            painter.drawText(self.inside, CENTRE, HIDDEN)
            return
        self._fit()
        painter.setFont(font(theme.SMALL))
        painter.setPen(shade(theme.QUIET))
        for share in (0.0, 1.0):
            value = share * self.strip.end
            y = self.plot.y() + self.strip.y(value) / self.devicePixelRatioF()
            self.paint_scale(painter, y, f"{value:g}")

    def _fit(self) -> None:
        plot = self.plot
        self.strip.fit(plot.width(), plot.height(), self.devicePixelRatioF())

    def covers(self, dirty: QRect) -> bool:
        return not self.hidden and self.plot.contains(QRectF(dirty))

    def paint_moving(self, painter: QPainter, dirty: QRect) -> None:
        plot = self.plot
        if self.hidden or not dirty.intersects(plot.toAlignedRect()):
            return
        self._fit()
        pixmap = self.strip.pixmap
        painter.drawPixmap(plot, pixmap, QRectF(pixmap.rect()))


class Currents(Trace):
    """The current of each brake, named in its colour."""

    def __init__(self, braked: str, parent: QWidget | None = None) -> None:
        self.braked = braked
        super().__init__("Brake currents", "A", [JOINT_COLOURS[joint] for joint in braked], 1.0, 2, parent)

    def show_newest(self) -> None:
        if self.newest and not self.hidden:
            words = [f"{joint} {value:.2f}" for joint, value in zip(self.braked, self.newest, strict=True)]
        else:
            words = [f"{joint} {NOTHING}" for joint in self.braked]
        self.words = words
        self.show_value(" ".join(words), "A")

    def _paint_value(self, painter: QPainter) -> None:
        """From the right: the unit, and each brake's letter and value behind a point in its colour."""
        y = 0.5 * (HEAD + 2.0)
        painter.setFont(font(theme.SMALL))
        painter.setPen(shade(theme.QUIET))
        painter.drawText(QRectF(PAD, 2.0, self.width() - 2.0 * PAD, HEAD - 2.0), RIGHT, "A")
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        x = self.width() - PAD - text_width("A", theme.SMALL)
        each = text_width("A 0.00", theme.SMALL) + 17.0
        for joint, said in reversed(list(zip(self.braked, self.words, strict=True))):
            x -= each
            painter.setBrush(shade(JOINT_COLOURS[joint]))
            painter.setPen(shade(JOINT_COLOURS[joint]))
            painter.drawEllipse(QPointF(x, y), 3.0, 3.0)
            painter.setPen(shade(theme.TEXT))
            painter.drawText(QRectF(x + 7.0, 2.0, each, HEAD - 2.0), LEFT, said)


class Traces(QWidget):
    """The four traces, one above the other."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.error = Trace("Path error", "mm", [theme.TRACE], 10.0, 1)
        self.force = Trace("Hand force", "N", [theme.GOOD], 10.0, 1)
        self.currents = Currents("AEB")
        self.speed = Trace("Tip speed", "m/s", [theme.TEXT], 0.2, 2)
        self._path = None
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(theme.GAP)
        for trace in (self.error, self.force, self.currents, self.speed):
            layout.addWidget(trace, 1)

    def show_trial(self, device: Device, path: PathFile) -> None:
        """Another trial: its brakes, its path; the curves begin anew."""
        self._path = build_path(path, "path")
        if device.braked != self.currents.braked:
            anew = Currents(device.braked)
            anew.hide_values(self.currents.hidden)
            self.layout().replaceWidget(self.currents, anew)
            self.currents.setParent(None)
            self.currents.deleteLater()
            self.currents = anew
            self.layout().setStretchFactor(anew, 1)
        self.clear()

    def clear(self) -> None:
        """Nothing to show yet."""
        for trace in (self.error, self.force, self.currents, self.speed):
            trace.clear()

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, tick_log.WIDTH) of the running trial; the error counts from go to the end."""
        if not len(rows):
            return
        t = rows[:, tick_log.T]
        self.force.add(t, np.hypot(rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY])[None])
        self.speed.add(t, np.hypot(rows[:, tick_log.TIP_VX], rows[:, tick_log.TIP_VY])[None])
        columns = [tick_log.CURRENT + JOINTS.index(joint) for joint in self.currents.braked]
        self.currents.add(t, rows[:, columns].T)
        error = np.full(len(rows), np.nan)
        if self._path is not None:
            errors(self._path, np.ascontiguousarray(rows), error)
        self.error.add(t, 1e3 * error[None])

    def set_blind(self, blind: bool) -> None:
        """Hide what would tell the controllers apart."""
        self.currents.hide_values(blind)
