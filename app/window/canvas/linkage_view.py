"""The linkage on the plane: arms, brakes in the colour of what they do, forces, layers on demand."""

from collections.abc import Mapping, Sequence

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QPainter

from app.window.canvas import layers, marks
from app.window.canvas.force_view import FORCES, INSET, LINKAGE, TRAIL, ForceView, Layered
from app.window.canvas.path_marks import AT_DESK
from app.window.canvas.small_view import ARM_PX
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, font, pen, shade, text_width, write, write_from
from core import tick_log
from core.device import Device
from core.path import Path, PathFile, build_path

FIELD, DIRECTIONS, REACHABLE = "desired directions", "directions of the brakes", "forces of the brakes"
NEAR_M = 0.02  # around the paths
NEEDLE_M, NEEDLE_PX = 0.02, 16.0  # between the needles of the field: at least so much of both
TOP_PX, LINE_PX = 36.0, 26.0  # high: what is kept clear above, and the line there
FOOT_PX, EDGE_PX = 30.0, 20.0  # high, the line below; clear at the sides
SCALE_M, SCALE_NAME = 0.05, "5 cm"  # of the bar that shows the scale
LEGEND_PX, SAMPLE_PX, BESIDE_RING_PX = 20.0, 18.0, 6.0  # high, a line of the legend; wide, its sample; a word's gap
#: layer -> what its marks mean
LEGENDS = {
    FIELD: "desired direction of motion",
    DIRECTIONS: "motion that one locked brake leaves; bold: the controller's choice",
    REACHABLE: "forces that the brakes can exert now",
}
ASSUMED = "device numbers assumed"
SAMPLE_WEDGE = layers.Wedge(-0.5, 0.5, (-0.5, 0.5))
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter


class LinkageView(ForceView):
    """The linkage of a device on its path, the forces, and what is laid over them."""

    def __init__(self) -> None:
        super().__init__(QRectF(-0.2, 0.2, 0.4, 0.3), QMarginsF(EDGE_PX, TOP_PX, EDGE_PX, FOOT_PX), AT_DESK)
        self._assumed = False  # some parameters of the device
        self._path: Path | None = None  # of the trial
        self.shown = {TRAIL, LINKAGE, FORCES}
        self.line = ""
        self.sense = 1.0  # of travel
        self.under_path = [self._paint_needles, self._paint_scale, *self.under_path]
        self.under_handle = self.of_instant(
            self._paint_wedge, self._paint_arms, self._paint_directions, self._paint_joints, self._paint_states,
            self.paint_forces,
        )  # fmt: skip
        self.over_handle = [*self.of_instant(self._paint_legend), self._paint_line]
        self.words_kept_clear = True
        self.fit()

    def show_places(self, devices: Sequence[Device], paths: Mapping[int, PathFile]) -> None:
        """Other devices and paths decide the scale; nothing is drawn of them before a trial."""
        self._assumed, self._path, self.instant = devices[0].assumed, None, None
        self.show_handle(None)
        self.show_pointer(None)
        self.show_path(None)
        self.set_extent(layers.extent_of_paths(paths.values(), NEAR_M))

    def show_trial(self, device: Device, path: PathFile, tip: layers.Point) -> None:
        self._path, self.sense, self._assumed = build_path(path, "path"), 1.0, device.assumed
        super().show_trial(device, path, tip)

    def _rest(self, device: Device, tip: layers.Point) -> None:
        self.show_line("")
        super()._rest(device, tip)

    def add(self, rows: np.ndarray, taken: bool | None = None, read_from: int = 0) -> None:
        if rows[-1, tick_log.TRAVEL_SENSE] != self.sense:
            self.sense = float(rows[-1, tick_log.TRAVEL_SENSE])
            self.repaint_still()
        super().add(rows, taken, read_from)

    def show_line(self, line: str) -> None:
        """Write the line above the drawing."""
        self.line = line
        self.update()

    @property
    def whole_in_corner(self) -> bool:
        return INSET in self.shown

    # painting

    def _paint_needles(self, painter: QPainter) -> None:
        if self._path is not None and self.instant is not None and FIELD in self.shown:
            step = max(NEEDLE_M, NEEDLE_PX / self.scale)
            low, high = (
                self.to_plane(self.field.bottomLeft()),
                self.to_plane(self.field.topRight()),
            )
            found = layers.needles(self._path, self.sense, self.instant.device, low, high, step)
            marks.paint_field(painter, self.pixels(found[:, :2]), found[:, 2:] * (1.0, -1.0), step * self.scale)

    def _paint_scale(self, painter: QPainter) -> None:
        """A bar of a known length, and whether parameters of the device are assumed."""
        if self._path is None:
            return
        wide, low = self.scale * SCALE_M, self.height() - 9.0
        left = QPointF(0.5 * (self.width() - wide), low)
        painter.setPen(pen(COLOURS.quiet, 1.5))
        painter.drawLine(left, left + QPointF(wide, 0.0))
        write(painter, left + QPointF(0.5 * wide, -10.0), SCALE_NAME, theme.SMALL, False, COLOURS.quiet)
        if self._assumed:
            write_from(painter, QPointF(EDGE_PX, low - 6.0), ASSUMED, theme.SMALL, False, COLOURS.quiet)

    def _paint_wedge(self, painter: QPainter, now: layers.Instant) -> None:
        if REACHABLE in self.shown and not self.blind and (wedge := now.reachable()):
            marks.paint_wedge(painter, self.to_screen(now.tip), wedge)

    def _paint_arms(self, painter: QPainter, now: layers.Instant) -> None:
        marks.paint_arms(painter, self._joints(now), ARM_PX, 2.0)

    def _paint_directions(self, painter: QPainter, now: layers.Instant) -> None:
        if LINKAGE in self.shown and now.joints and DIRECTIONS in self.shown and self._path is not None:
            field = now.field or layers.field_at_rest(self._path, now.tip, self.sense)
            found = layers.directions(now.device, now.g, field)
            marks.paint_directions(painter, self.to_screen(now.tip), found, field, now.device.labels)

    def _paint_joints(self, painter: QPainter, now: layers.Instant) -> None:
        marks.paint_joints(painter, self._rings(now), now.device.labels, None if self.blind else self.doing)

    def _paint_line(self, painter: QPainter) -> None:
        """The line above the drawing."""
        painter.setFont(font(theme.NORMAL))
        painter.setPen(shade(COLOURS.quiet))
        painter.drawText(QRectF(EDGE_PX, 8.0, self.width(), LINE_PX), LEFT, self.line)

    def _paint_states(self, painter: QPainter, now: layers.Instant) -> None:
        """Beside the ring of each brake that acts, in words, what it does, and its torque."""
        rings, labels = self._rings(now), now.device.labels
        for joint, (state, torque) in self.doing.items() if not self.blind else ():
            if state != layers.OFF and joint in rings:
                reach = marks.ring_radius(labels[joint]) + BESIDE_RING_PX
                text = f"{state} {torque:.1f} N m"
                wide = text_width(text, theme.SMALL)
                left = rings[joint].x() - reach - wide
                at = QPointF(left if left > 0.0 else rings[joint].x() + reach, rings[joint].y())
                write_from(painter, at, text, theme.SMALL, False, COLOURS.text)

    def _paint_legend(self, painter: QPainter, _: layers.Instant) -> None:
        """What the marks of each layer mean that is laid over the view."""
        shown = [layer for layer in (FIELD, DIRECTIONS, REACHABLE) if layer in self.shown]
        shown = [layer for layer in shown if layer != REACHABLE or not self.blind]
        x, y = EDGE_PX, self.height() - FOOT_PX - LEGEND_PX * len(shown)
        for layer in shown:
            wide = SAMPLE_PX + 8.0 + text_width(LEGENDS[layer], theme.SMALL)
            painter.fillRect(QRectF(x - 4.0, y, wide + 8.0, LEGEND_PX), shade(COLOURS.canvas, 0.92))
            middle = QPointF(x + 0.5 * SAMPLE_PX, y + 0.5 * LEGEND_PX)
            if layer == REACHABLE:
                marks.paint_wedge(painter, middle + QPointF(-0.4 * SAMPLE_PX, 0.0), SAMPLE_WEDGE, 0.9 * SAMPLE_PX)
            elif layer == FIELD:
                middles = np.array([[middle.x(), middle.y()]])
                marks.paint_field(painter, middles, np.array([[1.0, 0.0]]), 2.0 * SAMPLE_PX)
            else:
                tail = middle - QPointF(0.5 * SAMPLE_PX, 0.0)
                marks.paint_arrow(painter, tail, QPointF(SAMPLE_PX, 0.0), COLOURS.accent, 3.0)
            at = QPointF(x + SAMPLE_PX + 8.0, middle.y())
            write_from(painter, at, LEGENDS[layer], theme.SMALL, False, COLOURS.text)
            y += LEGEND_PX

    def moving_box(self) -> QRect:
        return self.rect()

    def _joints(self, now: layers.Instant) -> dict[str, QPointF]:
        """Where the joints are, px; none where the linkage is hidden."""
        shown = now.joints if LINKAGE in self.shown else {}
        return {joint: self.to_screen(place) for joint, place in shown.items()}

    def _rings(self, now: layers.Instant) -> dict[str, QPointF]:
        """Where the rings of the joints are, px, as far as they are seen beside words and corner."""
        rings = marks.rings_of(self._joints(now), now.device.labels)
        room = QMarginsF(*4 * (marks.JOINT_PX,))
        whole, corner = self.field.marginsRemoved(room), QRectF(self.inset.geometry()).marginsAdded(room)
        if self.inset.isHidden():
            corner = QRectF()
        return {name: place for name, place in rings.items() if whole.contains(place) and not corner.contains(place)}


#: layer -> its key, what it shows
LAYERS = {
    FIELD: ("F", "The desired direction of motion, everywhere"),
    DIRECTIONS: (
        "D",
        "How the handle can move while one brake alone is locked; bold: nearest to the desired direction",
    ),
    REACHABLE: ("W", "The forces that the brakes can exert against the present motion"),
    INSET: ("I", "The whole device with its brakes, in a corner"),
    TRAIL: ("T", "Where the handle has been in this trial"),
    LINKAGE: ("L", "Arms and brakes"),
}


class Workspace(Layered):
    """Linkage, forces and layers of one trial, with the menu that shows and hides them."""

    view: LinkageView

    def __init__(self) -> None:
        super().__init__(LinkageView(), LAYERS)

    def set_blind(self, blind: bool) -> None:
        """Hide brake colours, torques, the brakes' force and what they could exert."""
        self.view.set_blind(blind)
        self.layers[REACHABLE].setVisible(not blind)
