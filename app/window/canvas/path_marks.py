"""The marks of a path and of the hand on it, in px: line, rings, arrowheads, hold; handle, pointer, spring."""

import math
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPen, QPolygonF

from app.window.widgets.theme import COLOURS, mixed, pen, shade

FORCE_RED_N = 20.0  # the spring is green when slack, red from here on
HOLD_PX = 6.0  # width of the sweep of the hold
AWAY_PX = 26.0  # the arrow to a handle out of sight, from its point to where it ends
HEADS_PX = 130.0  # between the arrowheads along a path


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


def polygon(points: np.ndarray) -> QPolygonF:
    """A line through points (n, 2), px."""
    return QPolygonF([QPointF(x, y) for x, y in points.tolist()])


def paint_disc(painter: QPainter, middle: QPointF, radius: float, colour: str) -> None:
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(colour))
    painter.drawEllipse(middle, radius, radius)


def paint_circle(painter: QPainter, middle: QPointF, radius: float, line: QPen) -> None:
    painter.setPen(line)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawEllipse(middle, radius, radius)


def paint_path(painter: QPainter, points: np.ndarray, heads: bool, radii: tuple[float, float], sizes: Sizes) -> None:
    """A path through these points (n, 2): the start a ring, the end a ring with a dot. heads: arrowheads along it."""
    line = polygon(points)
    painter.setPen(pen(COLOURS.handle, sizes.path, 0.92, round_cap=True))
    painter.drawPolyline(line)
    if heads:
        _paint_heads(painter, points, 4.0 * sizes.path)
    start, end = line.first(), line.last()
    paint_disc(painter, end, 0.4 * sizes.ring, COLOURS.end_ring)
    if start == end and radii[0] == radii[1]:  # a closed path: one ring round the other
        radii = radii[0] + 1.5 * sizes.ring_pen, radii[1]
    for place, colour, radius in zip((start, end), (COLOURS.start_ring, COLOURS.end_ring), radii, strict=True):
        paint_circle(painter, place, radius, pen(colour, sizes.ring_pen))


def _paint_heads(painter: QPainter, points: np.ndarray, size: float) -> None:
    """Arrowheads: which way a path runs, where it is closed or crosses itself."""
    steps = np.diff(points, axis=0)
    way = np.cumsum(np.hypot(*steps.T))
    for place in np.searchsorted(way, np.arange(0.5 * HEADS_PX, way[-1], HEADS_PX)).tolist():
        tip, angle = QPointF(*points[place + 1].tolist()), math.atan2(steps[place, 1], steps[place, 0])
        left, right = (QPointF(math.cos(angle + turn), math.sin(angle + turn)) * size for turn in (-0.5, 0.5))
        painter.drawPolyline(QPolygonF([tip - left, tip, tip - right]))


def paint_hold(painter: QPainter, start: QPointF, radius: float, share: float, wide: float = HOLD_PX) -> None:
    """A sweep around the ring at the start, for the share of the hold that is over."""
    reach = radius + 0.5 * wide + 1.0
    painter.setPen(pen(COLOURS.start_ring, wide))
    painter.setBrush(Qt.BrushStyle.NoBrush)
    box = QRectF(start.x() - reach, start.y() - reach, 2.0 * reach, 2.0 * reach)
    painter.drawArc(box, 90 * 16, -round(share * 360 * 16))


def paint_spring(painter: QPainter, handle: QPointF, pointer: QPointF, force_N: float, width: float) -> None:
    """The spring from the handle to the pointer that has hold of it: green, yellow, red as its force grows."""
    share = round(2.0 * min(force_N / FORCE_RED_N, 1.0), 1)
    low, high = (COLOURS.good, COLOURS.caution) if share < 1.0 else (COLOURS.caution, COLOURS.bad)
    painter.setPen(pen(mixed(low, high, share if share < 1.0 else share - 1.0).name(), width))
    painter.drawLine(handle, pointer)


def paint_way_out(painter: QPainter, picture: QRectF, handle: QPointF) -> None:
    """At the edge of the picture, an arrow to the handle, which is out of sight."""
    half = 0.5 * AWAY_PX
    room = picture.adjusted(half, half, -half, -half)  # it is seen whole, in a corner too
    at = QPointF(min(max(handle.x(), room.left()), room.right()), min(max(handle.y(), room.top()), room.bottom()))
    painter.save()
    painter.translate(at)
    painter.rotate(math.degrees(math.atan2(handle.y() - at.y(), handle.x() - at.x())))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(COLOURS.handle))
    painter.drawPolygon(QPolygonF([QPointF(0.0, 0.0), QPointF(-AWAY_PX, half), QPointF(-AWAY_PX, -half)]))
    painter.restore()
