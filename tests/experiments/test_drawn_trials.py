"""A simulated person on a circle, a figure eight, a star, a spiral and letters: trials end, measured as run."""

import numpy as np
import pytest
from people import somebody

from core import tick_log
from core.path import HOLD_M, build_path
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.movement import along_path
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.trial.trial import Conditions, SimulatedTrial

PROTOCOL = load_protocol("docs/examples/protocols/drawn.toml")


@pytest.mark.parametrize("number", PROTOCOL.paths)
@pytest.mark.parametrize("controller", PROTOCOL.controllers)
def test_a_trial_on_a_drawn_path_ends_at_its_end_and_its_ticks_say_what_the_measures_say(number, controller):
    device, path = PROTOCOL.devices[0], build_path(PROTOCOL.paths[number], "it")
    planned = PlannedTrial(1, 1, device.name, controller, number, 1)
    conditions = Conditions(PROTOCOL.paths[number], PROTOCOL.controllers[controller], "settled", PROTOCOL.trial)
    simulation = SimulatedDevice(device, (0.0, 0.38))
    trial = SimulatedTrial(simulation, planned, conditions, somebody(7), np.random.default_rng(number))
    rows = np.empty((100_000, tick_log.WIDTH))
    rows = rows[: trial.run(rows)]
    assert trial.outcome()["status"] == "done"
    move = rows[rows[:, tick_log.PHASE] == tick_log.MOVE]
    progress, error = along_path(move[:, tick_log.TIP_X : tick_log.TIP_Y + 1], path)
    assert progress[0] < 0.01 and progress[-1] == pytest.approx(path.length, abs=0.011)
    apart = np.abs(move[:, tick_log.PATH_DISTANCE]) - error
    assert apart.min() > -1e-9 and apart.max() <= 2.0 * HOLD_M, "the controller may hold a piece a little longer"
    assert np.mean(apart > 1e-9) < 0.05
