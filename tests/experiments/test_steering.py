"""What brakes can do to a moving tip, against the exact simulator under every pattern of brakes."""

import itertools

import numpy as np
import pytest

from core.control.rule_sets import SETTLED
from core.device import load_device
from core.simulator.hand import new_hand
from core.simulator.simulation import Simulation
from core.workspace import brake_rows
from experiments.analysis.metrics import trial_metrics
from experiments.analysis.steering import KEY, across_range, from_metadata, to_metadata, wanted_across
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.recording import recording_of
from experiments.study.unrecorded import person_of, run_trial, switched_on, trial_of
from experiments.trial.population import load_population

AT = (0.03, 0.38)


def simulated(device, velocity, force, torques):
    """Acceleration of the tip with brakes that hold these torques (4,), N m, by the simulator."""
    hand = new_hand(np.zeros(1), np.array([force]))
    simulation = Simulation(device, AT, tuple(velocity), hand=hand)
    rate = simulation.body["rate"][0]
    simulation.body["sign"][0] = np.where(np.abs(rate) > 1e-9, np.sign(rate), 0.0)  # turning joints slip already
    simulation.run(0.0, 1e-3, torques)
    return simulation.body["acceleration"][0].copy()


@pytest.mark.parametrize("name", ["er-two-brake", "three-brake", "four-brake", "pter"])
def test_the_range_of_turning_is_that_of_the_simulator_over_all_patterns_of_brakes(name):
    device, rng = load_device(name), np.random.default_rng(5)
    braking = from_metadata({KEY: to_metadata(device)})
    rows = brake_rows(device.mechanism, *AT)
    for case in range(60):
        velocity, force = rng.normal(size=2) * 0.2, rng.normal(size=2) * 4.0
        if case % 2:  # one brake's joint is still, and the brake may hold it
            row = rows[rng.choice(braking.present)]
            velocity = np.array((-row[1], row[0])) / np.hypot(*row) * 0.2
        elif np.any(np.abs(rows[list(braking.present)] @ velocity) < SETTLED.still_rate):
            continue
        left = np.array((-velocity[1], velocity[0])) / np.hypot(*velocity)
        found = []
        for pattern in itertools.product((0, 1), repeat=len(braking.present)):
            torques = np.zeros(4)
            for i, on in zip(braking.present, pattern, strict=True):
                torques[i] = braking.high[i] if on else braking.low[i]
            found.append(left @ simulated(device, velocity, force, torques))
        least, most = across_range(braking, np.array([AT]), velocity[None], force[None])
        assert (least[0], most[0]) == pytest.approx((min(found), max(found)), rel=1e-9, abs=1e-9)


def test_the_wanted_arc_passes_through_the_point_ahead():
    rng = np.random.default_rng(6)
    velocity, angle = rng.normal(size=(50, 2)), rng.uniform(0.0, 2.0 * np.pi, 50)
    desired = np.column_stack((np.cos(angle), np.sin(angle)))
    curvature = wanted_across(velocity, desired, 0.05) / (velocity**2).sum(axis=1)
    left = np.column_stack((-velocity[:, 1], velocity[:, 0])) / np.hypot(*velocity.T)[:, None]
    centre = left / curvature[:, None]
    assert np.hypot(*(0.05 * desired - centre).T) == pytest.approx(1.0 / np.abs(curvature))


def test_the_push_that_is_held_is_what_the_simulated_brakes_did():
    arena = load_protocol("arena")
    device, preset = arena.device("four-brake"), next(p for p in arena.controllers.values() if p.kind == "sdof")
    planned = PlannedTrial(1, 1, device.name, 1, 1, 1)
    trial = trial_of(arena, person_of(load_population(), 1, 1), 1, planned, switched_on(device, arena), preset)
    recording = recording_of(run_trial(trial).copy(), device.braked, metadata={KEY: to_metadata(device)})
    found = trial_metrics(recording, trial.path)
    assert 0.0 < found["steerable_share"] <= 1.0
    moving = recording.in_phase("move")
    above = np.sign(recording.column("tip_y_m") - 0.4)  # the path is the line y = 40 cm
    push = above * recording.column("hand_fy_N")
    felt = moving & (push > 0.5)
    rows = brake_rows(device.mechanism, recording.column("tip_x_m"), recording.column("tip_y_m"))
    force = sum(rows["AEBC".index(j), 1] * recording.column(f"torque_{j}_N_m") for j in device.braked)
    assert found["push_held_share"] == pytest.approx((-above * force)[felt].sum() / push[felt].sum())
