"""Couplings: brakes that act on a combination of the base rates, on one axis (PTER) or on bases that are apart."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from devices import APART, COUPLED, PTER, S1, S4, THREE, UNEQUAL, random_five_bar, stops_of, switching, yields

from core.device import without_backlash
from core.mechanism import JOINTS
from core.simulator.hand import new_hand, wave_hand
from core.simulator.simulated_device import SimulatedDevice, is_start, start_again
from core.simulator.simulation import Grid, Schedule, Simulation
from core.simulator.state import carried
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import START, BenchScene

ONCE = np.zeros(1)
coupled = pytest.mark.parametrize("bar", COUPLED, ids=lambda bar: bar.name)


def angles(bar, joint: str, tips) -> np.ndarray:
    """The angle that a brake acts on, by the law of cosines, at tips (n, 2)."""
    i = JOINTS.index(joint)
    return np.array([bar.brake_rates(bar.angles(p))[i] for p in tips])


@pytest.mark.parametrize(
    "bar, scene",
    [
        *((bar, "switching") for bar in (PTER, *(random_five_bar(seed) for seed in (10, 27, 36)))),
        *((bar, scene) for bar in (UNEQUAL, APART) for scene in ("E locked", "C locked")),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_motion_equals_the_independent_solution_on_the_ten_coordinates(bar, scene):
    """1 ms steps against DOP853 on Eq. (5), which finds patterns by trial."""
    times, torques = switching(bar, 0.1)
    if scene != "switching":
        times, torques = ONCE, yields(bar, 0.3, **{scene[0]: 5.6})[None]
    wave = S4 if scene == "switching" else S1
    seconds = 0.1 if scene == "switching" else 0.3
    expected = reference_tips(BenchScene(scene, bar.device, seconds, wave, np.zeros(2), times, torques))
    simulation = Simulation(bar.device, START, hand=wave_hand(wave))
    n = len(expected) - 1
    rows = simulation.rows(n + 1, Schedule(times, torques), Grid(0, n, round(seconds / n / 1e-3), 1e-3))
    error = np.linalg.norm(rows[:, 1:3] - expected, axis=1)
    assert error.max() < 1e-10
    assert np.linalg.norm(expected - START, axis=1).max() > 5e-4


@coupled
@pytest.mark.parametrize("joint", "EC")
@pytest.mark.parametrize("fidelity", ["ideal", "mr"])
def test_a_locked_clutch_holds_its_angle_not_only_its_rate(bar, joint, fidelity):
    simulation = Simulation(without_backlash(bar.device), START, (0.0, 0.0), fidelity, hand=wave_hand(S1))
    commands = yields(bar, 0.3, **{joint: 5.6})
    if fidelity == "mr":
        commands = yields(bar, 0.0, **{joint: 1.0})
        simulation.braking["torque_yield"][0] = [5.3 if j == joint else 0.35 for j in JOINTS]
    rows = simulation.run(2.0, 1e-3, commands)
    turned = angles(bar, joint, rows[:, 1:3])
    assert np.ptp(rows[:, 1]) + np.ptp(rows[:, 2]) > 0.01
    assert np.abs(turned - turned[0]).max() < 5e-15 * sum(abs(a) + abs(b) for j, a, b in bar.couplings if j == joint)


@coupled
@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize("way", [0, 60, 90, 120, 225])
def test_couplings_without_torque_leave_the_motion_and_the_stops_as_they_are(bar, integrator, way):
    """Pushed into the stops of the elbows and of D, along them and into their corners, and thrown back."""
    plain = replace(bar, couplings=(), braked="AB", name="without couplings", rotor=0.0)
    force = 12.0 * np.array([math.cos(math.radians(way)), math.sin(math.radians(way))])
    found = []
    for one in (replace(bar, rotor=0.0), plain):
        simulation = Simulation(
            one.device, START, (0.0, 0.0), integrator=integrator, hand=new_hand(forces=np.array([force]))
        )
        rows = simulation.run(0.6, 1e-3, yields(replace(bar, braked="AB"), 0.3))
        assert stops_of(one.device, *rows[::10, 1:3]).min() > -1e-9
        found.append((rows, simulation.ledger()))
    (rows, ledger), (expected, as_it_is) = found
    assert as_it_is.lost_at_stops > 1e-3, "it has struck"
    if integrator == "event":
        assert rows[:, 1:5] == pytest.approx(expected[:, 1:5], abs=1e-7)
    assert rows[:, 1:3] == pytest.approx(expected[:, 1:3], abs=1e-3)
    assert ledger.lost_at_stops == pytest.approx(as_it_is.lost_at_stops, rel=1e-6 if integrator == "event" else 1e-2)


@pytest.mark.parametrize("bar, places", [(PTER, 7), (THREE, 5)], ids=lambda value: getattr(value, "name", value))
def test_the_start_of_a_trial_is_recorded_and_taken_up_again_as_long_as_without_couplings_it_always_was(bar, places):
    hand = new_hand(forces=np.array([[9.0, -6.0]]))
    device, again = (SimulatedDevice(bar.device, START, hand) for _ in range(2))
    for n in range(300):
        device.move(np.array([0.1, 0.4, 0.1, 0.0]), 1e-3 * n, 1e-3)
    start = json.loads(json.dumps(device.recorded_start()))
    assert is_start(start) and len(start["state"]["contact"]) == places
    assert not is_start({**start, "state": {**start["state"], "contact": [0.0] * 6}})
    start_again(again, start)
    before, after = carried(device.data), carried(again.data)
    for name in before:
        assert np.array_equal(before[name], after[name]), name
