"""Random paths for laws: segments, arcs, polylines. Lengths in m."""

import math

import numpy as np
from hypothesis import strategies as st

from core.path import Arc, Path, Polyline, build_path, line, point_at

coordinate = st.floats(-0.5, 0.5)
point = st.tuples(coordinate, coordinate)
segments = st.tuples(point, point).filter(lambda ends: math.dist(*ends) > 1e-3).map(lambda ends: line(*ends))


NEAR_M, NEAR_RATIO = 0.02, 3.0  # a corner of 140 degrees: 2.9 times


def comes_near_itself(path: Path) -> bool:
    """Whether points nearer to each other than `NEAR_M` lie `NEAR_RATIO` times as far apart along the path."""
    stations = np.linspace(0.0, path.length, math.ceil(path.length / 0.002))
    points = np.array([point_at(path, s)[:2] for s in stations])
    apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    return bool(np.any((apart < NEAR_M) & (np.abs(stations[:, None] - stations) > NEAR_RATIO * apart + 1e-9)))


def built(path_file):
    """The path, or None where it comes near itself: the nearest point then says where along it a place is."""
    path = build_path(path_file, "random")
    return None if comes_near_itself(path) else path


def turtle(start, heading, steps):
    """The polyline of steps (turn in degrees, length)."""
    points = [start]
    for turn, length in steps:
        heading += math.radians(turn)
        points.append((points[-1][0] + length * math.cos(heading), points[-1][1] + length * math.sin(heading)))
    return Polyline(tuple(points))


turn = st.one_of(st.floats(-130.0, 130.0), st.just(0.0))
polylines = (
    st.builds(
        turtle,
        point,
        st.floats(-math.pi, math.pi),
        st.lists(st.tuples(turn, st.floats(0.03, 0.2)), min_size=2, max_size=5),
    )
    .map(built)
    .filter(lambda path: path is not None)
)
sweep = st.tuples(st.floats(1.0, 330.0), st.sampled_from([1.0, -1.0])).map(math.prod)
arcs = (
    st.builds(lambda c, r, a, by: Arc(c, r, a, a + by), point, st.floats(0.02, 0.4), st.floats(-360.0, 360.0), sweep)
    .map(built)
    .filter(lambda path: path is not None)
)
curves = st.one_of(arcs, polylines)
