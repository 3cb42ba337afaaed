"""The closed chain: joint angles, rows g, virtual power. Eqs. (7)-(11)."""

from dataclasses import replace

import numpy as np
import pytest
from devices import BENCH_FOUR, FiveBar, slope

from core.control.algorithm import torque_for_force
from core.dynamics import motion
from core.linkage import joint_angles, joint_rows, tip_force_map
from core.simulator.state import new_state, pack_mechanism
from core.simulator.stick_slip import same_line
from core.simulator.stick_slip_mode import update_kinematics
from core.workspace import brake_rows

pytestmark = pytest.mark.nojit


def angles_of(bar: FiveBar, p: np.ndarray) -> np.ndarray:
    theta = np.zeros(4)
    joint_angles(pack_mechanism(bar.device.mechanism)[0], p[0], p[1], theta)
    return theta


def rows_of(bar: FiveBar, p: np.ndarray) -> np.ndarray:
    g = np.zeros((4, 2))
    joint_rows(pack_mechanism(bar.device.mechanism)[0], p[0], p[1], g)
    return g


def tips(bar: FiveBar, n: int = 8) -> np.ndarray:
    return bar.open_tips(np.random.default_rng(7), n)


def along(angle: float) -> np.ndarray:
    """Unit vector at an angle from +x."""
    return np.array([np.cos(angle), np.sin(angle)])


def turn(angle: np.ndarray) -> np.ndarray:
    """Angle differences in (-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def test_both_arms_reach_the_tip(any_five_bar):
    """Walking out along either arm by the joint angles ends at the tip."""
    lengths = any_five_bar.lengths
    for p in tips(any_five_bar):
        a, e, b, c = angles_of(any_five_bar, p)
        for base, t, bend, (one, two) in (
            (any_five_bar.base_a, a, e, lengths[:2]),
            (any_five_bar.base_b, b, c, lengths[2:]),
        ):
            end = base + one * along(t) + two * along(t + bend)
            assert end == pytest.approx(p, abs=1e-13)


def test_joint_angles_follow_the_law_of_cosines(any_five_bar):
    for p in tips(any_five_bar):
        assert np.max(np.abs(turn(angles_of(any_five_bar, p) - any_five_bar.angles(p)))) < 1e-13


SIDES = [("out", (-1, 1)), ("in", (1, -1)), ("left", (-1, -1)), ("right", (1, 1))]


@pytest.mark.parametrize("elbows, signs", SIDES)
def test_elbows_bulge_to_the_side_that_the_file_names(elbows, signs):
    """Out: theta_E < 0 < theta_C, the A-arm bulges to -x and the B-arm to +x."""
    bar = replace(BENCH_FOUR, elbows=elbows, limits="margin = 0.01")
    p = np.array([0.02, 0.38])
    theta = angles_of(bar, p)
    assert tuple(np.sign(theta[[1, 3]])) == signs
    for base, t, sign in ((bar.base_a, theta[0], signs[0]), (bar.base_b, theta[2], signs[1])):
        to_tip, elbow = p - base, along(t)
        left = to_tip[0] * elbow[1] - to_tip[1] * elbow[0]
        assert np.sign(left) == -sign  # a negative elbow angle: the elbow lies left of base -> tip


def test_rows_are_the_inverse_jacobians(any_five_bar):
    """Eqs. (8), (9), (10): the rows of J1^-1 and J2^-1."""
    for p in tips(any_five_bar):
        (j1, j2), g = any_five_bar.jacobians(p), rows_of(any_five_bar, p)
        assert g[:2] @ j1 == pytest.approx(np.eye(2), abs=1e-13)
        assert g[2:] @ j2 == pytest.approx(np.eye(2), abs=1e-13)


def test_rows_are_the_derivatives_of_the_joint_angles(any_five_bar):
    for p in tips(any_five_bar):
        expected = np.column_stack([slope(any_five_bar.angles, p, axis) for axis in np.eye(2)])
        assert rows_of(any_five_bar, p) == pytest.approx(expected, rel=1e-8, abs=1e-8)


def test_base_brakes_push_along_the_distal_links_and_elbow_brakes_along_base_to_tip(any_five_bar):
    for p in tips(any_five_bar):
        a, e, b, c = any_five_bar.angles(p)
        g = rows_of(any_five_bar, p)
        for i, (x, y) in (
            (0, (np.cos(a + e), np.sin(a + e))),
            (1, p - any_five_bar.base_a),
            (2, (np.cos(b + c), np.sin(b + c))),
            (3, p - any_five_bar.base_b),
        ):
            assert g[i, 0] * y - g[i, 1] * x == pytest.approx(0.0, abs=1e-12 * np.linalg.norm(g[i]))


def test_rates_and_their_bias_are_the_derivatives_of_the_angles_along_a_path(any_five_bar):
    """omega = g . v, and gdot . v is the joint acceleration of a tip in straight uniform motion."""
    rng = np.random.default_rng(5)
    mechanism = pack_mechanism(any_five_bar.device.mechanism)[0]
    for p in tips(any_five_bar):
        v = rng.normal(scale=0.5, size=2)
        m = motion(mechanism, p[0], p[1], v[0], v[1])
        rates = [rate for arm in (m.arm_1, m.arm_2) for rate in (arm.base_rate, arm.elbow_rate)]
        biases = [bias for arm in (m.arm_1, m.arm_2) for bias in (arm.base_bias, arm.elbow_bias)]
        assert rates == pytest.approx(slope(any_five_bar.angles, p, v), rel=1e-8, abs=1e-8)
        change = slope(lambda q, v=v: any_five_bar.joint_rows(q) @ v, p, v)
        assert biases == pytest.approx(change, rel=1e-7, abs=1e-7)
        state = new_state(*p, *v)[0]
        update_kinematics(mechanism, state)
        assert state.g[:4] == pytest.approx(any_five_bar.rows(p), rel=1e-9, abs=1e-9)
        assert state.rate[:4] == pytest.approx(any_five_bar.brake_rates(rates), rel=1e-9, abs=1e-9)
        assert state.bias[:4] == pytest.approx(any_five_bar.brake_rates(change), rel=1e-7, abs=1e-7)


def test_brakes_push_along_the_rows_of_their_joints_or_couplings(any_five_bar):
    """At one tip and at many."""
    at = tips(any_five_bar)
    many = brake_rows(any_five_bar.device.mechanism, *at.T)
    for k, p in enumerate(at):
        g = np.zeros((4, 2))
        tip_force_map(pack_mechanism(any_five_bar.device.mechanism)[0], p[0], p[1], g)
        assert g == pytest.approx(any_five_bar.rows(p), rel=1e-9, abs=1e-9)
        assert many[:, :, k] == pytest.approx(g, rel=1e-12, abs=1e-12)


def test_rows_that_are_parallel_at_every_tip_are_those_marked_so(any_five_bar):
    """D with them; a coupling of one ratio with a base joint is parallel to it on any bases."""
    mechanism = any_five_bar.device.mechanism
    for i in range(5):
        for j in range(i):
            sines = []
            for p in tips(any_five_bar):
                joints = any_five_bar.joint_rows(p)
                g = np.vstack([any_five_bar.rows(p), joints[2] + joints[3] - joints[0] - joints[1]])
                sines.append(np.linalg.det(g[[i, j]]) / np.prod(np.linalg.norm(g[[i, j]], axis=1)))
            assert (np.abs(sines).max() < 1e-12) == same_line(i, j, mechanism.lines), (i, j)


def test_tip_force_of_one_brake_is_its_torque_over_the_moment_arm(any_five_bar):
    """Eq. (11); the moment arm of brake i is the distance from the force's line to the joint: 1 / |g_i|."""
    p = tips(any_five_bar, 1)[0]
    g = rows_of(any_five_bar, p)
    a, e, b, c = any_five_bar.angles(p)
    ae, ed, bc, cd = any_five_bar.lengths
    reach_a, reach_b = np.linalg.norm(p - any_five_bar.base_a), np.linalg.norm(p - any_five_bar.base_b)
    arms = np.abs([ae * np.sin(e), ae * ed * np.sin(e) / reach_a, bc * np.sin(c), bc * cd * np.sin(c) / reach_b])
    for i in range(4):
        assert torque_for_force(3.0, *g[i]) == pytest.approx(3.0 * arms[i], rel=1e-12)
