"""The linkage on the plane: arms, brakes in the colour of what they do, forces with their values, layers on demand."""

import math
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QKeySequence, QPainter, QRegion, QShortcut
from PySide6.QtWidgets import QFrame, QPushButton, QVBoxLayout, QWidget

from app.window.painting import theme
from app.window.painting.flow import Flow
from app.window.painting.layers import (
    Doing,
    Instant,
    Point,
    directions,
    doing,
    extent_of_linkages,
    extent_of_paths,
    field_at_rest,
    field_of,
    needles,
)
from app.window.painting.marks import (
    BRAKES,
    HAND,
    JOINT_PX,
    LETTER_PX,
    SHADE,
    WEDGE_PX,
    Labels,
    Line,
    arrow_of,
    force_ends,
    paint_arrow,
    paint_directions,
    paint_field,
    paint_wedge,
)
from app.window.painting.plane import Plane
from app.window.painting.theme import font, pen, shade, text_width, write
from core import tick_log
from core.control.velocity_field import Field
from core.device import Device
from core.mechanism import JOINTS
from core.path import Path, PathFile, build_path

FIELD, DIRECTIONS, REACHABLE, TRAIL, LINKAGE = "field", "directions", "force", "trail", "linkage"
WHOLE = "device"  # not a layer, but what is seen: the whole device, or the paths
NEAR_M = 0.1  # around the paths
ARMS = ("AE", "ED", "BC", "CD")
BARE_PX = 5.0  # radius of a joint without a brake
TITLE_PX = 36  # the line above is so high
EDGE_PX = 6.0  # what pens and letters reach beyond a mark's radius
NEEDLE_M, NEEDLE_PX = 0.02, 16.0  # between the needles of the field: at least so much of both
ASSUMED = "parameters assumed"
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
WORDS_EVERY_S = 0.1  # numbers that change faster cannot be read
ARM_PX = 7.0  # how wide an arm is
PIECE_PX = 250.0  # an arm lies aslant: the boxes around pieces of it hold far less than the one around all of it


class Placed(NamedTuple):
    """Where an instant is on the widget, px."""

    joints: dict[str, QPointF]  # none where the linkage is hidden
    rings: dict[str, QPointF]  # their middles; the brakes of coaxial bases stand side by side
    marks: dict[str, QPointF]  # label -> the point that it stands beside


class LinkageView(Plane):
    """One device on one path, as its newest tick says."""

    def __init__(self, devices: tuple[Device, ...], paths: dict[int, PathFile], parent: QWidget | None = None) -> None:
        super().__init__(
            extent_of_paths(paths.values(), NEAR_M), keep_free=QMarginsF(64.0, 66.0, 44.0, 12.0),
            grid=True, follows_mouse=False, parent=parent,
        )  # fmt: skip
        self._extents = (self._extent, extent_of_linkages(devices, paths.values()))
        self.device = devices[0]
        self._path: Path | None = None  # of the trial
        self.shown = {FIELD, REACHABLE, TRAIL, LINKAGE}
        self.blind = False
        self.title, self.line = "", ""
        self.labels = Labels()
        self.instant: Instant | None = None
        self._placed: Placed | None = None
        self._ticks: np.ndarray | None = None  # since the last words (n, WIDTH), n > 0; none between trials
        self._worded = False  # words have been made of these
        self._field: Field | None = None
        self.sense = 1.0  # of travel

    # what to show

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        """Another trial: the handle at rest at `tip`, brakes off."""
        self.device = device
        self._path, self.sense = build_path(path, "path"), 1.0
        self.show_path(path)
        self.rest(tip)

    def rest(self, tip: Point) -> None:
        """The handle stands at `tip`, brakes off; the trail stays to be looked at."""
        self._show(tip, None)
        self._field = field_at_rest(self._path, tip, self.sense) if self._path else None
        self.word()

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH) of the running trial, n > 0: the newest is drawn."""
        tip = (float(rows[-1, tick_log.TIP_X]), float(rows[-1, tick_log.TIP_Y]))
        if self._path is not None:
            self._field = field_of(rows[-1]) or field_at_rest(self._path, tip, self.sense)
            if rows[-1, tick_log.TRAVEL_SENSE] != self.sense:
                self.sense = float(rows[-1, tick_log.TRAVEL_SENSE])
                self.repaint_still()
        if rows[-1, tick_log.PHASE] == tick_log.MOVE:
            self.extend_trail(tip)
        before = None if self._worded else self._ticks
        self._show(tip, rows.copy() if before is None else np.concatenate((before, rows)))

    def _show(self, tip: Point, ticks: np.ndarray | None) -> None:
        self._ticks, self._worded = ticks, False
        self.instant = Instant(self.device, tip, None if ticks is None else ticks[-1], self.blind)
        self._placed = None
        self.pointer = self.instant.wanted
        self.show_handle(tip)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Lay something over the workspace, or take it away."""
        if layer == WHOLE:
            self.set_extent(self._extents[shown])
        (self.shown.add if shown else self.shown.discard)(layer)
        if layer == TRAIL:
            self.trail_shown = shown
        self._placed = None
        self.repaint_still()

    def say(self, title: str, line: str) -> None:
        """The line above."""
        if (title, line) != (self.title, self.line):
            self.title, self.line = title, line
            self.update(0, 0, self.width(), TITLE_PX)

    def set_blind(self, blind: bool) -> None:
        """Hide what would tell the controllers apart: what the brakes do, and their force."""
        if blind != self.blind:
            self.blind = blind
            if self.tip is not None:
                self._show(self.tip, self._ticks)
            self.word()

    def word(self) -> None:
        """Bring the words up to date and find each a place; a few times a second, for they must be read."""
        if self.instant is not None:
            nothing = dict.fromkeys(self.device.braked, Doing())
            now = doing(self.device, self._ticks) if self._ticks is not None else nothing
            self.labels.word(self.instant, {} if self.blind else now)
            self._worded = True
            if LINKAGE in self.shown:
                self._place_labels(self.instant)
            self._placed = None
            self.repaint_moved()

    # painting

    def moving(self) -> QRegion:
        """Also arms, rings, arrows, layers and labels; the line above changes with the labels' words."""
        region = super().moving()
        if self.instant is None:
            return region
        at, rings, marks = self._places()
        handle = self.to_screen(self.instant.tip)
        region += around(handle, handle, WEDGE_PX + EDGE_PX)
        for force in (HAND, BRAKES):
            region += around(handle, marks[force], EDGE_PX)
        if at:
            for ring in rings.values():
                region += around(ring, ring, JOINT_PX + EDGE_PX)
            for one, other in ARMS:
                pieces = 1 + int((at[other] - at[one]).manhattanLength() / PIECE_PX)
                piece = (at[other] - at[one]) / pieces
                for i in range(pieces):
                    start = at[one] + piece * i
                    region += around(start, start + piece, ARM_PX)
            for box in self.labels.boxes.values():
                region += box.adjusted(-2.0, -2.0, 2.0, 2.0).toAlignedRect()
        return region

    def paint_under_path(self, painter: QPainter) -> None:
        if self._path is not None and FIELD in self.shown:
            step = max(NEEDLE_M, NEEDLE_PX / self.scale)
            low, high = self.to_plane(QPointF(60.0, self.height())), self.to_plane(QPointF(self.width() - 12.0, 40.0))
            found = needles(self._path, self.sense, self.device, low, high, step)
            middles = found[:, :2] * (self.scale, -self.scale) + (self._zero_x, self._zero_y)
            paint_field(painter, middles, found[:, 2:] * (1.0, -1.0), step * self.scale)
        if self.device.assumed:
            painter.setFont(font(theme.SMALL))
            painter.setPen(shade(theme.CAUTION, 0.9))
            painter.drawText(QRectF(0.0, 12.0, self.width() - 16.0, 20.0), RIGHT, ASSUMED)

    def paint_under_handle(self, painter: QPainter) -> None:
        if self.instant is None:
            return
        handle = self.to_screen(self.instant.tip)
        at, rings, _ = self._places()
        if REACHABLE in self.shown and (wedge := self.instant.reachable()) is not None:
            paint_wedge(painter, handle, wedge)
        for width, colour in ((ARM_PX, theme.ARM), (2.0, theme.ARM_CORE)) if at else ():
            painter.setPen(pen(colour, width))  # flat ends, opaque, line by line: a twentieth of the time
            for one, other in ARMS:
                painter.drawLine(at[one], at[other])
        if DIRECTIONS in self.shown and self._field is not None:
            paint_directions(painter, handle, directions(self.device, self.instant.g, self._field), self._field)
        if at:
            self._paint_joints(painter, rings)
        paint_arrow(painter, handle, arrow_of(self.instant.brakes), theme.BRAKE_SLIPPING, 3.0)
        paint_arrow(painter, handle, arrow_of(self.instant.hand), theme.GOOD, 3.0)

    def paint_over_handle(self, painter: QPainter) -> None:
        if self.instant is not None and LINKAGE in self.shown:
            self.labels.paint(painter)
        if self.dirty.top() > TITLE_PX:
            return
        painter.setFont(font(theme.HEAD, bold=True))
        painter.setPen(shade(theme.TEXT))
        painter.drawText(QRectF(16.0, 8.0, self.width(), 26.0), LEFT, self.title)
        if self.line:
            x = 28.0 + text_width(self.title, theme.HEAD, bold=True)
            painter.setFont(font(theme.NORMAL))
            painter.setPen(shade(theme.QUIET))
            painter.drawText(QRectF(x, 9.0, self.width() - x, 26.0), LEFT, self.line)

    def _places(self) -> Placed:
        """Where the instant is: worked out once, for it is asked for when it comes and when it is painted."""
        assert self.instant is not None
        if self._placed is None:
            at = {}
            if LINKAGE in self.shown:
                at = {joint: self.to_screen(place) for joint, place in self.instant.joints.items()}
            rings = dict(at)
            if at and "A" in self.device.braked and "B" in self.device.braked:
                if (at["A"] - at["B"]).manhattanLength() < 2.0 * JOINT_PX + 2.0:
                    middle, apart = 0.5 * (at["A"] + at["B"]), QPointF(JOINT_PX + 2.0, 0.0)
                    rings["A"], rings["B"] = middle - apart, middle + apart
            ends = force_ends(self.to_screen(self.instant.tip), self.instant)
            self._placed = Placed(at, rings, {**rings, **ends})
            self.labels.stand(self._placed.marks)
        return self._placed

    def _fit(self) -> None:
        self._placed = None
        super()._fit()

    def _place_labels(self, instant: Instant) -> None:
        """Labels keep off arms, path, arrows, directions, rings and the pointer."""
        at, _, marks = self._places()
        handle = self.to_screen(instant.tip)
        ends = [(at[a], at[b]) for a, b in ARMS] if at else []
        ends += [(handle, marks[HAND]), (handle, marks[BRAKES])]
        places = [(marks[joint], JOINT_PX) for joint in self.device.braked if joint in marks]
        if DIRECTIONS in self.shown:
            for g_x, g_y in instant.g[[JOINTS.index(joint) for joint in self.device.braked]].tolist():
                reach = QPointF(g_y, g_x) * (LETTER_PX / math.hypot(g_x, g_y))
                ends.append((handle - reach, handle + reach))
                places += [(handle - reach, 9.0), (handle + reach, 9.0)]
        path = [self.to_screen(point) for point in self.outline[:: max(1, len(self.outline) // 12)]]
        path += [self.to_screen(self.outline[-1])] if path else []
        ends += zip(path, path[1:], strict=False)
        lines: list[Line] = [(p.x(), p.y(), q.x(), q.y()) for p, q in ends]
        places += [(end, 13.0) for end in (path[:1] + path[-1:])]
        places += [(self.to_screen(self.pointer), 7.0)] if self.pointer else []
        boxes = [QRectF(p.x() - r, p.y() - r, 2.0 * r, 2.0 * r) for p, r in places]
        self.labels.place(instant, marks, lines, boxes, QRectF(self.rect()).adjusted(4.0, 36.0, -4.0, -2.0))

    def _paint_joints(self, painter: QPainter, rings: dict[str, QPointF]) -> None:
        painter.setPen(Qt.PenStyle.NoPen)
        for joint in JOINTS:
            place = rings[joint]
            if joint not in self.device.braked:
                paint_ring(painter, place, BARE_PX, 2.0, theme.BRAKE_OFF)
                continue
            state = self.labels.doing.get(joint, Doing()).state
            paint_ring(painter, place, JOINT_PX, 3.0, SHADE[state])
            write(painter, place, joint, theme.SMALL, True, theme.QUIET if self.blind else theme.JOINT[joint])


def paint_ring(painter: QPainter, middle: QPointF, radius: float, width: float, colour: str) -> None:
    """A ring and the canvas in it (px; no pen): two discs take half of the time of a circle drawn with a pen."""
    for reach, fill in ((radius + 0.5 * width, colour), (radius - 0.5 * width, theme.CANVAS)):
        painter.setBrush(shade(fill))
        painter.drawEllipse(middle, reach, reach)


def around(one: QPointF, other: QPointF, reach: float) -> QRect:
    """The box around two points (px) and so much more on each side."""
    return QRectF(one, other).normalized().adjusted(-reach, -reach, reach, reach).toAlignedRect()


#: layer -> its key, what it shows
LAYERS = {
    FIELD: ("F", "The desired direction of motion, everywhere"),
    DIRECTIONS: ("D", "The way that each brake alone would leave the tip; strong: nearest to the desired direction"),
    REACHABLE: ("W", "The forces that the brakes can exert against the present motion"),
    TRAIL: ("T", "The way of the handle in this trial"),
    LINKAGE: ("L", "Arms, brakes and their values"),
    WHOLE: ("Z", "The whole device, not only the paths and 10 cm around them"),
}
PHASE_NAMES = {tick_log.APPROACH: "Approach", tick_log.HOLD: "Hold", tick_log.MOVE: "Move", tick_log.END: "End"}


class Workspace(QFrame):
    """Linkage, forces and layers of one trial, with the buttons that show and hide them."""

    def __init__(self, devices: tuple[Device, ...], paths: dict[int, PathFile], parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="workspace")
        self.setStyleSheet(
            f"QFrame#workspace {{ background: {theme.CANVAS}; border: 1px solid {theme.LINE};"
            f" border-radius: {theme.RADIUS}px; }}"
        )
        self.view = LinkageView(devices, paths)
        self._began_s, self._phase, self._worded_s = 0.0, -1, -np.inf
        self.buttons = {layer: self._button(layer) for layer in LAYERS}
        row_of_buttons = Flow(5)
        row_of_buttons.setContentsMargins(8, 0, 8, 8)
        for button in self.buttons.values():
            row_of_buttons.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2, 2, 2, 2)
        layout.setSpacing(4)
        layout.addWidget(self.view, 1)
        layout.addLayout(row_of_buttons)

    def _button(self, layer: str) -> QPushButton:
        key, shows = LAYERS[layer]
        button = QPushButton(f"{layer}  {key}", objectName="toggle")
        button.setMinimumHeight(26)  # half of it holds the round ends
        button.setFont(theme.font(theme.SMALL))
        button.setCheckable(True)
        button.setChecked(layer in self.view.shown)
        button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        QShortcut(QKeySequence(key), self, button.toggle).setAutoRepeat(False)
        button.setToolTip(shows)
        button.toggled.connect(lambda shown: self.view.show_layer(layer, shown))
        return button

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        """The coming or beginning trial: its device and path, the handle at rest at `tip` (m)."""
        self._phase, self._worded_s = -1, -np.inf
        self.view.show_trial(device, path, tip)

    def rest(self, tip: Point) -> None:
        """Between trials: the handle stands at `tip` (m), brakes off; the trail stays to be looked at."""
        self._phase, self._worded_s = -1, -np.inf
        self.say("")
        self.view.rest(tip)

    def say(self, title: str, line: str = "") -> None:
        """What stands above the workspace while no trial runs."""
        self.view.say(title, line)

    def add(self, rows: np.ndarray, words: bool = True) -> None:
        """Ticks (n, tick_log.WIDTH) since the last frame. words: write the numbers too, ten times a second."""
        if not len(rows):
            return
        self.view.add(rows)
        now = rows[-1]
        if int(now[tick_log.PHASE]) != self._phase:
            self._phase = int(now[tick_log.PHASE])
            first = np.flatnonzero(rows[:, tick_log.PHASE] == self._phase)[0]
            self._began_s, self._worded_s = float(rows[first, tick_log.T]), -np.inf
        if words and not self._worded_s <= now[tick_log.T] < self._worded_s + WORDS_EVERY_S:
            self._worded_s = float(now[tick_log.T])
            self.word(now)

    def word(self, now: np.ndarray) -> None:
        """The numbers of a tick (tick_log.WIDTH,), which was the last one added."""
        says = [f"{now[tick_log.T] - self._began_s:.2f} s"]
        if self._phase == tick_log.MOVE:
            says.append(f"error {1e3 * abs(now[tick_log.PATH_DISTANCE]):.1f} mm")
        says.append(f"{np.hypot(now[tick_log.TIP_VX], now[tick_log.TIP_VY]):.2f} m/s")
        self.say(PHASE_NAMES[self._phase], " · ".join(says))
        self.view.word()

    def set_blind(self, blind: bool) -> None:
        """Hide brake colours, torques, the brakes' force and what they could exert."""
        self.view.set_blind(blind)
        self.buttons[REACHABLE].setVisible(not blind)
