"""The nearest passive force: exact against quadratic programming, never along the motion, and what `reflect` does."""

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from core.control.controllers import DECISIONS, decide, make_controller, make_preset
from core.control.reflect import nearest_passive_force
from core.control.velocity_field import NEAREST, WANTED, new_memory
from core.device import load_device
from core.path import line
from core.simulator.simulation import Simulation
from core.simulator.state import pack_brakes

THREE, FOUR = load_device("three-brake"), load_device("four-brake")
LAW = 1000  # random problems


def solved(a, low, high, force):
    """Torque (4,) and shown force (2,) of the exact solver; a (4, 2), 1/m."""
    torque = np.zeros(4)
    shown = nearest_passive_force(tuple(a[:, 0]), tuple(a[:, 1]), tuple(low), tuple(high), *force, torque)
    return torque, np.array(shown)


def random_problem(rng):
    a, low = rng.normal(size=(4, 2)) * 4.0, rng.uniform(0.0, 0.5, 4)
    high = low + rng.uniform(0.0, 5.0, 4)
    kind = rng.integers(5)
    if kind == 1:  # a joint without a brake
        a[rng.integers(4)] = 0.0
    if kind == 2:  # two brakes on one line, as on coaxial bases
        a[3] = a[1] * rng.uniform(0.2, 3.0)
    if kind == 3:  # one brake alone
        a[[0, 1, 3]], low[[0, 1, 3]], high[[0, 1, 3]] = 0.0, 0.0, 0.0
    if kind == 4:  # one that cannot give more than its drag
        high[0] = low[0]
    return a, low, high, rng.normal(size=2) * rng.choice([0.1, 5.0, 40.0])


def test_the_force_is_the_nearest_one_as_quadratic_programming_finds_it():
    rng = np.random.default_rng(15)
    worst = 0.0
    for _ in range(LAW):
        a, low, high, force = random_problem(rng)
        torque, shown = solved(a, low, high, force)
        assert np.all(torque >= low - 1e-12) and np.all(torque <= high + 1e-12)
        assert shown == pytest.approx(a.T @ torque, abs=1e-12)
        width = np.where(high > low, high - low, 1e-12)
        found = lsq_linear(a.T, force, (low, low + width), method="bvls", tol=1e-14)
        nearest = a.T @ np.clip(found.x, low, high)
        assert np.hypot(*(shown - force)) <= np.hypot(*(nearest - force)) + 1e-9, "no other is nearer"
        worst = max(worst, float(np.hypot(*(shown - nearest))))
    assert worst < 1e-6  # the nearest force is unique; the programme's own tolerance


def test_of_several_ways_to_have_a_force_the_least_braking_is_taken():
    rng, compared = np.random.default_rng(16), 0
    for _ in range(300):
        a, low, high, _ = random_problem(rng)
        force = a.T @ rng.uniform(low, high)  # one that can be had
        torque, shown = solved(a, low, high, force)
        assert shown == pytest.approx(force, abs=1e-9)
        room = high - low
        if np.count_nonzero(room * np.hypot(*a.T)) < 3:
            continue
        used = room > 0.0
        least = linprog(
            1.0 / room[used], A_eq=a.T[:, used], b_eq=force - a.T @ low, bounds=[(0.0, most) for most in room[used]]
        )
        assert np.sum((torque - low)[used] / room[used]) == pytest.approx(least.fun, abs=1e-6)
        compared += 1
    assert compared > 100


def one_tick(device, controller, velocity, push, wanted):
    """Decision, currents (4,) and memory of one tick at (0.02, 0.42)."""
    simulation = Simulation(device, (0.02, 0.42), velocity)
    memory, current = new_memory(), np.zeros(4)
    memory[WANTED : WANTED + 2] = wanted
    brakes, state = pack_brakes(device.brakes, backlash=False)[0], simulation.state[0]
    code, _ = decide(
        controller, brakes, line((-0.1, 0.4), (0.1, 0.4)), memory, 0.02, 0.42, *velocity, *push, state.g, state.mass,
        current,
    )  # fmt: skip
    return DECISIONS[code], current, memory, state.g[:4].copy()


@pytest.mark.parametrize("device", [THREE, FOUR], ids=lambda device: device.name)
def test_a_force_along_the_motion_cannot_be_had_and_one_against_it_can(device):
    reflect = make_controller(make_preset("", "reflect", {}), device.force_normalised_N)
    velocity = np.array((0.1, 0.02))
    rng = np.random.default_rng(17)
    for _ in range(200):
        turn = rng.uniform(0.0, 2.0 * np.pi)
        wanted = rng.uniform(1.0, 40.0) * np.array((np.cos(turn), np.sin(turn)))
        words, current, memory, g = one_tick(device, reflect, velocity, (0.0, 0.0), wanted)
        nearest = memory[NEAREST : NEAREST + 2]
        assert nearest @ velocity <= 1e-12, "brakes only take energy"
        assert words.endswith(", in part") == (np.hypot(*(nearest - wanted)) > 1e-6)
        if wanted @ velocity > 0.0:
            assert words.endswith(", in part") and np.hypot(*nearest) < np.hypot(*wanted) + 6.0
    against = -15.0 * velocity / np.hypot(*velocity)
    words, current, memory, _ = one_tick(device, reflect, velocity, (0.0, 0.0), against)
    assert words in ("show A", "show E", "show B", "show C") and memory[NEAREST : NEAREST + 2] == pytest.approx(against)
    assert current.any()


def test_no_force_to_show_releases_the_brakes_and_a_virtual_wall_is_a_spring_beyond_its_gap():
    reflect = make_controller(make_preset("", "reflect", {}), FOUR.force_normalised_N)
    for nothing in ((np.nan, np.nan), (0.0, 0.0), (0.3, 0.3)):
        words, current, _, _ = one_tick(FOUR, reflect, (0.1, 0.0), (0.0, 0.0), nothing)
        assert (words, current.any()) == ("none", False)
    wall = make_controller(make_preset("", "reflect", {"gap_m": 0.005, "wall_N_m": 1000.0}), FOUR.force_normalised_N)
    words, current, memory, _ = one_tick(FOUR, wall, (0.0, 0.1), (0.0, 10.0), (np.nan, np.nan))
    assert memory[WANTED : WANTED + 2] == pytest.approx((0.0, -15.0))  # 20 mm from the path, beyond a gap of 5 mm
    assert words.startswith("show") and current.any()
    wide = make_controller(make_preset("", "reflect", {"gap_m": 0.03, "wall_N_m": 1000.0}), FOUR.force_normalised_N)
    assert one_tick(FOUR, wide, (0.0, 0.1), (0.0, 10.0), (np.nan, np.nan))[0] == "gap"
