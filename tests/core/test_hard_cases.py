"""The hard cases, each with the law it must keep: never a NaN, never energy from a brake, never beyond a stop."""

import math
from dataclasses import replace

import numpy as np
import pytest
from devices import FOUR, S1, S4, rods, stops_of, yields

from core.simulator.hand import Hand, new_hand, spring_hand
from core.simulator.simulation import Grid, Schedule, Simulation

START = (0.05, 0.40)
#: J; the largest energy a brake may add in a step: rounding of its heat, which is summed from powers of one sign
FROM_A_BRAKE = 1e-15


def tethered(wave: np.ndarray, stiffness: float = 60.0, damping: float = 3.0) -> Hand:
    """A hand that shakes the handle, on a soft spring that keeps it in the workspace."""
    hand = spring_hand((stiffness, 0.0, stiffness), (damping, 0.0, damping), target=START)
    hand.grips["wave"][0], hand.grips["waves"][0] = wave, 1
    return hand


def check(simulation: Simulation, rows: np.ndarray) -> None:
    """The laws that hold in every case."""
    assert np.all(np.isfinite(rows))
    ledger = simulation.ledger()
    assert ledger.added_by_brakes <= FROM_A_BRAKE
    assert min(ledger.heat) >= 0.0 and ledger.lost_at_stops >= 0.0
    assert stops_of(simulation.device, *rows[:: max(1, len(rows) // 250), 1:3]).min() >= -1e-9


@pytest.mark.parametrize("share", [1 - 1e-15, 1.0, 1 + 1e-15, 1 + 1e-9, 1 + 1e-6])
def test_start_at_the_yield_limit_moves_no_further_than_the_excess_pushes(bench, share):
    """The edge of what the brakes hold: a force along g_A that one brake alone balances, to the last bit and beyond."""
    g = bench.rows(np.array(START))
    for i, joint in enumerate("AEB"):
        force = share * 2.0 * g[i]
        simulation = Simulation(bench.device, START, hand=new_hand(forces=force[None]))
        rows = simulation.run(0.05, 1e-3, yields(bench, 0.0, **{joint: 2.0}))
        xx, xy, yy = simulation.body["mass"][0]
        lightest = np.linalg.eigvalsh([[xx, xy], [xy, yy]])[0]
        pushed = 0.5 * max(share - 1, 1e-15) * np.linalg.norm(force) / lightest * 0.05**2
        angle = [bench.angles(p)[i] for p in rows[:, 1:3]]
        assert abs(angle[-1] - angle[0]) <= 20 * pushed + 1e-12
        check(simulation, rows)


def push(newtons: float, twelfth: int) -> Hand:
    """A constant force in one of twelve directions."""
    angle = twelfth * math.pi / 6 + 0.1
    return new_hand(forces=newtons * np.array([[math.cos(angle), math.sin(angle)]]))


@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_arms_folded_and_stretched_stay_inside_the_hard_stops(any_five_bar, integrator, friction):
    """Pushed for 2 s in 12 directions against every stop there is, in slow and fast impacts."""
    start = tuple(any_five_bar.open_tips(np.random.default_rng(1), 1)[0])
    struck = 0
    for k in range(12):
        simulation = Simulation(any_five_bar.device, start, integrator=integrator, hand=push((5.0, 30.0)[k % 2], k))
        rows = simulation.run(2.0, 1e-3, yields(any_five_bar, friction))
        check(simulation, rows)
        ledger = simulation.ledger()
        struck += ledger.lost_at_stops > 0.0
        assert abs(ledger.residual) < (1e-3 if integrator == "event" else 0.5) * (0.1 + abs(ledger.work_hand))
    assert struck >= 6


@pytest.mark.parametrize("integrator", ["event", "stepping"])
def test_sliding_along_a_stop_loses_no_energy_but_by_friction(integrator):
    """Ledger and motion agree the better the smaller the step, stops included."""
    left = []
    for step in (1e-3, 1e-4):
        simulation = Simulation(FOUR.device, START, integrator=integrator, hand=push(30.0, 3))
        rows = simulation.run(1.0, step, np.zeros(4))
        check(simulation, rows)
        left.append(abs(simulation.ledger().residual))
    assert left[1] < max(0.3 * left[0], 1e-9)


@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize("fidelity", ["ideal", "mr"])
@pytest.mark.parametrize("damping", [0.0, 50.0])
def test_mouse_jump_on_a_stiff_spring_makes_no_energy(five_bar, integrator, fidelity, damping):
    """0.3 m in one tick on 1e5 N/m (100 m/s, a tenth of a metre a step): energy stays near what the jump stored."""
    for jump in ((0.3, 0.0), (-0.3, 0.0), (0.0, -0.3), (0.0, 0.3)):
        hand = spring_hand((1e5, 0.0, 1e5), (damping, 0.0, damping), target=START)
        simulation = Simulation(five_bar.device, START, (0.0, 0.0), fidelity, integrator, hand)
        commands = yields(five_bar, 0.3)[None]
        simulation.rows(50, Schedule(np.zeros(1), commands), Grid(0, -1, 1, 1e-3))
        target = np.add(START, jump)
        hand.grips["target"][0, :2] = target
        rows = simulation.rows(300, Schedule(np.zeros(1), commands), Grid(50, -1, 1, 1e-3))
        check(simulation, rows)
        stored = 0.5e5 * np.sum((rows[:, 1:3] - target) ** 2, axis=1)
        kinetic = [five_bar.kinetic(row[1:3], row[3:5]) for row in rows]
        assert np.max(stored + kinetic) <= 1.1 * 0.5e5 * 0.3**2


@pytest.mark.parametrize("integrator, fidelity", [("event", "ideal"), ("stepping", "ideal"), ("event", "mr")])
def test_brakes_switching_every_tick_for_a_minute(bench, integrator, fidelity):
    rng = np.random.default_rng(9)
    n = 60000
    top = 5.6 if fidelity == "ideal" else 1.0
    present = yields(bench, 1.0)
    values = top * rng.integers(0, 2, (n, 4)) * present
    simulation = Simulation(bench.device, START, (0.0, 0.0), fidelity, integrator, tethered(S4, 200.0, 5.0))
    rows = simulation.rows(n + 1, Schedule(np.arange(n) * 1e-3, values), Grid(0, n, 1, 1e-3))
    check(simulation, rows)
    assert np.ptp(rows[-20000:, 1:3], axis=0).max() > 1e-3
    if fidelity == "ideal":
        assert np.all(np.abs(rows[:-1, 5:9]) <= values * (1 + 1e-12))


@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize("ratio", [1e-4, 1e4])
def test_tip_ten_thousand_times_heavier_or_lighter_than_the_links(bench, ratio, integrator):
    light = replace(bench, links=rods(0.3 if ratio < 1 else 3e-5, bench.lengths), tip=3e-5 if ratio < 1 else 0.3)
    light = replace(light, rotor=0.0, name="lopsided")
    for simulation in (
        Simulation(light.device, START, (0.1, 0.0), "ideal", integrator, tethered(S1)),
        Simulation(light.device, START, (0.1, 0.0), "mr", integrator, tethered(S1)),
    ):
        commands = yields(light, 0.2)
        rows = simulation.run(5.0, 1e-3, commands)
        check(simulation, rows)
        ledger = simulation.ledger()
        assert abs(ledger.residual) < (1e-5 if integrator == "event" else 0.1) * (1.0 + ledger.work_hand)
