"""The path to follow, as the controllers see it: where its nearest point lies and which way it runs there.

A path is a row of pieces, straight or bent (arcs), each starting where the last one ends. A single straight piece
counts as its infinite line. Any other path goes on straight beyond its two ends.

A path may be closed, cross itself and run back on itself: it is followed from its start on, piece by piece (`follow`).
The nearest point is sought no further than `near` along the path from the last one, so that another part of the path
which happens to come by does not count.

At a corner of a polyline (our choice):
    outside    the nearest point is the corner itself; there the tangent turns with the tip, from the one piece's to
               the other's, so that it stays at right angles to the way to the corner
    inside     the nearer piece counts. On the line between them both are equally near: `follow` stays with the
               last one until the other is clearly nearer, else noise would turn the direction back and forth
    turned     by more than `CORNER_DEG`: a place to arrive at and leave. Near it the next piece counts as soon as the
               last one is not clearly nearer, or a tip would never leave a corner that turns straight back
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from core.files import InputError, Pair, Positive, from_plain
from core.kernels import kernel

#: Columns of `Path.pieces`: progress at the piece's start (m), its length (m), start (m), unit tangent there,
#: curvature (1/m, positive to the left, 0: straight), turn from its end to the next piece (rad, positive to the left).
FROM, LENGTH, X, Y, TX, TY, CURVATURE, TURN = range(8)

#: m. Outside a corner, nearer to it than this, the tangent turns in proportion to the distance from it: at the corner
#: itself it is that of the piece. Zero: encoder steps at the corner turn the direction by the whole corner.
CORNER_M = 1e-3
#: A sharper turn is a corner: a place to arrive at, within a quarter of `near`, and to leave.
CORNER_DEG = 70.0
#: m. A shorter way counts as none: its square would be no normal number.
LEAST_M = 1e-100
#: m. A piece is left for another one that is nearer by more than this times (1 - cosine between their tangents).
#: Zero: noise of the tip half-way between two pieces picks the piece at every tick.
HOLD_M = 1e-3


class Path(NamedTuple):
    """A path ready for the kernels; made by `core.path.build_path`, a segment also by `line`. Lengths in m."""

    pieces: np.ndarray  # (n, 8), in order from start to end
    x0: float  # start
    y0: float
    x1: float  # end
    y1: float
    length: float
    near: float  # the nearest point is sought so far along the path from the last one
    blend_width: float  # nearer than this the desired direction is blended to the path's


def line(start: Sequence[float], end: Sequence[float], where: str = "path") -> Path:
    """The segment from start to end (m, two numbers each). InputError if it has no length or is not finite."""
    (x0, y0), (x1, y1) = start, end
    length = math.hypot(x1 - x0, y1 - y0)
    if not math.isfinite(length):
        raise InputError(f"{where}: start {start!r} and end {end!r} must be finite")
    if length <= 0.0:
        raise InputError(f"{where}: start and end are the same point {start!r}, the segment has no length")
    pieces = np.array([[0.0, length, x0, y0, (x1 - x0) / length, (y1 - y0) / length, 0.0, 0.0]])
    near, blend_width = _widths(pieces, (x1, y1))
    return Path(pieces, x0, y0, x1, y1, length, near, blend_width)


def joined(pieces: Sequence[Sequence[float]]) -> Path:
    """The path of pieces (length, x, y, tx, ty, curvature), as in `Path.pieces`; each starts where the last ends."""
    rows = np.zeros((len(pieces), 8))
    rows[:, LENGTH : CURVATURE + 1] = pieces
    rows[1:, FROM] = np.cumsum(rows[:-1, LENGTH])
    for i in range(len(rows) - 1):
        _, _, tx, ty = along_piece(rows, i, rows[i, LENGTH])
        next_tx, next_ty = rows[i + 1, TX], rows[i + 1, TY]
        rows[i, TURN] = math.atan2(tx * next_ty - ty * next_tx, tx * next_tx + ty * next_ty)
    last = len(rows) - 1
    x1, y1, _, _ = along_piece(rows, last, rows[last, LENGTH])
    length = rows[last, FROM] + rows[last, LENGTH]
    near, blend_width = _widths(rows, (x1, y1))
    return Path(rows, float(rows[0, X]), float(rows[0, Y]), float(x1), float(y1), float(length), near, blend_width)


def size_of(pieces: np.ndarray, end: Sequence[float]) -> float:
    """m: the diagonal of the rectangle around a path's corners and ends."""
    return math.hypot(*np.ptp(np.vstack([pieces[:, [X, Y]], end]), axis=0))


def _widths(pieces: np.ndarray, end: Sequence[float]) -> tuple[float, float]:
    """`near` and `blend_width` of a path by its size, m: of the paper's, 20 cm long, 2 cm and its 5 cm."""
    size = size_of(pieces, end)
    near = min(NEAR_M, NEAR_SHARE * size)
    loop = _shortest_loop(pieces, 2.0 * near)
    return max(min(near, 0.5 * loop), 0.25 * near), min(BLEND_WIDTH_M, BLEND_SHARE * size)


def _shortest_loop(pieces: np.ndarray, within: float) -> float:
    """Way (m) round the shortest loop that straight pieces close by crossing, if shorter than `within`; else inf."""
    shortest = math.inf
    for k in range(2, len(pieces)):
        first, second = pieces[:-k], pieces[k:]
        between = second[:, FROM] - first[:, FROM] - first[:, LENGTH]
        if between.min() >= within:
            break
        first, second, between = (rows[between < within] for rows in (first, second, between))
        (tx, ty), (ux, uy) = first[:, [TX, TY]].T, second[:, [TX, TY]].T
        dx, dy = (second[:, [X, Y]] - first[:, [X, Y]]).T
        cross = tx * uy - ty * ux
        with np.errstate(divide="ignore", invalid="ignore"):  # side by side
            a, b = (dx * uy - dy * ux) / cross, (dx * ty - dy * tx) / cross
        meet = (a >= 0.0) & (a <= first[:, LENGTH]) & (b >= 0.0) & (b <= second[:, LENGTH])
        loops = between[meet] + first[meet, LENGTH] - a[meet] + b[meet]
        shortest = float(loops.min(initial=shortest))
    return shortest


@kernel
def beside(x0, y0, tx, ty, x, y):
    """Coordinates (m) of (x, y) along and to the left of the straight line through (x0, y0) with unit tangent t."""
    rx, ry = x - x0, y - y0
    return tx * rx + ty * ry, tx * ry - ty * rx


@kernel
def beside_arc(piece, i, x, y):
    """Coordinates (m) of (x, y) along and to the left of the bent piece i, and the unit tangent there.

    On the piece's circle; the coordinate along it runs from half a turn before its middle to half a turn after. At the
    centre, where every point of the arc is nearest, the tangent is that at the start.
    """
    tx, ty, k = piece[i, TX], piece[i, TY], piece[i, CURVATURE]
    sense = 1.0 if k > 0.0 else -1.0
    rx, ry = x - (piece[i, X] - ty / k), y - (piece[i, Y] + tx / k)  # from the centre
    radius = math.sqrt(rx * rx + ry * ry)
    if radius <= LEAST_M:
        return 0.0, 1.0 / k, tx, ty
    ux, uy = -sense * ry / radius, sense * rx / radius
    angle = sense * math.atan2(tx * uy - ty * ux, tx * ux + ty * uy)  # turned since the start, -pi .. pi
    if angle < 0.5 * piece[i, LENGTH] * abs(k) - math.pi:
        angle += 2.0 * math.pi
    return angle / abs(k), 1.0 / k - sense * radius, ux, uy


@kernel
def along_piece(piece, i, way):
    """Point (m) and unit tangent of piece i, `way` (m) from its start, 0 to its length; outside, straight on."""
    x, y, tx, ty, k = piece[i, X], piece[i, Y], piece[i, TX], piece[i, TY], piece[i, CURVATURE]
    if k == 0.0 or way <= 0.0:
        return x + way * tx, y + way * ty, tx, ty
    bent = min(way, piece[i, LENGTH])
    c, s = math.cos(k * bent), math.sin(k * bent)
    x, y = x + (s * tx - (1.0 - c) * ty) / k, y + (s * ty + (1.0 - c) * tx) / k
    tx, ty = c * tx - s * ty, s * tx + c * ty
    return x + (way - bent) * tx, y + (way - bent) * ty, tx, ty


@kernel
def way_on(piece, i, x, y):
    """Way (m) from the start of piece i to its point nearest to (x, y), 0 to its length."""
    if piece[i, CURVATURE] != 0.0:
        along, _, _, _ = beside_arc(piece, i, x, y)
    else:
        along, _ = beside(piece[i, X], piece[i, Y], piece[i, TX], piece[i, TY], x, y)
    return min(max(along, 0.0), piece[i, LENGTH])


@kernel
def gap(piece, i, x, y, least, most):
    """Distance (m) of (x, y) from the part of piece i that is `least` to `most` (m) from its start."""
    px, py, _, _ = along_piece(piece, i, min(max(way_on(piece, i, x, y), least), most))
    return math.sqrt((x - px) * (x - px) + (y - py) * (y - py))


@kernel
def at_corner(x, y, corner_x, corner_y, tx, ty, to_other, outside):  # noqa: PLR0913
    """Signed distance (m) and unit tangent at (x, y) where the nearest point is a corner, for one of its two pieces.

    t: that piece's tangent at the corner; to_other: the angle from it to the other piece's, rad; outside: +1 where
    the outside of the corner is to the left, -1 to the right.
    """
    rx, ry = x - corner_x, y - corner_y
    distance = math.sqrt(rx * rx + ry * ry)
    if distance <= LEAST_M:
        return 0.0, tx, ty
    across_x, across_y = outside * ry / distance, -outside * rx / distance  # at right angles to the way to the corner
    turned = math.atan2(tx * across_y - ty * across_x, tx * across_x + ty * across_y)
    turned = min(max(turned, min(to_other, 0.0)), max(to_other, 0.0)) * min(1.0, distance / CORNER_M)
    c, s = math.cos(to_other), math.sin(to_other)
    left = tx * ry - ty * rx
    left_of_other = (c * tx - s * ty) * ry - (s * tx + c * ty) * rx
    inside_both = left * outside < 0.0 and left_of_other * outside < 0.0
    c, s = math.cos(turned), math.sin(turned)
    return (-outside if inside_both else outside) * distance, c * tx - s * ty, s * tx + c * ty


@kernel
def on_piece(path, i, x, y):
    """`nearest` as if piece i were the nearest one."""
    piece = path.pieces
    tx, ty = piece[i, TX], piece[i, TY]
    along, distance = beside(piece[i, X], piece[i, Y], tx, ty, x, y)
    if piece.shape[0] == 1 and piece[i, CURVATURE] == 0.0:
        return along, distance, tx, ty
    return on_piece_of_many(path, i, x, y, along, distance)


@kernel
def on_piece_of_many(path, i, x, y, along, distance):
    """`on_piece` where it may bend or have neighbours; along, distance: of the straight line from its start."""
    piece, last = path.pieces, path.pieces.shape[0] - 1
    begin, length, tx, ty = piece[i, FROM], piece[i, LENGTH], piece[i, TX], piece[i, TY]
    straight = piece[i, CURVATURE] == 0.0
    way = along
    if not straight:
        way, bent_distance, bent_tx, bent_ty = beside_arc(piece, i, x, y)
        if 0.0 <= way <= length:
            return begin + way, bent_distance, bent_tx, bent_ty
    if way < 0.0 and i > 0:
        turn = piece[i - 1, TURN]
        distance, tx, ty = at_corner(x, y, piece[i, X], piece[i, Y], tx, ty, -turn, 1.0 if turn < 0.0 else -1.0)
        return begin, distance, tx, ty
    if way > length and i < last:
        turn = piece[i, TURN]
        end_x, end_y, tx, ty = along_piece(piece, i, length)
        distance, tx, ty = at_corner(x, y, end_x, end_y, tx, ty, turn, 1.0 if turn < 0.0 else -1.0)
        return begin + length, distance, tx, ty
    if way > length and not straight:
        end_x, end_y, tx, ty = along_piece(piece, i, length)
        along, distance = beside(end_x, end_y, tx, ty, x, y)
        return begin + length + along, distance, tx, ty
    return begin + along, distance, tx, ty


@kernel
def nearest_piece(path, x, y):
    """The piece nearest to (x, y) of the whole path; of several, the first."""
    nearest_so_far, least = 0, math.inf
    for i in range(path.pieces.shape[0]):
        distance = gap(path.pieces, i, x, y, 0.0, path.pieces[i, LENGTH])
        if distance < least:
            nearest_so_far, least = i, distance
    return nearest_so_far


@kernel
def nearest_within(path, at, x, y):
    """The piece nearest to (x, y) within `near` along the path of its nearest point on piece `at`; ties go to `at`."""
    piece, last = path.pieces, path.pieces.shape[0] - 1
    way = way_on(piece, at, x, y)
    found, least = at, gap(piece, at, x, y, way, way)
    i, left = at, path.near - (piece[at, LENGTH] - way)
    while left > 0.0 and i < last:
        i += 1
        distance = gap(piece, i, x, y, 0.0, min(left, piece[i, LENGTH]))
        if distance < least:
            found, least = i, distance
        left -= piece[i, LENGTH]
    i, left = at, path.near - way
    while left > 0.0 and i > 0:
        i -= 1
        distance = gap(piece, i, x, y, max(piece[i, LENGTH] - left, 0.0), piece[i, LENGTH])
        if distance < least:
            found, least = i, distance
        left -= piece[i, LENGTH]
    return found


@kernel
def follow(path, last, x, y):
    """The piece that a tip at (x, y) has come to along the path; last: the piece before."""
    return 0 if path.pieces.shape[0] == 1 else follow_pieces(path, last, x, y)


@kernel
def follow_pieces(path, last, x, y):
    """`follow` along several pieces."""
    piece = path.pieces
    turn = abs(piece[last, TURN])
    if turn > CORNER_DEG * math.pi / 180.0:  # the last piece has none
        left = piece[last, LENGTH] - way_on(piece, last, x, y)
        if left <= 0.25 * path.near and nearer_by(path, last, last + 1, x, y) < 0.5 * HOLD_M * (1.0 - math.cos(turn)):
            last += 1
    i = nearest_within(path, last, x, y)
    if i == last:
        return i
    _, _, tx, ty = on_piece(path, i, x, y)
    _, _, last_tx, last_ty = on_piece(path, last, x, y)
    clear = HOLD_M * (1.0 - (tx * last_tx + ty * last_ty))
    return i if nearer_by(path, i, last, x, y) > clear else last


@kernel
def nearer_by(path, i, j, x, y):
    """By how much (m) piece i is nearer to (x, y) than piece j."""
    piece = path.pieces
    return gap(piece, j, x, y, 0.0, piece[j, LENGTH]) - gap(piece, i, x, y, 0.0, piece[i, LENGTH])


@kernel
def nearest(path, x, y):
    """Progress (m), signed distance (m), unit tangent (2,) at the point of the path nearest to (x, y).

    Distance is positive to the left of the tangent. Our choice: a single straight piece counts as its infinite line,
    progress is not clipped to its ends; any other path goes on straight where its end is the nearest point.
    """
    return on_piece(path, nearest_piece(path, x, y), x, y)


@kernel
def point_at(path, s):
    """Point (x, y), m, and unit tangent (2,) at progress s (m); straight beyond the ends, at a corner the later one."""
    i = 0
    while i + 1 < path.pieces.shape[0] and s >= path.pieces[i + 1, FROM]:
        i += 1
    return along_piece(path.pieces, i, s - path.pieces[i, FROM])


@kernel
def measure(path, points, found):
    """`nearest` at each of points (n, 2), m: writes progress, signed distance and tangent into found (n, 4)."""
    for n in range(points.shape[0]):
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = nearest(path, points[n, 0], points[n, 1])


@kernel
def track(path, tips, found):
    """Fill found (n, 2) with progress and signed distance (m) of tips (n, 2), m, that begin at the start of the path.

    Progress is that of the piece that `follow` stays with; the distance that of the nearest one about it.
    """
    piece = 0
    for n in range(tips.shape[0]):
        x, y = tips[n, 0], tips[n, 1]
        piece = follow(path, piece, x, y)
        found[n, 0], found[n, 1], _, _ = on_piece(path, piece, x, y)
        if path.pieces.shape[0] > 1:
            found[n, 1] = on_piece(path, nearest_within(path, piece, x, y), x, y)[1]


LONGEST_M = 10.0
LEAST_RADIUS_M = 0.001
MOST_POINTS = 1000
#: m, of the paper's path; shares of the size (diagonal) of a smaller one. `near` is less where the path makes a loop
#: that could be passed over.
NEAR_M, NEAR_SHARE = 0.02, 0.1
BLEND_WIDTH_M, BLEND_SHARE = 0.05, 0.25


class Followed(msgspec.Struct, kw_only=True, frozen=True, omit_defaults=True):
    """How any path is followed; None: by its size."""

    near_m: Positive | None = None
    blend_width_m: Positive | None = None


class Segment(Followed, tag="segment", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """A straight line from start to end."""

    start_m: Pair
    end_m: Pair


class Polyline(Followed, tag="polyline", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Straight lines from point to point."""

    points_m: Annotated[tuple[Pair, ...], msgspec.Meta(max_length=MOST_POINTS)]

    def __post_init__(self) -> None:
        if len(self.points_m) < 2:
            example = "points_m = [[-0.08, 0.26], [0.08, 0.42]]"
            raise ValueError(f"a polyline needs at least two points, for instance {example}")


class Arc(Followed, tag="arc", tag_field="kind", forbid_unknown_fields=True, frozen=True):
    """Part of a circle, or all of it; counter-clockwise where to_deg > from_deg."""

    centre_m: Pair
    radius_m: float
    from_deg: float
    to_deg: float


PathFile = Segment | Polyline | Arc


def path_from(content: Any, where: str) -> PathFile:
    """The path stored in a plain dict. InputError, beginning with `where`, if it holds none."""
    if not isinstance(content, dict):
        raise InputError(f"{where}: a path must be a table with its kind, not {content!r}")
    return from_plain(content, PathFile, where)


def build_path(path_file: PathFile, where: str) -> Path:
    """The path ready for the kernels; InputError, beginning with `where`, if it cannot be followed."""
    if isinstance(path_file, Segment):
        path = line(path_file.start_m, path_file.end_m, where)
    else:
        path = _polyline(path_file, where) if isinstance(path_file, Polyline) else _arc(path_file, where)
    if path.length > LONGEST_M:
        raise InputError(f"{where}: the path is {path.length:g} m long, at most {LONGEST_M:g} m can be followed")
    near, blend_width = path_file.near_m, path_file.blend_width_m
    return path._replace(near=near or path.near, blend_width=blend_width or path.blend_width)


def outline(path_file: PathFile, spacing_m: float) -> np.ndarray:
    """Points (n, 2), m, from start to end, at most spacing_m apart along the path; every corner is one of them."""
    path = build_path(path_file, "path")
    return np.array([point_at(path, s)[:2] for s in _stations(path, spacing_m)])


def _polyline(polyline: Polyline, where: str) -> Path:
    points = polyline.points_m
    lines = [line(*ends, f"{where}: point {i} to point {i + 1}") for i, ends in enumerate(pairwise(points), 1)]
    return joined([tuple(each.pieces[0, LENGTH:TURN]) for each in lines])


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
    sense, parts = math.copysign(1.0, swept), math.ceil(abs(swept) / 90.0)  # a piece is at most a quarter turn
    pieces = []
    for angle in np.radians(arc.from_deg + swept * np.arange(parts) / parts):
        c, s = math.cos(angle), math.sin(angle)
        x, y = arc.centre_m[0] + arc.radius_m * c, arc.centre_m[1] + arc.radius_m * s
        pieces.append(
            (math.radians(abs(swept)) * arc.radius_m / parts, x, y, -sense * s, sense * c, sense / arc.radius_m)
        )
    return joined(pieces)


def _stations(path: Path, spacing_m: float) -> np.ndarray:
    """Places along the path (m), start, end and corners among them, at most spacing_m apart."""
    parts = [
        begin + length * np.arange(n) / n
        for begin, length in path.pieces[:, [FROM, LENGTH]]
        for n in [math.ceil(length / spacing_m)]
    ]
    return np.append(np.concatenate(parts), path.length)
