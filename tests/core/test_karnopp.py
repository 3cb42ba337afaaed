"""The paper's friction model, Eq. (6), beside the exact solver."""

import numpy as np
import pytest
from devices import BENCH_FOUR, BENCH_THREE, S1, S4, stops_of, yields

from core.simulator.hand import new_hand, wave_hand
from core.simulator.simulation import Simulation
from core.simulator.solver_numbers import DELTA_OMEGA

START = (0.05, 0.40)


def scene(bar, step, integrator="karnopp", wave=S1, commands=None, delta_omega=DELTA_OMEGA):
    """A simulation after a second under a waving hand, and its rows."""
    simulation = Simulation(bar.device, START, integrator=integrator, hand=wave_hand(wave))
    simulation.body["delta_omega"][0] = delta_omega
    return simulation, simulation.run(1.0, step, yields(bar, 0.3) if commands is None else commands)


def test_stuck_joint_creeps_no_faster_than_its_band_and_in_proportion_to_it(bench):
    """A joint that is caught inside the band keeps the rate it had there; Eq. (6) only stops its acceleration."""
    gone = []
    for band in (1e-2, 1e-3, 1e-4):
        g = bench.rows(np.array(START))
        along = np.linalg.solve(g[:2], 0.5 * np.array([band, band]))  # A and E turn at half the band, B somewhat
        along *= 0.5 * band / np.abs(g @ along).max()
        simulation = Simulation(bench.device, START, tuple(along), integrator="karnopp")
        simulation.body["delta_omega"][0] = band
        rows = simulation.run(1.0, 1e-3, yields(bench, 5.6))
        rates = np.array([bench.rows(p) @ v for p, v in zip(rows[::100, 1:3], rows[::100, 3:5], strict=True)])
        assert np.all(np.abs(rates) < band)
        gone.append(np.linalg.norm(rows[-1, 1:3] - START))
    assert gone[0] / gone[1] == pytest.approx(10.0, rel=0.05)
    assert gone[1] / gone[2] == pytest.approx(10.0, rel=0.05)
    assert gone[2] > 0.0


def test_motion_tends_to_that_of_the_exact_solver_as_step_and_band_shrink(bench):
    exact = scene(bench, 1e-4, "event")[1]
    errors = []
    for step, band in ((2e-3, 4e-3), (5e-4, 1e-3), (1e-4, 2e-4)):
        rows = scene(bench, step, delta_omega=band)[1]
        every = round(step / 1e-4)
        errors.append(np.sqrt(np.mean(np.sum((rows[:, 1:3] - exact[::every, 1:3]) ** 2, axis=1))))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.15 * errors[0]
    assert errors[2] < 5e-5


@pytest.mark.parametrize("wave, locked", [(S1, {}), (S1, {"A": 5.6}), (S4, {"A": 5.6, "B": 5.6})])
def test_brakes_add_no_energy_beyond_what_the_band_allows(bench, wave, locked):
    """Inside the band a stuck brake may push with the motion: at most yield x band. Nowhere else."""
    commands = yields(bench, 0.3, **locked)
    simulation, _ = scene(bench, 1e-3, wave=wave, commands=commands)
    ledger = simulation.ledger()
    assert ledger.added_by_brakes <= commands.max() * DELTA_OMEGA * 1e-3 + 1e-15
    for heat, limit in zip(ledger.heat, commands, strict=True):
        assert heat >= -limit * DELTA_OMEGA * 1.0
    assert ledger.kinetic <= ledger.work_hand + 1e-4


@pytest.mark.parametrize("bar", [BENCH_THREE, BENCH_FOUR], ids=lambda bar: bar.name)
@pytest.mark.parametrize("push", [(-40.0, 5.0), (0.0, 40.0)])
def test_tip_never_passes_a_hard_stop(bar, push):
    hand = new_hand(forces=np.array([push]))
    simulation = Simulation(bar.device, START, hand=hand, integrator="karnopp")
    rows = simulation.run(1.0, 1e-3, yields(bar, 0.3))
    assert np.all(np.isfinite(rows))
    assert simulation.ledger().lost_at_stops > 0.0
    assert stops_of(bar.device, *rows[::10, 1:3]).min() > -1e-6
