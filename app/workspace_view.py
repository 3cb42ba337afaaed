"""The workspace as the person sees it: path, start, end, handle, the spring to the pointer, the linkage faintly.

True to scale, the same scale for all trials of a session. What stands still during a trial is painted once into a
background; only what moves is painted anew. The view holds no state of the experiment: it is told what to show.
"""

import math
from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPaintEvent, QPen, QPixmap, QPolygonF, QResizeEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app import theme
from core import row
from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.workspace import arm_pose
from experiments.plan import SEGMENTS, Segment

Point = tuple[float, float]  # m

FORCE_RED_N = 20.0  # the spring is green when slack, red from here on
MARGIN_M = 0.03  # around the linkage on all segments
TEXT_PX = 92  # kept free at the top for the participant's line
RING_PX, HANDLE_PX, POINTER_PX, JOINT_PX = 11.0, 7.5, 6.0, 12.0
FOOT_PX = 30  # kept free at the bottom for the notes
LEGEND = ((theme.BRAKE_OFF, "brake off"), (theme.BRAKE_SLIPPING, "slipping"), (theme.BRAKE_STUCK, "stuck"))
ASSUMED = "parameters assumed"
TRAIL_MOST = 4000  # points; a longer trail is thinned out


def joints_at(mechanism: Mechanism, tip: Point) -> dict[str, Point]:
    """Where the joints A, E, B, C and D are (m) for a tip; none of them out of reach."""
    places: dict[str, Point] = {}
    for base, elbow, arm in (("A", "E", mechanism.arm_1), ("B", "C", mechanism.arm_2)):
        e1 = arm_pose(arm, np.float64(tip[0]), np.float64(tip[1])).e1
        places[base] = (arm.base_x, arm.base_y)
        places[elbow] = (arm.base_x + float(e1[0]), arm.base_y + float(e1[1]))
    places["D"] = tip
    return places if np.all(np.isfinite(list(places.values()))) else {}


def extent(devices: Sequence[Device]) -> QRectF:
    """The rectangle (m) in which every device's linkage stays while its tip is on the segments."""
    points = [
        place
        for device in devices
        for segment in SEGMENTS.values()
        for share in np.linspace(0.0, 1.0, 9)
        for place in joints_at(
            device.mechanism, tuple((1 - share) * np.array(segment.start) + share * np.array(segment.end))
        ).values()
    ]
    low, high = np.min(points, axis=0) - MARGIN_M, np.max(points, axis=0) + MARGIN_M
    return QRectF(low[0], low[1], high[0] - low[0], high[1] - low[1])


class WorkspaceView(QWidget):
    """The picture of one device; tells where the pointer is on it."""

    pointer_moved = Signal(float, float)  # m, inside what is drawn

    def __init__(self, devices: Sequence[Device], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._extent = extent(devices)
        self._device, self._segment = devices[0], SEGMENTS[1]
        self._background: QPixmap | None = None
        self._large, self._small = "", ""
        self.tip: Point = (0.0, 0.0)
        self.pointer: Point | None = None
        self._taken, self._force_N = False, 0.0
        self._on, self._stuck = (False,) * 4, 0
        self._trail: list[Point] = []
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(420, 420)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    # what to show

    def show_trial(self, device: Device, segment: Segment, tip: Point) -> None:
        """Another path or device, the handle at rest at `tip` with the brakes off."""
        self._device, self._segment, self.tip = device, segment, tip
        self._take(False)
        self._on, self._stuck, self._force_N = (False,) * 4, 0, 0.0
        self.clear_trail()

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """The newest of ticks (n, row.WIDTH): handle, force, brakes; their way as a trail during `move`."""
        now = rows[-1]
        self.tip = (float(now[row.TIP_X]), float(now[row.TIP_Y]))
        self._take(taken)
        self._force_N = math.hypot(now[row.HAND_FX], now[row.HAND_FY])
        self._on = tuple(bool(now[row.CURRENT + i] > 0.0) for i in range(4))
        self._stuck = int(now[row.STUCK])
        if now[row.PHASE] == row.MOVE:
            if self._trail and self._background is not None:
                self._paint_trail(self._background, [self._trail[-1], self.tip])
            self._trail.append(self.tip)
            if len(self._trail) > TRAIL_MOST:
                self._trail = self._trail[::2]
        self.update()

    def show_rest(self, tip: Point) -> None:
        """The handle stands at `tip`, brakes off, nobody holds it; the trail stays to be looked at."""
        self._take(False)
        self.tip, self._force_N = tip, 0.0
        self._on, self._stuck = (False,) * 4, 0
        self.update()

    def _take(self, taken: bool) -> None:
        """With the handle in hand the ring is the pointer; the system's own arrow would only cover it."""
        if taken != self._taken:
            self._taken = taken
            self.setCursor(Qt.CursorShape.BlankCursor if taken else Qt.CursorShape.ArrowCursor)

    def clear_trail(self) -> None:
        """Forget the way so far."""
        self._trail.clear()
        self._background = None
        self.update()

    def say(self, large: str, small: str = "") -> None:
        """The participant's line, and a quiet one under it."""
        if (large, small) != (self._large, self._small):
            self._large, self._small = large, small
            self.update()

    @property
    def said(self) -> str:
        return self._large

    # metres and pixels

    def _scale(self) -> float:
        """Pixels per metre."""
        room = max(self.height() - TEXT_PX - FOOT_PX, 1)
        return min(self.width() / self._extent.width(), room / self._extent.height())

    def to_screen(self, point: Point) -> QPointF:
        """Where a place of the workspace (m) is on the widget (px)."""
        scale, centre = self._scale(), self._extent.center()
        middle_y = 0.5 * (self.height() + TEXT_PX - FOOT_PX)
        return QPointF(0.5 * self.width() + scale * (point[0] - centre.x()),
                       middle_y - scale * (point[1] - centre.y()))  # fmt: skip

    def to_workspace(self, place: QPointF) -> Point:
        """The place of the workspace (m) under a point of the widget (px), clamped to what is drawn."""
        scale, centre = self._scale(), self._extent.center()
        x = min(max(place.x(), 0.0), float(self.width()))
        y = min(max(place.y(), 0.0), float(self.height()))
        middle_y = 0.5 * (self.height() + TEXT_PX - FOOT_PX)
        return centre.x() + (x - 0.5 * self.width()) / scale, centre.y() + (middle_y - y) / scale

    # events

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self.pointer = self.to_workspace(event.position())
        self.pointer_moved.emit(*self.pointer)
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.mouseMoveEvent(event)
        super().mousePressEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._background = None
        super().resizeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        ratio = self.devicePixelRatioF()
        if self._background is None or self._background.devicePixelRatio() != ratio:
            self._background = self._paint_background(ratio)
        painter = QPainter(self)
        painter.drawPixmap(0, 0, self._background)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._paint_linkage(painter)
        self._paint_hand(painter)
        self._paint_text(painter)

    # painting

    def _paint_background(self, ratio: float) -> QPixmap:
        """Ground, scale lines every 10 cm, path, start, end."""
        pixmap = QPixmap(self.size() * ratio)
        pixmap.setDevicePixelRatio(ratio)
        pixmap.fill(theme.colour(theme.GROUND))
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(theme.colour(theme.LINE), 1.0))
        painter.setBrush(theme.colour(theme.CANVAS))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), theme.RADIUS, theme.RADIUS)
        painter.setFont(theme.font(theme.SMALL))
        for i in range(-20, 21):
            at = self.to_screen((0.1 * i, 0.1 * i))
            if i >= 0 and TEXT_PX < at.y() < self.height() - FOOT_PX:
                painter.setPen(QPen(theme.colour(theme.LINE, 0.55), 1.0))
                painter.drawLine(QPointF(58.0, at.y()), QPointF(self.width() - 14.0, at.y()))
                painter.setPen(theme.colour(theme.QUIET, 0.75))
                box = QRectF(10.0, at.y() - 9.0, 44.0, 18.0)
                painter.drawText(box, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, f"{10 * i} cm")
            if 60 < at.x() < self.width() - 14:
                painter.setPen(QPen(theme.colour(theme.LINE, 0.55), 1.0))
                painter.drawLine(QPointF(at.x(), float(TEXT_PX)), QPointF(at.x(), float(self.height() - FOOT_PX)))
        self._paint_notes(painter)
        start, end = self.to_screen(self._segment.start), self.to_screen(self._segment.end)
        pen = QPen(theme.colour("#ffffff", 0.92), 3.0)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        painter.setPen(pen)
        painter.drawLine(start, end)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for place, ring in ((start, theme.START_RING), (end, theme.END_RING)):
            painter.setPen(QPen(theme.colour(ring), 3.0))
            painter.drawEllipse(place, RING_PX, RING_PX)
        painter.end()
        if len(self._trail) > 1:
            self._paint_trail(pixmap, self._trail)
        return pixmap

    def _paint_notes(self, painter: QPainter) -> None:
        """Bottom line: what the brakes' colours mean, and that the device's numbers are assumed."""
        y, x = self.height() - 16.0, 18.0
        for shade, word in LEGEND:
            painter.setPen(QPen(theme.colour(shade), 2.5))
            painter.drawEllipse(QPointF(x + 4.0, y), 5.0, 5.0)
            painter.setPen(theme.colour(theme.QUIET))
            painter.drawText(QPointF(x + 15.0, y + 4.0), word)
            x += 29.0 + painter.fontMetrics().horizontalAdvance(word)
        if self._device.assumed:
            painter.setPen(theme.colour(theme.CAUTION, 0.85))
            width = painter.fontMetrics().horizontalAdvance(ASSUMED)
            painter.drawText(QPointF(self.width() - 14.0 - width, y + 4.0), ASSUMED)

    def _paint_linkage(self, painter: QPainter) -> None:
        """Arms faintly, each brake in the colour of what it does."""
        places = joints_at(self._device.mechanism, self.tip)
        if not places:
            return
        at = {joint: self.to_screen(place) for joint, place in places.items()}
        for width, shade in ((7.0, theme.ARM), (2.0, theme.ARM_CORE)):
            pen = QPen(theme.colour(shade), width)
            pen.setCapStyle(Qt.PenCapStyle.FlatCap)  # flat and opaque, line by line: a twentieth of the time
            painter.setPen(pen)
            for one, other in ("AE", "ED", "BC", "CD"):
                painter.drawLine(at[one], at[other])
        painter.setFont(theme.font(theme.SMALL, bold=True))
        painter.setBrush(theme.colour(theme.CANVAS))
        drawn: list[QPointF] = []
        for i, joint in enumerate(JOINTS):
            if joint not in self._device.braked:
                painter.setPen(QPen(theme.colour(theme.BRAKE_OFF, 0.8), 2.0))
                painter.drawEllipse(at[joint], 5.0, 5.0)
                continue
            place, radius = QPointF(at[joint]), JOINT_PX
            if any((place - other).manhattanLength() < JOINT_PX for other in drawn):
                place.setX(place.x() + 2.0 * JOINT_PX + 3.0)  # coaxial bases: side by side
            drawn.append(place)
            shade = theme.BRAKE_OFF
            if self._on[i]:
                shade = theme.BRAKE_STUCK if self._stuck >> i & 1 else theme.BRAKE_SLIPPING
            painter.setPen(QPen(theme.colour(shade), 3.0))
            painter.drawEllipse(place, radius, radius)
            painter.setPen(theme.colour(theme.TEXT if self._on[i] else theme.QUIET))
            box = QRectF(place.x() - radius, place.y() - radius, 2 * radius, 2 * radius)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, joint)

    def _paint_trail(self, pixmap: QPixmap, points: Sequence[Point]) -> None:
        """Add a piece of the way to the background: a long trail costs no more than a short one."""
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(theme.colour(theme.TRACE, 0.7), 1.5))
        painter.drawPolyline(QPolygonF([self.to_screen(point) for point in points]))

    def _paint_hand(self, painter: QPainter) -> None:
        """Handle, pointer and, once it is taken, the spring between them in the colour of its force."""
        handle = self.to_screen(self.tip)
        pointer = self.to_screen(self.pointer) if self.pointer else None
        if pointer and self._taken:
            share = min(self._force_N / FORCE_RED_N, 1.0)
            ends = (theme.GOOD, theme.CAUTION) if share < 0.5 else (theme.CAUTION, theme.BAD)
            painter.setPen(QPen(theme.mixed(*ends, 2.0 * share % 1.0 if share < 1.0 else 1.0), 2.0))
            painter.drawLine(handle, pointer)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.colour("#ffffff"))
        painter.drawEllipse(handle, HANDLE_PX, HANDLE_PX)
        if pointer:
            painter.setPen(QPen(theme.colour(theme.POINTER), 2.0))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawEllipse(pointer, POINTER_PX, POINTER_PX)

    def _paint_text(self, painter: QPainter) -> None:
        centre = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignVCenter
        painter.setFont(theme.font(theme.LARGE, bold=True))
        painter.setPen(theme.colour(theme.TEXT))
        painter.drawText(QRectF(0.0, 12.0, self.width(), 46.0), centre, self._large)
        painter.setFont(theme.font(theme.TITLE))
        painter.setPen(theme.colour(theme.QUIET))
        painter.drawText(QRectF(0.0, 58.0, self.width(), 24.0), centre, self._small)
