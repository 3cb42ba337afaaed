"""The marks on the workspace: arrows of forces, needles of the field, SDOF directions, the reachable forces."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QPainter

from app.window.painting import theme
from app.window.painting.layers import OFF, SLIPPING, STUCK, Direction, Doing, Instant, Point, Wedge
from app.window.painting.theme import pen, shade, text_width, write
from core.control.velocity_field import Field
from core.mechanism import JOINTS

PX_PER_N = 7.0  # of the arrows
ARROW_MOST_PX = 150.0  # longer ones are cut: their value stands beside them
LEAST_FORCE_N = 0.2  # weaker than this is not drawn
HEAD_PX = 8.0  # of an arrow's head
DIRECTION_PX, LETTER_PX, WEDGE_PX = 58.0, 69.0, 78.0  # length of a direction, its letter, radius of the wedge
NEEDLE_SHARE = 0.24  # half a needle's length, of the distance between two


def arrow_of(force: Point) -> QPointF:
    """From the tail to the head of a force's arrow, px; nothing where it is too weak to be drawn."""
    size = math.hypot(*force)
    if size < LEAST_FORCE_N:
        return QPointF()
    scale = min(PX_PER_N, ARROW_MOST_PX / size)
    return QPointF(scale * force[0], -scale * force[1])


def paint_arrow(painter: QPainter, tail: QPointF, reach: QPointF, colour: str, width: float) -> None:
    """An arrow from `tail` over `reach`, px."""
    x, y = reach.toTuple()
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


def paint_directions(painter: QPainter, handle: QPointF, found: Iterable[Direction], field: Field) -> None:
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
        write(painter, beyond, JOINTS[direction.joint], theme.SMALL, True, colour)
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


Line = tuple[float, float, float, float]  # px: x0, y0, x1, y1
Box = tuple[float, float, float, float]  # px: left, top, right, bottom

RIGHT_OF, LEFT_OF, BELOW, ABOVE = "right", "left", "below", "above"
CORNERS = ("above right", "below right", "above left", "below left")
FAR, FAR_PX = "far ", 18.0  # before a side: so much further away
ROUND = (*CORNERS, *(FAR + side for side in (RIGHT_OF, LEFT_OF, BELOW, ABOVE, *CORNERS)))


def meets(line: Line, box: Box) -> bool:
    """Whether a straight line passes through a box: what is left of it between the box's four sides."""
    x0, y0, x1, y1 = line
    left, top, right, bottom = box
    if (x0 < left and x1 < left) or (x0 > right and x1 > right) or (y0 < top and y1 < top) or (y0 > bottom < y1):
        return False  # most of them: all of it is beyond one side
    first, last = 0.0, 1.0
    for start, run, low, high in ((x0, x1 - x0, left, right), (y0, y1 - y0, top, bottom)):
        if run == 0.0:
            if not low <= start <= high:
                return False
            continue
        enters, leaves = (low - start) / run, (high - start) / run
        if enters > leaves:
            enters, leaves = leaves, enters
        first, last = max(first, enters), min(last, leaves)
        if first > last:
            return False
    return True


def box_at(mark: QPointF, side: str, away: float, width: float, height: float) -> QRectF:
    """The label's box on one side of its mark, `away` px from it."""
    x, y = mark.x(), mark.y()
    if side.startswith(FAR):
        return box_at(mark, side.removeprefix(FAR), away + FAR_PX, width, height)
    if side == RIGHT_OF:
        return QRectF(x + away, y - 0.5 * height, width, height)
    if side == LEFT_OF:
        return QRectF(x - away - width, y - 0.5 * height, width, height)
    if side in CORNERS:
        above, left = side.startswith("above"), side.endswith("left")
        return QRectF(x - width if left else x, y - away - height if above else y + away, width, height)
    return QRectF(x - 0.5 * width, y + away if side == BELOW else y - away - height, width, height)


def free_side(
    mark: QPointF,
    sides: Sequence[str],
    size: tuple[float, float, float],
    lines: Sequence[Line],
    boxes: Sequence[QRectF],
    room: QRectF,
) -> str:
    """The side on which the label (away, width, height; px) touches least, the first of `sides` where several do."""

    def touched(side: str) -> int:
        box = box_at(mark, side, *size)
        outside, corners = 0 if room.contains(box) else 100, box.getCoords()
        crossed = sum(meets(line, corners) for line in lines)
        return outside + crossed + 2 * sum(box.intersects(other) for other in boxes)

    best, least = sides[0], touched(sides[0])
    for side in sides[1:]:
        if least == 0:
            break
        if (count := touched(side)) < least:
            best, least = side, count
    return best


SHADE = {OFF: theme.BRAKE_OFF, SLIPPING: theme.BRAKE_SLIPPING, STUCK: theme.BRAKE_STUCK}
HAND, BRAKES = "hand", "brakes"
FORCE_SHADE = {HAND: theme.GOOD, BRAKES: theme.BRAKE_SLIPPING}
JOINT_PX = 12.0  # radius of a brake's ring
HEIGHT_PX = 15.0  # of a label
JOINT_AWAY_PX, FORCE_AWAY_PX = JOINT_PX + 7.0, 9.0  # from the middle of the ring, from the arrow's head
#: where a joint's label goes if it can: inside the linkage at the elbows, outside at the bases
SIDES = {
    "A": (LEFT_OF, BELOW, RIGHT_OF, ABOVE),
    "E": (RIGHT_OF, LEFT_OF, BELOW, ABOVE),
    "B": (RIGHT_OF, BELOW, LEFT_OF, ABOVE),
    "C": (LEFT_OF, RIGHT_OF, BELOW, ABOVE),
}


def sides_of(force: Point) -> tuple[str, ...]:
    """The sides of an arrow's head, the one that it points to first, none that lies back at its tail."""
    across = (RIGHT_OF, LEFT_OF) if force[0] >= 0.0 else (LEFT_OF, RIGHT_OF)
    up = (ABOVE, BELOW) if force[1] >= 0.0 else (BELOW, ABOVE)
    ahead, beside = (across, up) if abs(force[0]) > abs(force[1]) else (up, across)
    return (ahead[0], *beside, *(side for side in ROUND if ahead[0] in side and ahead[1] not in side))


class Labels:
    """What is written, and on which side of its mark."""

    def __init__(self) -> None:
        self.words: dict[str, str] = {}
        self.doing: dict[str, Doing] = {}  # joint -> what its brake does
        self.sides: dict[str, str] = {}
        self.boxes: dict[str, QRectF] = {}  # where each stands, px

    def word(self, instant: Instant, doing: dict[str, Doing]) -> None:
        """New words: of each brake, of both forces."""
        words, self.doing = {}, doing
        for joint, (state, torque) in doing.items():
            words[joint] = state if state == OFF else f"{state} {torque:.1f} N m"
        for name, force in ((HAND, instant.hand), (BRAKES, instant.brakes)):
            if math.hypot(*force) >= LEAST_FORCE_N:
                words[name] = f"{name} {math.hypot(*force):.1f} N"
        self.words = words

    def place(
        self,
        instant: Instant,
        marks: Mapping[str, QPointF],
        lines: Sequence[Line],
        boxes: Sequence[QRectF],
        room: QRectF,
    ) -> None:
        """Choose sides: of marks (px) by name; lines and boxes are what a label must not lie on."""
        taken = list(boxes)
        for name, words in self.words.items():
            if name not in marks:
                continue
            wanted = SIDES.get(name) or sides_of(instant.hand if name == HAND else instant.brakes)
            before = self.sides.get(name)
            sides = wanted if before is None else (before, *(side for side in wanted if side != before))
            size = self._size(name, words)
            own = [box for box in taken if not box.contains(marks[name])]
            self.sides[name] = free_side(marks[name], sides, size, lines, own, room)
            taken.append(box_at(marks[name], self.sides[name], *size))

    def stand(self, marks: Mapping[str, QPointF]) -> None:
        """Each label beside its mark (px)."""
        self.boxes = {
            name: box_at(marks[name], self.sides.get(name, RIGHT_OF), *self._size(name, words))
            for name, words in self.words.items()
            if name in marks
        }

    def paint(self, painter: QPainter) -> None:
        """Write each label where it stands."""
        for name, box in self.boxes.items():
            words = self.words[name]
            colour = FORCE_SHADE.get(name) or (theme.QUIET if words == OFF else SHADE[words.split()[0]])
            painter.fillRect(box, shade(theme.CANVAS, 0.6))  # to be read even where it must lie on something
            write(painter, box.center(), words, theme.SMALL, False, colour)

    @staticmethod
    def _size(name: str, words: str) -> tuple[float, float, float]:
        """How far from its mark, how wide and how high, px."""
        away = FORCE_AWAY_PX if name in FORCE_SHADE else JOINT_AWAY_PX
        return away, text_width(words, theme.SMALL) + 2.0, HEIGHT_PX


def force_ends(handle: QPointF, instant: Instant) -> dict[str, QPointF]:
    """The heads of both forces' arrows, px."""
    return {HAND: handle + arrow_of(instant.hand), BRAKES: handle + arrow_of(instant.brakes)}
