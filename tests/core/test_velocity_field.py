"""Path, travel sense and the field of desired directions (Section IV-A, Fig. 12)."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from paths import curves, point, segments

from core.control.rule_sets import LITERAL, SETTLED
from core.control.velocity_field import (
    PIECE,
    Seen,
    desired_direction,
    field_around,
    field_at,
    new_memory,
    side_of_path,
    travel_sense,
)
from core.path import BLEND_WIDTH_M, CORNER_M, line, nearest, nearest_piece, point_at

pytestmark = pytest.mark.nojit

angle = st.floats(-math.pi, math.pi)


def come_to(path, at):
    """The memory of a trial whose tip has come to the piece nearest to this place."""
    memory = new_memory()
    memory[PIECE] = nearest_piece(path, *at)
    return memory


def beta_angle(distance, n, t, width=BLEND_WIDTH_M):
    """Angle of beta from t towards n, rad."""
    bx, by = desired_direction(distance, *n, *t, width)
    assert math.hypot(bx, by) == pytest.approx(1.0)
    return math.atan2(bx * n[0] + by * n[1], bx * t[0] + by * t[1])


@given(angle, st.sampled_from([1.0, -1.0]), st.floats(0.0, 0.2))
def test_the_angle_of_the_field_grows_linearly_with_distance_to_a_right_angle_at_the_boundary(direction, side, d):
    t = (math.cos(direction), math.sin(direction))
    n = (side * t[1], -side * t[0])
    assert beta_angle(d, n, t) == pytest.approx(min(d / BLEND_WIDTH_M, 1.0) * math.pi / 2, abs=1e-12)


@given(st.one_of(segments, curves), point, point, angle, st.floats(0.1, 40.0), st.sampled_from([SETTLED, LITERAL]))
def test_a_small_step_along_the_field_never_leads_away_from_the_path(path, at, v, push, force, rules):
    fx, fy = force * math.cos(push), force * math.sin(push)
    field = field_at(path, come_to(path, at), Seen(*at, *v, fx, fy), rules)
    assert field.distance == pytest.approx(abs(nearest(path, *at)[1]))
    assert field.t_x * field.n_x + field.t_y * field.n_y == pytest.approx(0.0, abs=1e-12)
    assert field.beta_x * field.n_x + field.beta_y * field.n_y >= -1e-12
    assert field.beta_x * field.t_x + field.beta_y * field.t_y >= -1e-12
    if field.distance > CORNER_M:
        step = 1e-7
        nearer = nearest(path, at[0] + step * field.n_x, at[1] + step * field.n_y)[1]
        assert abs(nearer) < field.distance, "n points towards the path"


@given(segments, point, angle, st.floats(1.5, 40.0), st.sampled_from([SETTLED, LITERAL]))
def test_a_push_along_the_path_sets_the_travel_sense_and_the_field_never_opposes_it(path, at, push, force, rules):
    fx, fy = force * math.cos(push), force * math.sin(push)
    field = field_at(path, new_memory(), Seen(*at, 0.0, 0.0, fx, fy), rules)
    along = fx * field.t_x + fy * field.t_y
    assert along >= (0.0 if rules is LITERAL else -rules.turn_force) - 1e-12


@given(st.sampled_from([1.0, -1.0]), st.floats(-40, 40), st.floats(-0.5, 0.5))
def test_settled_4_the_travel_sense_turns_only_for_a_clear_push_that_the_motion_does_not_contradict(last, f, v):
    sense = travel_sense(last, f, v, SETTLED)
    turned = abs(f) > 1.0 and f * last < 0.0 and v * last <= 0.005
    assert sense == (-last if turned else last)


def test_settled_6_on_the_path_the_last_side_is_kept_and_the_first_is_the_left_of_t():
    path = line((-0.1, 0.4), (0.1, 0.4))
    memory = new_memory()
    first = field_at(path, memory, Seen(0.0, 0.4, 0.0, 0.0, 5.0, 0.0), SETTLED)
    assert first.n_y == -1.0, "left of t: n points right"
    for y, expected in ((0.39, 1.0), (0.4, 1.0), (0.41, -1.0), (0.4, -1.0)):
        assert field_at(path, memory, Seen(0.0, y, 0.0, 0.0, 5.0, 0.0), SETTLED).n_y == expected
    backwards = field_at(path, new_memory(), Seen(0.0, 0.4, 0.0, 0.0, -5.0, 0.0), SETTLED)
    assert (backwards.t_x, backwards.n_y) == (-1.0, 1.0), "left of a tangent that points to the start"


@given(segments, st.floats(-1.0, 2.0), st.sampled_from([1.0, -1.0]))
def test_rounding_does_not_choose_the_side_of_a_tip_on_the_path(path, share, side):
    x = path.x0 + share * (path.x1 - path.x0)
    y = path.y0 + share * (path.y1 - path.y0)
    assert side_of_path(side, nearest(path, x, y)[1], 1.0, SETTLED) == side


@given(curves, st.floats(0.0, 1.0), st.floats(-0.002, 0.002), st.sampled_from([1.0, -1.0]))
def test_near_any_path_the_field_runs_along_it_the_way_the_hand_pushes(path, share, off, sense):
    s = share * path.length
    x, y, tx, ty = point_at(path, s)
    assume(all(abs(s - begin) > 0.01 for begin in path.pieces[1:, 0]))
    tip = (x - off * ty, y + off * tx)
    field = field_at(path, come_to(path, tip), Seen(*tip, 0.0, 0.0, 5.0 * sense * tx, 5.0 * sense * ty), SETTLED)
    assert (field.t_x, field.t_y) == pytest.approx((sense * tx, sense * ty), abs=1e-9)
    assert field.distance == pytest.approx(abs(off), abs=1e-9)
    cosine = math.cos(0.5 * math.pi * min(abs(off) / path.blend_width, 1.0))
    assert field.beta_x * field.t_x + field.beta_y * field.t_y == pytest.approx(cosine, abs=1e-9)
    drawn = field_around(path, np.array([tip]), sense)
    assert abs(off) < 1e-9 or np.ravel(drawn) == pytest.approx(field, abs=1e-9), "what is drawn is what it follows"
