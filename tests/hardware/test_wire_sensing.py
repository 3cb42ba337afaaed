"""From counts to SI: poses with any encoders, motion, hand force, the board's clock."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from devices import FIXED, FOUR, THREE, FiveBar

from core.device import load_device
from core.device_file import Encoders, ForceSensor, Sensing
from core.files import InputError
from hardware.emulated_board.device import EmulatedSensors, hello_of
from hardware.sensing.board_clock import ClockModel, fit_line
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.samples import WINDOW, ForceSensing, MotionFilter

PER_REV = 96000
PAIRS = [*combinations(range(4), 2), (0, 1, 2, 3)]
rng = np.random.default_rng(5)


def sensing(bar: FiveBar, joints: tuple[int, ...]) -> PoseSensing:
    return PoseSensing(bar.device, joints, (PER_REV,) * 4)


def counts(bar: FiveBar, joints: tuple[int, ...], tip: np.ndarray) -> tuple[int, ...]:
    theta = bar.angles(tip)
    return tuple(round(float(theta[i]) / (2 * math.pi) * PER_REV) for i in joints)


@pytest.mark.parametrize("joints", PAIRS, ids=lambda joints: "".join("AEBC"[i] for i in joints))
@pytest.mark.parametrize("bar", FIXED, ids=lambda bar: bar.name.replace(" ", "-"))
def test_any_two_or_four_encoders_tell_where_the_tip_is(bar: FiveBar, joints: tuple[int, ...]) -> None:
    if joints == (1, 3) and bar.device.mechanism.coaxial:
        with pytest.raises(InputError, match="E and C alone do not say where the tip is"):
            sensing(bar, joints)
        return
    for tip in bar.open_tips(rng, 12, least=0.4):
        pose = sensing(bar, joints).pose(counts(bar, joints, tip))
        assert pose.closed
        step = 2 * math.pi / PER_REV / min(abs(bar.sines(tip)))  # what a count is worth at the tip, in rad
        assert np.allclose(pose.tip, tip, atol=2.0 * step)
        assert np.allclose(np.exp(1j * np.array(pose.theta)), np.exp(1j * bar.angles(tip)), atol=20.0 * step)


def test_angles_that_no_linkage_has_are_said_and_keep_the_last_tip() -> None:
    found = sensing(FOUR, (0, 2))
    before = found.pose(counts(FOUR, (0, 2), np.array([0.0, 0.4])))
    after = found.pose((PER_REV // 2, 0))  # both arms flat and away from each other
    assert not after.closed and after.tip == before.tip


def test_four_encoders_that_disagree_do_not_close() -> None:
    found = sensing(FOUR, (0, 1, 2, 3))
    good = counts(FOUR, (0, 1, 2, 3), np.array([0.0, 0.4]))
    assert found.pose(good).closed
    stuck = (good[0] + 600, *good[1:])  # 2 degrees
    assert not found.pose(stuck).closed


@pytest.mark.parametrize("lost", [(), (31,), (28, 29, 33, 36)])
def test_velocity_is_that_of_the_middle_of_the_window_even_where_samples_are_lost(lost: tuple[int, ...]) -> None:
    motion, times = MotionFilter(), [k for k in range(40) if k not in lost]
    for k in times:
        velocity, acceleration = motion.add(1e-3 * k, 3.0 * (1e-3 * k) ** 2, 0.0)
    middle = 1e-3 * 0.5 * (times[-WINDOW] + times[-1])
    assert velocity[0] == pytest.approx(6.0 * middle, rel=1e-9)
    assert acceleration[0] == pytest.approx(6.0, rel=1e-6)


def test_a_still_encoder_gives_exactly_no_velocity_and_motion_begins_anew_after_a_gap() -> None:
    motion = MotionFilter()
    for k in range(100):
        found = motion.add(1e-3 * k, 0.1234567, 0.3456789)
    assert found == ((0.0, 0.0), (0.0, 0.0))
    for k in range(30):
        motion.add(0.1 + 1e-3 * k, 0.001 * k, 0.0)
    assert motion.add(1.0, 0.5, 0.0) == ((0.0, 0.0), (0.0, 0.0))


def test_encoder_steps_make_the_noise_that_is_written() -> None:
    """Rounding to steps of 20 um, the error of each sample on its own: 0.35 mm/s and 0.18 m/s2."""
    motion, random, step = MotionFilter(), np.random.default_rng(3), 20e-6
    found = [motion.add(1e-3 * k, step * random.uniform(-0.5, 0.5), 0.0) for k in range(6000)][WINDOW:]
    velocity, acceleration = (np.array([f[i][0] for f in found]) for i in range(2))
    assert velocity.std() == pytest.approx(0.35e-3, rel=0.1)
    assert acceleration.std() == pytest.approx(0.18, rel=0.1)


SHIPPED = load_device("four-brake")


@pytest.mark.parametrize("on", ["handle", "ED", "CD"])
@pytest.mark.parametrize("gauges", [False, True])
def test_the_hand_force_comes_back_through_mounting_calibration_and_mass_beyond(on: str, gauges: bool) -> None:
    """What the emulated sensor makes of a hand force, the host undoes: turned, moving, coupled gauges, zero offset."""
    matrix = np.eye(6) + 0.2 * np.random.default_rng(1).standard_normal((6, 6)) if gauges else None
    sensor = ForceSensor(on=on, rotation_rad=0.7, inertia_beyond_kg=0.2)
    device = replace(SHIPPED, sensing=Sensing(encoders=Encoders(A=96000, B=96000), force=sensor), calibration=matrix)
    tip, force, acceleration = (0.04, 0.41), np.array([12.0, -7.0]), np.array([3.0, 5.0])
    hello = hello_of(device)
    emulated = EmulatedSensors(device, hello, tip, seed=1)
    read = [emulated.read(tip, force, acceleration, (0,) * 4).force for _ in range(400)]
    found = ForceSensing(device, hello.force_channels, hello.force_unit)
    found.zero = np.full(6, 50.0)
    mean = np.array(read).mean(axis=0) + 50.0
    theta = tuple(FOUR.angles(np.array(tip)))
    assert np.allclose(found.hand_force(mean, theta, tuple(acceleration)), force, atol=0.01)


def test_a_device_whose_sensor_the_board_does_not_read_is_refused_and_one_without_a_sensor_has_no_force() -> None:
    with pytest.raises(InputError, match="the board sends 0 channels"):
        ForceSensing(SHIPPED, 0, 1000)
    device = replace(THREE.device, sensing=None)
    assert ForceSensing(device, 0, 1000).hand_force((), (0.0,) * 4, (1.0, 1.0)) == (0.0, 0.0)


@pytest.mark.parametrize("drift", [0.0, 80e-6, -120e-6])
def test_the_clock_model_finds_offset_and_drift_through_late_and_wrong_arrivals(drift: float) -> None:
    random, model = np.random.default_rng(2), ClockModel()
    late = 100e-6 + random.exponential(200e-6, 40_000)
    late[random.integers(0, 40_000, 400)] += 0.02
    late[5000:8000] += 0.004  # three seconds in which everything came late
    for k in range(40_000):
        board_us = 7_000_000 + 1000 * k
        model.add(board_us, 1234.5 + (1.0 + drift) * 1e-6 * board_us + late[k])
    fit = model.fit
    assert fit.drift == pytest.approx(drift, abs=1e-6)
    assert model.host_s(40_000_000) == pytest.approx(1234.5 + (1.0 + drift) * 40.0 + 100e-6, abs=20e-6)
    assert fit.residual_s < 5e-6 and fit.blocks > 30


def test_the_clock_model_has_no_drift_before_three_seconds_and_follows_a_clock_that_stepped_within_seconds() -> None:
    model = ClockModel()
    for k in range(40_000):
        host_s = 50.0 + 1e-3 * k + (0.03 if k > 20_000 else 0.0)
        model.add(1000 * k, host_s)
        if not 20_000 < k < 24_500:
            assert model.host_s(1000 * k) == pytest.approx(host_s, abs=1e-5), k
    model = ClockModel()
    model.add(1_000_000, 51.0)
    assert model.fit.drift == 0.0 and model.host_s(1_000_000) == pytest.approx(51.0)
    assert fit_line(np.array([[0.0, 5.0], [1.0, 5.1]])).drift == 0.0
