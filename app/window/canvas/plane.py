"""The plane that the handle moves in, true to scale: path, start, end, handle, pointer and the spring between them.

Metres in, the same scale for all trials of a session. What stands still is painted once into a background, the trail
piece by piece as it grows; a frame paints, where something moves, the background and on it what moves.
"""

from collections.abc import Callable, Sequence

import numpy as np
from PySide6.QtCore import QEvent, QMarginsF, QPointF, QRect, QRectF, Qt, Signal
from PySide6.QtGui import (
    QBrush,
    QInputDevice,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPixmap,
    QPolygonF,
    QResizeEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.ipc.ring import GRASP_RADIUS_M
from app.window.canvas import path_marks
from app.window.canvas.layers import SPACING_M, Point
from app.window.canvas.path_marks import AT_DESK, Sizes, polygon
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, pen, shade
from core.obstacles import ObstacleFile
from core.path import PathFile, Segment, outline

LEAST_HANDLE_PX = 4.0  # radius
EDGE_PX = 4.0  # around the middle of a line or the radius of a disc: what it colours lies within
#: A way is drawn through the first point in each such square that it comes into: nowhere further off than its diagonal,
#: which is less than a pixel of a screen at 200 %, too.
THIN_PX = 0.3


def around(places: QPolygonF | list[QPointF], reach: float) -> QRect:
    """All pixels that lines and discs at these places (px) colour: none reaches further than this, px."""
    edge = reach + EDGE_PX
    return QPolygonF(places).boundingRect().adjusted(-edge, -edge, edge, edge).toAlignedRect()


Painter = Callable[[QPainter], object]  # draws one thing


class Plane(QWidget):
    """Path, start, end, trail, handle, pointer and spring, and what else `under_path`, `under_handle` and `over_handle`
    draw, each painter one thing, in this order.

    extent: what must be seen, m. keep_free: px at each side that stay clear of it.
    follows_mouse: the pointer over this widget is the hand, and drawn.
    """

    pointer_moved = Signal(float, float)  # m, inside what is drawn
    pointer_left = Signal()  # the hand lets go
    painted = Signal()

    def __init__(
        self,
        extent: QRectF,
        sizes: Sizes = AT_DESK,
        keep_free: QMarginsF | None = None,
        follows_mouse: bool = True,
    ) -> None:
        super().__init__()
        self.sizes, self._extent = sizes, extent
        self._keep_free = keep_free or QMarginsF()
        self._background, self._still = QPixmap(), False  # for what stands still; whether it is up to date
        self._box, self._painted_box = QRect(), QRect()  # px, around what moves: now, and as it was painted last
        self.scale, self._zero_x, self._zero_y = 1.0, 0.0, 0.0  # px / m; where (0, 0) is, px
        self.path: PathFile | None = None
        self.outline = np.empty((0, 2))  # m
        self.tip: Point | None = None
        self.pointer: Point | None = None
        self.force_N = 0.0
        self.taken: bool | None = None
        self.trail: list[np.ndarray] = []  # piece by piece (n, 2), m, n > 0
        self._trail_end = np.empty((0, 2))  # px: up to where it is painted; nowhere, or (1, 2)
        self.trail_shown = True
        self.radii_m: tuple[float, float] | None = None  # that count at start and end; None: rings of a fixed size
        self._obstacles: list[np.ndarray] = []  # corners (n, 2), m
        self._beside: tuple[np.ndarray, str] | None = None  # another way (n, 2), m, and its colour
        self.under_path: list[Painter] = []  # what stands still
        self.under_handle: list[Painter] = []  # what moves
        self.over_handle: list[Painter] = []
        self.words_kept_clear = False  # what moves under the handle covers no words above and below the field
        self._follows_mouse = follows_mouse
        self._aimed: Point | None = None  # where the own pointer is (m), if that is not shown yet
        self.setMouseTracking(follows_mouse)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(240, 200)
        theme.follow(self.repaint_still)

    # what to show

    def set_extent(self, extent: QRectF) -> None:
        """What must be seen, m."""
        self._extent = extent
        self.fit()

    def show_path(self, path: PathFile | None) -> None:
        """The path to follow, or none; without a trail yet."""
        self.path = path
        self.outline = np.empty((0, 2)) if path is None else np.asarray(outline(path, SPACING_M))
        self.clear_trail()

    def show_obstacles(self, obstacles: Sequence[ObstacleFile]) -> None:
        """What the handle is to keep out of."""
        self._obstacles = [obstacle.outline() for obstacle in obstacles]
        self.repaint_still()

    def show_handle(self, tip: Point | None, taken: bool | None = None, force_N: float = 0.0) -> bool:
        """Where the handle is (m), and the force of the spring between it and the pointer (N); whether that is new.

        taken: whether the pointer holds it; None: no pointer can take it now.
        """
        if (tip, taken, force_N) == (self.tip, self.taken, self.force_N):
            return False
        if taken != self.taken:  # with the handle in hand the ring is the pointer: the arrow would only cover it
            self.setCursor(Qt.CursorShape.BlankCursor if taken else Qt.CursorShape.ArrowCursor)
        self.tip, self.taken, self.force_N = tip, taken, force_N
        self.repaint_moving()
        return True

    def show_pointer(self, place: Point | None) -> None:
        """Where the hand wants the handle to be, m."""
        self.pointer, self._aimed = place, None
        self.repaint_moving()

    def extend_trail(self, tips: np.ndarray) -> None:
        """The trail goes on over all of these (n, 2), m."""
        if len(tips):
            self.trail.append(tips)
            if self.trail_shown and self._still and len(drawn := self._paint_piece(tips)) > 1:
                self.update(around(polygon(drawn), self.sizes.trail))

    def show_beside(self, tips: np.ndarray, colour: str) -> None:
        """Another way beside the trail: tips (n, 2), m; n = 0: no other way."""
        self._beside = (tips, colour) if len(tips) else None
        self.repaint_still()

    def clear_trail(self) -> None:
        self.trail.clear()
        self.repaint_still()

    def repaint_still(self) -> None:
        """What stands still has changed: paint all of it anew with the next frame."""
        self._still, self._box = False, self.rect()
        self.update()

    def repaint_moving(self) -> None:
        """What moves has changed: paint anew with the next frame where it was and where it is."""
        self._box = self.moving_box()
        self.update(self._painted_box | self._box)

    def moving_box(self) -> QRect:
        """Around all that moves, px."""
        grasp = self.scale * GRASP_RADIUS_M if self.taken is False else 0.0
        box = around(self.moving_places(), max(grasp, self.sizes.handle, self.sizes.pointer))
        return box if self.handle_seen else self.rect()  # with an arrow somewhere at the edge

    def moving_places(self) -> list[QPointF]:
        """The middles of what moves, px."""
        return [self.to_screen(place) for place in (self.tip, self.pointer) if place]

    def follow_pointer(self) -> None:
        """With every frame: show the own pointer, which moves more often than can be seen."""
        if self._aimed is not None:
            self.show_pointer(self._aimed)

    # metres and pixels

    def fit(self) -> None:
        """Size, extent or text size has changed: the handle has another place on the screen, too. A subclass first
        sets the room that it keeps free."""
        free, extent = self._keep_free, self._extent
        width = max(self.width() - free.left() - free.right(), 1.0)
        height = max(self.height() - free.top() - free.bottom(), 1.0)
        self.scale = min(width / extent.width(), height / extent.height())
        self._zero_x = free.left() + 0.5 * width - self.scale * extent.center().x()
        self._zero_y = free.top() + 0.5 * height + self.scale * extent.center().y()
        self.repaint_still()
        self.show_handle(self.tip, self.taken, self.force_N)

    @property
    def field(self) -> QRectF:
        """The part (px) between what stands at top and bottom in words."""
        return QRectF(self.rect()).adjusted(0.0, self._keep_free.top(), 0.0, -self._keep_free.bottom())

    def to_screen(self, point: Sequence[float] | np.ndarray) -> QPointF:
        """Place of the plane (m) -> point of the widget (px)."""
        return QPointF(self._zero_x + self.scale * point[0], self._zero_y - self.scale * point[1])

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Places (n, 2) of the plane (m) -> points of the widget (px)."""
        return places * (self.scale, -self.scale) + (self._zero_x, self._zero_y)

    def to_plane(self, place: QPointF) -> Point:
        """Point of the widget (px) -> place of the plane (m), clamped to what is drawn."""
        x = min(max(place.x(), 0.0), float(self.width()))
        y = min(max(place.y(), 0.0), float(self.height()))
        return (x - self._zero_x) / self.scale, (self._zero_y - y) / self.scale

    # events

    def point_at(self, at: QPointF) -> None:
        """The hand is here, px."""
        if not self.rect().contains(at.toPoint()):  # dragged out, with a button held down
            self._leave()
            return
        place = self.to_plane(at)
        if self._follows_mouse:
            self._aimed = place
        self.pointer_moved.emit(*place)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self.point_at(event.position())

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.mouseMoveEvent(event)
        super().mousePressEvent(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if event.deviceType() == QInputDevice.DeviceType.TouchScreen:  # a finger that is lifted is nowhere
            self._leave()
        super().mouseReleaseEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._leave()
        super().leaveEvent(event)

    def _leave(self) -> None:
        if self._follows_mouse:
            if self._aimed is self.pointer is None:
                return
            self.show_pointer(None)
        self.pointer_left.emit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.fit()
        super().resizeEvent(event)

    # painting

    def paintEvent(self, event: QPaintEvent) -> None:
        ratio = self.devicePixelRatioF()
        if not self._still or self._background.devicePixelRatio() != ratio:
            self._paint_background(ratio)
        painter = QPainter(self)
        painter.drawPixmap(0, 0, self._background)
        if event.region().intersects(self._box):
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            if self.words_kept_clear:
                painter.setClipRect(self.field)
            for paint in self.under_handle:
                paint(painter)
            painter.setClipping(False)
            for paint in (self._paint_hand, *self.over_handle):
                paint(painter)
            self._painted_box = self._box
        self.painted.emit()

    def _paint_background(self, ratio: float) -> None:
        if self._background.size() != self.size() * ratio:  # else the memory that is there is painted again
            self._background = QPixmap(self.size() * ratio)
        self._still = True
        self._background.setDevicePixelRatio(ratio)
        self._background.fill(shade(COLOURS.canvas))
        painter = QPainter(self._background)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for corners in self._obstacles:
            painter.setPen(pen(COLOURS.quiet, 2.0))
            painter.setBrush(QBrush(shade(COLOURS.quiet, 0.6), Qt.BrushStyle.BDiagPattern))
            painter.drawPolygon(polygon(self.pixels(corners)))
        for paint in self.under_path:
            paint(painter)
        if len(self.outline):
            heads = not isinstance(self.path, Segment)
            path_marks.paint_path(painter, self.pixels(self.outline), heads, self.rings_px, self.sizes)
        painter.end()
        if self._beside is not None:
            self._paint_way(self.pixels(self._beside[0]), self._beside[1])
        self._trail_end = np.empty((0, 2))
        for piece in self.trail if self.trail_shown else ():  # as they came: each pixel is as it was
            self._paint_piece(piece)

    @property
    def rings_px(self) -> tuple[float, float]:
        """Radii of the rings at the start and at the end: those that count, where they are known."""
        start, end = (self.scale * radius for radius in self.radii_m) if self.radii_m else 2 * (self.sizes.ring,)
        return start, end

    @property
    def handle_px(self) -> float:
        """Radius of the handle: its middle must be seen to lie in the ring at the start."""
        return min(self.sizes.handle, max(0.6 * self.rings_px[0], LEAST_HANDLE_PX))

    def _paint_piece(self, tips: np.ndarray) -> np.ndarray:
        """Add a piece of the trail to the background; the points of its line (n, 2), px."""
        drawn = self._paint_way(np.concatenate((self._trail_end, self.pixels(tips))), COLOURS.trace)
        self._trail_end = drawn[-1:]
        return drawn

    def _paint_way(self, points: np.ndarray, colour: str) -> np.ndarray:
        """Add a piece of a way, points (n, 2) in px, to the background: a long trail costs no more than a short one.

        The points through which it is drawn (n, 2), px; a line from two on. The next piece goes on at the last of them.
        """
        squares = np.floor(points / THIN_PX)
        seen = np.ones(len(points), dtype=bool)
        seen[1:] = (squares[1:] != squares[:-1]).any(axis=1)
        drawn = points[seen]
        if len(drawn) > 1:
            painter = QPainter(self._background)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            painter.setPen(pen(colour, self.sizes.trail, round_cap=True))  # pieces join as if they were one
            painter.drawPolyline(polygon(drawn))
            painter.end()
        return drawn

    @property
    def handle_seen(self) -> bool:
        """Whether the middle of the handle lies in the picture; no handle at all is not out of sight."""
        return self.tip is None or QRectF(self.rect()).contains(self.to_screen(self.tip))

    def _paint_hand(self, painter: QPainter) -> None:
        """Handle, pointer and, once it is taken, the spring between them; until then where it can be taken."""
        pointer = self.to_screen(self.pointer) if self.pointer else None
        handle = self.to_screen(self.tip) if self.tip else None
        if pointer and handle and self.taken:
            path_marks.paint_spring(painter, handle, pointer, self.force_N, self.sizes.spring)
        if handle:
            if self.taken is False:
                reach = self.scale * GRASP_RADIUS_M
                painter.setPen(pen(COLOURS.handle, 1.5, 0.6))
                painter.setBrush(shade(COLOURS.handle, 0.12))
                painter.drawEllipse(handle, reach, reach)
            path_marks.paint_disc(painter, handle, self.handle_px, COLOURS.handle)
            if not self.handle_seen:
                path_marks.paint_way_out(painter, QRectF(self.rect()), handle)
        if pointer:
            path_marks.paint_circle(painter, pointer, self.sizes.pointer, pen(COLOURS.pointer, 2.0))
