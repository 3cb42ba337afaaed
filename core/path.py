"""The path to follow, as the controllers see it: where the nearest point lies and which way the path runs there.

A straight segment now. A polyline or an arc joins by giving `nearest` another branch; nothing else asks how a path
is made.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from core.errors import InputError
from core.jit import kernel


class Path(NamedTuple):
    """A line segment from start to end (m) with its unit tangent, start to end."""

    x0: float
    y0: float
    x1: float
    y1: float
    length: float  # m
    tangent_x: float
    tangent_y: float


def line(start: Sequence[float], end: Sequence[float]) -> Path:
    """The segment from start to end (m, two numbers each). InputError if it has no length or is not finite."""
    try:
        x0, y0 = (float(value) for value in start)
        x1, y1 = (float(value) for value in end)
    except (TypeError, ValueError):
        raise InputError(f"path: start {start!r} and end {end!r} must be two numbers each, in metres") from None
    length = math.hypot(x1 - x0, y1 - y0)
    if not math.isfinite(length):
        raise InputError(f"path: start {start!r} and end {end!r} must be finite")
    if length <= 0.0:
        raise InputError(f"path: start and end are the same point {start!r}, the segment has no length")
    return Path(x0, y0, x1, y1, length, (x1 - x0) / length, (y1 - y0) / length)


@kernel
def nearest(path: Path, x: float, y: float) -> tuple[float, float, float, float]:
    """Progress (m), signed distance (m), tangent (2,) at the point of the path nearest to (x, y).

    Distance is positive to the left of the tangent. Our choice: a segment's distance and tangent are those of its
    infinite line, and progress is not clipped to the ends.
    """
    rx, ry = x - path.x0, y - path.y0
    tx, ty = path.tangent_x, path.tangent_y
    return tx * rx + ty * ry, tx * ry - ty * rx, tx, ty
