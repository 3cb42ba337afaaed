"""Where the joints of a device are, and how much of the plane must be seen (m)."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from PySide6.QtCore import QRectF

from app.window.painting.along import elbows
from core.device import Device
from core.mechanism import Mechanism
from core.path_file import PathFile, outline

Point = tuple[float, float]  # m

MARGIN_M = 0.03  # around everything that must be seen
SPACING_M = 0.002  # of the points of a drawn path: straight between them


def joints_at(mechanism: Mechanism, tip: Point) -> dict[str, Point]:
    """Where the joints A, E, B, C and D are (m) for a tip; none where the arms do not reach it."""
    first, second = mechanism.arm_1, mechanism.arm_2
    e_x, e_y, c_x, c_y = elbows(mechanism, *tip)
    if math.isnan(e_x):
        return {}
    return {
        "A": (first.base_x, first.base_y), "E": (e_x, e_y), "B": (second.base_x, second.base_y), "C": (c_x, c_y),
        "D": tip,
    }  # fmt: skip


def extent_of_paths(paths: Iterable[PathFile], margin: float = MARGIN_M) -> QRectF:
    """The rectangle (m) around all of these paths."""
    return _around(np.concatenate([outline(path, SPACING_M) for path in paths]), margin)


def extent_of_linkages(devices: Sequence[Device], paths: Iterable[PathFile], margin: float = MARGIN_M) -> QRectF:
    """The rectangle (m) in which every device's linkage stays while its tip is on these paths."""
    places: list[Point] = []
    for path in paths:
        points = np.asarray(outline(path, SPACING_M))
        every = max(1, len(points) // 24)
        for tip in (*points[::every].tolist(), points[-1].tolist()):
            places += [place for device in devices for place in joints_at(device.mechanism, (tip[0], tip[1])).values()]
    return _around(np.array(places), margin)


def _around(points: np.ndarray, margin: float) -> QRectF:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return QRectF(low[0], low[1], high[0] - low[0], high[1] - low[1])
