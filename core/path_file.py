"""How a path stands in a protocol, a session and a recording: a segment, a polyline or an arc (m, degrees).

Refused, our choice, are paths that nobody could follow: closed ones, and those that turn back or come near themselves,
where the nearest point would jump from one part of the path to another.
"""

import math
from itertools import pairwise
from typing import Annotated, Any

import msgspec
import numpy as np

from core.errors import InputError
from core.files import Pair, from_plain
from core.path import CURVATURE, FROM, LENGTH, TURN, Path, joined, line, point_at

LONGEST_M = 10.0
LEAST_RADIUS_M = 0.01
LARGEST_CORNER_DEG = 140.0  # between the directions of two pieces; 180 would be straight back
#: Points of the path nearer to each other than this must not be more than NEAR_RATIO times as far apart along it (a
#: corner of 140 degrees: 2.9 times).
NEAR_M = 0.02
NEAR_RATIO = 3.0
_CHECKED_EVERY_M = 0.002


class Segment(msgspec.Struct, tag="segment", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """A straight line from start to end."""

    start_m: Pair
    end_m: Pair


class Polyline(msgspec.Struct, tag="polyline", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Straight lines from point to point. At most 1000: each tick of control looks at every piece."""

    points_m: Annotated[tuple[Pair, ...], msgspec.Meta(min_length=2, max_length=1000)]


class Arc(msgspec.Struct, tag="arc", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Part of a circle; counter-clockwise where to_deg > from_deg."""

    centre_m: Pair
    radius_m: float
    from_deg: float
    to_deg: float


PathFile = Segment | Polyline | Arc


def path_from(content: Any, where: str) -> PathFile:
    """A path from the plain dict it is stored as; InputError, beginning with `where`, if it is none."""
    if not isinstance(content, dict):
        raise InputError(f"{where}: a path must be a table with its kind, not {content!r}")
    return from_plain(content, PathFile, where)


def build_path(path_file: PathFile, where: str) -> Path:
    """The path ready for the kernels; InputError, beginning with `where`, if it cannot be followed."""
    if isinstance(path_file, Segment):
        return line(path_file.start_m, path_file.end_m, where)
    path = _polyline(path_file, where) if isinstance(path_file, Polyline) else _arc(path_file, where)
    if path.length > LONGEST_M:
        raise InputError(f"{where}: the path is {path.length:g} m long, at most {LONGEST_M:g} m can be followed")
    _refuse_near_itself(path, where)
    return path


def outline(path_file: PathFile, spacing_m: float) -> np.ndarray:
    """Points (n, 2), m, from start to end, at most spacing_m apart along the path; every corner is one of them."""
    path = build_path(path_file, "path")
    return np.array([point_at(path, s)[:2] for s in _stations(path, spacing_m)])


def _polyline(polyline: Polyline, where: str) -> Path:
    points = polyline.points_m
    lines = [line(*ends, f"{where}: point {i} to point {i + 1}") for i, ends in enumerate(pairwise(points), 1)]
    path = joined([tuple(each.pieces[0, LENGTH:TURN]) for each in lines])
    for i, turn in enumerate(np.degrees(path.pieces[:-1, TURN]), 2):
        if abs(turn) > LARGEST_CORNER_DEG:
            raise InputError(
                f"{where}: at point {i} the path turns by {abs(turn):.0f} degrees, nearly straight back, at most "
                f"{LARGEST_CORNER_DEG:g} can be followed"
            )
    return path


def _arc(arc: Arc, where: str) -> Path:
    if not all(math.isfinite(value) for value in (*arc.centre_m, arc.radius_m, arc.from_deg, arc.to_deg)):
        raise InputError(f"{where}: every number of an arc must be finite")
    if arc.radius_m < LEAST_RADIUS_M:
        raise InputError(f"{where}: radius_m must be at least {LEAST_RADIUS_M:g}, not {arc.radius_m:g}")
    swept = arc.to_deg - arc.from_deg
    if swept == 0.0:
        raise InputError(f"{where}: from_deg and to_deg are the same, the arc has no length")
    if abs(swept) > 360.0:
        raise InputError(f"{where}: from_deg to to_deg is {abs(swept):g} degrees, more than a full turn")
    sense = math.copysign(1.0, swept)
    c, s = math.cos(math.radians(arc.from_deg)), math.sin(math.radians(arc.from_deg))
    x, y = arc.centre_m[0] + arc.radius_m * c, arc.centre_m[1] + arc.radius_m * s
    length = math.radians(abs(swept)) * arc.radius_m
    return joined([(length, x, y, -sense * s, sense * c, sense / arc.radius_m)])


def _stations(path: Path, spacing_m: float) -> np.ndarray:
    """Places along the path (m), start, end and corners among them, at most spacing_m apart."""
    parts = [
        begin + length * np.arange(n) / n
        for begin, length in path.pieces[:, [FROM, LENGTH]]
        for n in [math.ceil(length / spacing_m)]
    ]
    return np.append(np.concatenate(parts), path.length)


def _refuse_near_itself(path: Path, where: str) -> None:
    if len(path.pieces) == 1 and path.pieces[0, CURVATURE] == 0.0:
        return
    between_ends = math.hypot(path.x1 - path.x0, path.y1 - path.y0)
    if between_ends < NEAR_M and path.length > NEAR_RATIO * between_ends:
        raise InputError(
            f"{where}: the path ends {100 * between_ends:.1f} cm from where it starts, leave at least "
            f"{100 * NEAR_M:g} cm between its ends"
        )
    stations = _stations(path, _CHECKED_EVERY_M)
    points = np.array([point_at(path, s)[:2] for s in stations])
    for i in range(len(stations)):
        apart = np.hypot(*(points[i + 1 :] - points[i]).T)
        way = stations[i + 1 :] - stations[i]
        near = np.flatnonzero((apart < NEAR_M) & (way > NEAR_RATIO * apart))
        if len(near):
            j = near[0]
            raise InputError(
                f"{where}: the path comes within {100 * NEAR_M:g} cm of itself: {100 * stations[i]:.1f} cm and "
                f"{100 * stations[i + 1 + j]:.1f} cm along it are {100 * apart[j]:.1f} cm apart"
            )
