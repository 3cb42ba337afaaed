"""The way of a simulated operator round obstacles: never nearer than it keeps, no longer than it must be."""

import math

import numpy as np
import pytest

from core.obstacles import ObstacleFile, build_obstacles, nearest_obstacle
from core.path import Arc, Path, Segment, build_path, point_at
from experiments.trial.detour import CLEAR_M, from_obstacle, way_round

ACROSS = Segment(start_m=(-0.1, 0.4), end_m=(0.1, 0.4))
BOX = ObstacleFile(polygon_m=((-0.02, 0.39), (0.02, 0.39), (0.02, 0.43), (-0.02, 0.43)))


def clearance(way: Path, obstacles: list[ObstacleFile]) -> float:
    """The least distance of the way from any obstacle, m."""
    edges = build_obstacles(obstacles)
    places = [point_at(way, s)[:2] for s in np.linspace(0.0, way.length, 2000)]
    return min(nearest_obstacle(edges, len(edges), *place)[0] for place in places)


def test_a_way_that_meets_nothing_is_the_path() -> None:
    way = way_round(ACROSS, [ObstacleFile(disc_m=(0.0, 0.5, 0.03))], "path 1")
    assert np.array_equal(way.pieces, build_path(ACROSS, "path 1").pieces)


@pytest.mark.parametrize("obstacle", [
    ObstacleFile(disc_m=(0.0, 0.4, 0.02)), ObstacleFile(disc_m=(0.03, 0.41, 0.02)), BOX,
    ObstacleFile(polygon_m=((0.0, 0.41), (0.03, 0.44), (-0.03, 0.44))),
])  # fmt: skip
@pytest.mark.parametrize("path", [ACROSS, Arc(centre_m=(0.0, 0.35), radius_m=0.07, from_deg=150.0, to_deg=30.0)])
def test_the_way_keeps_clear_and_ends_where_the_path_does(obstacle: ObstacleFile, path: Segment | Arc) -> None:
    way, straight = way_round(path, [obstacle], "path 1"), build_path(path, "path 1")
    ends = [(straight.x0, straight.y0), (straight.x1, straight.y1)]
    assert clearance(way, [obstacle]) >= min(CLEAR_M, *(0.8 * from_obstacle(obstacle, *end) for end in ends)) - 1e-9
    assert math.dist((way.x0, way.y0), (straight.x0, straight.y0)) < 1e-12
    assert math.dist((way.x1, way.y1), (straight.x1, straight.y1)) < 1e-12


def test_of_the_two_ways_round_a_disc_the_shorter_is_taken_and_is_hardly_longer_than_tangents_and_arc() -> None:
    radius, off = 0.02 + CLEAR_M, 0.01
    way = way_round(ACROSS, [ObstacleFile(disc_m=(0.0, 0.4 + off, 0.02))], "path 1")
    places = np.array([point_at(way, s)[:2] for s in np.linspace(0.0, way.length, 2000)])
    assert places[:, 1].max() < 0.4 + 1e-9 and places[:, 1].min() == pytest.approx(0.4 + off - radius, abs=1e-3)
    half = math.sqrt(radius**2 - off**2)  # it leaves the path where it comes too near, not before
    arc = 2.0 * radius * math.acos(off / radius)
    assert way.length == pytest.approx(0.2 - 2.0 * half + arc, rel=0.02)


def test_several_obstacles_are_walked_round_one_after_the_other() -> None:
    discs = [ObstacleFile(disc_m=(-0.05, 0.405, 0.012)), ObstacleFile(disc_m=(0.05, 0.395, 0.012))]
    way = way_round(ACROSS, discs, "path 1")
    places = np.array([point_at(way, s)[:2] for s in np.linspace(0.0, way.length, 2000)])
    assert clearance(way, discs) >= 0.02
    assert places[places[:, 0] < 0.0, 1].min() < 0.39 and places[places[:, 0] > 0.0, 1].max() > 0.41


@pytest.mark.parametrize("obstacle", [
    ObstacleFile(half_plane_m=(0.05, 0.4, -1.0, 0.0)), ObstacleFile(disc_m=(0.1, 0.4, 0.02)),
])  # fmt: skip
def test_what_has_no_other_side_is_left_to_the_guard(obstacle: ObstacleFile) -> None:
    way = way_round(ACROSS, [obstacle], "path 1")
    assert np.array_equal(way.pieces, build_path(ACROSS, "path 1").pieces)
