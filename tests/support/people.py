"""Simulated operators for tests."""

import numpy as np

from core import tick_log
from core.simulator.simulated_device import SimulatedDevice
from experiments.operator_fit.motions import Motion, motion_of
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.recording.schema import recording_of
from experiments.trial.operator import Person
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

AVERAGE = load_population()


def somebody(seed: int, **changes: float) -> Person:
    """A person of the average population, with some numbers changed."""
    return AVERAGE.draw(np.random.default_rng(seed))._replace(**changes)


def noiseless(person: Person) -> Person:
    """The same person without noise, tremor, or change from trial to trial."""
    return person._replace(noise_share=0.0, tremor_N=0.0, trial_bias_m=0.0, reaction_spread_s=0.0)


def bench_trials(person: Person, seed: int, rounds: int = 3) -> list[Motion]:
    """The trials of a study as a bench would have recorded them, none on a disk: each controller on each path and
    device, in random order, `rounds` times.
    """
    paper = load_protocol()
    generator, found = np.random.default_rng(seed), []
    rows = np.empty((80_000, tick_log.WIDTH))
    for device in paper.devices:
        simulation = SimulatedDevice(device, (0.0, 0.38))
        for _ in range(rounds):
            cells = [(number, segment) for number in paper.controllers for segment in paper.paths]
            for number, segment in generator.permutation(cells).tolist():
                trial = SimulatedTrial(
                    simulation,
                    PlannedTrial(1, 1, device.name, number, segment, 1),
                    Conditions(paper.paths[segment], paper.controllers[number], "settled"),
                    person=person,
                    generator=generator.spawn(1)[0],
                )
                n = trial.run(rows)
                if trial.outcome()["status"] == "done":
                    braked = "".join(device.braked)
                    found.append(motion_of(recording_of(rows[:n].copy(), braked), paper.paths[segment]))
    return found
