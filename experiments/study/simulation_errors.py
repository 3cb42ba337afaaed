"""How far the measures move when a study's trials are simulated otherwise (what each change is: `error_bars.READ`).

Each trial of one operator's first block is run again from the same start, with the same operator and the same noise.
The controller decides at 1 kHz as before: that is the device's, and no error of the simulation.
"""

from pathlib import Path

import numpy as np

from core.simulator.simulated_device import SimulatedDevice, start_again
from experiments.analysis.error_bars import ASIDE_M, HAND, STEP, SUBSTEPS, Moved
from experiments.analysis.metrics import BY_NAME
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial, make_plan, participant_index
from experiments.protocol import Protocol
from experiments.recording.atomic_files import reading_stored
from experiments.session.files import STORED, read_stored
from experiments.study.unrecorded import run_measured, switched_on, trial_of
from experiments.trial.operator import Person

BRAKES = {"static": "brakes without lag and backlash", "mr": "brakes with lag and backlash"}


def errors_in(folder: Path) -> list[Moved]:
    """Those of the first simulated operator in a data folder, none if there is none. InputError: cannot be read."""
    for session in sorted(folder.glob("sub-*/ses-*")):
        stored = read_stored(session)
        with reading_stored(session / STORED):
            about = stored.about["person"]
            person = Person(**about) if about else None
        if person:
            return simulation_errors(stored.protocol, person, str(stored.about["participant"]))
    return []


def simulation_errors(protocol: Protocol, person: Person, label: str) -> list[Moved]:
    """Every controller, change and measure, in order; label: of the participant that the person is."""
    devices = {device.name: switched_on(device, protocol) for device in protocol.devices}
    assumed = protocol.assumptions.simulated_fidelity
    other = "static" if assumed == "mr" else "mr"  # the fidelity that the study does not assume

    def measured(
        planned: PlannedTrial, person: Person, device: SimulatedDevice, substeps: int = 1
    ) -> TrialRow:
        preset = protocol.controllers[int(planned.controller)]
        trial = trial_of(protocol, person, participant_index(label), planned, device, preset)
        trial.refine(substeps)
        return run_measured(trial, label)[0]

    found: dict[tuple[int, str, str], list[tuple[float, float]]] = {}
    for planned in make_plan(protocol, label, coded=False):
        if planned.block != 1:
            continue
        here = devices[planned.configuration]
        start, tip = here.recorded_start(), here.tip
        before = measured(planned, person, here)
        for change in (STEP, HAND, BRAKES[other]):
            again = SimulatedDevice(here.device, tip, fidelity=other if change == BRAKES[other] else assumed)
            start_again(again, start)
            someone = person._replace(bias_m=person.bias_m + ASIDE_M) if change == HAND else person
            after = measured(planned, someone, again, SUBSTEPS if change == STEP else 1)
            for name in BY_NAME:
                value, was = getattr(after, name), getattr(before, name)
                if value is not None and was is not None:
                    moved = found.setdefault((int(planned.controller), change, name), [])
                    moved.append((abs(value - was), abs(was)))
    return [_moved(*cell, found[cell]) for cell in sorted(found, key=lambda cell: cell[0])]


def _moved(controller: int, change: str, measure: str, by: list[tuple[float, float]]) -> Moved:
    moved, was = np.transpose(by)
    shares = moved[was > 0.0] / was[was > 0.0]
    worst_share = float(shares.max()) if len(shares) else None
    return Moved(controller, change, measure, len(by), float(np.median(moved)), float(moved.max()), worst_share)
