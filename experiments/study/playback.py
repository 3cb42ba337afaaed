"""A recorded trial to be shown: its ticks, device, path and row, and its distance from the path."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pyarrow import csv

from core import tick_log
from core.device import Device
from core.files import InputError
from core.mechanism import JOINTS
from core.obstacles import ObstacleFile
from core.path import PathFile, Segment, path_from
from experiments.analysis.colours import colour_places
from experiments.analysis.trials_table import Controller, TrialRow, is_code
from experiments.recording import TEXT_COLUMNS, Recording, recording_columns
from experiments.store.cells import trial_names
from experiments.store.files import rows_of
from experiments.store.journal import EXCLUDED, exclusion_of
from experiments.store.recording import read_recording
from experiments.store.stored import StoredSession, read_stored


@dataclass(frozen=True)
class Playback:
    """One recorded trial."""

    path: Path  # of its recording
    ticks: np.ndarray  # (n, tick_log.WIDTH), n > 0
    error: np.ndarray  # (n,) m, distance from the path; NaN outside the movement
    device: Device
    way: PathFile  # the path to follow
    obstacles: tuple[ObstacleFile, ...]
    row: TrialRow | None  # None: the recording is in no table
    title: str  # "participant 03, trial 27"
    controller: str  # its name, or its code in a blind session
    about: str  # device, path, block
    blind: bool  # what reveals the controller must not be shown
    damaged: bool  # some ticks are missing
    excluded: str  # the reason for which it is in no result; "": it is not excluded
    decisions: tuple[str, ...]  # words of the column
    controllers: dict[Controller, str]  # of its protocol
    colour: int | None  # the place of its controller's colour; None: a code has none

    @property
    def t(self) -> np.ndarray:
        """Time since the first tick (n,), s."""
        return self.ticks[:, tick_log.T] - self.ticks[0, tick_log.T]


def read_playback(path: Path) -> Playback:
    """A trial from its recording and its session. InputError if the recording has no ticks."""
    recording = read_recording(path)
    if not recording.rows:
        raise InputError(f"{path}: there are no ticks to play ({recording.faults or 'it ended before the first'})")
    session = path.resolve().parent.parent
    stored = read_stored(session)
    way = way_of(recording)
    ticks = ticks_of(recording)
    about = recording.metadata
    rows = rows_of(session)
    row = next((row for row in rows if row.recording and session / row.recording == path.resolve()), None)
    planned = f"trial {about.get('run', '?')}" if about.get("block", 1) else "practice"
    trial = planned if row is None else trial_names(rows)[row.participant, row.run]
    controller = about.get("controller", "?") if row is None else row.controller
    controllers: dict[Controller, str] = {number: preset.name for number, preset in stored.protocol.controllers.items()}
    named = about.get("preset", {}).get("name") or f"controller {controller}"
    place = (about.get("configuration"), f"path {about.get('path', '?')}", f"block {about.get('block', '?')}")
    return Playback(
        path=path,
        ticks=ticks,
        error=errors(ticks),
        device=device_of(recording, stored),
        way=way,
        obstacles=stored.protocol.obstacle,
        row=row,
        title=f"participant {about.get('participant', '?')}, {trial}",
        controller=str(controller) if is_code(str(controller)) else controllers.get(controller, named),
        about=" · ".join(str(part) for part in place if part),
        blind=is_code(str(controller)),
        damaged=not recording.whole,
        excluded=exclusion_of(session, row.run) if row is not None and row.status == EXCLUDED.name else "",
        decisions=recording.words["decision"],
        controllers=controllers,
        colour=colour_places(stored.protocol.controllers).get(controller),
    )


def ticks_of(recording: Recording) -> np.ndarray:
    """The tick log (n, tick_log.WIDTH) of a recording; text columns with the codes of this program."""
    rows = np.zeros((recording.rows, tick_log.WIDTH))
    for name, place in recording_columns(recording.braked):
        if name in recording.columns:  # a device on the bench has no simulated hand
            rows[:, place] = recording.column(name)
    for name, place, words in (
        ("phase", tick_log.PHASE, tick_log.PHASES),
        ("stuck", tick_log.STUCK, tick_log.STUCK_LETTERS),
    ):
        codes = np.array([words.index(text) for text in recording.words[name]], dtype=float)
        rows[:, place] = codes[recording.column(name)]
    return rows


def device_of(recording: Recording, stored: StoredSession) -> Device:
    """The device as its session stored it."""
    name = str(recording.metadata.get("configuration", ""))
    for device in stored.protocol.devices:
        if device.name == name:
            return device
    raise InputError(f"{recording.path}: its session has no device {name!r}")


def way_of(recording: Recording) -> PathFile:
    about = recording.metadata
    if "path_shape" in about:
        return path_from(about["path_shape"], f"{recording.path}: path_shape")
    if "start_m" not in about or "end_m" not in about:
        raise InputError(f"{recording.path}: the metadata lack the path")
    return Segment(tuple(about["start_m"]), tuple(about["end_m"]))


def errors(ticks: np.ndarray) -> np.ndarray:
    """Distance of the tip from the path (n,), m, in ticks (n, tick_log.WIDTH); NaN outside the movement."""
    return np.where(ticks[:, tick_log.PHASE] == tick_log.MOVE, np.abs(ticks[:, tick_log.PATH_DISTANCE]), np.nan)


class Comparison(NamedTuple):
    """A trial's hand through another controller: the result of `phd replay`."""

    ticks: np.ndarray  # (n, tick_log.WIDTH), of the movement; of its texts the phase alone
    error: np.ndarray  # (n,) m
    metrics: dict[str, float | None]
    recorded: dict[str, float | None] | None  # of the trial, over the way that both made; None: all of it
    status: str
    text: str  # how it is to be read


def read_comparison(path: Path, summary: str) -> Comparison:
    """Read a replay from the table and the summary of `phd replay --out`."""
    about, ticks = json.loads(summary), _replayed_ticks(path)
    then, now = ({name: change[when] for name, change in about["metrics"].items()} for when in ("before", "after"))
    recorded = None if about["compared_way"] is None else then
    return Comparison(
        ticks, errors(ticks), now, recorded, about["after"]["status"], " ".join([about["says"], *about["warnings"]])
    )


def _replayed_ticks(path: Path) -> np.ndarray:
    table = csv.read_csv(path)
    rows = np.zeros((table.num_rows, tick_log.WIDTH))
    for name, place in recording_columns(JOINTS):
        if name in table.column_names and name not in TEXT_COLUMNS:
            rows[:, place] = table[name].to_numpy()
    rows[:, tick_log.PHASE] = [tick_log.PHASES.index(phase) for phase in table["phase"].to_pylist()]
    return rows
