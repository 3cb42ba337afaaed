"""`phd check-controller`: does a controller in a file of its own keep the laws that every controller keeps?

Simulated people move along the paper's paths on shipped devices; every tick is checked.
"""

import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from core import tick_log
from core.control.controllers import Preset, make_preset
from core.files import InputError
from core.mechanism import JOINTS
from core.own_files import OwnFile
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol, load_protocol
from experiments.study.unrecorded import person_of, run_trial, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.real_trial import load_kernels

PEOPLE = 2
ADDED_J = 1e-9  # of rounding; the exact solver's brakes add none


class Law(NamedTuple):
    """One law and how it was kept."""

    law: str
    broken: int  # trials in which it was not kept
    worst: str  # in words


def check_controller(own: OwnFile, given: Mapping[str, float]) -> dict:
    """Run trials with the controller of a file, parameters given by name; the summary. InputError: it cannot be run."""
    load_kernels()
    protocol = load_protocol()
    try:
        preset = make_preset(own.name, f"{own.name}.py", given, own)
    except ValueError as error:
        raise InputError(f"{own.name}.py: {error}") from None
    began = time.perf_counter()
    laws = laws_of(protocol, preset)
    wall_s = time.perf_counter() - began
    sdof = next(preset for preset in protocol.controllers.values() if preset.kind == "sdof")
    return {
        "file": f"{own.name}.py",
        "sha256": own.digest,
        "trials": len(_trials(protocol)),
        "checks": [
            f"{'failed in ' + str(law.broken) if law.broken else 'passed'}: {law.law} ({law.worst})" for law in laws
        ],
        "failed": sum(law.broken > 0 for law in laws),
        "wall_s": wall_s,
        "tick_us": tick_us(protocol, preset),
        "tick_of_sdof_us": tick_us(protocol, sdof),
    }


def laws_of(protocol: Protocol, preset: Preset) -> list[Law]:
    """How a controller keeps `LAWS` on the devices and paths of a protocol."""
    trials = [_checked_numbers(protocol, preset, *trial) for trial in _trials(protocol)]
    return [
        Law(law, sum(values[i] > most for values in trials), f"{max(values[i] for values in trials):.3g}{unit}")
        for i, (law, most, unit) in enumerate(LAWS)
    ]


#: The laws, each with the largest number that keeps it, and the unit of that number.
LAWS = (
    ("no brake adds energy in any step", ADDED_J, " J at most"),
    ("currents lie within 0 and the brake's largest", 0.0, " A outside at most"),
    ("joints without a brake get no current", 0.0, " A at most"),
    ("every number is finite", 0.0, " ticks are not"),
    ("the same motion gives the same decisions", 0.0, " ticks differ"),
    ("nothing of the device is written but currents", 0.0, " of its brakes' numbers are"),
)


def _trials(protocol: Protocol) -> list[tuple[int, str, int]]:
    return [
        (person, device.name, path)
        for person in range(1, PEOPLE + 1)
        for device in protocol.devices
        for path in protocol.paths
    ]


def _rows(protocol: Protocol, preset: Preset, number: int, device: str, path: int) -> np.ndarray:
    planned = PlannedTrial(1, 1, device, 1, path, 1)
    person = person_of(load_population(), protocol.seed, number)
    simulated = switched_on(protocol.device(device), protocol)
    trial = trial_of(protocol, person, number, planned, simulated, preset)
    brakes = simulated.model.brakes.tobytes()
    rows = run_trial(trial).copy()
    written = float(brakes != simulated.model.brakes.tobytes())
    return np.column_stack((rows, np.tile((trial.outcome()["energy_added_max_J"], written), (len(rows), 1))))


def _checked_numbers(protocol: Protocol, preset: Preset, number: int, device: str, path: int) -> tuple[float, ...]:
    """The number that each of `LAWS` limits, in one trial."""
    rows, again = (_rows(protocol, preset, number, device, path) for _ in range(2))
    brakes = protocol.device(device).brakes
    current = rows[:, tick_log.CURRENT : tick_log.CURRENT + len(JOINTS)]
    braked = brakes.present > 0.0
    most = np.where(braked, brakes.current_max, 0.0)
    moving = rows[:, tick_log.T : tick_log.SLAVE_X]
    return (
        float(rows[-1, -2]),
        float(max(np.max(current - most), np.max(-current), 0.0)),
        float(np.max(np.abs(current[:, ~braked]), initial=0.0)),
        float(np.count_nonzero(~np.isfinite(moving[:, : tick_log.TARGET_X]).all(axis=1))),
        float(np.count_nonzero((rows[:, : tick_log.TARGET_X] != again[:, : tick_log.TARGET_X]).any(axis=1)))
        if len(rows) == len(again)
        else float(max(len(rows), len(again))),
        float(rows[-1, -1]),
    )


def tick_us(protocol: Protocol, preset: Preset) -> float:
    """The cost of a simulated tick with this controller, the least of a few trials."""
    device, path = protocol.devices[0].name, next(iter(protocol.paths))
    found = []
    for _ in range(5):
        planned = PlannedTrial(1, 1, device, 1, path, 1)
        trial = trial_of(
            protocol, person_of(load_population(), protocol.seed, 1), 1, planned,
            switched_on(protocol.devices[0], protocol), preset,
        )  # fmt: skip
        began = time.perf_counter()
        ticks = len(run_trial(trial))
        found.append(1e6 * (time.perf_counter() - began) / ticks)
    return min(found)
