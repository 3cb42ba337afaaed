"""`phd replay`: the hand of a recorded trial once more, through its own or another controller or device.

Which controller, device and hand that is, what came of it, metric by metric, and the replayed ticks as a file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv as pa_csv

from core import tick_log
from core.control.controllers import DECISIONS, Preset
from core.device import Device, load_device
from core.files import InputError
from core.path import Path as PathAhead
from core.workspace import tip_is_free
from experiments.analysis.metrics import along_path, trial_metrics
from experiments.protocol import Protocol, check_reach, load_protocol
from experiments.recording.atomic_files import refuse_existing_files, write_new_file
from experiments.recording.schema import TEXT_COLUMNS, Recording, column_words, recording_columns, recording_of
from experiments.session.files import STORED
from experiments.study.decisions import Checked, check_decisions
from experiments.study.replay_hand import (
    HANDS,
    WITH_TARGET,
    RecordedHand,
    force_hand,
    has_arm,
    has_start,
    recorded_arm,
    target_hand,
)
from experiments.study.replay_run import Recorded, read_recorded, run_replay
from experiments.trial.inputs import OPERATOR
from experiments.trial.operator import Person

A_PERSON_WOULD_REACT = (
    "A person would feel the difference and react: this is what the recorded hand would have come to, not what a "
    "person would have done."
)
OTHER_VERSION = (
    "another version recorded the trial, without all that an equal replay needs: it begins with the movement and comes "
    "near the recorded motion, mostly to rounding"
)


def replay(
    file: str | Path,
    controller: int | None = None,
    device: str | None = None,
    protocol: str | None = None,
    hand: str | None = None,
    out: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Replay a recording; the summary. None: as recorded; for `hand`, the target where there is one, else the force.

    controller: its number in the session's protocol, or in `protocol` (a name or a file), whose rules it then follows.
    out: a new CSV file for the replayed ticks. InputError, and nothing written, for what cannot be replayed.
    """
    trial = read_recorded(Path(file))
    chosen, number = _choose_controller(trial, controller, protocol)
    own = trial.stored.protocol.device(trial.row.configuration)
    onto = own if device is None else _choose_device(trial, device)
    kind, moved = _choose_hand(trial, hand)
    if out is not None:
        refuse_existing_files([out])
    same_device = (onto.text, onto.brake_texts) == (own.text, own.brake_texts)
    lead = recorded_arm(trial.recording, 0) if same_device and has_start(trial.recording) else None
    preset = chosen.controllers[number]
    rows, outcome = run_replay(trial, moved, onto, preset, chosen.rules, lead, progress)
    itself = kind == "target" and same_device and is_own(trial, preset, chosen.rules)
    doubts = outcome.pop("warnings")
    difference = first_difference(trial.recording, rows) if lead and itself else None
    checked = decisions_of(trial, own)
    rows = rows[trial.first :] if lead else rows
    replayed = as_recording(trial, rows, onto)
    if out is not None:
        _write(replayed, trial.first, out)
    return {
        "recording": str(file),
        "participant": trial.row.participant,
        "run": trial.row.run,
        "hand": kind,
        "before": {
            "device": trial.row.configuration,
            "controller": _named(trial.stored.protocol, trial.row.controller),
            "status": trial.row.status,
            "way_made": way_made(trial.recording, trial.path),
            "energy_residual_J": trial.row.energy_residual_J,
            "energy_added_max_J": trial.row.energy_added_max_J,
        },
        "after": {"device": onto.name, "controller": _named(chosen, number)}
        | {"way_made": way_made(replayed, trial.path)}
        | outcome,
        "metrics": compared(trial, replayed),
        "begins": "start" if lead else "move",
        "equal": None if difference is None else not difference,
        "decisions": checked._asdict() if checked else None,
        "largest_tip_difference_m": tip_difference(trial, rows),
        "ticks": len(rows),
        "note": chosen.note(),
        "assumed": onto.assumed,
        "says": A_PERSON_WOULD_REACT,
        "warnings": [
            *(f"the recording: {doubt}" for doubt in trial.recording.outcome.get("warnings", ())),
            *(f"the replay: {doubt}" for doubt in doubts),
            *warnings(trial, bool(lead) or not same_device, difference, checked),
        ],
        "out": None if out is None else str(out),
    }


def _choose_controller(trial: Recorded, controller: int | None, protocol: str | None) -> tuple[Protocol, int]:
    """The protocol that has the controller, and its number there."""
    if protocol is not None and controller is None:
        raise InputError(f"{protocol}: the protocol is where a controller is looked up, say which")
    chosen = trial.stored.protocol if protocol is None else load_protocol(protocol)
    number = trial.row.controller if controller is None else controller
    if isinstance(number, str):
        raise InputError(f"{trial.recording.path}: its session is blind, say through which controller")
    if number not in chosen.controllers:
        there = ", ".join(f"{number} {preset.name}" for number, preset in chosen.controllers.items())
        raise InputError(f"controller {number}: the {chosen.name} protocol has none of this number ({there})")
    return chosen, number


def _choose_device(trial: Recorded, device: str | None) -> Device:
    """The device, which can follow the path and can be where the recorded movement begins."""
    protocol, segment = trial.stored.protocol, trial.row.segment
    if device is None:
        return protocol.device(trial.row.configuration)
    onto = load_device(device)
    paths = {segment: protocol.paths[segment]}
    check_reach([(f"device {device}", onto)], paths, f"the {protocol.name} protocol")
    x, y = trial.start
    if not tip_is_free(onto.mechanism, x, y):
        raise InputError(f"device {device}: cannot be at ({x:.3f}, {y:.3f}) m, where the recorded movement begins")
    return onto


def _choose_hand(trial: Recorded, hand: str | None) -> tuple[str, RecordedHand]:
    """Which of `HANDS` it is, and that hand."""
    about = trial.recording.metadata
    whole_arm = has_arm(trial.recording)
    has_target = whole_arm or about.get("hand") in WITH_TARGET
    kind = hand or ("target" if has_target else "force")
    if kind not in HANDS:
        raise InputError(f"hand: {kind!r} is not one of {', '.join(HANDS)}")
    if kind == "force":
        return kind, force_hand(trial.recording, trial.first)
    if not has_target:
        raise InputError(f"{trial.recording.path}: the hand ({about.get('hand')!r}) has no target, replay its force")
    if whole_arm:
        return kind, recorded_arm(trial.recording, trial.first)
    stored = trial.stored
    try:
        person = Person(**stored.about["person"]) if about["hand"] == OPERATOR else None
    except (KeyError, TypeError) as error:
        raise InputError(f"{trial.recording.path}: {STORED} of its session: person: {error}") from None
    return kind, target_hand(trial.recording, trial.first, trial.path, person, stored.protocol.mouse)


def is_own(trial: Recorded, preset: Preset, rules: str) -> bool:
    """Whether this is what the trial was run with; a blind session does not say."""
    number, protocol = trial.row.controller, trial.stored.protocol
    return not isinstance(number, str) and (preset, rules) == (protocol.controllers[number], protocol.rules)


def decisions_of(trial: Recorded, own: Device) -> Checked | None:
    """The recorded decisions, each taken again; None: the session is blind, or an earlier version recorded it."""
    number, protocol = trial.row.controller, trial.stored.protocol
    if isinstance(number, str):
        return None
    return check_decisions(trial.recording, trial.path, own, protocol.controllers[number], protocol.rules)


def first_difference(recording: Recording, rows: np.ndarray) -> str:
    """Where all ticks (n, tick_log.WIDTH), replayed, differ from the recorded ones; "": nowhere, bit for bit."""
    words = column_words(DECISIONS)
    first, where = len(rows), ""
    for name, place in recording_columns(recording.braked):
        if name == "lateness_us":  # of the machine, not of the trial
            continue
        then = recording.column(name)[: len(rows)]
        if name in TEXT_COLUMNS:
            then = np.array([words[name].index(word) for word in recording.words[name]])[then]
        differs = np.flatnonzero(then != rows[:, place])
        if len(differs) and differs[0] < first:
            first, where = int(differs[0]), f"tick {differs[0]}, {name}"
    return where or ("" if len(rows) == recording.rows else f"tick {len(rows)}, after which the replay ends")


def warnings(trial: Recorded, exact: bool, difference: str | None, checked: Checked | None) -> list[str]:
    """Why the replay is not the recorded trial though it might be, and what is wrong with the recording.

    exact: it is no replay on the recorded device that had to do without the recorded start.
    """
    said = []
    if not exact and not trial.recording.sensors:
        said.append(OTHER_VERSION)
    if difference:
        said.append(
            f"the replay differs from the recording, first in {difference}: another version of the program or "
            "another kind of machine recorded it"
        )
    if checked and checked.different:
        said.append(
            f"{checked.different} of {checked.decisions} recorded decisions are not what the controller decides on "
            "what it was given"
        )
    return said


def as_recording(trial: Recorded, rows: np.ndarray, device: Device) -> Recording:
    """The replayed ticks as a recording of this device, behind the recorded tip until then (filters need a lead)."""
    ticks = np.zeros((trial.first, tick_log.WIDTH))
    for name, place in recording_columns(""):
        if name not in TEXT_COLUMNS and name in trial.recording.columns:
            ticks[:, place] = trial.recording.column(name)[: trial.first]
    ticks = np.concatenate((ticks, rows))
    ticks[:, tick_log.T] = trial.recording.column("t_s")[: len(ticks)]
    return recording_of(ticks, device.braked, trial.recording.path)


def compared(trial: Recorded, replayed: Recording) -> dict[str, dict[str, float | None]]:
    """Each metric before and after, and its change; None where there is nothing, or a blind session hides it."""
    found = {}
    for name, after in trial_metrics(replayed, trial.path)._asdict().items():
        before = getattr(trial.row, name)
        change = None if before is None or after is None else after - before
        found[name] = {"before": before, "after": after, "change": change}
    return found


def way_made(recording: Recording, path: PathAhead) -> float:
    """The share of the path (0 to 1) that `move` came along: where it is short, the metrics are of that part."""
    move = recording.in_phase("move")
    progress, _ = along_path(np.column_stack([recording.column(name)[move] for name in ("tip_x_m", "tip_y_m")]), path)
    return float(progress[-1] / path.length)


def tip_difference(trial: Recorded, rows: np.ndarray) -> float:
    """The largest distance (m) between the recorded and the replayed tip, tick by tick, while both are in `move`."""
    last = trial.first + len(rows)
    both = trial.recording.in_phase("move")[trial.first : last] & (rows[:, tick_log.PHASE] == tick_log.MOVE)
    dx, dy = (
        rows[:, place] - trial.recording.column(name)[trial.first : last]
        for name, place in (("tip_x_m", tick_log.TIP_X), ("tip_y_m", tick_log.TIP_Y))
    )
    return float(np.max(np.hypot(dx, dy)[both], initial=0.0))


def _named(protocol: Protocol, controller: int | str) -> str:
    name = protocol.controller_name(controller)
    return name if isinstance(controller, str) else f"{controller} {name}"


def _write(replayed: Recording, first: int, out: Path) -> None:
    """The replayed ticks as a new CSV file, whole or not at all."""
    arrays = [
        pa.array(replayed.text(name)[first:].tolist(), pa.string())
        if name in TEXT_COLUMNS
        else pa.array(replayed.columns[name][first:] + 0.0)  # no "-0"
        for name in replayed.columns
    ]
    sink = pa.BufferOutputStream()
    header = ",".join(replayed.columns) + "\n"
    sink.write(header.encode())
    table = pa.table(arrays, names=list(replayed.columns))
    pa_csv.write_csv(table, sink, pa_csv.WriteOptions(include_header=False, quoting_style="needed"))
    write_new_file(out, sink.getvalue().to_pybytes())
