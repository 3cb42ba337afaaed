"""SDOF velocity control (Section IV-B): the paths that single locked brakes leave, and the choice among them."""

import math

import numpy as np
import pytest
from devices import FOUR, THREE
from hypothesis import given
from hypothesis import strategies as st
from synthetic_device import brakes_on, random_rows

from core.control.rule_sets import SETTLED
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import Field, desired_direction

pytestmark = pytest.mark.nojit

angle = st.floats(-math.pi, math.pi)
side = st.sampled_from([1.0, -1.0])
seed = st.integers(0, 2**32 - 1)


def field_of(direction: float, side: float, distance: float = 0.02) -> Field:
    """The field left (+1) or right (-1) of a path in a direction (rad)."""
    t = (math.cos(direction), math.sin(direction))
    n = (side * t[1], -side * t[0])
    return Field(distance, *t, *n, *desired_direction(distance, *n, *t, 0.05))


def angle_between(a, b) -> float:
    """Unsigned angle between two vectors, rad."""
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))


@given(st.sampled_from([THREE, FOUR]), st.floats(-0.08, 0.08), st.floats(0.3, 0.42), st.integers(0, 3))
def test_a_tip_that_moves_along_the_sdof_path_leaves_the_angle_of_that_joint_alone(bar, x, y, joint):
    tip, step = np.array([x, y]), 1e-5
    turned = bar.angles(tip + step * np.array(sdof_direction(*bar.rows(tip)[joint]))) - bar.angles(tip)
    assert abs(turned[joint]) < 1e-3 * step
    assert np.max(np.abs(turned)) > 0.1 * step, "the other joints turn"


def test_a_brake_without_a_moment_arm_has_no_sdof_path_and_is_never_valid():
    assert sdof_direction(0.0, 0.0) == (0.0, 0.0)
    assert valid_sense(0.0, 0.0, field_of(0.3, 1.0), 1e-9) == 0.0
    assert nearest_valid_brake(brakes_on("AEBC"), np.zeros((4, 2)), field_of(0.3, 1.0), SETTLED) == -1


@given(angle, side, st.floats(-1e-12, 1e-12))
def test_paths_along_t_and_n_themselves_are_valid_whatever_rounding_does_to_them(direction, side, rounding):
    field = field_of(direction, side)
    for x, y in ((field.t_x, field.t_y), (field.n_x, field.n_y)):
        p = (x - rounding * y, y + rounding * x)
        assert valid_sense(*p, field, SETTLED.span_rounding) == 1.0
        assert valid_sense(-p[0], -p[1], field, SETTLED.span_rounding) == -1.0


@given(seed, angle, side, st.floats(0.0, 0.1), st.sampled_from(["AEBC", "AEB", "EC", "B"]))
def test_the_chosen_path_is_the_valid_one_closest_in_angle_to_the_desired_direction(
    seed, direction, side, distance, joints
):
    g = random_rows(np.random.default_rng(seed))
    field = field_of(direction, side, distance)
    middle = (field.t_x + field.n_x, field.t_y + field.n_y)
    angles = {}
    for i in ("AEBC".index(joint) for joint in joints):
        for quarter in (0.5, -0.5):
            a = math.atan2(g[i, 1], g[i, 0]) + quarter * math.pi
            p = (math.cos(a), math.sin(a))
            if angle_between(p, middle) <= math.pi / 4:
                angles[i] = angle_between(p, (field.beta_x, field.beta_y))
    expected = min(angles, key=angles.__getitem__) if angles else -1
    assert nearest_valid_brake(brakes_on(joints), g, field, SETTLED) == expected
