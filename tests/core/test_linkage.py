"""The closed chain: joint angles, rows g, virtual power. Eqs. (7)-(11)."""

from dataclasses import replace

import numpy as np
import pytest
from devices import BENCH_FOUR, FiveBar, slope

from core.dynamics import motion
from core.linkage import joint_angles, tip_force_map
from core.simulator.state import new_body, pack_mechanism
from core.simulator.stick_slip import same_line
from core.simulator.stick_slip_mode import update_kinematics
from core.workspace import brake_rows

pytestmark = pytest.mark.nojit


def angles_of(bar: FiveBar, p: np.ndarray) -> np.ndarray:
    theta = np.zeros(4)
    joint_angles(pack_mechanism(bar.device.mechanism)[0], p[0], p[1], theta)
    return theta


def tips(bar: FiveBar, n: int = 8) -> np.ndarray:
    return bar.open_tips(np.random.default_rng(7), n)


def turn(angle: np.ndarray) -> np.ndarray:
    """Angle differences in (-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def test_joint_angles_follow_the_law_of_cosines(any_five_bar):
    """Elbows in: no other device has them so."""
    inwards = replace(BENCH_FOUR, elbows="in", limits="margin = 0.01"), np.array([0.02, 0.38])
    for bar, p in (*((any_five_bar, p) for p in tips(any_five_bar)), inwards):
        assert np.max(np.abs(turn(angles_of(bar, p) - bar.angles(p)))) < 1e-13


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
        body = new_body(*p, *v)[0]
        update_kinematics(mechanism, body)
        assert body.g[:4] == pytest.approx(any_five_bar.rows(p), rel=1e-9, abs=1e-9)
        assert body.rate[:4] == pytest.approx(any_five_bar.brake_rates(rates), rel=1e-9, abs=1e-9)
        assert body.bias[:4] == pytest.approx(any_five_bar.brake_rates(change), rel=1e-7, abs=1e-7)


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
