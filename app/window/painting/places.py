"""Where a label can stand beside its mark without lying on an arm, another label or the edge."""

from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF

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
