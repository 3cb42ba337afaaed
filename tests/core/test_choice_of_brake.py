"""Which brake SDOF and proportional velocity control choose (Sections IV-B and IV-C), and with which force."""

import math

import numpy as np
import pytest
from devices import FOUR, THREE
from hypothesis import assume, given
from hypothesis import strategies as st
from synthetic_device import brakes_on, random_rows

from core.control.algorithm import Tick
from core.control.proportional import (
    Push,
    best_brake,
    commanded_force,
    force_direction,
    influence,
    joint_sense,
)
from core.control.rule_sets import LITERAL, SETTLED
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import Field, Seen, desired_direction, new_memory

pytestmark = pytest.mark.nojit

angle = st.floats(-math.pi, math.pi)
side = st.sampled_from([1.0, -1.0])
seed = st.integers(0, 2**32 - 1)
rule_sets = st.sampled_from([SETTLED, LITERAL])


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


def field_along(direction: float) -> Field:
    """A field whose desired direction is given (rad)."""
    c, s = math.cos(direction), math.sin(direction)
    return Field(0.0, c, s, s, -c, c, s)


def test_settled_2_a_slow_joint_takes_the_sense_in_which_a_felt_hand_would_turn_it():
    slow = 0.019
    for rate in (slow, -slow, 0.0):
        assert joint_sense(rate, 3.0, True, SETTLED.still_rate) == 1.0
        assert joint_sense(rate, -3.0, True, SETTLED.still_rate) == -1.0
        assert joint_sense(rate, 3.0, False, SETTLED.still_rate) == 0.0, "no hand: no candidate"
    assert joint_sense(0.021, -3.0, True, SETTLED.still_rate) == 1.0
    assert joint_sense(-0.021, 3.0, False, SETTLED.still_rate) == -1.0


@pytest.mark.parametrize("rules", [SETTLED, LITERAL])
def test_a_component_below_a_fiftieth_of_the_force_has_no_effect(rules):
    for small, effect in ((0.0199, 0), (0.0201, 1)):
        large = math.sqrt(1.0 - small**2)
        for force in (0.1, 30.0):
            assert influence(force * small, force * large, 0.1, 0.1, rules.no_effect, rules.along_beta) == (
                effect,
                1,
            )
            assert influence(force * large, force * small, 0.1, 0.1, rules.no_effect, rules.along_beta) == (
                1,
                effect,
            )


@given(seed, angle, angle, st.floats(0.0, 0.4), rule_sets, st.sampled_from(["AEBC", "AEB", "C"]))
def test_the_chosen_brake_is_the_best_by_an_independent_reading_of_the_paper(
    seed, direction, motion, speed, rules, joints
):
    rng = np.random.default_rng(seed)
    g, v = random_rows(rng), speed * np.array([math.cos(motion), math.sin(motion)])
    push = rng.normal(size=2)
    push /= np.linalg.norm(push)
    beta = np.array([math.cos(direction), math.sin(direction)])
    left = np.array([-beta[1], beta[0]])
    assume(speed == 0.0 or min(abs(v @ beta), abs(v @ left)) > 1e-9)  # else rounding decides, for a force of zero
    candidates = []
    for i in ("AEBC".index(joint) for joint in joints):
        omega = g[i] @ v
        if rules is SETTLED and abs(omega) < 0.02:
            omega = g[i] @ push
        if omega == 0.0:
            continue
        phi = math.atan2(g[i, 1], g[i, 0]) + (math.pi if omega > 0 else 0.0)
        f = np.array([math.cos(phi), math.sin(phi)])
        if (f @ left) * (v @ left) >= 0.0 or abs(f @ left) <= 0.02:
            continue
        growing = f @ beta > 0 if rules is SETTLED else (f @ beta) * (v @ beta) > 0 or v @ beta == 0
        column = 0 if abs(f @ beta) <= 0.02 else 1 if growing else -1
        candidates.append((column, f @ beta, i))
    tick = Tick(Seen(0.0, 0.0, *v, *push), g, np.ones(3), brakes_on(joints), new_memory(), np.zeros(4))
    chosen = best_brake(tick, field_along(direction), v, Push(True, *push), rules)
    assert chosen == (max(candidates)[2] if candidates else -1)
    if chosen >= 0:
        sense = joint_sense(g[chosen] @ v, g[chosen] @ push, True, rules.still_rate)
        across = np.array(force_direction(*g[chosen], sense)) @ left
        assert across * (v @ left) < 0.0, "the force opposes v_beta_y"


@given(st.floats(0.0, 1e5), st.floats(-2.0, 2.0), st.floats(5.0, 30.0))
def test_the_force_is_proportional_to_v_beta_y_and_never_above_the_normalised_force(gain, v_beta_y, most):
    force = commanded_force(gain, v_beta_y, most)
    assert 0.0 <= force <= most
    assert force == commanded_force(gain, -v_beta_y, most)
    if gain * abs(v_beta_y) < most:
        assert force == pytest.approx(gain * abs(v_beta_y))
