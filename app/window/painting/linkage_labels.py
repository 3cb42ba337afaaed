"""The words on the workspace: what each brake does beside its joint, the size of each force beside its arrow.

A label stands where it lies on nothing, and stays on its side as long as that is free.
"""

import math
from collections.abc import Mapping, Sequence

from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QPainter

from app.window.painting import theme
from app.window.painting.extent import Point
from app.window.painting.instant import OFF, SLIPPING, STUCK, Doing, Instant
from app.window.painting.marks import LEAST_FORCE_N, arrow_of
from app.window.painting.pens import shade, text_width, write
from app.window.painting.places import ABOVE, BELOW, LEFT_OF, RIGHT_OF, ROUND, Line, box_at, free_side

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
