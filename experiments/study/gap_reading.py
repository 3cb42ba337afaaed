"""A study's trials with SDOF with gap again, without recordings, with the gap of Table I read the other way."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from core.control.controllers import Preset
from core.simulator.simulated_device import SimulatedDevice, start_again
from experiments.analysis.findings import why_no_findings
from experiments.analysis.gap_reading import GAP, GapReadOtherwise
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.plan import make_plan, participant_index
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.store.files import sessions_in
from experiments.store.stored import read_stored, stored_person
from experiments.study.unrecorded import run_measured, run_trial, switched_on, trial_of
from experiments.trial.operator import Person

OTHER = {"half": "full", "full": "half"}


def gap_otherwise_in(folder: Path) -> GapReadOtherwise | None:
    """`gap_read_otherwise` of the sessions in a data folder; None where a person took part, or protocols differ.

    InputError: a session cannot be read.
    """
    people: dict[str, Person] = {}
    protocols: list[Protocol] = []
    for session in sessions_in(folder).folders:
        stored = read_stored(session)
        person = stored_person(session, stored)
        if person is None:
            return None
        people[stored.participant] = person
        protocols.append(stored.protocol)
    alike = {(protocol.text, str(protocol.overrides)) for protocol in protocols}
    return gap_read_otherwise(protocols[0], people) if len(alike) == 1 else None


def gap_read_otherwise(protocol: Protocol, people: Mapping[str, Person]) -> GapReadOtherwise | None:
    """The trials with SDOF with gap of these people (by label), its gap read the other way.

    None: the controllers are not those of Table I, or its gap is not tried.
    """
    if why_no_findings(protocol.controllers) or GAP not in protocol.controllers:
        return None
    reading = protocol.assumptions.gap_reading
    preset = with_gap_read_as(OTHER[reading], protocol).controllers[GAP]
    rows = [row for label, person in people.items() for row in _trials(protocol, person, label, preset)]
    gap_m, other_gap_m = (one.value("gap_m") for one in (protocol.controllers[GAP], preset))
    return GapReadOtherwise(reading, gap_m, other_gap_m, as_table(rows))


def _trials(protocol: Protocol, person: Person, label: str, preset: Preset) -> Iterator[TrialRow]:
    """A participant's trials with SDOF with gap again, with this gap: each from where it began in the study."""
    number = participant_index(label)
    devices = {device.name: switched_on(device, protocol) for device in protocol.devices}
    for planned in make_plan(protocol, label, coded=False):
        device = devices[planned.configuration]
        if planned.controller == GAP:
            again = SimulatedDevice(device.device, device.tip)
            start_again(again, device.recorded_start())
            yield run_measured(trial_of(protocol, person, number, planned, again, preset), label, JUDGED)[0]
        run_trial(trial_of(protocol, person, number, planned, device, protocol.controllers[int(planned.controller)]))


def with_gap_read_as(reading: str, protocol: Protocol) -> Protocol:
    """The protocol with the gap as half the width of the band without control ("half"), or all of it ("full")."""
    about = protocol_to_json(protocol)
    assumptions = msgspec.to_builtins(protocol.assumptions) | {"gap_reading": reading}
    return protocol_from_json({**about, "overrides": about["overrides"] | {"assumptions": assumptions}}, protocol.name)
