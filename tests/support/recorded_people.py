"""Trials of simulated people for the fit of operators, as a bench would have recorded them; nothing goes to a disk."""

import numpy as np
from protocols import PAPER

from core import tick_log
from core.simulator.simulated_device import SimulatedDevice
from experiments.operator_fit.motions import Motion, motion_of
from experiments.plan import PlannedTrial
from experiments.recording.schema import recording_of
from experiments.trial.operator import Person
from experiments.trial.trial import Trial


def motions(person: Person, seed: int, rounds: int = 3) -> list[Motion]:
    """The trials of a study: each controller on each path and device, in random order, `rounds` times."""
    generator, found = np.random.default_rng(seed), []
    rows = np.empty((80_000, tick_log.WIDTH))
    for device in PAPER.devices:
        simulation = SimulatedDevice(device, (0.0, 0.38))
        for _ in range(rounds):
            cells = [(number, segment) for number in PAPER.controllers for segment in PAPER.paths]
            for number, segment in generator.permutation(cells).tolist():
                trial = Trial(
                    simulation, PlannedTrial(1, 1, device.name, number, segment, 1), PAPER.paths[segment],
                    PAPER.controllers[number], "settled", person=person, generator=generator.spawn(1)[0],
                )  # fmt: skip
                n = trial.run(rows)
                if trial.outcome()["status"] == "done":
                    braked = "".join(device.braked)
                    found.append(motion_of(recording_of(rows[:n].copy(), braked), PAPER.paths[segment]))
    return found
