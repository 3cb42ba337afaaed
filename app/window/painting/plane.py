"""The plane that the handle moves in, true to scale: path, start, end, handle, pointer and the spring between them.

Metres in, the same scale for all trials of a session. What stands still is painted once into a background, the trail
piece by piece as it grows; a frame paints only what moves. A plane holds no state of the experiment: it is told what
to show, and tells where the pointer is.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QEvent, QLineF, QMarginsF, QPointF, QRect, QRectF, Qt, Signal
from PySide6.QtGui import (
    QInputDevice,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPixmap,
    QPointingDevice,
    QPolygonF,
    QRegion,
    QResizeEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.window.painting import theme
from app.window.painting.layers import SPACING_M, Point
from app.window.painting.theme import SHADES, font, pen, shade, spring_pen
from core.path import PathFile, outline

FORCE_RED_N = 20.0  # the spring is green when slack, red from here on
TRAIL_MOST = 4000  # points; a longer trail is thinned out
HOLD_PX = 6.0  # how wide the sweep of the hold is
LEAST_HANDLE_PX = 4.0  # radius
TRAIL_STEP_PX = 3.0  # a trail grows by pieces so long; what is missing lies under the handle


class Sizes(NamedTuple):
    """How large the marks are, px."""

    path: float = 3.0
    ring: float = 11.0  # radius
    ring_pen: float = 3.0
    handle: float = 7.5  # radius, at most
    pointer: float = 6.0  # radius
    trail: float = 1.5
    spring: float = 2.0


AT_DESK, FROM_AFAR = Sizes(), Sizes(7.0, 26.0, 6.0, 17.0, 10.0, 3.0, 3.0)


def hovers(device: QPointingDevice) -> bool:
    """Whether a pointing device says where it is without being pressed."""
    kind = QInputDevice.DeviceType
    if device.type() in (kind.Mouse, kind.TouchPad):
        return True
    return bool(device.capabilities() & QInputDevice.Capability.Hover)


class Plane(QWidget):
    """Path, start, end, trail, handle, pointer and spring. A subclass adds what else it shows.

    extent: what must be seen, m. keep_free: px at each side that stay clear of it. grid: lines every 10 cm.
    follows_mouse: the pointer over this widget is the hand.
    """

    pointer_moved = Signal(float, float)  # m, inside what is drawn
    pointer_left = Signal()  # the pointer is no hand any more
    painted = Signal()  # what had to be painted anew has been

    def __init__(
        self,
        extent: QRectF,
        sizes: Sizes = AT_DESK,
        keep_free: QMarginsF | None = None,
        grid: bool = False,
        follows_mouse: bool = True,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.sizes, self._extent, self._grid = sizes, extent, grid
        self._keep_free = keep_free or QMarginsF()
        self._background, self._still = QPixmap(), False  # for what stands still; whether it shows it
        self._scale, self._zero_x, self._zero_y = 1.0, 0.0, 0.0  # px / m; where (0, 0) is, px
        self.path: PathFile | None = None
        self.outline = np.empty((0, 2))  # m
        self.tip: Point | None = None
        self.pointer: Point | None = None
        self.force_N, self.taken = 0.0, False
        self.trail: list[Point] = []
        self.trail_shown = True
        self.radii_m: tuple[float, float] | None = None  # that count at start and end; None: rings of a fixed size
        self._beside: tuple[np.ndarray, str] | None = None  # another way (n, 2), m, and its colour
        self.dirty = QRect()  # what is being painted anew, px
        self._moving = QRegion()  # where things that move were last, px
        self._follows_mouse, self._pointer_moved = follows_mouse, False
        self.setMouseTracking(follows_mouse)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(240, 200)
        self._fit()

    # what to show

    def set_extent(self, extent: QRectF, keep_free: QMarginsF | None = None) -> None:
        """What must be seen, m; keep_free: px at each side that stay clear of it (None: as before)."""
        self._extent = extent
        self._keep_free = keep_free or self._keep_free
        self._fit()

    def show_path(self, path: PathFile | None) -> None:
        """The path to follow; None: there is none. The trail is forgotten."""
        self.path = path
        self.outline = np.empty((0, 2)) if path is None else np.asarray(outline(path, SPACING_M))
        self.clear_trail()

    def show_handle(self, tip: Point | None, taken: bool = False, force_N: float = 0.0) -> None:
        """Where the handle is (m), whether the pointer holds it, and the force of the spring between them (N)."""
        self.tip, self.force_N = tip, force_N
        if taken != self.taken:  # with the handle in hand the ring is the pointer: the arrow would only cover it
            self.taken = taken
            self.setCursor(Qt.CursorShape.BlankCursor if taken else Qt.CursorShape.ArrowCursor)
        self.repaint_moved()

    def show_pointer(self, place: Point | None) -> None:
        """Where the hand wants the handle to be (m), when it is not this widget's own pointer that says so."""
        self.pointer = place
        self.repaint_moved()

    def extend_trail(self, tip: Point) -> None:
        """The way of the handle goes on to here (m)."""
        if self.trail and self._scale * math.dist(tip, self.trail[-1]) < TRAIL_STEP_PX:
            return
        if self.trail and self.trail_shown and self._still:
            self._paint_trail(self._background, [self.trail[-1], tip])
        self.trail.append(tip)
        if len(self.trail) > TRAIL_MOST:
            self.trail = self.trail[::2]

    def show_way(self, tips: np.ndarray) -> None:
        """The whole way so far at once: tips (n, 2), m."""
        self.trail = [(x, y) for x, y in tips[:: len(tips) // TRAIL_MOST + 1].tolist()]
        self.repaint_still()

    def show_beside(self, tips: np.ndarray, colour: str) -> None:
        """Another way beside the trail, whatever is shown: tips (n, 2), m; none of them: no other way."""
        self._beside = (tips, colour) if len(tips) else None
        self.repaint_still()

    def clear_trail(self) -> None:
        """Forget the way so far."""
        self.trail.clear()
        self.repaint_still()

    def show_trail(self, shown: bool) -> None:
        """Whether the way so far is drawn."""
        self.trail_shown = shown
        self.repaint_still()

    def repaint_still(self) -> None:
        """What stands still has changed: paint it anew with the next frame."""
        self._still = False
        self.update()

    def repaint_moved(self) -> None:
        """Paint anew where things that move were and where they are."""
        before, self._moving, self._pointer_moved = self._moving, self.moving(), False
        self.update(before.united(self._moving))

    def follow_pointer(self) -> None:
        """With every frame: the own pointer, which tells more often than can be seen where it is."""
        if self._pointer_moved:
            self.repaint_moved()

    def moving(self) -> QRegion:
        """Where handle, pointer and spring are, px. A subclass in which more moves says so."""
        sizes = self.sizes
        around = QRectF()
        for place, radius in ((self.tip, sizes.handle), (self.pointer, sizes.pointer)):
            if place is not None:
                at, reach = self.to_screen(place), radius + sizes.trail + 2.0
                around = around.united(QRectF(at.x() - reach, at.y() - reach, 2.0 * reach, 2.0 * reach))
        return QRegion(around.toAlignedRect())

    # metres and pixels

    def _fit(self) -> None:
        free, extent = self._keep_free, self._extent
        width = max(self.width() - free.left() - free.right(), 1.0)
        height = max(self.height() - free.top() - free.bottom(), 1.0)
        self._scale = min(width / extent.width(), height / extent.height())
        self._zero_x = free.left() + 0.5 * width - self._scale * extent.center().x()
        self._zero_y = free.top() + 0.5 * height + self._scale * extent.center().y()
        self.repaint_still()

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self._scale

    def to_screen(self, point: Sequence[float]) -> QPointF:
        """Where a place of the plane (m) is on the widget (px)."""
        return QPointF(self._zero_x + self._scale * point[0], self._zero_y - self._scale * point[1])

    def to_plane(self, place: QPointF) -> Point:
        """The place of the plane (m) under a point of the widget (px), clamped to what is drawn."""
        x = min(max(place.x(), 0.0), float(self.width()))
        y = min(max(place.y(), 0.0), float(self.height()))
        return (x - self._zero_x) / self._scale, (self._zero_y - y) / self._scale

    # events

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if not self._follows_mouse:
            return
        if not self.rect().contains(event.position().toPoint()):  # dragged out, with a button held down
            self._leave()
            return
        self.pointer = self.to_plane(event.position())
        self.pointer_moved.emit(*self.pointer)
        self._pointer_moved = True

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.mouseMoveEvent(event)
        super().mousePressEvent(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """A finger, or a pen that is not seen in the air, holds the handle while it is down."""
        if not hovers(event.pointingDevice()):
            self._leave()
        super().mouseReleaseEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._leave()
        super().leaveEvent(event)

    def _leave(self) -> None:
        if self._follows_mouse and self.pointer is not None:
            self.show_pointer(None)
            self.pointer_left.emit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._fit()
        super().resizeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        ratio = self.devicePixelRatioF()
        if not self._still or self._background.devicePixelRatio() != ratio:
            self._paint_background(ratio)
        self.dirty = event.rect()
        painter = QPainter(self)
        painter.drawPixmap(0, 0, self._background)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self.paint_under_handle(painter)
        self._paint_hand(painter)
        self.paint_over_handle(painter)
        self.painted.emit()

    # painting: a subclass adds to these three

    def paint_under_path(self, painter: QPainter) -> None:
        """What stands still under the path."""

    def paint_under_handle(self, painter: QPainter) -> None:
        """What moves, under the handle."""

    def paint_over_handle(self, painter: QPainter) -> None:
        """What moves, over everything."""

    def _paint_background(self, ratio: float) -> None:
        if self._background.size() != self.size() * ratio:  # else the memory that is there is painted again
            self._background = QPixmap(self.size() * ratio)
        pixmap, self._still = self._background, True
        pixmap.setDevicePixelRatio(ratio)
        pixmap.fill(shade(theme.CANVAS))
        painter = QPainter(pixmap)
        if self._grid:
            self._paint_grid(painter)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self.paint_under_path(painter)
        if len(self.outline):
            self._paint_path(painter)
        if self._beside is not None:
            tips, colour = self._beside
            painter.setPen(pen(colour, self.sizes.trail))
            painter.drawPolyline(QPolygonF([self.to_screen(tip) for tip in tips[:: len(tips) // TRAIL_MOST + 1]]))
        painter.end()
        if self.trail_shown and len(self.trail) > 1:
            self._paint_trail(pixmap, self.trail)

    def _paint_grid(self, painter: QPainter) -> None:
        """Lines every 10 cm; those across are named."""
        free = self._keep_free
        left, right = 58.0, self.width() - 14.0
        top, bottom = 0.7 * free.top() + 8.0, self.height() - 8.0
        painter.setFont(font(theme.SMALL))
        for i in range(-20, 21):
            at = self.to_screen((0.1 * i, 0.1 * i))
            x, y = round(at.x()) + 0.5, round(at.y()) + 0.5
            painter.setPen(pen(theme.LINE, 1.0, 0.55))
            if left < x < right:
                painter.drawLine(QLineF(x, top, x, bottom))
            if i >= 0 and top < y < bottom:
                painter.drawLine(QLineF(left, y, right, y))
                painter.setPen(pen(theme.QUIET, 1.0, 0.75))
                box = QRectF(0.0, y - 10.0, left - 8.0, 20.0)
                painter.drawText(box, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, f"{10 * i} cm")

    def _paint_path(self, painter: QPainter) -> None:
        """The path, the start as a ring, the end as a ring with a point in it."""
        sizes = self.sizes
        painter.setPen(pen(theme.HANDLE, sizes.path, 0.92, round_cap=True))
        painter.drawPolyline(QPolygonF([self.to_screen(point) for point in self.outline]))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        start, end = self.rings_px
        rings = ((self.outline[0], theme.START_RING, start), (self.outline[-1], theme.END_RING, end))
        for place, ring, radius in rings:
            painter.setPen(pen(ring, sizes.ring_pen))
            painter.drawEllipse(self.to_screen(place), radius, radius)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(shade(theme.END_RING))
        painter.drawEllipse(self.to_screen(self.outline[-1]), 0.4 * sizes.ring, 0.4 * sizes.ring)

    @property
    def rings_px(self) -> tuple[float, float]:
        """Radii of the rings at the start and at the end: those that count, where they are known."""
        if self.radii_m is None:
            return self.sizes.ring, self.sizes.ring
        start, end = (radius * self._scale for radius in self.radii_m)
        return start, end

    @property
    def handle_px(self) -> float:
        """Radius of the handle: its middle must be seen to lie in the ring at the start."""
        return min(self.sizes.handle, max(0.6 * self.rings_px[0], LEAST_HANDLE_PX))

    def start_box(self) -> QRect:
        """Around the ring at the start, px."""
        at, reach = self.to_screen(self.outline[0]), self.rings_px[0] + HOLD_PX + 2.0
        return QRectF(at.x() - reach, at.y() - reach, 2.0 * reach, 2.0 * reach).toAlignedRect()

    def paint_hold(self, painter: QPainter, share: float) -> None:
        """A sweep around the start for the share of the hold that is over."""
        at, reach = self.to_screen(self.outline[0]), self.rings_px[0] + 0.5 * HOLD_PX + 1.0
        painter.setPen(pen(theme.START_RING, HOLD_PX))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        box = QRectF(at.x() - reach, at.y() - reach, 2.0 * reach, 2.0 * reach)
        painter.drawArc(box, 90 * 16, -round(share * 360 * 16))

    def _paint_trail(self, pixmap: QPixmap, points: Sequence[Point]) -> None:
        """Add a piece of the way to the background: a long trail costs no more than a short one."""
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(pen(theme.TRACE, self.sizes.trail))
        painter.drawPolyline(QPolygonF([self.to_screen(point) for point in points]))
        painter.end()

    def _paint_hand(self, painter: QPainter) -> None:
        """Handle, pointer and, once it is taken, the spring between them in the colour of its force."""
        sizes = self.sizes
        pointer = self.to_screen(self.pointer) if self.pointer else None
        handle = self.to_screen(self.tip) if self.tip else None
        if pointer and handle and self.taken:
            step = round(min(self.force_N / FORCE_RED_N, 1.0) * (SHADES - 1))
            painter.setPen(spring_pen(sizes.spring, step))
            painter.drawLine(handle, pointer)
        if handle:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(shade(theme.HANDLE))
            painter.drawEllipse(handle, self.handle_px, self.handle_px)
        if pointer:
            painter.setPen(pen(theme.POINTER, 2.0))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawEllipse(pointer, sizes.pointer, sizes.pointer)
