"""Where the two rule sets differ: the paper's rules read literally deadlock and chatter, the settled ones do not.

Points (2) (sense of a joint), (4) and (6) are held by kernel tests in test_proportional and test_velocity_field.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from protocols import PAPER
from synthetic_device import DEVICES, brakes_on, random_mass, random_rows, rows

from core.control import algorithm
from core.control import controllers as control
from core.control.algorithm import LOCKED, Tick, pushes_away
from core.control.controllers import decide, make_controller
from core.control.rule_sets import LITERAL, RULE_SETS, SETTLED
from core.control.velocity_field import Field, Seen, new_memory
from core.path import line
from core.simulator.state import pack_brakes

USE_PROPORTIONAL = control.DECISIONS.index("prop A")
USE_CAPPED = control.DECISIONS.index("prop A, at normalised force")

pytestmark = pytest.mark.nojit
PRESETS = PAPER.controllers

PATH = line((-0.10, 0.40), (0.10, 0.40))
BRAKES = pack_brakes(brakes_on("AEB"), backlash=True)[0]
FORCE = DEVICES["three-brake"][5]
MASS = np.array([1.2, 0.3, 2.5])

seed = st.integers(0, 2**32 - 1)
angle = st.floats(-math.pi, math.pi)


def decision(controller, x, y, v, f, g=None, mass=MASS, memory=None):
    """Decision code and currents (4,) of one tick of the three-brake device on segment 1."""
    g = rows("three-brake", x, y) if g is None else g
    current, memory = np.zeros(4), new_memory() if memory is None else memory
    seen = Seen(*map(float, (x, y, *v, *f)))
    return decide(controller, PATH, Tick(seen, g, mass, BRAKES, memory, current))[0], current


@given(angle, st.floats(1e-6, 60.0), st.floats(0.005, 0.04))
def test_literally_a_tip_at_rest_has_no_candidate_and_the_slightest_outward_push_locks_it(push, force, distance):
    f = (force * math.cos(push), force * math.sin(push))
    assume(f[1] != 0.0)
    code, _ = decision(make_controller(PRESETS[4], FORCE, "literal"), 0.0, 0.4 + distance, (0, 0), f)
    assert code == (algorithm.LOCK_NONE_SELECTED if f[1] > 0.0 else algorithm.RELEASE_NONE_SELECTED)


@given(seed, angle, st.floats(0.6, 60.0), st.floats(0.0, 0.0019), angle)
def test_settled_1_at_rest_the_impending_motion_decides_whatever_the_velocity_noise(seed, push, force, noise, way):
    rng = np.random.default_rng(seed)
    g, mass = random_rows(rng), random_mass(rng)
    f = force * np.array([math.cos(push), math.sin(push)])
    start = np.linalg.solve([[mass[0], mass[1]], [mass[1], mass[2]]], f)
    begun = (0.002 + 1e-12) * start / np.linalg.norm(start)
    for preset in (PRESETS[4], PRESETS[5].replaced(gain_N_s_m=500.0)):
        controller = make_controller(preset, FORCE)
        at_rest = decision(controller, 0.0, 0.42, (0, 0), f, g, mass)
        noisy = decision(controller, 0.0, 0.42, (noise * math.cos(way), noise * math.sin(way)), f, g, mass)
        moving = decision(controller, 0.0, 0.42, begun, f, g, mass)
        assert at_rest[0] == noisy[0] == moving[0]
        assert at_rest[1] == pytest.approx(moving[1], abs=1e-6)
        assert at_rest[1] == pytest.approx(noisy[1], abs=1e-12)


@pytest.mark.parametrize(("force", "felt"), [(0.49, False), (0.51, True)])
def test_settled_1_a_hand_is_felt_above_half_a_newton(force, felt):
    code, _ = decision(make_controller(PRESETS[4], FORCE), 0.0, 0.42, (0.0, 0.0), (force, 0.0))
    assert (code >= USE_PROPORTIONAL) == felt


@given(angle, st.floats(0.51, 40.0), st.floats(0.01, 0.2), st.sampled_from([0, 1, 2]))
def test_settled_2_the_noise_of_a_stuck_joints_rate_does_not_decide(push, force, speed, stuck):
    g = rows("three-brake", 0.01, 0.42)
    along = np.array([-g[stuck, 1], g[stuck, 0]]) / np.hypot(*g[stuck])
    f = force * np.array([math.cos(push), math.sin(push)])
    codes = set()
    for noise in (1e-9, -1e-9):  # m/s across the arc of the stuck joint
        v = speed * along + noise * g[stuck] / np.hypot(*g[stuck])
        codes.add(decision(make_controller(PRESETS[4], FORCE), 0.01, 0.42, v, f, g)[0])
    assert len(codes) == 1


@given(angle, angle, st.sampled_from([1.0, -1.0]), st.floats(0.0, 40.0))
def test_settled_3_a_push_is_outward_above_half_a_newton_and_within_60_degrees(direction, push, side, f):
    t = (math.cos(direction), math.sin(direction))
    n = (side * t[1], -side * t[0])
    field = Field(0.01, *t, *n, *t)
    force = (f * math.cos(push), f * math.sin(push))
    outward = -(force[0] * n[0] + force[1] * n[1])
    assume(abs(outward - 0.5) > 1e-9 and abs(outward - 0.5 * f) > 1e-9 and (abs(outward) > 1e-9 or f == 0.0))
    within_60_degrees = f > 0.0 and math.acos(max(-1.0, min(outward / f, 1.0))) < math.pi / 3
    assert pushes_away(Seen(0.0, 0.0, 0.0, 0.0, *force), field, SETTLED) == (outward > 0.5 and within_60_degrees)
    assert pushes_away(Seen(0.0, 0.0, 0.0, 0.0, *force), field, LITERAL) == (outward > 0.0)


def test_the_proportional_controller_locks_if_no_brake_helps_an_outward_push_or_the_tip_moves_back():
    helps = np.array([[3.0, 3.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])  # brake A only
    out_ahead, out_back, in_ahead, in_back = (0.1, 0.1), (-0.05, 0.1), (0.1, -0.005), (-0.1, -0.04)
    none = np.zeros((4, 2))
    for rules in RULE_SETS:
        for v, f, g, expected in [
            (out_ahead, (1, 5), helps, USE_CAPPED),  # a brake that helps is used, not the lock
            (out_ahead, (1, 5), none, algorithm.LOCK_NONE_SELECTED),
            (out_ahead, (1, -5), none, algorithm.RELEASE_NONE_SELECTED),
            (out_back, (1, 5), helps, algorithm.LOCK_BACK),
            (out_back, (1, 5), none, algorithm.LOCK_NONE_SELECTED),
            (in_back, (1, -5), none, algorithm.LOCK_BACK_NONE_SELECTED),
            (in_ahead, (1, -5), none, algorithm.RELEASE_NONE_SELECTED),
        ]:
            code, _ = decision(make_controller(PRESETS[4], FORCE, rules), 0.0, 0.4001, v, f, g)
            assert control.DECISIONS[code] == control.DECISIONS[expected], (rules, v, f)


def test_settled_5_moving_back_locks_only_beyond_5_mm_s_and_four_times_the_velocity_noise():
    def locked(speed, rules="settled", noise=0.0):
        controller = make_controller(PRESETS[4], FORCE, rules, velocity_noise=noise)
        code, current = decision(controller, 0.0, 0.4, (-speed, 0.0), (3.0, 0.0))
        assert (code in {algorithm.LOCK_BACK, algorithm.LOCK_BACK_NONE_SELECTED}) == (current[[0, 1, 2]].min() == 1.0)
        return code in LOCKED

    assert [locked(s) for s in (0.0049, 0.0051)] == [False, True]
    assert [locked(s, noise=2e-3) for s in (0.0079, 0.0081)] == [False, True]
    assert [locked(s, noise=1e-4) for s in (0.0049, 0.0051)] == [False, True]
    assert [locked(s, "literal") for s in (0.0, 1e-9)] == [False, True]


@given(seed, angle, st.floats(0.0, 40.0), st.floats(0.0, 0.00499), angle, st.floats(-0.06, 0.06))
def test_settled_a_hand_that_pushes_inward_is_never_locked_below_5_mm_s(seed, push, force, speed, way, distance):
    assume(abs(distance) > 1e-6)
    f = (force * math.cos(push), -math.copysign(force * abs(math.sin(push)), distance))
    v = (speed * math.cos(way), speed * math.sin(way))
    for number in (2, 3, 4, 5):
        rng = np.random.default_rng(seed)
        controller = make_controller(PRESETS[number], FORCE)
        assert decision(controller, 0.0, 0.4 + distance, v, f, random_rows(rng), random_mass(rng))[0] not in LOCKED
