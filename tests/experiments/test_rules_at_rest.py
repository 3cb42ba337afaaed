"""Laws of the settled rules on the simulated device: nobody is held who pushes along the path."""

import numpy as np
import pytest
from people import noiseless, somebody
from protocols import CURVES, PAPER

from core import tick_log
from core.control.controllers import make_controller
from core.control.velocity_field import new_memory
from core.device import load_device
from core.path import build_path, nearest, point_at
from core.records import new_record
from core.simulator.hand import new_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from experiments.assumptions import DEFAULTS
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules, load_protocol
from experiments.trial.encoder_sensing import new_sensing
from experiments.trial.operator import OPERATOR
from experiments.trial.tick import RunningTrial, new_run, run_ticks
from experiments.trial.trial import Conditions, SimulatedTrial

DEVICES = {name: load_device(name) for name in ("three-brake", "four-brake")}
SPEED_AT_REST = 0.005  # m/s


#: Every device with the paths that lie well inside its workspace.
PLACES = [(name, path) for name in DEVICES for path in PAPER.paths.values()]
PLACES += [("four-brake", path) for path in load_protocol(CURVES).paths.values()]


def push(device, path, number, tip, force, ticks, fidelity="static", rules="settled"):
    """The tick log of a hand force (N) that rises in 0.2 s, under a controller, from rest at `tip`, in `move`."""
    hand = new_hand(np.array([0.0, 0.2]), np.array([(0.0, 0.0), force]))
    simulation = Simulation(device, tip, fidelity=fidelity, hand=hand)
    controller = make_controller(PAPER.controllers[number], device.force_normalised_N, rules)
    run = new_run(TrialRules(), simulated_hand=False)
    run["phase"][0] = tick_log.MOVE
    rows = np.zeros((ticks, tick_log.WIDTH))
    trial = RunningTrial(
        path, path, controller, simulation.model, simulation.data, run, new_record(OPERATOR), np.zeros((1, 2)),
        new_memory(), new_sensing(device, DEFAULTS),
    )  # fmt: skip
    n = run_ticks(trial, rows)
    return rows[:n]


def beside_the_path(path, along, across):
    """The point `across` (m) to the left of the path at progress `along` (m)."""
    x, y, tx, ty = point_at(path, along)
    return x - across * ty, y + across * tx


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(("name", "path_file"), PLACES)
def test_a_hand_that_pushes_within_45_degrees_of_the_path_starts_to_move_along_it(name, path_file, number):
    path, generator = build_path(path_file, "it"), np.random.default_rng(number)
    for _ in range(12):
        along, across = generator.uniform(0.05, 0.85) * path.length, generator.uniform(-0.02, 0.02)
        tip = beside_the_path(path, along, across)
        _, _, tx, ty = nearest(path, *tip)
        angle = generator.uniform(-np.pi / 4, np.pi / 4) + np.arctan2(ty, tx)
        force = 30.0 * np.array([np.cos(angle), np.sin(angle)])
        rows = push(DEVICES[name], path, number, tip, force, 600)
        speed = rows[:, tick_log.TIP_VX] * tx + rows[:, tick_log.TIP_VY] * ty
        assert speed.max() > SPEED_AT_REST, (tip, force)


@pytest.mark.parametrize("name", DEVICES)
def test_the_noiseless_operator_finishes_every_trial_under_the_settled_rules(name):
    device = DEVICES[name]
    rows = np.zeros((80_000, tick_log.WIDTH))
    for seed in range(4):
        person = noiseless(somebody(seed))
        simulation = SimulatedDevice(device, (0.0, 0.38))
        for number, path in enumerate(path for place, path in PLACES if place == name):
            for controller, preset in PAPER.controllers.items():
                planned = PlannedTrial(1, 1, name, controller, number, 1)
                generator = np.random.default_rng([seed, number])
                trial = SimulatedTrial(
                    simulation, planned, Conditions(path, preset, "settled"), person=person, generator=generator
                )
                trial.run(rows)
                assert trial.outcome()["status"] == "done", (seed, path, controller)
