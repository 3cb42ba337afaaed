"""The path to follow: where its nearest point lies, which way it runs, and which paths are refused."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from paths import curves, point, segments, turtle

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


@pytest.mark.parametrize("path_file", [CORNER, SHARP], ids=["corner", "sharp corner"])
@pytest.mark.parametrize("inward", [-0.004, -0.0005, 0.0, 0.0005, 0.004])
def test_noise_on_the_way_round_a_corner_does_not_turn_the_direction_at_every_tick(path_file, inward):
    """Tips on the path moved along the bisector, so that they turn inside or outside the corner; noise of 20 um."""
    path, generator = build_path(path_file, "it"), np.random.default_rng(0)
    tips = np.array([point_at(path, s)[:2] for s in np.linspace(0.05, 0.15, 2000)])
    ends = along_bisector(path_file, 2)
    tips += inward * (ends[1] - ends[0]) / math.dist(*ends) + generator.normal(size=tips.shape) * 2e-5
    angles = directions(path, tips, hold=True)
    assert np.count_nonzero(turned(angles) > 0.3) <= 3, "once, or thrice within a millimetre of a sharp corner"
    assert turned([angles[0], angles[-1]]) == pytest.approx(abs(path.pieces[0, TURN]), abs=1e-6)


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
        ({"kind": "polyline", "points_m": [[0, 0]]}, "points_m"),
        ({"kind": "segment", "start_m": [0, 0], "end_m": [0, 0]}, "no length"),
        ({"kind": "segment", "start_m": [0, 0]}, "end_m is missing"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": 0.0009, "from_deg": 0, "to_deg": 90}, "radius_m"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": -0.1, "from_deg": 0, "to_deg": 90}, "radius_m"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": 0.1, "from_deg": 90, "to_deg": 90}, "no length"),
        ({"kind": "arc", "centre_m": [0, 0], "radius_m": 0.1, "from_deg": 0, "to_deg": -361}, "full turn"),
        (Arc((0.0, math.nan), 0.1, 0.0, 90.0), "finite"),
        ({"kind": "circle"}, "circle"),
        ({"points_m": [[0, 0], [1, 1]]}, "kind"),
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
