"""Trials of simulated operators without recordings: the ticks of `phd study`, measured and not kept."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.device import Device
from core.path import PathFile
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import METRICS, Metric, measures_of
from experiments.assumptions import Assumptions
from experiments.plan import PlannedTrial, make_plan, participant_index
from experiments.protocol import Protocol, middle_of_first
from experiments.recording.schema import recording_of
from experiments.trial.normals import normals
from experiments.trial.operator import Person
from experiments.trial.population import Population
from experiments.trial.trial import Trial

#: Ticks that one block of rows holds: more than a trial of the paper's protocol can have.
BLOCK_TICKS = 65_536


class Measured(NamedTuple):
    """A trial that was run."""

    planned: PlannedTrial
    outcome: Mapping[str, Any]
    measures: Mapping[str, float | None]
    ticks: int


def person_of(population: Population, seed: int, operator: int) -> Person:
    """The operator of this number (1..), as in a study."""
    return population.draw(np.random.default_rng(np.random.SeedSequence([seed, operator])))


def switched_on(device: Device, paths: Mapping[int, PathFile], assumed: Assumptions) -> SimulatedDevice:
    """A device under these assumptions as a session begins with it: at rest in the middle of the first path."""
    return SimulatedDevice(assumed.applied_to(device), middle_of_first(paths), fidelity=assumed.simulated_fidelity)


def study_trials(
    protocol: Protocol, population: Population, operators: int, metrics: Sequence[Metric] = METRICS
) -> Iterator[Measured]:
    """Every trial of a study, in its order; the same numbers as `phd study` writes into its table."""
    for operator in range(1, operators + 1):
        label = f"{operator:02d}"
        index = participant_index(label)
        person = person_of(population, protocol.seed, index)
        devices: dict[str, SimulatedDevice] = {}
        for planned in make_plan(protocol, label, coded=False):
            if planned.configuration not in devices:
                device = protocol.device(planned.configuration)
                devices[planned.configuration] = switched_on(device, protocol.paths, protocol.assumptions)
            trial = Trial(
                devices[planned.configuration], planned, protocol.paths[planned.segment],
                protocol.controllers[int(planned.controller)], protocol.rules, protocol.trial, person,
                normals(protocol.seed, index, planned.segment, planned.repetition),
            )  # fmt: skip
            yield run_measured(trial, metrics)


def run_measured(trial: Trial, metrics: Sequence[Metric] = METRICS) -> Measured:
    """Run a trial to its end and measure it."""
    rows = run_trial(trial)
    recording = recording_of(rows, trial.device.braked)
    found = measures_of(recording, trial.path, metrics)
    names = [metric.name for metric in metrics]
    return Measured(trial.planned, trial.outcome(), dict(zip(names, found, strict=True)), len(rows))


def run_trial(trial: Trial) -> np.ndarray:
    """Every tick of a trial (n, tick_log.WIDTH); to be used before the next trial, which takes the same room."""
    block = _block()
    n = trial.run(block)
    blocks = [block[:n]]
    while not trial.finished:
        block = np.empty((BLOCK_TICKS, tick_log.WIDTH))
        blocks.append(block[: trial.run(block)])
    return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)


@cache
def _block() -> np.ndarray:
    return np.empty((BLOCK_TICKS, tick_log.WIDTH))
