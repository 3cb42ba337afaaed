"""Trials of simulated operators without recordings: the ticks of `phd study`, measured and not kept."""

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from core import tick_log
from core.control.controllers import Preset
from core.device import Device
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import METRICS, Metric, measures_of
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial, make_plan, participant_index
from experiments.protocol import Protocol
from experiments.recording.schema import recording_of
from experiments.trial.normals import normals
from experiments.trial.operator import Person
from experiments.trial.population import Population
from experiments.trial.trial import Trial

#: Ticks that one block of rows holds: more than a trial of the paper's protocol can have.
BLOCK_TICKS = 65_536


def person_of(population: Population, seed: int, operator: int) -> Person:
    """The operator of this number (1..), as in a study."""
    return population.draw(np.random.default_rng(np.random.SeedSequence([seed, operator])))


def switched_on(device: Device, protocol: Protocol) -> SimulatedDevice:
    """A device under the protocol's assumptions as a session begins with it: at rest in the middle of the first path.
    """
    first = build_path(next(iter(protocol.paths.values())), "path")
    x, y, _, _ = point_at(first, 0.5 * first.length)
    assumed = protocol.assumptions
    return SimulatedDevice(assumed.applied_to(device), (x, y), fidelity=assumed.simulated_fidelity)


def trial_of(
    protocol: Protocol, person: Person, operator: int, planned: PlannedTrial, device: SimulatedDevice, preset: Preset
) -> Trial:
    """A trial of the operator of this number (1..), on a device as it is.

    As in a study: the same noise for every controller, device and rule set.
    """
    noise = normals(protocol.seed, operator, planned.segment, planned.repetition)
    path = protocol.paths[planned.segment]
    return Trial(device, planned, path, preset, protocol.rules, protocol.trial, person, noise)


def study_trials(
    protocol: Protocol, population: Population, operators: int, metrics: Sequence[Metric] = METRICS
) -> Iterator[tuple[TrialRow, int]]:
    """Every trial of a study, in its order, and its ticks; the same numbers as `phd study` writes into its table."""
    for operator in range(1, operators + 1):
        label = f"{operator:02d}"
        person = person_of(population, protocol.seed, participant_index(label))
        devices = {device.name: switched_on(device, protocol) for device in protocol.devices}
        for planned in make_plan(protocol, label, coded=False):
            preset = protocol.controllers[int(planned.controller)]
            device = devices[planned.configuration]
            yield run_measured(trial_of(protocol, person, operator, planned, device, preset), label, metrics)


def run_measured(trial: Trial, label: str, metrics: Sequence[Metric] = METRICS) -> tuple[TrialRow, int]:
    """Run a trial to its end and measure it: its row, with these measures alone, and its ticks."""
    rows = run_trial(trial)
    found = measures_of(recording_of(rows, trial.device.braked), trial.path, metrics)
    measures = dict(zip((metric.name for metric in metrics), found, strict=True))
    outcome = trial.outcome()
    energies = {name: outcome[name] for name in ("energy_residual_J", "energy_added_max_J")}
    return TrialRow(label, *trial.planned, outcome["status"], **energies, **measures), len(rows)


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
