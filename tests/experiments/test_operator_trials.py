"""Trials of the simulated operator: it moves like a person, and the same seed is the same trial."""

import numpy as np
import pytest
from people import noiseless, somebody
from protocols import PAPER

from core import tick_log
from core.device import load_device
from core.path import Arc, Polyline, Segment, build_path
from core.simulator.hand import grip_force
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.movement import along_path, mean_over_progress
from experiments.plan import PlannedTrial
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

DEVICES = {name: load_device(name) for name in ("three-brake", "four-brake")}
FLAT = Segment((-0.1, 0.4), (0.1, 0.4))
CORNER = Polyline(((-0.1, 0.34), (0.0, 0.42), (0.1, 0.34)))
BOW = Arc((0.0, 0.36), 0.08, 180.0, 0.0)


def new_trial(person, number=1, path=FLAT, seed=3, device="three-brake", simulation=None):
    simulation = simulation or SimulatedDevice(DEVICES[device], (0.0, 0.38))
    return SimulatedTrial(
        simulation,
        PlannedTrial(1, 1, device, number, 1, 1),
        Conditions(path, PAPER.controllers[number], "settled"),
        person=person,
        generator=np.random.default_rng(seed),
    )


def one_trial(person, number=1, path=FLAT, **how):
    trial = new_trial(person, number, path, **how)
    rows = np.zeros((80_000, tick_log.WIDTH))
    return trial, rows[: trial.run(rows)]


def moving(rows):
    return rows[rows[:, tick_log.PHASE] == tick_log.MOVE]


def test_the_same_seed_is_the_same_trial_and_another_seed_another_one_but_for_people_without_noise():
    person = somebody(5)
    first, again, other = (one_trial(person, seed=seed)[1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    first, other = (one_trial(noiseless(person), seed=seed)[1] for seed in (3, 4))
    np.testing.assert_array_equal(first, other)


def test_phases_follow_one_another_and_the_start_is_held_for_half_a_second():
    trial, rows = one_trial(somebody(1))
    phases = rows[:, tick_log.PHASE]
    move, end = np.flatnonzero(phases == tick_log.MOVE), np.flatnonzero(phases == tick_log.END)
    assert trial.outcome()["status"] == "done"
    assert np.all(np.diff(phases[move[0] :]) >= 0) and len(end) == 300
    held = rows[move[0] - 500 : move[0]]
    assert np.all(held[:, tick_log.PHASE] == tick_log.HOLD)
    assert np.hypot(held[:, tick_log.TIP_X] - FLAT.start_m[0], held[:, tick_log.TIP_Y] - FLAT.start_m[1]).max() <= 0.003
    assert np.hypot(rows[end[0], tick_log.TIP_X] - FLAT.end_m[0], rows[end[0], tick_log.TIP_Y] - FLAT.end_m[1]) <= 0.01
    assert np.all(
        rows[phases != tick_log.MOVE, tick_log.CURRENT : tick_log.CURRENT + 4] == 0.0
    )  # brakes off outside `move`


@pytest.mark.parametrize("path", [FLAT, CORNER, BOW], ids=["segment", "corner", "bow"])
def test_an_unaided_operator_follows_any_path_to_its_end_without_a_jump_of_the_virtual_hand(path):
    for seed in range(3):
        trial, rows = one_trial(somebody(seed), path=path)
        move = moving(rows)
        assert trial.outcome()["status"] == "done"
        assert np.abs(move[:, tick_log.PATH_DISTANCE]).max() < 0.03
        assert np.abs(np.diff(move[:, [tick_log.TARGET_X, tick_log.TARGET_Y]], axis=0)).max() < 1e-3


def path_error(move, path):
    """The measure of trials.csv, m."""
    progress, distance = along_path(move[:, [tick_log.TIP_X, tick_log.TIP_Y]], build_path(path, "path"))
    return mean_over_progress(distance, progress)


def test_unaided_people_err_push_and_move_within_the_ranges_they_are_set_to():
    """Most trials on the three-brake device lie in the ranges of path error, force and speed of decision 08."""
    error, force, speed = [], [], []
    for seed in range(16):
        for path in PAPER.paths.values():
            trial, rows = one_trial(somebody(seed), path=path, seed=seed)
            move = moving(rows)
            assert trial.outcome()["status"] == "done"
            error.append(path_error(move, path))
            force.append(np.hypot(move[:, tick_log.HAND_FX], move[:, tick_log.HAND_FY]).mean())
            speed.append(np.hypot(move[:, tick_log.TIP_VX], move[:, tick_log.TIP_VY]).max())
    for values, low, high in ((error, 0.0011, 0.0042), (force, 1.9, 4.4), (speed, 0.11, 0.24)):
        assert np.mean([low <= value <= high for value in values]) > 0.65
        assert low < np.median(values) < high


def test_the_device_alone_takes_an_unaided_hand_further_off_than_the_gap_and_the_heavier_one_further():
    """Decision 13; the gap of the paper's SDOF controller is 5 mm."""
    people = [load_population("from-device").draw(np.random.default_rng(seed)) for seed in range(24)]
    error = {name: [] for name in DEVICES}
    for name, errors in error.items():
        for seed, person in enumerate(people):
            simulation = SimulatedDevice(DEVICES[name], (0.0, 0.38))
            # where a trial ended is where the next one sets out from: the order of the paths is random, as in a study
            for path in np.random.default_rng(seed).permutation([*PAPER.paths.values()] * 2):
                trial, rows = one_trial(person, path=path, seed=seed, device=name, simulation=simulation)
                if trial.outcome()["status"] == "done":
                    errors.append(path_error(moving(rows), path))
        assert len(errors) > 90  # of 96
    assert np.median(error["three-brake"] + error["four-brake"]) > 0.0055
    assert 0.004 < np.median(error["three-brake"]) < 0.85 * np.median(error["four-brake"])


@pytest.mark.parametrize("name", DEVICES)
def test_steady_people_reach_the_end_whatever_the_controller(name):
    steady = load_population("steady")
    for seed in range(3):
        person, simulation = steady.draw(np.random.default_rng(seed)), SimulatedDevice(DEVICES[name], (0.0, 0.38))
        for path in PAPER.paths.values():
            for number in PAPER.controllers:
                trial, _ = one_trial(person, number, path, seed=seed, device=name, simulation=simulation)
                assert trial.outcome()["status"] == "done", (seed, path, number)


def test_the_mass_of_the_arm_is_on_the_hands_side_of_the_force_sensor():
    """The sensor reads what the arm exerts less what its own mass takes."""
    person = somebody(8)
    trial = new_trial(person)
    tick, taken, seen = np.zeros((1, tick_log.WIDTH)), 0.0, 0
    grip = trial.simulation.hand.grips[0]
    while not trial.finished and trial.ticks < 3000:
        trial.run(tick)
        at = tick[0]
        arm = grip_force(grip, at[tick_log.TIP_X], at[tick_log.TIP_Y], at[tick_log.TIP_VX], at[tick_log.TIP_VY])
        inertial = person.mass_kg * at[[tick_log.TIP_AX, tick_log.TIP_AY]]
        np.testing.assert_allclose(at[[tick_log.HAND_FX, tick_log.HAND_FY]], arm - inertial, atol=1e-9)
        taken, seen = max(taken, np.hypot(*inertial)), seen + 1
    assert taken > 0.3 and seen == 3000


def test_an_operator_whose_trial_is_stopped_leaves_the_virtual_hand_where_it_is():
    trial = new_trial(somebody(1))
    rows = np.zeros((80_000, tick_log.WIDTH))
    n = trial.run(rows[:400])  # on the way to the start
    trial.abort("test")
    n += trial.run(rows[n:])
    assert trial.outcome()["status"] == "aborted"
    targets = rows[399:n, tick_log.TARGET_X : tick_log.TARGET_Y + 1]
    assert np.all(targets == targets[0])


def test_a_hand_force_that_is_not_finite_ends_the_trial_with_brakes_off():
    simulation = SimulatedDevice(DEVICES["three-brake"], (0.0, 0.38))
    trial = SimulatedTrial(
        simulation, PlannedTrial(1, 1, "three-brake", 2, 1, 1), Conditions(FLAT, PAPER.controllers[2], "settled")
    )
    trial.aim(float("nan"), 0.4)
    rows = np.zeros((1000, tick_log.WIDTH))
    n = trial.run(rows)
    assert trial.finished and trial.outcome()["status"] == "aborted"
    assert "not finite" in trial.outcome()["reason"]
    assert np.isfinite(rows[:n, : tick_log.ARM_FORCE_MAX]).all()
    assert np.all(rows[:n, tick_log.CURRENT : tick_log.CURRENT + 4] == 0.0)
