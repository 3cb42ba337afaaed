"""Obstacles: how far the tip is from discs, half-planes and convex polygons, and which of them are refused."""

import math

import msgspec
import numpy as np
import pytest

from core.files import InputError, from_plain
from core.obstacles import MOST_EDGES, Nearest, ObstacleFile, away_from, build_obstacles
from core.obstacles import nearest_obstacle as nearest_of

SQUARE = ((0.1, 0.3), (0.2, 0.3), (0.2, 0.4), (0.1, 0.4))


def nearest_obstacle(edges: np.ndarray, x: float, y: float) -> Nearest:
    """Of all edges."""
    return Nearest(*nearest_of(edges, len(edges), x, y))


def outline(corners: tuple[tuple[float, float], ...], spacing: int = 2000) -> np.ndarray:
    """Points all along the edge of a polygon."""
    ends = np.array(corners)
    ways = np.linspace(0.0, 1.0, spacing)[:, None, None]
    return (ends + ways * (np.roll(ends, -1, axis=0) - ends)).reshape(-1, 2)


def convex(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """A random convex polygon, either way round."""
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(3, 9)))
    while np.diff(angles, append=angles[0] + 2.0 * math.pi).min() < 0.1:
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, len(angles)))
    corners = [(0.05 + 0.08 * math.cos(a), 0.4 + 0.05 * math.sin(a)) for a in angles]
    return tuple(corners if rng.random() < 0.5 else corners[::-1])


def test_the_distance_from_a_polygon_is_that_of_the_nearest_point_of_its_edge_negative_inside() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        corners = convex(rng)
        edges, points = build_obstacles([ObstacleFile(polygon_m=corners)]), outline(corners)
        for x, y in rng.uniform((-0.1, 0.3), (0.2, 0.5), (20, 2)):
            found = nearest_obstacle(edges, x, y)
            nearest = points[np.argmin(np.hypot(points[:, 0] - x, points[:, 1] - y))]
            assert abs(found.distance) == pytest.approx(math.dist(nearest, (x, y)), abs=1e-6)
            on_edge = x - found.distance * found.n_x, y - found.distance * found.n_y
            assert math.dist(on_edge, nearest) < 1e-3 or found.distance < 0.0
            assert math.hypot(found.n_x, found.n_y) == pytest.approx(1.0)


def test_a_step_along_the_normal_leads_away_as_far() -> None:
    rng = np.random.default_rng(4)
    shapes = [
        ObstacleFile(disc_m=(0.0, 0.4, 0.03)), ObstacleFile(half_plane_m=(0.0, 0.35, 1.0, 2.0)),
        ObstacleFile(polygon_m=SQUARE),
    ]  # fmt: skip
    for shape in shapes:
        edges = build_obstacles([shape])
        for x, y in rng.uniform((-0.2, 0.2), (0.3, 0.5), (200, 2)):
            here = nearest_obstacle(edges, x, y)
            if here.distance > 0.0:
                further = nearest_obstacle(edges, x + 0.01 * here.n_x, y + 0.01 * here.n_y)
                assert further.distance == pytest.approx(here.distance + 0.01, abs=1e-9)


def test_of_several_obstacles_the_nearest_counts_and_none_is_infinitely_far() -> None:
    shapes = [ObstacleFile(disc_m=(0.0, 0.4, 0.03)), ObstacleFile(polygon_m=SQUARE)]
    both, alone = build_obstacles(shapes), [build_obstacles([shape]) for shape in shapes]
    for x, y in np.random.default_rng(5).uniform((-0.2, 0.2), (0.3, 0.5), (200, 2)):
        distances = [away_from(edges, 0, len(edges), x, y).distance for edges in alone]
        assert nearest_obstacle(both, x, y).distance == min(distances)
    assert nearest_obstacle(np.zeros((0, 7)), 0.0, 0.4).distance == math.inf


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, "must be one of disc_m, half_plane_m, polygon_m"),
        ({"disc_m": [0, 0.4, 0.1], "polygon_m": SQUARE}, "must be one of disc_m, half_plane_m, polygon_m"),
        ({"disc_m": [0, 0.4, 0.0]}, "must be greater than 0"),
        ({"half_plane_m": [0, 0.4, 0, 0]}, "has no length"),
        ({"polygon_m": [[0, 0], [1, 0]]}, "3"),
        ({"polygon_m": [[0, 0], [1, 0], [0.2, 0.2], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 1], [0, 1], [1, 0]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 0], [2, 0], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [0, 0], [1, 0], [0, 1]]}, "two corners on end are the same"),
        ({"ring_m": [0, 0]}, "unknown key"),
    ],
)
def test_an_obstacle_that_cannot_be_is_refused_in_a_sentence(content: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        from_plain(msgspec.json.decode(msgspec.json.encode(content)), ObstacleFile, "file")


def test_more_edges_than_the_kernels_have_room_for_are_refused() -> None:
    discs = [ObstacleFile(disc_m=(0.001 * n, 0.4, 0.01)) for n in range(MOST_EDGES + 1)]
    assert len(build_obstacles(discs[1:])) == MOST_EDGES
    with pytest.raises(ValueError, match="at most"):
        build_obstacles(discs)
