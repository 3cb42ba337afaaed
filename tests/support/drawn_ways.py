"""What of a way is really painted: every piece that a view paints of its trail, beside the ticks that it is made of."""

from collections.abc import Iterator

import numpy as np
import pytest
from PySide6.QtGui import QPainter
from scipy.spatial import cKDTree

from app.window.canvas import plane
from app.window.canvas.plane import Plane
from app.window.widgets.theme import COLOURS, shade
from core import tick_log

APART_PX = 0.2  # between the points of a line that is looked at


def way_of(rows: np.ndarray) -> np.ndarray:
    """Where the handle was (n, 2), m, at every tick of the movement."""
    return rows[rows[:, tick_log.PHASE] == tick_log.MOVE][:, (tick_log.TIP_X, tick_log.TIP_Y)]


def trail_of(view: Plane) -> np.ndarray:
    """Every place (n, 2), m, on the way that a view shows."""
    return np.concatenate([np.empty((0, 2)), *view.trail])


class Pieces(dict[Plane, list[np.ndarray]]):
    """View -> the lines (n, 2), px, of its trail that stand on its background now."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        """patch: until it is undone everything that is painted is noted."""
        super().__init__()
        pieces, paint_way, paint_background = self, Plane._paint_way, Plane._paint_background
        noted: list[np.ndarray] = []

        class Noting(QPainter):
            def drawPolyline(self, line) -> None:
                if self.pen().color().rgb() == shade(COLOURS.trace).rgb():
                    noted.append(np.array([point.toTuple() for point in line]))
                super().drawPolyline(line)

        def way(view: Plane, *about):
            result = paint_way(view, *about)
            pieces.setdefault(view, []).extend(noted)
            noted.clear()
            return result

        def background(view: Plane, ratio: float) -> None:
            pieces[view] = []
            paint_background(view, ratio)

        patch.setattr(plane, "QPainter", Noting)
        patch.setattr(Plane, "_paint_way", way)
        patch.setattr(Plane, "_paint_background", background)

    def furthest_px(self, view: Plane, rows: np.ndarray) -> float:
        """How far the way of these ticks, from the first to the last, and what is painted of it lie apart at most, px:
        every place of each from the nearest of the other, and end from end.
        """
        recorded, drawn = view.pixels(way_of(rows)), self.get(view, [])
        if not drawn:
            return float("inf")
        gaps = [float(np.hypot(*(b[0] - a[-1]))) for a, b in zip(drawn, drawn[1:], strict=False)]
        ends = [float(np.hypot(*(drawn[at][at] - recorded[at]))) for at in (0, -1)]
        painted = np.concatenate([dense(line) for line in drawn])
        return max(*gaps, *ends, apart(painted, dense(recorded)), apart(dense(recorded), painted))


def dense(line: np.ndarray) -> np.ndarray:
    """Points (n, 2) on a line, `APART_PX` apart at most."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    at = np.concatenate(([0.0], np.cumsum(steps)))
    places = np.union1d(at, np.arange(0.0, at[-1], APART_PX))
    return np.column_stack([np.interp(places, at, line[:, axis]) for axis in range(2)])


def apart(some: np.ndarray, others: np.ndarray) -> float:
    """The largest distance of one of some points (n, 2) from the nearest of the others."""
    return float(cKDTree(others).query(some)[0].max())


def frames(rows: np.ndarray, generator: np.random.Generator) -> Iterator[tuple[int, int]]:
    """First and last tick (not included) of frame after frame, of which many are dropped, some for a second."""
    at = 0
    while at < len(rows):
        until = at + int(generator.choice((16, 17, 33, 90, 400, 1300), p=(0.4, 0.2, 0.15, 0.15, 0.05, 0.05)))
        yield at, min(until, len(rows))
        at = until
