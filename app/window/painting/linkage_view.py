"""The linkage on the plane: arms, brakes in the colour of what they do, forces with their values, layers on demand."""

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRectF, Qt
from PySide6.QtGui import QKeySequence, QPainter, QShortcut
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
    ARMS,
    BRAKES,
    HAND,
    JOINT_PX,
    LETTER_PX,
    Labels,
    arrow_of,
    paint_arms,
    paint_arrow,
    paint_directions,
    paint_field,
    paint_joints,
    paint_wedge,
    points_along,
    points_in,
    rings_of,
)
from app.window.painting.plane import RIGHT, Plane
from app.window.painting.theme import font, pen, shade, text_width
from core import tick_log
from core.control.velocity_field import Field
from core.device import Device
from core.path import Path, PathFile, build_path

FIELD, DIRECTIONS, REACHABLE, TRAIL, LINKAGE = "field", "directions", "force", "trail", "linkage"
WHOLE = "device"  # not a layer, but what is seen: the whole device, or the paths
NEAR_M = 0.1  # around the paths
NEEDLE_M, NEEDLE_PX = 0.02, 16.0  # between the needles of the field: at least so much of both
ARM_PX = 7.0  # width of an arm
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
WORDS_EVERY_S = 0.1  # numbers that change faster cannot be read


class LinkageView(Plane):
    """One device on one path, as its newest tick is."""

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
        self.pointer = self.instant.wanted
        self.show_handle(tip)

    def show_layer(self, layer: str, shown: bool) -> None:
        """Lay something over the workspace, or take it away."""
        if layer == WHOLE:
            self.set_extent(self._extents[shown])
        (self.shown.add if shown else self.shown.discard)(layer)
        self.show_trail(TRAIL in self.shown)

    def say(self, title: str, line: str) -> None:
        """The line above."""
        self.title, self.line = title, line
        self.update()

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
            self.update()

    # painting

    def paint_under_path(self, painter: QPainter) -> None:
        if self._path is not None and FIELD in self.shown:
            step = max(NEEDLE_M, NEEDLE_PX / self.scale)
            low, high = self.to_plane(QPointF(60.0, self.height())), self.to_plane(QPointF(self.width() - 12.0, 40.0))
            found = needles(self._path, self.sense, self.device, low, high, step)
            paint_field(painter, self._pixels(found[:, :2]), found[:, 2:] * (1.0, -1.0), step * self.scale)
        if self.device.assumed:
            painter.setFont(font(theme.SMALL))
            painter.setPen(pen(theme.CAUTION, 1.0, 0.9))
            painter.drawText(QRectF(0.0, 36.0, self.width() - 16.0, 20.0), RIGHT, "parameters assumed")

    def paint_under_handle(self, painter: QPainter) -> None:
        if self.instant is None:
            return
        handle, (at, rings) = self.to_screen(self.instant.tip), self._joints(self.instant)
        if REACHABLE in self.shown and (wedge := self.instant.reachable()) is not None:
            paint_wedge(painter, handle, wedge)
        paint_arms(painter, at, ARM_PX, 2.0)
        if DIRECTIONS in self.shown and self._field is not None:
            found = directions(self.device, self.instant.g, self._field)
            paint_directions(painter, handle, found, self._field, self.device.labels)
        paint_joints(painter, rings, self.device.labels, self.labels.doing, self.blind)
        paint_arrow(painter, handle, arrow_of(self.instant.brakes), theme.BRAKE_SLIPPING, 3.0)
        paint_arrow(painter, handle, arrow_of(self.instant.hand), theme.GOOD, 3.0)

    def paint_over_handle(self, painter: QPainter) -> None:
        if self.instant is not None and LINKAGE in self.shown:
            self.labels.paint(painter, self._marks(self.instant))
        x = 16.0
        for text, size, bold, colour in (
            (self.title, theme.HEAD, True, theme.TEXT),
            (self.line, theme.NORMAL, False, theme.QUIET),
        ):
            painter.setFont(font(size, bold))
            painter.setPen(shade(colour))
            painter.drawText(QRectF(x, 8.0, self.width(), 26.0), LEFT, text)
            x += 12.0 + text_width(text, size, bold)

    def _pixels(self, places: np.ndarray) -> np.ndarray:
        """Places (n, 2) of the plane, m -> px."""
        return places * (self.scale, -self.scale) + (self._zero_x, self._zero_y)

    def _joints(self, instant: Instant) -> tuple[dict[str, QPointF], dict[str, QPointF]]:
        """Where the joints and their rings are, px; none where the linkage is hidden."""
        shown = instant.joints if LINKAGE in self.shown else {}
        at = {joint: self.to_screen(place) for joint, place in shown.items()}
        return at, rings_of(at, self.device.labels, JOINT_PX)

    def _marks(self, instant: Instant) -> dict[str, QPointF]:
        """The points (px) beside which the labels stand: the rings, the heads of both forces' arrows."""
        handle = self.to_screen(instant.tip)
        return self._joints(instant)[1] | {
            HAND: handle + arrow_of(instant.hand), BRAKES: handle + arrow_of(instant.brakes)
        }  # fmt: skip

    def _place_labels(self, instant: Instant) -> None:
        """Labels keep off arms, path, arrows, directions, rings and the pointer."""
        marks, handle, (at, _) = self._marks(instant), self.to_screen(instant.tip), self._joints(instant)
        lines = [(at[a], at[b]) for a, b in ARMS] if at else []
        lines += [(handle, marks[HAND]), (handle, marks[BRAKES])]
        places = [(marks[joint], JOINT_PX) for joint in self.device.braked if joint in marks]
        if DIRECTIONS in self.shown and self._field is not None:
            for one in directions(self.device, instant.g, self._field):
                reach = QPointF(one.p_x, -one.p_y) * LETTER_PX
                lines.append((handle - reach, handle + reach))
                places += [(handle - reach, 9.0), (handle + reach, 9.0)]
        places += [(self.to_screen(end), 13.0) for end in (*self.outline[:1], *self.outline[-1:])]
        places += [(self.to_screen(self.pointer), 7.0)] if self.pointer else []
        drawn = [self._pixels(self.outline), *(points_along(*line) for line in lines)]
        drawn += [points_in(QRectF(p.x() - r, p.y() - r, 2.0 * r, 2.0 * r)) for p, r in places]
        room = QRectF(self.rect()).adjusted(4.0, 36.0, -4.0, -2.0)
        self.labels.place(instant, marks, np.concatenate(drawn), room)


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
