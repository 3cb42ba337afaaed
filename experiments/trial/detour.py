"""The way of a simulated operator who sees obstacles on the path: along the path, and round each on its shorter side.

Our choice: people are not told a way, they see the obstacles; a simulated one keeps `CLEAR_M` from each corner and
disc. A half-plane has no other side: towards it the operator follows the path, and the guard is what stops it.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from core.obstacles import ObstacleFile, build_obstacles, nearest_obstacle
from core.path import Path, PathFile, Polyline, build_path, outline

CLEAR_M = 0.03  # assumed: two fingers, more than a hand strays
ENDS_SHARE = 0.8  # of an end's own distance from the obstacle
SPACING_M = 0.002  # between the places of the path that are looked at
CORNERS = 24  # of the circle that is walked round a disc or a corner


def way_round(path: PathFile, obstacles: Sequence[ObstacleFile], where: str) -> Path:
    """The path, or a polyline that leaves it where an obstacle comes nearer than `CLEAR_M`. InputError as `build_path`.

    Where a start or an end lies nearer to an obstacle, the way is as near; one that holds an end is not walked round.
    """
    straight = build_path(path, where)
    if not obstacles:
        return straight
    points = outline(path, SPACING_M)
    left = False
    for obstacle in obstacles:
        clear = ENDS_SHARE * min(from_obstacle(obstacle, *end) for end in (points[0], points[-1]))
        if obstacle.half_plane_m is not None or clear <= 0.0:
            continue
        hull = grown(obstacle, min(clear, CLEAR_M))
        inside = np.flatnonzero(is_inside(hull, points))
        if len(inside):
            before, after = points[: inside[0]], points[inside[-1] + 1 :]
            points, left = np.concatenate([before, round_hull(hull, before[-1], after[0]), after]), True
    if not left:
        return straight
    return build_path(Polyline(points_m=tuple((x, y) for x, y in without_straight(points).tolist())), where)


def from_obstacle(obstacle: ObstacleFile, x: float, y: float) -> float:
    """How far a place is from an obstacle, m."""
    edges = build_obstacles([obstacle])
    return float(nearest_obstacle(edges, len(edges), x, y)[0])


def grown(obstacle: ObstacleFile, clear: float) -> np.ndarray:
    """The corners (n, 2) of a convex outline `clear` (m) round a disc or polygon, counter-clockwise."""
    if obstacle.disc_m is not None:
        corners, radius = np.array([obstacle.disc_m[:2]]), obstacle.disc_m[2] + clear
    else:
        corners, radius = np.array(obstacle.polygon_m), clear
    angles = 2.0 * math.pi * np.arange(CORNERS) / CORNERS
    circle = radius / math.cos(math.pi / CORNERS) * np.column_stack([np.cos(angles), np.sin(angles)])
    return convex_hull((corners[:, None] + circle).reshape(-1, 2))


def convex_hull(points: np.ndarray) -> np.ndarray:
    """The corners of the convex hull of points (n, 2), counter-clockwise."""
    return points[scipy.spatial.ConvexHull(points).vertices]


def is_inside(hull: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether each of points (n, 2) lies inside a convex outline, corners counter-clockwise."""
    sides = np.roll(hull, -1, axis=0) - hull
    to_points = points[:, None] - hull
    return (sides[:, 0] * to_points[..., 1] - sides[:, 1] * to_points[..., 0] > 0.0).all(axis=1)


def round_hull(hull: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The corners on the shorter of the two ways round a convex outline from start to end, both outside it."""
    across = end - start
    side = across[0] * (hull[:, 1] - start[1]) - across[1] * (hull[:, 0] - start[0])
    ways = []
    for corners in (hull[side > 0.0], hull[side < 0.0]):
        chain = convex_hull(np.array([start, end, *corners])) if len(corners) else np.empty((0, 2))
        is_end = (chain == start).all(axis=1) | (chain == end).all(axis=1)
        ways.append(in_order(chain[~is_end], start, end))
    return min(ways, key=lambda way: float(np.hypot(*np.diff([start, *way, end], axis=0).T).sum()))


def in_order(chain: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The corners of one side in the order in which they are met from start to end."""
    middle, across = 0.5 * (start + end), end - start
    along = (chain - middle) @ across / float(across @ across)
    off = ((chain - middle)[:, 1] * across[0] - (chain - middle)[:, 0] * across[1]) / float(across @ across)
    return chain[np.argsort(-np.arctan2(np.abs(off), along))]


def without_straight(points: np.ndarray) -> np.ndarray:
    """The corners of a polyline: places on the straight line between their neighbours left out."""
    steps = np.diff(points, axis=0)
    steps /= np.hypot(*steps.T)[:, None]
    turns = np.abs(steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0])
    return points[np.concatenate([[True], turns > 1e-9, [True]])]
