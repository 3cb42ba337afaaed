"""How a path stands in a protocol, a session and a recording: a segment, a polyline or an arc (m, degrees)."""

from typing import Annotated

import msgspec
import numpy as np

from core.errors import InputError
from core.files import Pair
from core.path import Path, line


class Segment(msgspec.Struct, tag="segment", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """A straight line from start to end."""

    start_m: Pair
    end_m: Pair


class Polyline(msgspec.Struct, tag="polyline", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Straight lines from point to point."""

    points_m: Annotated[tuple[Pair, ...], msgspec.Meta(min_length=2)]


class Arc(msgspec.Struct, tag="arc", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Part of a circle; counter-clockwise where to_deg > from_deg."""

    centre_m: Pair
    radius_m: float
    from_deg: float
    to_deg: float


PathFile = Segment | Polyline | Arc


# Interim, for segments, polylines and arcs on screen, until the paths themselves stand in core/path.py.


def outline(path_file: PathFile, spacing_m: float) -> np.ndarray:
    """Points (n, 2), m, along the path, for drawing; an arc's at most spacing_m apart."""
    if isinstance(path_file, Segment):
        return np.array([path_file.start_m, path_file.end_m])
    if isinstance(path_file, Polyline):
        return np.array(path_file.points_m)
    a, b = np.radians([path_file.from_deg, path_file.to_deg])
    t = np.linspace(a, b, 2 + int(abs(b - a) * path_file.radius_m / spacing_m))
    return np.array(path_file.centre_m) + path_file.radius_m * np.column_stack((np.cos(t), np.sin(t)))


def build_path(path_file: PathFile, where: str) -> Path:
    """The path as the kernels read it; here only a segment."""
    if not isinstance(path_file, Segment):
        raise InputError(f"{where}: only a segment can be followed yet")
    return line(path_file.start_m, path_file.end_m)


def path_from(data: dict, where: str) -> PathFile:
    """A path from a plain dict."""
    try:
        return msgspec.convert(data, PathFile)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None
