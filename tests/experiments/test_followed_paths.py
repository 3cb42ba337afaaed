"""Paths that are closed, cross themselves or turn sharply: progress and error against a search of another kind."""

import math

import numpy as np
import pytest
from paths import turtle

from core.control.rule_sets import SETTLED
from core.control.velocity_field import PIECE, Seen, field_at, new_memory
from core.path import Arc, Polyline, build_path, point_at
from experiments.analysis.movement import along_path, mean_over_progress

TURN = 2.0 * math.pi


def curve(of, n=240):
    """A polyline through the points of a curve, a function of 0 to 1."""
    return Polyline(tuple(of(share) for share in np.linspace(0.0, 1.0, n).tolist()))


def eight(width, height, turns=1.0):
    return curve(lambda s: (width * math.sin(TURN * turns * s), 0.36 + height * math.sin(2.0 * TURN * turns * s)))


def spiral(turns, inner, outer):
    def place(s):
        radius, angle = inner + (outer - inner) * s, TURN * turns * s
        return radius * math.cos(angle), 0.36 + radius * math.sin(angle)

    return curve(place)


def star(points, step, radius):
    """The star polygon of so many points, each joined to the one `step` further; closed."""
    angles = [TURN * (0.25 + step * k / points) for k in range(points + 1)]
    return Polyline(tuple((radius * math.cos(a), 0.36 + radius * math.sin(a)) for a in angles))


def letter(height):
    """A handwritten e and l: two loops, the second one higher, and a hook."""
    x = [0.0, 0.5, 0.75, 0.5, 0.2, 0.25, 0.7, 1.2, 1.5, 1.45, 1.2, 1.15, 1.4, 1.9]
    y = [0.3, 0.5, 0.8, 1.0, 0.7, 0.2, 0.0, 0.5, 1.5, 2.0, 1.6, 0.6, 0.0, 0.3]
    from scipy.interpolate import CubicSpline

    through = CubicSpline(range(len(x)), np.column_stack([x, y]) * height)
    return curve(lambda s: tuple((through(s * (len(x) - 1)) + (-height, 0.32)).tolist()))


PATHS = {
    "circle": Arc((0.0, 0.36), 0.06, 0.0, 360.0),
    "figure eight": eight(0.08, 0.04),
    "twice round an eight": eight(0.08, 0.04, 2.0),
    "small star": star(5, 2, 0.03),
    "spiral": spiral(2.0, 0.02, 0.08),
    "spiral inwards": spiral(2.0, 0.08, 0.015),
    "small letter": letter(0.015),
    "there and back": Polyline(((-0.08, 0.36), (0.08, 0.36), (-0.08, 0.36))),
    "zigzag": turtle((-0.06, 0.3), 1.3, [(0.0, 0.1), (-150.0, 0.1), (150.0, 0.1), (-150.0, 0.1)]),
    "hairpin": Polyline(((-0.08, 0.36), (0.08, 0.36), (0.08, 0.366), (-0.08, 0.366))),
}


def vertices(path_file):
    """Points (n, 2) of a fine polyline, made without core.path."""
    if isinstance(path_file, Polyline):
        return np.array(path_file.points_m)
    angles = np.radians(np.linspace(path_file.from_deg, path_file.to_deg, 1001))
    return np.array(path_file.centre_m) + path_file.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


def hand(points, seed):
    """A tip (n, 2) that goes along a polyline, up to some 2 mm off it, and cuts its corners a little; its true way."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    size = np.hypot(*np.ptp(points, axis=0))
    s = np.linspace(0.0, way[-1], math.ceil(way[-1] / 2e-4))
    tip = np.column_stack([np.interp(s, way, points[:, k]) for k in range(2)])
    generator = np.random.default_rng(seed)
    from scipy.ndimage import gaussian_filter1d

    wobble = gaussian_filter1d(generator.normal(size=tip.shape), 60.0, axis=0, mode="nearest")
    wobble *= min(2e-3, 0.02 * size) / np.abs(wobble).max()
    wobble *= np.minimum(1.0, s / 0.01)[:, None]
    return gaussian_filter1d(tip + wobble, 4.0, axis=0, mode="nearest"), s


def searched(points, tip, way, window):
    """Distance (n,) of each tip from the pieces of a polyline within `window` (m) of its true way along it."""
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    start, along = points[:-1], np.diff(points, axis=0)
    share = np.einsum("nij,ij->ni", tip[:, None] - start, along) / np.einsum("ij,ij->i", along, along)
    length = np.diff(ends)
    low = (way[:, None] - window - ends[:-1]) / length
    high = (way[:, None] + window - ends[:-1]) / length
    share = np.clip(np.clip(share, np.maximum(low, 0.0), np.minimum(high, 1.0)), 0.0, 1.0)
    apart = np.linalg.norm(start + share[..., None] * along - tip[:, None], axis=2)
    return np.where((low <= 1.0) & (high >= 0.0), apart, np.inf).min(axis=1)


@pytest.mark.parametrize("name", PATHS)
def test_the_error_is_that_of_an_independent_search_near_the_true_way(name):
    path, points = build_path(PATHS[name], name), vertices(PATHS[name])
    for seed in range(2):
        tip, way = hand(points, seed)
        progress, error = along_path(tip, path)
        expected = searched(points, tip, way, path.near)
        assert progress[-1] == pytest.approx(path.length, abs=0.005)
        inside = (progress > 0.0) & (progress < path.length)
        assert np.abs(error - expected)[inside].max() < 2e-5
        assert mean_over_progress(error, progress) == pytest.approx(mean_over_progress(expected, progress), abs=5e-6)
        assert np.abs(progress - way).max() < 2.0 * path.near


@pytest.mark.parametrize("name", PATHS)
def test_a_tip_that_goes_where_the_field_points_comes_along_the_whole_path(name):
    """Steps of 0.5 mm along beta, with noise of 20 um; the hand pushes the way that the path runs at its progress."""
    path, memory, generator = build_path(PATHS[name], name), new_memory(), np.random.default_rng(0)
    tip, furthest = np.array([path.x0, path.y0]), 0.0
    for _ in range(math.ceil(3.0 * path.length / 5e-4)):
        seen = tip + generator.normal(size=2) * 2e-5
        tx, ty = point_at(path, furthest)[2:]
        field = field_at(path, memory, Seen(*seen, 0.0, 0.0, 5.0 * tx, 5.0 * ty), SETTLED)
        from core.path import on_piece

        furthest = max(furthest, on_piece(path, int(memory[PIECE]), *seen)[0])
        if furthest >= path.length - 1e-3:
            break
        tip = tip + 2e-4 * np.array([field.beta_x, field.beta_y])
    else:
        raise AssertionError(f"came {furthest} m of {path.length} m")
    assert field.distance < 0.003
