"""The way of the handle as a view shows it, beside the ticks that it is made of."""

from collections.abc import Iterator

import numpy as np

from app.window.canvas.plane import Plane
from core import tick_log


def way_of(rows: np.ndarray) -> np.ndarray:
    """Where the handle was (n, 2), m, at every tick of the movement."""
    return rows[rows[:, tick_log.PHASE] == tick_log.MOVE][:, (tick_log.TIP_X, tick_log.TIP_Y)]


def trail_of(view: Plane) -> np.ndarray:
    """Every place (n, 2), m, on the way that a view shows."""
    return np.concatenate([np.empty((0, 2)), *view.trail])


def is_painted(view: Plane) -> bool:
    """Whether what stands on the screen is what a whole repaint shows."""
    seen = view.grab().toImage()
    view.repaint_still()
    return view.grab().toImage() == seen


def frames(rows: np.ndarray, generator: np.random.Generator) -> Iterator[tuple[int, int]]:
    """First and last tick (not included) of frame after frame, of which many are dropped, some for a second."""
    at = 0
    while at < len(rows):
        until = at + int(generator.choice((16, 17, 33, 90, 400, 1300), p=(0.4, 0.2, 0.15, 0.15, 0.05, 0.05)))
        yield at, min(until, len(rows))
        at = until
