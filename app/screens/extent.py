"""Where the joints of a device are, and how much of the plane must be seen (m)."""

from collections.abc import Iterable, Sequence

import numpy as np
from PySide6.QtCore import QRectF

from core.device import Device
from core.mechanism import Mechanism
from core.path_file import PathFile, outline
from core.workspace import arm_pose

Point = tuple[float, float]  # m

MARGIN_M = 0.03  # around everything that must be seen
SPACING_M = 0.002  # of the points of a drawn path: straight between them


def joints_at(mechanism: Mechanism, tip: Point) -> dict[str, Point]:
    """Where the joints A, E, B, C and D are (m) for a tip; none where the arms do not reach it."""
    places: dict[str, Point] = {}
    for base, elbow, arm in (("A", "E", mechanism.arm_1), ("B", "C", mechanism.arm_2)):
        e1 = arm_pose(arm, np.float64(tip[0]), np.float64(tip[1])).e1
        places[base] = (arm.base_x, arm.base_y)
        places[elbow] = (arm.base_x + float(e1[0]), arm.base_y + float(e1[1]))
    places["D"] = tip
    return places if np.all(np.isfinite(list(places.values()))) else {}


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
