"""The nearest passive force: exact against quadratic programming, never along the motion, and what `reflect` does."""

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from core.control.algorithm import Tick
from core.control.controllers import DECISIONS, decide, make_controller, make_preset
from core.control.reflect import nearest_passive_force
from core.control.velocity_field import NEAREST, WANTED, Seen, new_memory
from core.device import load_device
from core.path import line
from core.simulator.simulation import Simulation
from core.simulator.state import pack_brakes

THREE, FOUR = load_device("three-brake"), load_device("four-brake")
LAW = 600  # random problems


def solved(a, low, high, force):
    """Torque (4,) and shown force (2,) of the exact solver; a (4, 2), 1/m."""
    torque = np.zeros(4)
    shown = nearest_passive_force(tuple(a[:, 0]), tuple(a[:, 1]), tuple(low), tuple(high), *force, torque)
    return torque, np.array(shown)


#: How the rows of a random problem lie.
LAYOUTS = (
    "generic", "one without a brake", "one alone", "one with its drag alone", "parallel", "anti-parallel", "two lines",
    "all on one line", "nearly parallel", "vanishing",
)  # fmt: skip


def random_problem(rng, layout):
    """Rows (4, 2), lows and highs of a layout, and a wanted force: any, one that can be had, or a corner of these."""
    a, low = rng.normal(size=(4, 2)) * 4.0, rng.uniform(0.0, 0.5, 4)
    high = low + rng.uniform(0.0, 5.0, 4)
    i, j, k, m = rng.permutation(4)
    ratio, senses = rng.uniform(0.2, 3.0), rng.choice([1.0, -1.0], 4)
    if layout == "one without a brake":
        a[i] = 0.0
    elif layout == "one alone":
        a[[j, k, m]], low[[j, k, m]], high[[j, k, m]] = 0.0, 0.0, 0.0
    elif layout == "one with its drag alone":
        high[i] = low[i]
    elif layout == "parallel":  # as on coaxial bases
        a[i] = a[j] * ratio
    elif layout == "anti-parallel":
        a[i] = -a[j] * ratio
    elif layout == "two lines":
        a[i], a[k] = senses[0] * ratio * a[j], senses[1] * a[m]
    elif layout == "all on one line":
        a = np.outer(senses * rng.uniform(0.2, 3.0, 4), a[0])
    elif layout == "nearly parallel":
        row = senses[0] * ratio * a[j]
        a[i] = row + 10.0 ** rng.uniform(-17.0, -3.0) * np.array((-row[1], row[0]))
    elif layout == "vanishing":
        a[i] *= 10.0 ** rng.uniform(-320.0, -3.0)
    where = rng.random()
    force = rng.normal(size=2) * rng.choice([0.1, 5.0, 40.0])
    if where < 0.3:
        force = a.T @ rng.uniform(low, high)
    elif where < 0.4:
        force = a.T @ np.where(rng.random(4) < 0.5, low, high)
    return a, low, high, force


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_force_is_the_nearest_one_as_bounded_least_squares_finds_it(layout):
    rng = np.random.default_rng((15, LAYOUTS.index(layout)))
    for _ in range(LAW // len(LAYOUTS)):
        a, low, high, force = random_problem(rng, layout)
        torque, shown = solved(a, low, high, force)
        assert np.all(torque >= low - 1e-12) and np.all(torque <= high + 1e-12)
        assert shown == pytest.approx(a.T @ torque, abs=1e-12)
        width = np.where(high > low, high - low, 1e-12)
        found = lsq_linear(a.T, force, (low, low + width), method="bvls", tol=1e-15)
        nearest = a.T @ np.clip(found.x, low, high)
        # the nearest force is unique; rows that are nearly parallel leave a millionth part of what a hand feels
        assert shown == pytest.approx(nearest, abs=1e-7 if layout == "nearly parallel" else 1e-10)


def test_of_several_ways_to_have_a_force_the_least_braking_is_taken():
    rng, compared = np.random.default_rng(16), 0
    for n in range(200):
        layout = LAYOUTS[n % len(LAYOUTS)]
        if layout in ("nearly parallel", "vanishing"):
            continue  # the programme below is too coarse for them
        a, low, high, _ = random_problem(rng, layout)
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
    assert compared > 50


def one_tick(device, controller, velocity, push, wanted):
    """Decision, currents (4,) and memory of one tick at (0.02, 0.42)."""
    simulation = Simulation(device, (0.02, 0.42), velocity)
    memory, current = new_memory(), np.zeros(4)
    memory[WANTED : WANTED + 2] = wanted
    brakes, body = pack_brakes(device.brakes, backlash=False)[0], simulation.body[0]
    tick = Tick(Seen(0.02, 0.42, *velocity, *push), body.g, body.mass, brakes, memory, current)
    code, _ = decide(controller, line((-0.1, 0.4), (0.1, 0.4)), tick)
    return DECISIONS[code], current, memory, body.g[:4].copy()


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
