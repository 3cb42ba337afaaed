"""Paths drawn elsewhere: the points of a CSV table, or the line of an SVG picture, as a polyline."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from core.files import InputError, NotNegative, Pair, Positive, from_plain
from core.number_table import number_table
from core.path import MOST_POINTS, Followed, PathFile, Polyline, path_from
from core.ranges import PLACE
from core.svg_picture import shown_lines

DRAWING = "drawing"  # kind of a path that is drawn in a file
KINDS = ("segment", "polyline", "arc", DRAWING)
COLUMNS = ("x_m", "y_m")
LEAST_STEP_M = 1e-6  # points nearer to the one before are left out
SMOOTHING_STEPS = 2  # points within the width of the smoothing
MOST_DRAWN = 100_000  # points of a file. Our choice: more is no hand's drawing


class Drawing(Followed, tag=DRAWING, tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """A path as a protocol names it: its file, and how the drawing is placed."""

    file: str  # .csv, with columns x_m and y_m, or .svg; a path from the protocol's folder
    smoothing_m: NotNegative = 0.0  # sd of the Gaussian along the path, by which each point is averaged
    width_m: Positive | None = None  # to which the drawing is scaled; a CSV table may stay as it is
    centre_m: Pair | None = None  # to which the middle of the drawing is moved


def read_path(entry: dict[str, Any], read: Callable[[str], str], where: str) -> tuple[PathFile, str]:
    """The path of an entry, and how its drawing was changed, in words ("": it has none).

    read: returns the text of a file by its name. InputError, beginning with `where`, if the entry is no path.
    """
    kind = entry.get("kind")
    if kind is not None and kind not in KINDS:
        raise InputError(f"{where}: kind must be one of {', '.join(KINDS)}, not {kind!r}")
    if kind != DRAWING:
        return path_from(entry, where), ""
    drawing = from_plain(entry, Drawing, where)
    where = f"{where}: {drawing.file}"
    text = read(drawing.file)
    is_svg = drawing.file.lower().endswith(".svg")
    if is_svg and (drawing.width_m is None or drawing.centre_m is None):
        raise InputError(f"{where}: an SVG picture has no metres, width_m and centre_m are required")
    points = _picture_points(text, where) if is_svg else _table_points(text, where, drawing.width_m is None)
    points = _placed(points, drawing, where)
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > LEAST_STEP_M)]
    if len(points) < 2:
        raise InputError(f"{where}: has fewer than two different points")
    points, moved = _smoothed(points, drawing.smoothing_m)
    about = f"{drawing.file}, {len(points)} points, "
    if drawing.smoothing_m:
        about += f"smoothed over {1e3 * drawing.smoothing_m:g} mm (moved by at most {1e3 * moved:.2g} mm)"
    else:
        about += "not smoothed"
    pairs = tuple((round(x, 7), round(y, 7)) for x, y in points.tolist())
    return Polyline(pairs, near_m=drawing.near_m, blend_width_m=drawing.blend_width_m), about


def _table_points(text: str, where: str, in_metres: bool) -> np.ndarray:
    """The points (n, 2) of a table; in_metres: they are not scaled, so their unit matters."""
    table = number_table(text, where, COLUMNS, None)
    if in_metres:
        for name in COLUMNS:
            table.check_range(name, PLACE)
    return table.values


def _picture_points(text: str, where: str) -> np.ndarray:
    """The points (n, 2) of the one line of a picture, y upwards."""
    lines = shown_lines(text, where)
    if len(lines) != 1:
        raise InputError(f"{where}: has {len(lines)} separate lines, a path must be one")
    return lines[0] * (1.0, -1.0)


def _placed(points: np.ndarray, drawing: Drawing, where: str) -> np.ndarray:
    """The points scaled to the drawing's width and moved to its centre."""
    if not 2 <= len(points) <= MOST_DRAWN:
        raise InputError(f"{where}: has {len(points)} points, 2 to {MOST_DRAWN} are needed")
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    centre = middle if drawing.centre_m is None else np.array(drawing.centre_m)
    if drawing.width_m is None:
        return points - middle + centre
    if high[0] <= low[0]:
        raise InputError(f"{where}: width_m: the drawing has no width")
    return drawing.width_m / (high[0] - low[0]) * (points - middle) + centre


def _smoothed(points: np.ndarray, smoothing: float) -> tuple[np.ndarray, float]:
    """At most `MOST_POINTS` points along the line, averaged over `smoothing` (m); how far it was moved at most (m).

    The ends stay where they are; where they are one point, the average goes round. Without smoothing and within that
    number the points stay as they are.
    """
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    if not smoothing and len(points) <= MOST_POINTS:
        return points, 0.0
    steps = math.ceil(SMOOTHING_STEPS * way[-1] / smoothing) if smoothing else MOST_POINTS
    steps = max(min(steps, MOST_POINTS - 1), 2)
    even = np.linspace(0.0, way[-1], steps + 1)
    before = np.column_stack([np.interp(even, way, points[:, k]) for k in range(2)])
    if not smoothing:
        return before, 0.0
    sigma = smoothing * steps / way[-1]  # points
    room = min(math.ceil(4.0 * sigma), steps)
    weights = np.exp(-0.5 * (np.arange(-room, room + 1) / sigma) ** 2)
    closed = math.dist(points[0], points[-1]) <= LEAST_STEP_M
    if closed:
        ahead, behind = before[-room - 1 : -1], before[1 : room + 1]
    else:  # turned about its ends the line goes on, so that they stay
        ahead, behind = 2.0 * before[0] - before[room:0:-1], 2.0 * before[-1] - before[-2 : -room - 2 : -1]
    longer = np.vstack([ahead, before, behind])
    after = np.column_stack([np.convolve(longer[:, k], weights / weights.sum(), "valid") for k in range(2)])
    after[-1] = after[0] if closed else before[-1]
    return after, float(np.hypot(*(after - before).T).max())
