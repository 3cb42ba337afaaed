"""Trials of simulated operators without recordings: the ticks of `phd study`, measured and not kept.

Of samples and sweeps; of a study's error bars; and of the paper's own rule for the low gain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from core import tick_log
from core.control.controllers import Preset, make_preset
from core.device import Device
from core.files import InputError
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice, start_again
from core.tick_log import TICK_S
from experiments.analysis import steering
from experiments.analysis.metrics import BY_NAME, METRICS, Metric
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.simulation_errors import HAND, STEP, Moved
from experiments.analysis.trials_table import TrialRow, ledger_of, measure
from experiments.assumptions import NO_VIBRATION
from experiments.plan import PlannedTrial, make_plan, participant_index
from experiments.protocol import Protocol, middle_of_first, protocol_from_json, protocol_to_json
from experiments.recording import recording_of
from experiments.store.files import sessions_in
from experiments.store.stored import read_stored, stored_person
from experiments.study.helpers import cores, process_pool
from experiments.trial.normals import normals
from experiments.trial.operator import Person
from experiments.trial.population import Population
from experiments.trial.trial import Conditions, SimulatedTrial, Trial

#: Ticks that one block of rows holds: more than a trial of the paper's protocol can have.
BLOCK_TICKS = 65_536
_BLOCK = np.empty((BLOCK_TICKS, tick_log.WIDTH))  # takes memory as it is written
BRAKES = "brakes without lag and backlash"
BAND_HZ = 20.0, 100.0  # assumed
DETECTED_M_S2 = 0.1  # rms; assumed
PEOPLE = 3
SUBSTEPS, ASIDE_M = 10, 1e-6  # of the changes STEP and HAND
#: N s/m, from one to the other: ten a decade, two digits each.
GAINS = [float(f"{10.0 ** (k / 10.0):.2g}") for k in range(41)]


def person_of(population: Population, seed: int, operator: int) -> Person:
    """The operator of this number (1..), as in a study."""
    return population.draw(np.random.default_rng(np.random.SeedSequence([seed, operator])))


def switched_on(device: Device, protocol: Protocol) -> SimulatedDevice:
    """A device under the protocol's assumptions as a session begins: at rest in the middle of the first path."""
    return SimulatedDevice(protocol.assumptions.applied_to(device), middle_of_first(protocol.paths))


def after_the_last_path(device: Device, protocol: Protocol) -> SimulatedDevice:
    """A device under the protocol's assumptions at rest where the last path ends, as after a trial on it.

    From where a handle comes to the start changes the trial: the brakes' drag holds part of that motion's force.
    """
    path = build_path(list(protocol.paths.values())[-1], "path")
    x, y, _, _ = point_at(path, path.length)
    return SimulatedDevice(protocol.assumptions.applied_to(device), (float(x), float(y)))


def trial_of(
    protocol: Protocol, person: Person, operator: int, planned: PlannedTrial, device: SimulatedDevice, preset: Preset
) -> SimulatedTrial:
    """A trial of the operator of this number (1..), on a device as it is.

    As in a study: the same noise for every controller, device and rule set.
    """
    noise = normals(protocol.seed, operator, planned.path, planned.repetition)
    path = protocol.paths[planned.path]
    return SimulatedTrial(device, planned, Conditions(path, preset, protocol.rules, protocol.trial), person, noise)


def study_trials(
    protocol: Protocol, population: Population, operators: int, metrics: Sequence[Metric] | None = None
) -> Iterator[tuple[TrialRow, int]]:
    """Every trial of a study, in its order, and its ticks; the same numbers as `phd study` writes into its table.

    metrics: None: all, and those of the protocol's own file.
    """
    for operator in range(1, operators + 1):
        yield from operator_trials(protocol, population, operator, metrics)


def study_in_processes(
    protocol: Protocol, population: Population, operators: int, processes: int
) -> Iterator[list[TrialRow]]:
    """The rows of `study_trials`, operator by operator, simulated in so many processes (-1: one a core)."""
    most = min(cores() if processes == -1 else processes, operators)
    rows = partial(operator_rows, protocol, population)
    if most <= 1:
        yield from map(rows, range(1, operators + 1))
        return
    with process_pool(most) as pool:
        yield from pool.map(rows, range(1, operators + 1))


def operator_rows(protocol: Protocol, population: Population, operator: int) -> list[TrialRow]:
    """The rows of the operator of this number (1..)."""
    return [row for row, _ in operator_trials(protocol, population, operator)]


def operator_trials(
    protocol: Protocol, population: Population, operator: int, metrics: Sequence[Metric] | None = None
) -> Iterator[tuple[TrialRow, int]]:
    """Those of the operator of this number (1..)."""
    metrics = (*METRICS, *own_metrics(protocol)) if metrics is None else metrics
    label = f"{operator:02d}"
    person = person_of(population, protocol.seed, participant_index(label))
    devices = {device.name: switched_on(device, protocol) for device in protocol.devices}
    for planned in make_plan(protocol, label, coded=False):
        preset = protocol.controllers[int(planned.controller)]
        device = devices[planned.configuration]
        trial = trial_of(protocol, person, operator, planned, device, preset)
        row, ticks = run_measured(trial, label, metrics)
        yield replace(row, controller_name=preset.name), ticks


def run_measured(trial: Trial, label: str, metrics: Sequence[Metric] = METRICS) -> tuple[TrialRow, int]:
    """Run a trial to its end and measure it: its row, with these measures alone, and its ticks."""
    rows = run_trial(trial)
    outcome = trial.outcome()
    about = {steering.KEY: steering.to_metadata(trial.device), "preset": {"kind": trial.preset.kind}}
    recording = recording_of(rows, trial.device.braked, decisions=trial.preset.decisions, metadata=about)
    measures, failed = measure(recording, trial.path, metrics)
    row = TrialRow(label, *trial.planned, outcome["status"], measures=measures | ledger_of(outcome), failed=failed)
    return row, len(rows)


def run_trial(trial: Trial) -> np.ndarray:
    """Every tick of a trial (n, tick_log.WIDTH); to be used before the next trial, which takes the same room.

    InputError if the file of its controller failed.
    """
    blocks = [_BLOCK[: trial.run(_BLOCK)]]
    while not trial.finished:
        block = np.empty((BLOCK_TICKS, tick_log.WIDTH))
        blocks.append(block[: trial.run(block)])
    trial.refuse_failed_controller()
    return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)


# ------------------------------------------------------------------------------------------------------- error bars


def errors_in(folder: Path) -> list[Moved]:
    """`simulation_errors` of the first simulated operator in a data folder; none without one.

    InputError: the session cannot be read.
    """
    for session in sessions_in(folder).folders:
        stored = read_stored(session)
        if person := stored_person(session, stored):
            return simulation_errors(stored.protocol, person, stored.participant)
    return []


def simulation_errors(protocol: Protocol, person: Person, label: str) -> list[Moved]:
    """How far the measures move when a study's trials are simulated otherwise (`STEP`, `HAND`, `BRAKES`).

    Each trial of one operator's first block is run again from the same start, with the same operator and noise. The
    controller decides at 1 kHz as before: that is the device's, and no error of the simulation. Every controller,
    change and measure, in order; label: of the participant that the person is.
    """
    devices = {device.name: switched_on(device, protocol) for device in protocol.devices}

    def measured(planned: PlannedTrial, person: Person, device: SimulatedDevice, substeps: int = 1) -> TrialRow:
        preset = protocol.controllers[int(planned.controller)]
        trial = trial_of(protocol, person, participant_index(label), planned, device, preset)
        trial.refine(substeps)
        return run_measured(trial, label)[0]

    found: dict[tuple[int, str, str], list[tuple[float, float]]] = {}
    for planned in make_plan(protocol, label, coded=False):
        if planned.block != 1:
            continue
        device = devices[planned.configuration]
        start, tip = device.recorded_start(), device.tip
        before = measured(planned, person, device)
        for change in (STEP, HAND, BRAKES):
            again = SimulatedDevice(device.device, tip, fidelity="static" if change == BRAKES else "mr")
            start_again(again, start)
            someone = person._replace(bias_m=person.bias_m + ASIDE_M) if change == HAND else person
            after = measured(planned, someone, again, SUBSTEPS if change == STEP else 1)
            for name in BY_NAME:
                value, was = after.value(name), before.value(name)
                if value is not None and was is not None:
                    moved = found.setdefault((int(planned.controller), change, name), [])
                    moved.append((abs(value - was), abs(was)))
    return [_moved(*cell, found[cell]) for cell in sorted(found, key=lambda cell: cell[0])]


def _moved(controller: int, change: str, measure: str, by: list[tuple[float, float]]) -> Moved:
    moved, was = np.transpose(by)
    shares = moved[was > 0.0] / was[was > 0.0]
    worst_share = float(shares.max()) if len(shares) else None
    return Moved(controller, change, measure, len(by), float(np.median(moved)), float(moved.max()), worst_share)


# ----------------------------------------------------------------------------- the low gain by the rule "no vibration"


def with_low_gain_found(protocol: Protocol, population: Population) -> Protocol:
    """The protocol with the number for a low gain that is given by the paper's rule, "no detectable vibration": the
    largest such gain, found on simulated trials; else as it is.

    Vibration is what control adds to the handle's acceleration between 20 and 100 Hz, beside the same trial without
    control. It counts as detected where it exceeds 0.1 m/s2 (rms over the movement) in any trial. Both are assumed: the
    paper states neither a band nor a threshold, and has the gain chosen by feel. Trials are the first of three people
    on every path and device, under the assumptions of the study; the same seed finds the same gain.
    """
    if not protocol.low_gain_unknown:
        return protocol
    about = protocol_to_json(protocol)
    found = {"low_gain_found": largest_without_vibration(protocol, population)}
    return protocol_from_json({**about, "overrides": about["overrides"] | found}, protocol.name)


def largest_without_vibration(protocol: Protocol, population: Population) -> float:
    """The largest gain (N s/m) of `GAINS` at which no trial vibrates. InputError where the least one does.

    By bisection: with the gain the vibration rises.
    """
    number = protocol.low_gain_controller
    assert number is not None  # else `low_gain_unknown` is False
    squares = partial(vibrations, protocol, population)
    without = squares(make_preset("without", "none", {}))

    def vibrates(gain: float) -> bool:
        added = squares(protocol.controllers[number].replaced(gain_N_s_m=gain)) - without
        return bool((added > DETECTED_M_S2**2).any())

    if vibrates(GAINS[0]):
        raise InputError(f"low gain {NO_VIBRATION!r}: vibration is detected even at {GAINS[0]:g} N s/m")
    low, high = 0, len(GAINS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if vibrates(GAINS[middle]) else (middle, high)
    return GAINS[low]


def vibrations(protocol: Protocol, population: Population, preset: Preset) -> np.ndarray:
    """Mean square of the acceleration (m2/s4) in the band during the movement, of each trial."""
    band = scipy.signal.butter(2, BAND_HZ, "band", fs=1.0 / TICK_S, output="sos")
    found = []
    for operator in range(1, PEOPLE + 1):
        person = person_of(population, protocol.seed, operator)
        for device in protocol.devices:
            for path in protocol.paths:
                planned = PlannedTrial(1, 1, device.name, 1, path, 1)
                trial = trial_of(protocol, person, operator, planned, switched_on(device, protocol), preset)
                rows = run_trial(trial)
                moving = rows[:, tick_log.PHASE] == tick_log.MOVE
                acceleration = rows[:, tick_log.TIP_AX : tick_log.TIP_AY + 1]
                filtered = scipy.signal.sosfiltfilt(band, acceleration, axis=0)[moving]
                found.append(float(np.mean(np.sum(filtered**2, axis=1))) if moving.any() else math.nan)
    return np.array(found)
