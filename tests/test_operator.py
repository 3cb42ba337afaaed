"""The simulated operator moves like a person, and the same seed is the same person."""

import numpy as np
import pytest

from core import row
from core.device import load_device
from experiments.operator import draw_person, minimum_jerk, steady
from experiments.plan import SEGMENTS, PlannedTrial
from experiments.trial import Trial, new_simulation

DEVICE = load_device("three-brake")


def one_trial(person, number=1, segment=1, seed=3):
    simulation = new_simulation(DEVICE, (0.0, 0.38))
    planned = PlannedTrial(1, 1, "three-brake", number, segment, 1)
    trial = Trial(simulation, planned, SEGMENTS[segment], "settled", 5.0, person, np.random.default_rng(seed))
    rows = np.zeros((80_000, row.WIDTH))
    return trial, rows[: trial.run(rows)]


@pytest.mark.nojit
def test_minimum_jerk_starts_and_ends_at_rest_and_is_fastest_in_the_middle():
    share, slope = np.array([minimum_jerk(r) for r in np.linspace(0.0, 1.0, 101)]).T
    assert (share[0], share[-1], slope[0], slope[-1]) == (0.0, 1.0, 0.0, 0.0)
    assert np.all(np.diff(share) > 0.0) and slope.argmax() == 50
    assert slope.max() == pytest.approx(1.875)  # peak speed 1.875 L / T, Flash & Hogan 1985
    np.testing.assert_allclose(np.gradient(share, 0.01)[1:-1], slope[1:-1], atol=2e-3)


def test_the_same_seed_is_the_same_person_and_the_same_trial():
    first, again = (draw_person(np.random.default_rng(5)) for _ in range(2))
    assert first == again != draw_person(np.random.default_rng(6))
    np.testing.assert_array_equal(one_trial(first)[1], one_trial(again)[1])


def test_phases_follow_one_another_and_the_start_is_held_for_half_a_second():
    trial, rows = one_trial(draw_person(np.random.default_rng(1)))
    phases = rows[:, row.PHASE]
    move, end = np.flatnonzero(phases == row.MOVE), np.flatnonzero(phases == row.END)
    assert trial.outcome()["status"] == "done"
    assert np.all(np.diff(phases[move[0] :]) >= 0) and len(end) == 300
    held = rows[move[0] - 500 : move[0]]
    assert np.all(held[:, row.PHASE] == row.HOLD)
    start, goal = SEGMENTS[1]
    assert np.hypot(held[:, row.TIP_X] - start[0], held[:, row.TIP_Y] - start[1]).max() <= 0.003
    assert np.hypot(rows[end[0], row.TIP_X] - goal[0], rows[end[0], row.TIP_Y] - goal[1]) <= 0.01
    assert np.all(rows[phases != row.MOVE, row.CURRENT : row.CURRENT + 4] == 0.0)  # brakes off outside `move`


def test_people_move_and_push_within_what_people_do():
    """Peak speed, force and path error of uncontrolled trials stay in the ranges measured or computed for people."""
    for seed in range(6):
        trial, rows = one_trial(draw_person(np.random.default_rng(seed)), seed=seed)
        moving = rows[rows[:, row.PHASE] == row.MOVE]
        assert trial.outcome()["status"] == "done"
        assert 0.05 < np.hypot(moving[:, row.TIP_VX], moving[:, row.TIP_VY]).max() < 0.5
        assert 1.0 < np.hypot(moving[:, row.HAND_FX], moving[:, row.HAND_FY]).mean() < 8.0
        assert np.abs(moving[:, row.TIP_Y] - 0.40).mean() < 0.02


def test_without_noise_the_force_is_smooth_and_with_tremor_it_oscillates_near_9_hz():
    calm = steady(draw_person(np.random.default_rng(2)))
    trembling = calm._replace(tremor_N=0.3, tremor_hz=9.0)
    spectra = []
    for person in (calm, trembling):
        rows = one_trial(person)[1]
        moving = rows[rows[:, row.PHASE] == row.MOVE][:2000]
        spectra.append(np.abs(np.fft.rfft(moving[:, row.HAND_FX] * np.hanning(2000)))[17:20].sum())
    assert spectra[1] > 5.0 * spectra[0]


def test_the_ledger_of_a_trial_closes_and_no_brake_adds_energy():
    for number in (1, 2, 4):
        trial, rows = one_trial(draw_person(np.random.default_rng(4)), number)
        last, first = rows[-1], rows[0]
        kept = last[row.ENERGY_KINETIC] - first[row.ENERGY_KINETIC]
        residual = last[row.ENERGY_HAND] - last[row.ENERGY_BRAKES] - last[row.ENERGY_STOPS] - kept
        assert abs(residual) < 1e-4 * max(last[row.ENERGY_BRAKES], 0.01)
        assert np.all(np.diff(rows[:, row.ENERGY_BRAKES]) >= 0.0)
        assert trial.outcome()["energy_added_max_J"] == 0.0


def test_a_hand_force_that_is_not_finite_ends_the_trial_with_brakes_off():
    simulation = new_simulation(DEVICE, (0.0, 0.38))
    trial = Trial(simulation, PlannedTrial(1, 1, "three-brake", 2, 1, 1), SEGMENTS[1], "settled", 5.0)
    trial.aim(float("nan"), 0.4)
    rows = np.zeros((1000, row.WIDTH))
    n = trial.run(rows)
    assert trial.finished and trial.outcome()["status"] == "aborted"
    assert "not finite" in trial.outcome()["reason"]
    assert np.isfinite(rows[:n]).all() and np.all(rows[:n, row.CURRENT : row.CURRENT + 4] == 0.0)
