"""The path to follow: where its nearest point lies, which way it runs, how far a hand is off it, which are refused."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from paths import curves, point, segments, turtle

from core.control.rule_sets import SETTLED
from core.control.velocity_field import PIECE, Seen, field_at, new_memory
from core.files import InputError
from core.path import (
    FROM,
    TURN,
    Arc,
    Polyline,
    Segment,
    build_path,
    follow,
    nearest,
    nearest_piece,
    on_piece,
    outline,
    path_from,
    point_at,
)
from experiments.analysis.movement import along_path, mean_over_progress
from experiments.trial.tick import arrived

pytestmark = pytest.mark.nojit
share = st.floats(0.0, 1.0)


def from_corners(path, s):
    """How far progress s (m) is from the nearest corner along the path, m."""
    return min((abs(s - begin) for begin in path.pieces[1:, FROM]), default=math.inf)


@given(segments, point)
def test_a_segment_is_its_infinite_line_to_the_last_bit(path, at):
    """The formula of the segment alone, as it was before there were other paths."""
    tx, ty = (path.x1 - path.x0) / path.length, (path.y1 - path.y0) / path.length
    rx, ry = at[0] - path.x0, at[1] - path.y0
    assert nearest(path, *at) == (tx * rx + ty * ry, tx * ry - ty * rx, tx, ty)
    assert on_piece(path, follow(path, 0, *at), *at) == nearest(path, *at)


def test_a_tip_is_near_a_path_within_half_the_way_round_its_smallest_loop():
    """Farther off, the other way through the crossing could be taken for its own."""
    corners = ((0.0, 0.3), (0.1, 0.3), (0.1, 0.305), (0.095, 0.305), (0.095, 0.2))
    assert build_path(Polyline(corners), "path").near == pytest.approx(0.5 * 0.02)


@given(curves, share, st.floats(-0.003, 0.003))
def test_a_tip_offset_to_the_left_is_that_far_from_the_path_and_no_further_along_it(path, of_length, offset):
    s = of_length * path.length
    assume(from_corners(path, s) > 0.01)  # a corner of 140 degrees cuts an offset of 3 mm within 8.2 mm
    x, y, tx, ty = point_at(path, s)
    found = nearest(path, x - offset * ty, y + offset * tx)
    assert found == pytest.approx((s, offset, tx, ty), abs=1e-9)


@given(curves, point)
def test_the_nearest_point_is_that_far_away_and_no_point_of_the_path_is_nearer(path, at):
    progress, distance, _, _ = nearest(path, *at)
    foot = point_at(path, progress)[:2]
    assert math.dist(foot, at) == pytest.approx(abs(distance), abs=1e-9)
    apart = [math.dist(point_at(path, s)[:2], at) for s in np.linspace(0.0, path.length, 200)]
    assert abs(distance) <= min(apart) + 1e-12
    if 0.0 < progress < path.length:
        assert abs(distance) >= min(apart) - path.length / 199


@given(curves, st.floats(0.0, 0.01), st.floats(-0.004, 0.004))
def test_beyond_its_ends_a_path_goes_on_straight(path, beyond, offset):
    for s, end in ((-beyond, 0.0), (path.length + beyond, path.length)):
        x, y, tx, ty = point_at(path, s)
        assert (tx, ty) == pytest.approx(point_at(path, end)[2:], abs=1e-12)
        if len(path.pieces) == 1 or np.ptp(np.cumsum(path.pieces[:, TURN])) < 1.0:
            found = nearest(path, x - offset * ty, y + offset * tx)
            assert found == pytest.approx((s, offset, tx, ty), abs=1e-9)


CORNER = Polyline(((-0.1, 0.3), (0.0, 0.3), (0.05, 0.38)))
SHARP = turtle((-0.1, 0.3), 0.0, [(0.0, 0.1), (-130.0, 0.1)])
LEGS = Polyline(((-0.1, 0.30), (0.0, 0.30), (0.0, 0.34), (-0.1, 0.34)))


def directions(path, tips, hold):
    """Angle (n,) of the tangent at each tip in turn, rad."""
    found, piece = [], 0
    for x, y in tips:
        piece = follow(path, piece, x, y) if hold else nearest_piece(path, x, y)
        _, _, tx, ty = on_piece(path, piece, x, y)
        found.append(math.atan2(ty, tx))
    return np.array(found)


def turned(angles):
    """Turn (n - 1,) from tick to tick, rad, without sign."""
    return np.abs((np.diff(angles) + math.pi) % (2.0 * math.pi) - math.pi)


def along_bisector(path_file, ticks):
    """Tips (n, 2) from 2 cm outside the corner at the second point to 3 cm inside it, half-way between its pieces."""
    before, corner, after = (np.array(p) for p in path_file.points_m[:3])
    inward = (before - corner) / math.dist(before, corner) + (after - corner) / math.dist(after, corner)
    inward /= np.hypot(*inward)
    return corner + np.linspace(-0.02, 0.03, ticks)[:, None] * inward


@pytest.mark.parametrize(
    ("path_file", "tips"),
    [
        (CORNER, along_bisector(CORNER, 2000)),
        (SHARP, along_bisector(SHARP, 2000)),
        (LEGS, np.column_stack([np.linspace(-0.1, -0.03, 2000), np.full(2000, 0.32)])),
    ],
    ids=["corner", "sharp corner", "between two legs"],
)
def test_noise_half_way_between_two_pieces_does_not_turn_the_direction_back_and_forth(path_file, tips):
    path = build_path(path_file, "it")
    noisy = tips + np.random.default_rng(0).normal(size=tips.shape) * 5e-5
    assert turned(directions(path, noisy, hold=False)).max() > 0.5, "by itself the nearest piece would"
    assert turned(directions(path, noisy, hold=True)).max() < 0.3


def test_the_end_is_reached_along_the_path_only():
    hook = build_path(turtle((0.0, 0.3), 0.0, [(0.0, 0.1), (120.0, 0.012)]), "it")
    assert not arrived(hook, 0, 0.01, hook.x0 + 0.092, 0.3), "as near to the end as it comes before the corner"
    assert arrived(hook, 1, 0.013, hook.x1, hook.y1)
    assert not arrived(hook, 0, 0.013, hook.x0 + 0.09, 0.3)
    circle = build_path(Arc((0.0, 0.35), 0.1, 0.0, 360.0), "it")
    assert not arrived(circle, 0, 0.04, circle.x0, circle.y0), "the start, which is the end"
    assert arrived(circle, 3, 0.04, circle.x1, circle.y1)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"kind": "polyline", "points_m": [[0, 0], [0.1, 0], [0.1, 0]]}, "point 2 to point 3.*no length"),
        ({"kind": "polyline", "points_m": [[0, 0], [20, 0], [20, 1]]}, "21 m long"),
        ({"kind": "segment", "start_m": [1e6, 0.4], "end_m": [0.1, 0.4]}, "at most 10 m can be followed"),
        ({"kind": "segment", "start_m": [0, 0], "end_m": [0, 0]}, "no length"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": 0.0009, "from_deg": 0, "to_deg": 90}, "radius_m"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": 0.1, "from_deg": 0, "to_deg": -361}, "full turn"),
        (Arc((0.0, math.nan), 0.1, 0.0, 90.0), "finite"),
        ([[0, 0], [1, 1]], "table"),
    ],
)
def test_a_path_that_nobody_can_follow_is_refused_in_a_sentence(content, reason):
    with pytest.raises(InputError, match=rf"^mine\.toml: path 2.*({reason})"):
        given_in_code = isinstance(content, Arc)
        build_path(content if given_in_code else path_from(content, "mine.toml: path 2"), "mine.toml: path 2")


@pytest.mark.parametrize("path_file", [Segment((0.0, 0.3), (0.1, 0.4)), CORNER, Arc((0.0, 0.3), 0.1, 20.0, -100.0)])
def test_a_stored_path_comes_back_as_it_was_and_its_outline_runs_through_every_corner_in_small_steps(path_file):
    stored = msgspec.json.decode(msgspec.json.encode(msgspec.to_builtins(path_file)))
    assert path_from(stored, "it") == path_file
    path, points = build_path(path_file, "it"), outline(path_file, 0.004)
    assert points[0] == pytest.approx((path.x0, path.y0)) and points[-1] == pytest.approx((path.x1, path.y1))
    assert np.hypot(*np.diff(points, axis=0).T).max() <= 0.004 + 1e-12
    assert [nearest(path, *p)[1] for p in points] == pytest.approx([0.0] * len(points), abs=1e-12)
    for corner in getattr(path_file, "points_m", ()):
        assert np.hypot(*(points - corner).T).min() < 1e-12


ROUND = 2.0 * math.pi


def curve(of, n=240):
    """A polyline through the points of a curve, a function of 0 to 1."""
    return Polyline(tuple(of(share) for share in np.linspace(0.0, 1.0, n).tolist()))


def eight(width, height, turns=1.0):
    return curve(lambda s: (width * math.sin(ROUND * turns * s), 0.36 + height * math.sin(2.0 * ROUND * turns * s)))


def spiral(turns, inner, outer):
    def place(s):
        radius, angle = inner + (outer - inner) * s, ROUND * turns * s
        return radius * math.cos(angle), 0.36 + radius * math.sin(angle)

    return curve(place)


def star(points, step, radius):
    """The star polygon of so many points, each joined to the one `step` further; closed."""
    angles = [ROUND * (0.25 + step * k / points) for k in range(points + 1)]
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
