"""Obstacles in the workspace: discs, half-planes and convex polygons, and how far the tip is from the nearest one.

The kernels read every obstacle as straight edges with a radius around them: a disc is an edge without length, a
half-plane an edge without ends, a polygon its sides, counter-clockwise. Lengths in m.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from core.files import Table
from core.kernels import kernel
from core.ranges import Coordinate, Place, Radius

#: Columns of an edge: its obstacle's number, start (m), unit tangent (outside is to its right), length (m; infinite:
#: without ends), radius around it (m).
OBSTACLE, X, Y, TX, TY, LENGTH, RADIUS = range(7)
MOST_EDGES = 64  # of all obstacles of a trial

Corners = Annotated[tuple[Place, ...], msgspec.Meta(min_length=3, max_length=32)]


class ObstacleFile(Table, frozen=True):
    """One obstacle as it stands in a protocol: a disc, a half-plane or a convex polygon."""

    disc_m: tuple[Coordinate, Coordinate, Radius] | None = None  # [x, y, radius]; an obstacle has one of these three
    half_plane_m: tuple[Coordinate, Coordinate, float, float] | None = None  # point of its edge, direction outwards
    polygon_m: Corners | None = None  # corners in order, convex

    def __post_init__(self) -> None:
        given = [value for value in (self.disc_m, self.half_plane_m, self.polygon_m) if value is not None]
        if len(given) != 1:
            raise ValueError("must be one of disc_m, half_plane_m, polygon_m")
        self.edges(0)

    def outline(self) -> np.ndarray:
        """Corners (n, 2), m, of its outline for drawings; a half-plane is a square of 4 m."""
        if self.disc_m is not None:
            angles = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
            return np.array(self.disc_m[:2]) + self.disc_m[2] * np.column_stack([np.cos(angles), np.sin(angles)])
        if self.polygon_m is not None:
            return np.array(self.polygon_m)
        [[_, x, y, t_x, t_y, _, _]] = self.edges(0)
        along, inward = 2.0 * np.array([t_x, t_y]), 4.0 * np.array([-t_y, t_x])
        middle = np.array([x, y])
        return np.array([middle - along, middle + along, middle + along + inward, middle - along + inward])

    def edges(self, number: int) -> list[list[float]]:
        """Its edges as the kernels read them. ValueError if it has no inside, or is not convex."""
        if self.disc_m is not None:
            x, y, radius = self.disc_m
            return [[number, x, y, 1.0, 0.0, 0.0, radius]]
        if self.half_plane_m is not None:
            x, y, n_x, n_y = self.half_plane_m
            if (size := math.hypot(n_x, n_y)) <= 0.0:
                raise ValueError("half_plane_m: the direction to its outside has no length")
            return [[number, x, y, -n_y / size, n_x / size, math.inf, 0.0]]
        corners = np.array(self.polygon_m, dtype=float)
        x, y = corners.T
        if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0:  # twice the area; clockwise
            corners = corners[::-1]
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(sides[:, 0], sides[:, 1])
        if not lengths.all():
            raise ValueError("polygon_m: two corners on end are the same")
        tangents = sides / lengths[:, None]
        following = np.roll(tangents, -1, axis=0)
        turns = np.arctan2(
            tangents[:, 0] * following[:, 1] - tangents[:, 1] * following[:, 0], (tangents * following).sum(axis=1)
        )
        if not ((turns > 0.0).all() and math.isclose(turns.sum(), 2.0 * math.pi, abs_tol=1e-6)):
            raise ValueError("polygon_m: must be convex, with an angle at every corner")
        return [
            [number, *corner, *tangent, length, 0.0]
            for corner, tangent, length in zip(corners, tangents, lengths, strict=True)
        ]


def build_obstacles(files: Sequence[ObstacleFile]) -> np.ndarray:
    """The edges (n, 7) of all obstacles as the kernels read them. ValueError if they are too many."""
    edges = [edge for number, file in enumerate(files) for edge in file.edges(number)]
    if len(edges) > MOST_EDGES:
        raise ValueError(f"obstacle: they have {len(edges)} edges together, {MOST_EDGES} at most")
    return np.array(edges).reshape(-1, 7)


class Nearest(NamedTuple):
    """The nearest obstacle as seen from the tip."""

    distance: float  # m, negative inside; infinite: there is no obstacle
    n_x: float  # unit vector away from it
    n_y: float


@kernel
def nearest_obstacle(edges, count, x, y):
    """`Nearest` of the tip (x, y), m, among the first `count` edges (n, 7), those of all obstacles."""
    distance, n_x, n_y = math.inf, 0.0, 0.0
    first = 0
    while first < count:
        after = next_obstacle(edges, count, first)
        near = away_from(edges, first, after, x, y)
        if near.distance < distance:
            distance, n_x, n_y = near.distance, near.n_x, near.n_y
        first = after
    return Nearest(distance, n_x, n_y)


@kernel
def next_obstacle(edges, count, first):
    """The first edge of the obstacle after that of the edge `first`; `count` where there is none."""
    after = first + 1
    while after < count and edges[after, OBSTACLE] == edges[first, OBSTACLE]:
        after += 1
    return after


@kernel
def away_from(edges, first, after, x, y):
    """`Nearest` where the edges first .. after - 1 are the only obstacle."""
    inside, side_x, side_y = -math.inf, 0.0, 0.0  # the least deep way out, as long as the tip is behind every edge
    distance, n_x, n_y = math.inf, 0.0, 0.0
    for i in range(first, after):
        t_x, t_y, length = edges[i, TX], edges[i, TY], edges[i, LENGTH]
        r_x, r_y = x - edges[i, X], y - edges[i, Y]
        outward = t_y * r_x - t_x * r_y
        along = t_x * r_x + t_y * r_y
        if length > 0.0 and outward > inside:
            inside, side_x, side_y = outward, t_y, -t_x
        if length == math.inf:
            return Nearest(outward, t_y, -t_x)
        along -= min(max(along, 0.0), length)  # beyond its ends
        size = math.sqrt(along * along + outward * outward)
        if size - edges[i, RADIUS] < distance:
            distance = size - edges[i, RADIUS]
            n_x, n_y = t_y, -t_x
            if size > 0.0:
                n_x, n_y = (along * t_x + outward * t_y) / size, (along * t_y - outward * t_x) / size
    if -math.inf < inside <= 0.0:
        return Nearest(inside, side_x, side_y)
    return Nearest(distance, n_x, n_y)
