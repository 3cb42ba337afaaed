"""`phd replay`: the hand of a recorded trial once more, through its own or another controller or device.

The summary names controller, device and hand and compares each metric; the replayed ticks can be written to a file.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv as pa_csv

from core import tick_log
from core.control.controllers import Preset, make_controller
from core.control.guard import make_around
from core.control.velocity_field import new_memory
from core.device import Device, load_device
from core.device_interface import velocity_noise
from core.files import InputError
from core.mechanism import JOINTS
from core.path import Path as PathAhead
from core.path import build_path
from core.simulator.simulation import EVENT
from core.simulator.state import MR, Model, new_body, pack_brakes, pack_mechanism
from core.workspace import tip_is_free
from experiments.analysis import steering
from experiments.analysis.metrics import METRICS, trial_metrics
from experiments.analysis.movement import along_path
from experiments.analysis.own_measures import recorded_metrics
from experiments.assumptions import DEFAULTS
from experiments.atomic_files import refuse_existing_files, write_new_file
from experiments.numbers import percent
from experiments.progress import Progress, no_progress
from experiments.protocol import Protocol, check_reach, middle_of
from experiments.recording import TEXT_COLUMNS, Recording, column_words, recording_columns, recording_of
from experiments.store.cells import name_among
from experiments.store.files import rows_of
from experiments.study.replay_motion import Recorded, has_start, read_recorded, recorded_hand, run_replay
from experiments.trial.decisions import Decisions, decide_again
from experiments.trial.encoder_sensing import AS_ON_THE_BENCH, decision_noise, new_sensing, sensed
from experiments.trial.trial import Conditions

A_PERSON_WOULD_REACT = "A person would feel the difference and react: this is the recorded hand alone."
ROUNDING_M = 1e-9
OTHER_VERSION = (
    "another version recorded the trial, without all that an equal replay needs: it begins with the movement and only "
    "comes near the recorded motion"
)
#: What a decision is taken from, in the order in which `decide_again` reads it.
GIVEN = ("tip_x_m", "tip_y_m", "tip_vx_m_s", "tip_vy_m_s", "sensed_fx_N", "sensed_fy_N")
WANTED = ("wanted_fx_N", "wanted_fy_N")  # n/a in the recordings of earlier versions, which had no force to show


class Checked(NamedTuple):
    """How many recorded decisions the controller takes again from the recording, and how many differ."""

    decisions: int  # that were taken again
    different: int  # of them, by the decision or by any current


class Replacement(NamedTuple):
    """The controller or device that replaces the recorded one; None: it stays."""

    controller: int | str | None = None  # its name, or its number in the session's protocol
    device: str | None = None  # a name or a file


AS_RECORDED = Replacement()


def replay(
    file: str | Path, other: Replacement = AS_RECORDED, out: Path | None = None, progress: Progress = no_progress
) -> dict[str, Any]:
    """Replay a recording; the summary.

    out: a new CSV file for the replayed ticks. InputError, and nothing written, for what cannot be replayed.
    """
    trial = read_recorded(Path(file))
    protocol, row = trial.stored.protocol, trial.row
    number, device = choose_controller(trial, other.controller), choose_device(trial, other.device)
    preset, own = protocol.controllers[number], protocol.device(row.configuration)
    if out is not None:
        refuse_existing_files([out])
    is_own_device = (device.text, device.brake_texts) == (own.text, own.brake_texts)
    from_start = is_own_device and has_start(trial.recording)
    hand = recorded_hand(trial.recording, trial.first)
    conditions = Conditions(trial.path_file, preset, protocol.rules, protocol.trial)
    rows, outcome = run_replay(trial, hand, device, conditions, from_start, progress)
    difference = checked = None
    if not isinstance(row.controller, str):  # a blind session does not say which controller it was
        recorded = conditions._replace(preset=protocol.controllers[row.controller])
        checked = check_decisions(trial.recording, own, recorded)
        if from_start and conditions == recorded:
            difference = first_difference(trial.recording, rows, preset)
    rows = rows[trial.first :] if from_start else rows
    replayed = as_recording(trial, rows, device, preset)
    ways = way_made(trial.recording, trial.path), way_made(replayed, trial.path)
    common = None if (row.status, outcome["status"]) == ("done", "done") else min(ways)
    metrics, failed = compare_metrics(trial, replayed, common)
    if out is not None:
        write_ticks(replayed, trial.first, out)
    ledger = ("energy_residual_J", "energy_added_max_J")
    return {
        "recording": str(file),
        "participant": row.participant,
        "run": row.run,
        "trial": name_among(row, rows_of(Path(file).resolve().parent.parent)),
        "hand": hand.kind,
        "before": {
            "device": row.configuration,
            "controller": controller_words(protocol, row.controller),
            "status": row.status,
            "way_made": ways[0],
            **{name: row.value(name) for name in ledger},
        },
        "after": {
            "device": device.name,
            "controller": controller_words(protocol, number),
            "way_made": ways[1],
            **{key: outcome[key] for key in ("status", *ledger)},
        },
        "compared_way": common,
        "metrics": metrics,
        "begins": "start" if from_start else "move",
        "equal": None if difference is None else not difference,
        "decisions": checked._asdict() if checked else None,
        "largest_tip_difference_m": tip_difference(trial, rows),
        "ticks": len(rows),
        "note": protocol.note(),
        "assumed": device.assumed,
        "says": A_PERSON_WOULD_REACT,
        "warnings": [
            *(f"the recording: {doubt}" for doubt in trial.recording.outcome.get("warnings", ())),
            *(f"the replay: {doubt}" for doubt in outcome["warnings"]),
            *short_ways(common, ways, outcome["status"]),
            *failed,
            *warnings(is_own_device and not from_start and not trial.recording.sensors, difference, checked),
        ],
        "out": None if out is None else str(out),
    }


def choose_controller(trial: Recorded, controller: int | str | None) -> int:
    """The number of a controller of the session's protocol; None: the recorded one. InputError: there is none."""
    if controller is not None:
        return trial.stored.protocol.number_of(controller)
    if isinstance(trial.row.controller, str):
        raise InputError(f"{trial.recording.path}: its session is blind, say through which controller")
    return trial.stored.protocol.number_of(trial.row.controller)


def choose_device(trial: Recorded, device: str | None) -> Device:
    """A device, shipped or from a file, that can follow the path and be where the recorded movement begins.

    None: the recorded one.
    """
    protocol, path = trial.stored.protocol, trial.row.path
    if device is None:
        return protocol.device(trial.row.configuration)
    onto = load_device(device)
    paths = {path: protocol.paths[path]}
    check_reach([(f"device {device}", onto)], paths, f"the {protocol.name} protocol")
    x, y = (float(trial.recording.column(name)[trial.first]) for name in ("tip_x_m", "tip_y_m"))
    if not tip_is_free(onto.mechanism, x, y):
        raise InputError(f"device {device}: cannot be at ({x:.3f}, {y:.3f}) m, where the recorded movement begins")
    return onto


def first_difference(recording: Recording, rows: np.ndarray, preset: Preset) -> str:
    """Where all ticks (n, tick_log.WIDTH), replayed, differ from the recorded ones; "": nowhere, bit for bit."""
    words = column_words(preset.decisions)
    first, where = len(rows), ""
    for name, place in recording_columns(recording.braked):
        if name == "lateness_us" or name not in recording.columns:  # of the machine; of a later version
            continue
        then = recording.column(name)[: len(rows)]
        if name in TEXT_COLUMNS:
            then = np.array([words[name].index(word) for word in recording.words[name]])[then]
        differs = np.flatnonzero((then != rows[:, place]) & ~(np.isnan(then) & np.isnan(rows[:, place])))
        if len(differs) and differs[0] < first:
            first, where = int(differs[0]), f"tick {differs[0]}, {name}"
    return where or ("" if len(rows) == recording.rows else f"tick {len(rows)}, after which the replay ends")


def warnings(without_start: bool, difference: str | None, checked: Checked | None) -> list[str]:
    """Why the replay differs from the recorded trial, and decisions of the recording that are not reproduced."""
    found = [OTHER_VERSION] if without_start else []
    if difference:
        found.append(
            f"the replay differs from the recording, first in {difference}: another version of the program or "
            "another kind of machine recorded it"
        )
    if checked and checked.different:
        found.append(
            f"{checked.different} of {checked.decisions} recorded decisions are not what the controller decides "
            "from the recorded motion and force"
        )
    return found


def as_recording(trial: Recorded, rows: np.ndarray, device: Device, preset: Preset) -> Recording:
    """The replayed ticks as a recording of this device, behind the recorded tip until then (filters need a lead)."""
    ticks = np.zeros((trial.first, tick_log.WIDTH))
    for name, place in recording_columns(""):
        if name not in TEXT_COLUMNS and name in trial.recording.columns:
            ticks[:, place] = trial.recording.column(name)[: trial.first]
    ticks = np.concatenate((ticks, rows))
    ticks[:, tick_log.T] = trial.recording.column("t_s")[: len(ticks)]
    steered = steering.to_metadata(trial.stored.protocol.assumptions.applied_to(device))
    about = {steering.KEY: steered, "preset": {"kind": preset.kind}}
    return recording_of(ticks, device.braked, trial.recording.path, preset.decisions, about)


def short_ways(common: float | None, ways: tuple[float, float], status: str) -> list[str]:
    """A warning where replay and recording made different shares of the way: measures cover the part that both made."""
    if common is None or ways[0] == ways[1]:
        return []
    short = f"the replay ({status})" if ways[1] < ways[0] else "the recorded trial"
    return [f"{short} made {percent(common, 1)} of the way: both are measured from the start to there, and no further"]


def compare_metrics(
    trial: Recorded, replayed: Recording, common: float | None
) -> tuple[dict[str, dict[str, float | None]], list[str]]:
    """Each metric before and after, and its change; None where there is nothing, or a blind session hides it.

    common: the share of the path over which they are taken; None: all of it. A metric that neither has is left out.
    Besides, why measures of a file of one's own gave no number.
    """
    then, failed = trial.recording, dict(trial.row.failed)
    hidden = isinstance(trial.row.controller, str) or "measure" in failed
    metrics = METRICS if hidden else (*METRICS, *recorded_metrics(then.metadata))
    if common is not None:
        then, replayed = (until(recording, trial.path, common) for recording in (then, replayed))
    befores, found = trial_metrics(then, trial.path, metrics, failed), {}
    for name, after in trial_metrics(replayed, trial.path, metrics, failed).items():
        before = trial.row.value(name)
        before = before if before is None or common is None else befores[name]
        if before is not None or after is not None:
            change = None if before is None or after is None else after - before
            found[name] = {"before": before, "after": after, "change": change}
    return found, list(dict.fromkeys(failed.values()))


def until(recording: Recording, path: PathAhead, way: float) -> Recording:
    """The recording as if `move` had ended where it had made this share of the path first; as it is if it made less."""
    move = np.flatnonzero(recording.in_phase("move"))
    progress = progress_of(recording, path)
    if progress[-1] <= way * path.length + ROUNDING_M:
        return recording
    phase = recording.column("phase").copy()
    phase[move[np.argmax(progress >= way * path.length) + 1 :]] = recording.words["phase"].index("end")
    return replace(recording, columns={**recording.columns, "phase": phase})


def progress_of(recording: Recording, path: PathAhead) -> np.ndarray:
    """The furthest way along the path (n,), m, at each tick of `move`."""
    move = recording.in_phase("move")
    tip = np.column_stack([recording.column(name)[move] for name in ("tip_x_m", "tip_y_m")])
    return along_path(tip, path)[0]


def way_made(recording: Recording, path: PathAhead) -> float:
    """The share of the path (0 to 1) that `move` came along."""
    return float(progress_of(recording, path)[-1] / path.length)


def tip_difference(trial: Recorded, rows: np.ndarray) -> float:
    """The largest distance (m) between the recorded and the replayed tip, tick by tick, while both are in `move`."""
    ticks = slice(trial.first, trial.first + len(rows))
    both = trial.recording.in_phase("move")[ticks] & (rows[:, tick_log.PHASE] == tick_log.MOVE)
    dx = rows[:, tick_log.TIP_X] - trial.recording.column("tip_x_m")[ticks]
    dy = rows[:, tick_log.TIP_Y] - trial.recording.column("tip_y_m")[ticks]
    return float(np.max(np.hypot(dx, dy)[both], initial=0.0))


def controller_words(protocol: Protocol, controller: int | str) -> str:
    """A controller as a summary names it: number and name, or its code in a blind session."""
    name = protocol.controller_name(controller)
    return name if isinstance(controller, str) else f"{controller} {name}"


def write_ticks(replayed: Recording, first: int, out: Path) -> None:
    """The replayed ticks as a new CSV file, whole or not at all."""
    columns = {
        name: replayed.text(name)[first:].tolist() if name in TEXT_COLUMNS else column[first:] + 0.0  # no "-0"
        for name, column in replayed.columns.items()
    }
    sink = pa.BufferOutputStream()
    pa_csv.write_csv(pa.table(columns), sink, pa_csv.WriteOptions(quoting_style="needed", quoting_header="none"))
    write_new_file(out, sink.getvalue().to_pybytes())


def check_decisions(recording: Recording, device: Device, conditions: Conditions) -> Checked | None:
    """Take each decision of the movement again, from the recording and the session's device and conditions alone.

    The controller is given what it was given then: tip, velocity and sensed force of each tick; or what the encoders of
    a simulated device made of the tip's motion until then. Nothing is simulated. None: an earlier version recorded the
    trial, without the sensed force. What is assumed is of a simulated device; a real one is as its file has it.
    """
    if not all(name in recording.columns for name in GIVEN):
        return None
    taken = recording.in_phase("move")
    if recording.sensors:
        taken &= recording.column("decided") == 1.0
    without = np.full(recording.rows, np.nan)
    wanted = [recording.columns.get(name, without) for name in WANTED]
    given = np.column_stack((*map(recording.column, GIVEN), *wanted))
    path, assumed = build_path(conditions.path, f"{recording.path}: path"), conditions.trial_rules.assumptions
    middle = middle_of(path)
    if recording.sensors:
        noise, sensing, assumed = velocity_noise(device, middle), new_sensing(device, DEFAULTS), AS_ON_THE_BENCH
    else:
        device = assumed.applied_to(device)
        noise, sensing = decision_noise(device, middle, assumed), new_sensing(device, assumed)
    controller = make_controller(
        conditions.preset, device.force_normalised_N, conditions.rules, velocity_noise=noise,
        around=make_around(conditions.trial_rules.around, device, sensed(device, middle, assumed)),
    )  # fmt: skip
    codes, currents = np.zeros(len(given), dtype=np.int64), np.zeros((len(given), 4))
    model = Model(pack_mechanism(device.mechanism), pack_brakes(device.brakes, backlash=False), MR, EVENT)
    decisions = Decisions(given, taken, new_memory(), codes, currents)
    decide_again(controller, path, model, new_body(0.0, 0.0), sensing, decisions)
    codes, currents = codes[taken], currents[taken]
    words = np.array(conditions.preset.decisions, dtype=object)
    different = words[codes] != recording.text("decision")[taken]
    for joint in device.braked:
        different |= currents[:, JOINTS.index(joint)] != recording.column(f"current_{joint}_A")[taken]
    return Checked(len(codes), int(np.count_nonzero(different)))
