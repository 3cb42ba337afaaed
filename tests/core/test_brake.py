"""The MR brake: Eqs. (1), (2), (4), the inverse of (2), a measured torque table in its place, the backlash."""

import math
import re
import warnings
from itertools import product

import numpy as np
import pytest
from devices import BENCH_FOUR, BENCH_THREE, BRAKE_TEXT, THREE
from hypothesis import given, settings
from hypothesis import strategies as st

from core.brake import RPM_PER_RAD_S, current_for_torque, lagged_yield, time_constant, torque_gain
from core.device import build_brakes, without_backlash
from core.device_file import parse_brake
from core.files import InputError, StrangeInput
from core.simulator.hand import new_hand, spring_hand
from core.simulator.simulation import Grid, Schedule, Simulation
from core.simulator.state import pack_brakes
from core.torque_table import FROM, SLOPE, SQUARE, torque_curve

FILE = THREE.device.brake_files["A"]
BRAKES = pack_brakes(THREE.device.brakes, backlash=True)[0]
RPM = 1.0 / RPM_PER_RAD_S
START = (0.05, 0.40)
PLAY = math.radians(0.75)


def after(current, start, rate, elapsed, brakes=BRAKES):
    """Yield of brake A after so many seconds at one rate."""
    gain = torque_gain(brakes, 0, current)
    return lagged_yield(gain, start, elapsed, time_constant(brakes, 0, current, rate, gain > start))


@pytest.mark.nojit
def test_gain_is_the_off_torque_at_no_current_and_passes_the_assumed_points():
    """Eq. (2), of file and kernel: 0.35, 1, 3.4, 5.3 N m at 0, 0.2, 0.6, 1 A, continuous at the knee, rising."""
    for current, torque in ((0.0, 0.35), (0.2, 1.0), (0.6, 3.4), (1.0, 5.3)):
        assert torque_gain(BRAKES, 0, current) == FILE.torque_gain(current) == pytest.approx(torque, rel=1e-12)
    below, above = torque_gain(BRAKES, 0, 0.2 - 1e-12), torque_gain(BRAKES, 0, 0.2)
    assert below == pytest.approx(above, abs=1e-9)
    gains = [torque_gain(BRAKES, 0, i) for i in np.linspace(0, 1, 1001)]
    assert np.all(np.diff(gains) > 0.0)


@pytest.mark.nojit
def test_inverse_of_the_gain_gives_back_every_current_is_clipped_and_monotone():
    for current in np.linspace(0, 1, 501):
        assert current_for_torque(BRAKES, 0, torque_gain(BRAKES, 0, current)) == pytest.approx(current, abs=1e-12)
    torques = np.linspace(-1, 8, 2001)
    currents = np.array([current_for_torque(BRAKES, 0, t) for t in torques])
    assert np.all(np.diff(currents) >= 0.0)
    assert np.all(currents[torques <= 0.35] == 0.0) and np.all(currents[torques >= 5.3] == 1.0)
    assert current_for_torque(BRAKES, 3, 2.0) == 0.0


def test_a_brake_file_without_the_coefficients_of_eq_4_has_its_average_at_every_speed_and_current():
    numbers = "current_max_A = 1.0\nk = [1.0, 0.1, 0.0, 1.0, 0.1]\nrise = {a_avg_s = 0.02}\nfall = {a_avg_s = 0.01}"
    brake = parse_brake(f'name = "b"\n{numbers}', "")
    for current, speed_log2 in ((0.0, -3.0), (1.0, 3.0)):
        assert (
            brake.rise.below_omega_0(current, speed_log2) == 0.02
            and brake.fall.below_omega_0(current, speed_log2) == 0.01
        )


@pytest.mark.nojit
def test_time_constant_has_its_form_below_omega_0_is_constant_above_and_at_rest_that_at_the_floor():
    """Eq. (4), assumed: 0.030 + 0.004 (w - 3)^2 (1 + I) rising, 0.020 + 0.002 (w - 3)^2 (1 + I) falling."""
    for rpm in (0.125, 0.5, 1.0, 4.0, 7.99):
        for current in (0.0, 0.3, 1.0):
            bow = (math.log2(rpm) - 3) ** 2 * (1 + current)
            assert FILE.rise.below_omega_0(current, math.log2(rpm)) == pytest.approx(0.030 + 0.004 * bow, rel=1e-9)
            assert FILE.fall.below_omega_0(current, math.log2(rpm)) == pytest.approx(0.020 + 0.002 * bow, rel=1e-9)
            for rate in (rpm * RPM, -rpm * RPM):
                rising, falling = (time_constant(BRAKES, 0, current, rate, up) for up in (True, False))
                assert rising == pytest.approx(0.030 + 0.004 * bow, rel=1e-9)
                assert falling == pytest.approx(0.020 + 0.002 * bow, rel=1e-9)
    for rpm in (8.0, 8.001, 64.0, 1e4):
        assert time_constant(BRAKES, 0, 1.0, rpm * RPM * (1 + 1e-12), True) == 0.030
        assert time_constant(BRAKES, 0, 1.0, rpm * RPM * (1 + 1e-12), False) == 0.020
    for rising, least in ((True, 0.318), (False, 0.164)):
        at_rest = time_constant(BRAKES, 0, 1.0, 0.0, rising)
        assert at_rest == time_constant(BRAKES, 0, 1.0, 0.1249 * RPM, rising)
        assert at_rest == pytest.approx(least, rel=1e-9)


@pytest.mark.nojit
@settings(max_examples=60)
@given(
    current=st.floats(0, 1), start=st.floats(0.0, 5.3), rate=st.floats(-8, 8),
    time=st.floats(1e-4, 0.5), pieces=st.integers(2, 20),
)  # fmt: skip
def test_lag_does_not_depend_on_the_step_at_constant_current_and_speed(current, start, rate, time, pieces):
    """Eq. (1): y = K + (y_0 - K) exp(-t / a), in one step or in many."""
    once, y = after(current, start, rate, time), start
    for _ in range(pieces):
        y = after(current, y, rate, time / pieces)
    gain = torque_gain(BRAKES, 0, current)
    a = time_constant(BRAKES, 0, current, rate, gain > start)
    exact = gain + (start - gain) * math.exp(-time / a)
    assert once == pytest.approx(exact, rel=1e-12, abs=1e-12)
    assert y == pytest.approx(exact, rel=1e-10, abs=1e-10)
    assert min(start, gain) - 1e-12 <= once <= max(start, gain) + 1e-12


def test_reversal_leaves_the_yield_for_the_width_of_the_play():
    """A joint driven back from the edge of its play: the off torque for 0.75 degrees, then the yield."""
    for bar, way in product((BENCH_THREE, BENCH_FOUR), (1.0, -1.0)):
        g = bar.rows(np.array(START))
        v = np.array([0.05 * way, 0.0])
        currents = np.array([0.6, 0.0, 0.0, 0.0])
        hand = new_hand(forces=np.array([[60.0 * way, 0.0]]))
        simulation = Simulation(bar.device, START, tuple(v), fidelity="mr", hand=hand)
        simulation.braking["torque_yield"][0, 0] = 3.4
        side = math.copysign(1.0, g[0] @ v)
        simulation.braking["edge"][0, 0] = -side
        simulation.braking["play"][0, 0] = 0.0 if side > 0 else PLAY
        rows = simulation.run(0.08, 1e-4, currents)
        turned = np.abs(np.array([bar.angles(p)[0] for p in rows[:, 1:3]]) - bar.angles(np.array(START))[0])
        inside, outside = turned < PLAY - 1e-5, turned > PLAY + 1e-5
        assert inside.sum() > 10 and outside.sum() > 10
        assert np.abs(rows[inside, 5]) == pytest.approx(0.35, rel=1e-9)
        assert np.all(np.abs(rows[outside, 5]) > 3.0)


def test_locked_tip_with_backlash_roams_within_the_play(bench):
    """mr, full current everywhere: no joint leaves its play (0.4 mrad for the impacts at its ends).

    Without backlash none moves at all.
    """
    currents = np.array([float(j in bench.braked) for j in "AEBC"])
    theta_0 = bench.angles(np.array(START))
    for backlash in (True, False):
        device = bench.device if backlash else without_backlash(bench.device)
        simulation = Simulation(device, START, fidelity="mr")
        simulation.braking["torque_yield"][0] = 5.3 * currents  # already locked
        hand = spring_hand((0.0, 0.0, 0.0), (200.0, 0.0, 200.0))  # slow, so that the ends of the play are met gently
        simulation.hand.grips[0] = hand.grips[0]
        simulation.hand.grips["wave"][0] = [[10.0, 6.0, 0.0], [10.0, 6.0, 1.57]]
        simulation.hand.grips["waves"][0] = 1
        rows = simulation.rows(401, Schedule(np.zeros(1), currents[None]), Grid(0, 400, 10, 1e-3))
        turned = np.array([bench.angles(p) for p in rows[:, 1:3]]) - theta_0
        on = currents > 0
        assert np.all(np.abs(turned[:, on]) <= PLAY / 2 + 4e-4)
        roam = np.ptp(rows[:, 1:3], axis=0)
        assert (5e-4 < roam.max() < 6e-3) if backlash else np.all(roam == 0.0)


steps = st.lists(st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 5.0)), min_size=1, max_size=23)
tables = st.builds(
    lambda off, rows: [(0.0, off), *((x, off + y) for x, y in np.cumsum(rows, axis=0).tolist())],
    st.floats(0.0, 1.0),
    steps,
)


def brake_of(gain, current_max=1.0, knee=0.2):
    """A brake file with this line in place of k, and the record of a device that has it at joint A."""
    text = re.sub(r"(?m)^k = .*$", gain, BRAKE_TEXT).replace("current_max_A = 1.0", f"current_max_A = {current_max}")
    brake = parse_brake(text.replace("knee_A = 0.2", f"knee_A = {knee}"), "brake")
    return brake, pack_brakes(build_brakes({"A": brake}), backlash=False)[0]


@pytest.mark.nojit
@settings(max_examples=25)
@given(tables)
def test_a_table_is_a_torque_that_rises_through_its_points_without_corners_and_has_an_inverse(table):
    brake, record = brake_of(f"torque_table = {[list(row) for row in table]}", table[-1][0])
    for current, torque in table:
        assert torque_gain(record, 0, current) == pytest.approx(torque, rel=1e-9)
        assert brake.torque_gain(current) == pytest.approx(torque, rel=1e-9)
    currents = np.linspace(0.0, table[-1][0], 161)
    torques = np.array([torque_gain(record, 0, current) for current in currents])
    assert torques == pytest.approx([brake.torque_gain(current) for current in currents.tolist()], rel=1e-12)
    assert np.all(np.diff(torques) > -1e-12)
    back = [torque_gain(record, 0, current_for_torque(record, 0, torque)) for torque in torques.tolist()]
    assert back == pytest.approx(torques, abs=1e-9 * torques[-1])
    curve = torque_curve(table)[: 2 * (len(table) - 1)]
    arriving = curve[:-1, SLOPE] + 2.0 * curve[:-1, SQUARE] * np.diff(curve[:, FROM])
    assert arriving == pytest.approx(curve[1:, SLOPE], rel=1e-9, abs=1e-9), "no corner"


@pytest.mark.nojit
@pytest.mark.parametrize(
    "gain", ["k = [3.25, 0.35, -1.5625, 7.25, -0.3875]", "torque_table = [[0.0, 0.35], [1.0, 5.0]]"]
)
def test_drag_and_the_torque_that_current_adds_change_by_factors_of_their_own(gain):
    brake, _ = brake_of(gain)
    for current in (0.0, 0.1, 0.5, 1.0):
        added = brake.torque_gain(current) - 0.35
        changed = brake.changed(1.0, 2.0, 0.5, None).torque_gain(current)
        assert changed == pytest.approx(2.0 * 0.35 + 0.5 * added), current
        half = pack_brakes(build_brakes({"A": brake}).stronger(0.5), backlash=False)[0]
        assert torque_gain(half, 0, current) == pytest.approx(0.5 * brake.torque_gain(current)), current


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("gain", "says"),
    [
        ("torque_table = [[0.0, 0.3]]", "has 1 points"),
        ("torque_table = [[0.1, 0.3], [1.0, 5.0]]", "must begin at 0 A"),
        ("torque_table = [[0.0, 0.3], [0.9, 5.0]]", "ends at 0.9 A"),
        ("torque_table = [[0.0, -0.3], [1.0, 5.0]]", "negative torque"),
        ("torque_table = [[0.0, 0.3], [0.5, 0.3], [1.0, 5.0]]", "torques must rise"),
        ("torque_table = [[0.0, 0.3], [0.0, 0.4], [1.0, 5.0]]", "currents must rise"),
        ("torque_table = [[0.0, 0.3], [1.0, 5.0]]\nk = [1, 1, 1, 1, 1]", "either k or torque_table"),
        ("", "either k or torque_table"),
    ],
)
def test_a_table_that_is_no_torque_curve_is_refused(gain, says):
    with pytest.raises(InputError, match=says):
        brake_of(gain)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("k", "knee", "k5"),
    [
        ([3.25, 0.35, -1.5625, 7.25, -0.38], 0.19778, -0.38),  # rounded: the branches meet 2 mA from the knee
        ([3.25, 0.35, -1.5625, 7.25, -0.3], 0.17438, -0.3),  # fitted apart: 26 mA
        ([3.25, 0.35, 1.0, 3.25, 0.5], 0.2, 0.31),  # they meet nowhere near: k_5 is computed
    ],
)
def test_published_coefficients_are_joined_at_the_knee_and_a_jump_that_matters_is_said(k, knee, k5):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", StrangeInput)
        brake, record = brake_of(f"k = {k}")
    assert bool(said) == (k[4] != -0.38)
    assert brake.knee_A == pytest.approx(knee, abs=1e-4) and brake.equation_2[4] == pytest.approx(k5, abs=1e-9)
    assert brake.equation_2[:4] == tuple(k[:4])
    below, above = (brake.torque_gain(brake.knee_A + d) for d in (-1e-12, 0.0))
    assert above == pytest.approx(below, abs=1e-9)
    torques = [torque_gain(record, 0, current) for current in np.linspace(0.0, 1.0, 501).tolist()]
    assert np.all(np.diff(torques) > 0.0)
