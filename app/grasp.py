"""How the pointer takes hold of the handle."""

import math

Point = tuple[float, float]

#: Our choice: the pointer takes the handle when it comes this near (m), and keeps it until the trial ends. So the
#: handle never leaps to a pointer that happened to be elsewhere: at first it is pulled with 2.4 N at most.
GRASP_RADIUS_M = 0.012


class Grasp:
    """Where the spring pulls to: the handle itself until it is taken, then the newest pointer."""

    def __init__(self, tip: Point, pointer: Point | None = None) -> None:
        self.target, self.taken = tip, False
        if pointer is not None:
            self.point(pointer, tip)

    def point(self, pointer: Point, tip: Point) -> None:
        """The pointer is now here, the handle there (m)."""
        if math.dist(pointer, tip) <= GRASP_RADIUS_M:
            self.taken = True
        if self.taken:
            self.target = pointer
