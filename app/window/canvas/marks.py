"""The marks on the workspace: arms, rings, arrows of forces, needles of the field, SDOF directions, labels."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, QSizeF, Qt
from PySide6.QtGui import QPainter

from app.window.canvas.layers import OFF, SLIPPING, STUCK, Direction, Doing, Instant, Point, Wedge
from app.window.widgets import theme
from app.window.widgets.theme import pen, shade, text_px, text_width, write
from core.control.velocity_field import Field
from core.mechanism import JOINTS

PX_PER_N = 7.0  # of the arrows
ARROW_MOST_PX = 150.0  # longer ones are cut: their value stands beside them
LEAST_FORCE_N = 0.2  # weaker than this is not drawn
HEAD_PX = 8.0  # of an arrow's head
DIRECTION_PX, LETTER_PX, WEDGE_PX = 58.0, 69.0, 78.0  # length of a direction, its letter, radius of the wedge
NEEDLE_SHARE = 0.24  # half a needle's length, of the distance between two
ARMS = (("A", "E"), ("E", "D"), ("B", "C"), ("C", "D"))
HAND, BRAKES = "hand", "brakes"
SHADE = {OFF: theme.BRAKE_OFF, SLIPPING: theme.BRAKE_SLIPPING, STUCK: theme.BRAKE_STUCK}
FORCE_SHADE = {HAND: theme.GOOD, BRAKES: theme.BRAKE_SLIPPING}
JOINT_PX, BARE_PX = 12.0, 5.0  # radius of a brake's ring, and of a joint's without a brake
LETTER_WIDE_PX = 2.5  # more radius for each further letter in a ring


def paint_arms(painter: QPainter, at: Mapping[str, QPointF], width: float, core_width: float) -> None:
    """The arms between the joints (px; none where the arms do not reach). Flat, opaque lines one by one are fast."""
    for thick, colour in ((width, theme.ARM), (core_width, theme.ARM_CORE)) if at else ():
        painter.setPen(pen(colour, thick))
        for one, other in ARMS:
            painter.drawLine(at[one], at[other])


def ring_radius(label: str) -> float:
    """Of a brake's ring (px): a coupling's label is wider than a letter."""
    return JOINT_PX + LETTER_WIDE_PX * (len(label) - 1)


def rings_of(at: Mapping[str, QPointF], labels: Mapping[str, str]) -> dict[str, QPointF]:
    """The middles of the joints' rings (px): brakes of coaxial bases, and couplings, stand in a row at the bases."""
    there = [joint for joint in "AECB" if joint in labels and (joint in "AB" or labels[joint] != joint)]
    if len(there) < 2 or not at:
        return dict(at)
    span, radius = QLineF(at["A"], at["B"]).length(), max(ring_radius(labels[joint]) for joint in there)
    if span >= 2.0 * radius + 2.0 and there == ["A", "B"]:
        return dict(at)
    way = (at["B"] - at["A"]) * (1.0 / span) if span > radius else QPointF(1.0, 0.0)
    middle, apart = (at["A"] + at["B"]) * 0.5, max(2.0 * radius + 4.0, span / (len(there) - 1))
    places = [way * ((k - 0.5 * (len(there) - 1)) * apart) for k in range(len(there))]
    return {**at, **{joint: middle + place for joint, place in zip(there, places, strict=True)}}


def paint_ring(painter: QPainter, middle: QPointF, radius: float, width: float, colour: str) -> None:
    """A ring and the canvas in it (px; no pen): two discs take half of the time of a circle drawn with a pen."""
    for reach, fill in ((radius + 0.5 * width, colour), (radius - 0.5 * width, theme.CANVAS)):
        painter.setBrush(shade(fill))
        painter.drawEllipse(middle, reach, reach)


def paint_joints(
    painter: QPainter,
    rings: Mapping[str, QPointF],
    labels: Mapping[str, str],
    doing: Mapping[str, Doing],
    blind: bool,
) -> None:
    """A ring for each brake, in the colour of what it does, its label in that of its current's curve, unless blind;
    a bare ring for a joint without a brake."""
    painter.setPen(Qt.PenStyle.NoPen)
    for joint in JOINTS if rings else "":
        if joint not in labels:
            paint_ring(painter, rings[joint], BARE_PX, 2.0, theme.BRAKE_OFF)
            continue
        state = doing.get(joint, Doing()).state
        paint_ring(painter, rings[joint], ring_radius(labels[joint]), 3.0, SHADE[state])
        write(painter, rings[joint], labels[joint], theme.SMALL, True, theme.QUIET if blind else theme.JOINT[joint])


def arrow_of(force: Point) -> QPointF:
    """From the tail to the head of a force's arrow, px; (0, 0) where it is too weak to be drawn."""
    size = math.hypot(*force)
    if size < LEAST_FORCE_N:
        return QPointF()
    scale = min(PX_PER_N, ARROW_MOST_PX / size)
    return QPointF(scale * force[0], -scale * force[1])


def paint_arrow(painter: QPainter, tail: QPointF, reach: QPointF, colour: str, width: float) -> None:
    """An arrow from `tail` over `reach`, px."""
    x, y = reach.x(), reach.y()
    length = math.hypot(x, y)
    if length < 1.0:
        return
    head, size = tail + reach, min(HEAD_PX, length)
    share = size / length
    foot, half = head - reach * share, QPointF(-y, x) * (0.45 * share)
    painter.setPen(pen(colour, width))
    painter.drawLine(tail, head - reach * (0.8 * share))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(colour))
    painter.drawPolygon([head, foot + half, foot - half])


def paint_field(painter: QPainter, middles: np.ndarray, ways: np.ndarray, apart: float) -> None:
    """Needles, their middles (n, 2) `apart` px from each other, brighter towards their ways (n, 2), unit vectors."""
    half = NEEDLE_SHARE * apart * ways
    for one, other, alpha in ((middles - half, middles, 0.35), (middles, middles + half, 0.8)):
        painter.setPen(pen(theme.BRAKE_OFF, 1.0, alpha))
        painter.drawLines([QLineF(*line) for line in np.hstack((one, other)).tolist()])


def paint_directions(
    painter: QPainter, handle: QPointF, found: Iterable[Direction], field: Field, labels: Mapping[str, str]
) -> None:
    """Each brake's line; the valid sense an arrow, the chosen one strong; the desired direction as text."""
    for direction in found:
        reach = QPointF(direction.p_x, -direction.p_y) * ((direction.sense or 1.0) * DIRECTION_PX)
        painter.setPen(pen(theme.QUIET, 1.0, 0.6))
        painter.drawLine(handle - reach, handle + reach)
        if direction.sense:
            colour, width = (theme.ACCENT, 3.0) if direction.chosen else (theme.QUIET, 1.6)
            paint_arrow(painter, handle, reach, colour, width)
        beyond = handle + reach * (LETTER_PX / DIRECTION_PX)
        colour = theme.TEXT if direction.chosen else theme.QUIET
        write(painter, beyond, labels[JOINTS[direction.joint]], theme.SMALL, True, colour)
    paint_arrow(painter, handle, QPointF(field.beta_x, -field.beta_y) * (0.6 * DIRECTION_PX), theme.TEXT, 1.6)


def paint_wedge(painter: QPainter, handle: QPointF, found: Wedge) -> None:
    """The wedge and, in it, each brake by itself."""
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(shade(theme.WEDGE, 0.24))
    box = QRectF(handle.x() - WEDGE_PX, handle.y() - WEDGE_PX, 2.0 * WEDGE_PX, 2.0 * WEDGE_PX)
    first, span = math.degrees(found.first), math.degrees(found.last - found.first)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # a third of the time; the edges below are smooth
    painter.drawPie(box, round(16.0 * first), round(16.0 * span))  # sixteenths of a degree
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(pen(theme.WEDGE_EDGE, 1.2))
    for angle in found.spokes:
        painter.drawLine(handle, handle + QPointF(math.cos(angle), -math.sin(angle)) * WEDGE_PX)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawArc(box, round(16.0 * first), round(16.0 * span))


# labels


class Side(NamedTuple):
    """Where a label stands, seen from its mark: -1, 0 or 1 to the right and down, and so much further away (px)."""

    x: int
    y: int
    far: float = 0.0


RIGHT_OF, LEFT_OF, BELOW, ABOVE = Side(1, 0), Side(-1, 0), Side(0, 1), Side(0, -1)
FAR_PX = (0.0, 18.0, 40.0, 80.0, 130.0)
ROUND = tuple(Side(x, y, far) for far in FAR_PX for x in (1, 0, -1) for y in (-1, 0, 1) if x or y)
NEAR = tuple(side for side in ROUND if side.far <= FAR_PX[1])
#: where a joint's label goes if it can: inside the linkage at the elbows, outside at the bases
SIDES = {
    "A": (LEFT_OF, BELOW, RIGHT_OF, ABOVE),
    "E": (RIGHT_OF, LEFT_OF, BELOW, ABOVE),
    "B": (RIGHT_OF, BELOW, LEFT_OF, ABOVE),
    "C": (LEFT_OF, RIGHT_OF, BELOW, ABOVE),
}
COVERED = 1000  # how much worse it is to lie on what must be seen than on what is only drawn, point by point
JOINT_AWAY_PX, FORCE_AWAY_PX = JOINT_PX + 7.0, 11.0  # from the middle of the ring, from the arrow's head
SPARE_PX = 1.5  # around a label
ALONG = np.linspace(0.0, 1.0, 75)[:, None]  # shares of a line at which it is looked whether a label lies on it
TOGETHER = 4  # places for a label that are looked at together
APART_PX = 13.0  # at most, between points all over a box; labels are higher


def points_along(one: QPointF, other: QPointF) -> np.ndarray:
    """Points (n, 2), px, along a straight line."""
    return np.array((one.x(), one.y())) + ALONG * (other.x() - one.x(), other.y() - one.y())


def points_in(box: QRectF) -> np.ndarray:
    """Points (n, 2), px, all over a box: a label that lies on it covers at least one of them."""
    x, y = (
        np.linspace(low, low + far, 2 + int(far / APART_PX))
        for low, far in ((box.x(), box.width()), (box.y(), box.height()))
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def box_at(mark: QPointF, side: Side, away: float, width: float, height: float) -> QRectF:
    """The box of a label (px), `away` px from its mark."""
    away += side.far
    x = mark.x() + side.x * (0.5 * width + (0.0 if side.y else away))
    y = mark.y() + side.y * (0.5 * height + away)
    return QRectF(x - 0.5 * width, y - 0.5 * height, width, height)


def counts_in(boxes: Sequence[QRectF], points: np.ndarray) -> np.ndarray:
    """How many points (n, 2), px, lie in each box or close to it."""
    edges = [box.adjusted(-SPARE_PX, -SPARE_PX, SPARE_PX, SPARE_PX).getCoords() for box in boxes]
    left, top, right, bottom = np.array(edges).T[:, :, None]
    x, y = points.T
    return np.count_nonzero((x > left) & (x < right) & (y > top) & (y < bottom), axis=1)


def free_box(boxes: Iterable[QRectF], solid: np.ndarray, drawn: np.ndarray, room: QRectF) -> tuple[int, QRectF]:
    """The box, and its place among them, that lies in the room (px) and on the fewest points (n, 2), of those first on
    the solid ones; of equals the first. A few are looked at together, and no more once one is free."""
    left, at, best, least = iter(boxes), 0, (0, QRectF()), math.inf
    while least > 0 and (some := list(islice(left, TOGETHER))):
        outside = np.array([not room.contains(box) for box in some])
        costs = COVERED * (counts_in(some, solid) + outside) + counts_in(some, drawn)
        if costs.min() < least:
            least, best = costs.min(), (at + int(costs.argmin()), some[int(costs.argmin())])
        at += len(some)
    return best


def inside(box: QRectF, room: QRectF) -> QRectF:
    """The box moved into the room, if it is partly outside."""
    x = min(max(box.x(), room.left()), max(room.right() - box.width(), room.left()))
    y = min(max(box.y(), room.top()), max(room.bottom() - box.height(), room.top()))
    return QRectF(x, y, box.width(), box.height())


def sides_of(force: Point) -> list[Side]:
    """The sides of an arrow's head, nearest to where it points first."""
    ahead = {side: (side.x * force[0] - side.y * force[1]) / math.hypot(side.x, side.y) for side in ROUND}
    return sorted(ROUND, key=lambda side: (side.far if ahead[side] >= 0.0 else side.far + 100.0, -ahead[side]))


class Labels:
    """What is written at the brakes and at the forces' arrows, and on which side of its mark."""

    def __init__(self, hand: str = HAND, size: int = theme.SMALL, bold: bool = False) -> None:
        """hand: what its force is called."""
        self.names, self._size, self._bold = {HAND: hand, BRAKES: BRAKES}, size, bold
        self.words: dict[str, str] = {}
        self.doing: dict[str, Doing] = {}  # joint -> what its brake does
        self.sides: dict[str, Side] = {}
        self.boxes: dict[str, QRectF] = {}  # where each stands, px

    def word(self, instant: Instant, doing: dict[str, Doing]) -> None:
        """New words: of each brake, of both forces."""
        self.doing = doing
        self.words = {
            joint: state if state == OFF else f"{state} {torque:.1f} N m" for joint, (state, torque) in doing.items()
        }
        for name, force in ((HAND, instant.hand), (BRAKES, instant.brakes)):
            if math.hypot(*force) >= LEAST_FORCE_N:
                self.words[name] = f"{self.names[name]} {math.hypot(*force):.1f} N"

    def place(
        self, instant: Instant, marks: Mapping[str, QPointF], solid: np.ndarray, drawn: np.ndarray, room: QRectF
    ) -> None:
        """Choose the side of each mark (px) on which least is drawn (n, 2), px; before others, the side it had.

        Solid points and other labels are covered only where there is no other place.
        """
        for name in (name for name in self.words if name in marks):
            force = instant.hand if name == HAND else instant.brakes
            sides = [*SIDES[name], *NEAR] if name in SIDES else sides_of(force)
            sides = [self.sides[name], *sides] if name in self.sides else sides
            best, box = free_box((self._box(name, marks[name], side, room) for side in sides), solid, drawn, room)
            self.sides[name] = sides[best]
            solid = np.vstack((solid, points_in(box)))

    def cover(self, marks: Mapping[str, QPointF], solid: np.ndarray, room: QRectF) -> bool:
        """Whether one of them now lies on another, or on a solid point (n, 2), px."""
        self._stand(marks, room)
        boxes = list(self.boxes.values())
        if any(box.intersects(other) for at, box in enumerate(boxes) for other in boxes[:at]):
            return True
        return bool(boxes and counts_in(boxes, solid).any())

    def paint(self, painter: QPainter, marks: Mapping[str, QPointF], room: QRectF) -> None:
        """Write each label beside its mark, in the room (px)."""
        self._stand(marks, room)
        for name, box in self.boxes.items():
            words = self.words[name]
            colour = FORCE_SHADE.get(name) or (theme.QUIET if words == OFF else SHADE[words.split()[0]])
            painter.fillRect(box, shade(theme.CANVAS, 0.6))  # to be read even where it must lie on something
            write(painter, box.center(), words, self._size, self._bold, colour)

    def _stand(self, marks: Mapping[str, QPointF], room: QRectF) -> None:
        self.boxes = {
            name: self._box(name, marks[name], self.sides.get(name, RIGHT_OF), room)
            for name in self.words
            if name in marks
        }

    def _box(self, name: str, mark: QPointF, side: Side, room: QRectF) -> QRectF:
        away = FORCE_AWAY_PX if name in FORCE_SHADE else JOINT_AWAY_PX
        width = text_width(self.words[name], self._size, self._bold) + 2.0
        mark = inside(QRectF(mark, QSizeF()), room).topLeft()
        return inside(box_at(mark, side, away, width, text_px(self._size + 3)), room)
