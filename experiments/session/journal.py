"""journal.jsonl of a session: what happened and when, one line an event, never rewritten; and what follows from it.

A recording says how its trial ended and never changes. That a trial was redone afterwards, that one was skipped, and
whether the key of a blind session was opened for its table, stands in the journal, which is written first. So a table
that a crash or a bad disk has spoilt can be made again, and `phd analyze` gives the same one.
"""

import contextlib
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from core.device_interface import ZeroRecord
from core.files import InputError
from experiments.analysis.trials_table import COUNTED, SETTLED, TrialRow, row_of, write_table
from experiments.plan import PlannedTrial
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import append_whole, reason_of
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session.blind import opened, veiled
from experiments.session.files import CRASHED, TABLE, hold_lock, rows_of, write_pooled_table

NAME = "journal.jsonl"

# ---------------------------------------------------------------------------------------------------------- the events


class Event(NamedTuple):
    """A kind of event: its name, and the fields of its line besides the time."""

    name: str
    fields: dict[str, Any]  # name -> type, or types, as JSON has them


_NUMBER, _TEXTS = (int, float), ("recovered", "completed", "rows_added", "rows_changed", "set_aside", "removed")
_TRIAL = dict(get_type_hints(PlannedTrial))

CREATED = Event("created", {"plan": str})  # hash of the plan
RESUMED = Event("resumed", {"open": int})  # trials still to come
PRACTICE_BEGUN = Event("practice begun", _TRIAL)
PRACTICE_ENDED = Event("practice ended", {"run": int, "status": str, "reason": str, "configuration": str})
BEGUN = Event("trial begun", _TRIAL)
ENDED = Event("trial ended", {"run": int, "status": str, "reason": str})
TRIAL_CUT_OFF = Event("trial cut off", {"run": int, "reason": str})  # of a study whose disk is full
LEFT_AS_STREAM = Event("left as a stream", {"file": str, "reason": str})
SKIPPED = Event("skipped", {**_TRIAL, "reason": str})
REDONE = Event("redone", {"run": int, "reason": str})
POSTPONED = Event("postponed", {"run": int})  # its trial comes again at the end of its configuration
EXCLUDED = Event("excluded", {"run": int, "reason": str})  # from every result but the table
UNBLINDED = Event("unblinded", {"who": str, "key": dict})  # code -> controller
KEY_OPENED = Event("key opened", {"who": str, "analysis": str})  # for an analysis; the session stays blind
NOTE = Event("note", {"text": str})
PAUSED = Event("paused", {})
RESUMED_AFTER_PAUSE = Event("resumed after a pause", {"seconds": _NUMBER})
BREAK_ENDED = Event("break ended", {"settled": int})  # trials of the plan
ANSWERS = Event("answers", {"configuration": str, "block": int, "values": dict})
CONTROLLER_ANSWERS = Event("answers of a controller", {"configuration": str, "controller": (int, str), "values": dict})
RERIGGED = Event("re-rigged", {"configuration": str})
HOMED = Event("homed", {"tip_m": list, "board": str})
ZEROED = Event("zero taken", dict.fromkeys(ZeroRecord._fields, list) | {"samples": int})
BRAKES_OFF = Event("brakes off", {"cause": str})
BRAKES_ALLOWED = Event("brakes allowed", {})
LOOP_LOST = Event("control loop lost", {"run": int, "reason": str})
WINDOW_LOST = Event("window lost", {})
PUT_IN_ORDER = Event("recovered", dict.fromkeys((*_TEXTS, "not_rescued"), list))

EVENTS = {event.name: event for event in tuple(globals().values()) if isinstance(event, Event)}


class Entry(NamedTuple):
    """A line of the journal."""

    event: Event
    time: str  # ISO, UTC
    about: dict[str, Any]  # its fields


def now() -> str:
    """The time of an event that happens now."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def write_event(folder: Path, event: Event, sync: bool = True, time: str = "", **about: object) -> None:
    """Append one line; a line that a crash cut off is ended first. time: if not now.

    OSError, and no half line, on a full disk. TypeError: the event has other fields.
    """
    if about.keys() != event.fields.keys():
        raise TypeError(f"{event.name}: its fields are {sorted(event.fields)}, not {sorted(about)}")
    line = json.dumps({"time": time or now(), "event": event.name, **about}).encode() + b"\n"
    handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
    try:
        end = os.lseek(handle, 0, os.SEEK_END)
        os.lseek(handle, max(end - 1, 0), os.SEEK_SET)
        is_cut = os.read(handle, 1) not in (b"\n", b"")
        append_whole(handle, b"\n" + line if is_cut else line, end, sync)
    finally:
        os.close(handle)


def read_events(folder: Path) -> list[Entry]:
    """Every event that can be read, in order.

    Left out are a line that a crash cut off, and an event that is not declared or does not have the declared fields.
    """
    try:
        lines = (folder / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    entries = []
    for line in lines:
        with contextlib.suppress(ValueError, TypeError, KeyError):
            about = json.loads(line)
            event, time = EVENTS[about["event"]], about["time"]
            fields = {name: about[name] for name in event.fields}
            if isinstance(time, str) and all(isinstance(fields[name], kind) for name, kind in event.fields.items()):
                entries.append(Entry(event, time, fields))
    return entries


# ------------------------------------------------------------------------------------- what follows for table and plan


@dataclass
class JournalSummary:
    """What the journal of a session holds of its trials."""

    begun: dict[int, dict] = field(default_factory=dict)  # run -> the event
    skipped: dict[int, dict] = field(default_factory=dict)  # run -> the event
    marked: dict[int, str] = field(default_factory=dict)  # run -> its status since, "redone" or "excluded"
    postponed: list[int] = field(default_factory=list)  # runs, in the order in which that was asked for
    practised: Counter[str] = field(default_factory=Counter)  # configuration -> practice trials done or skipped
    key: dict[str, int] | None = None  # code -> controller, once the session is unblinded

    def row(self, row: TrialRow) -> TrialRow:
        """A row, from its recording or of a skipped trial, as it stands in the table."""
        row = opened(row, self.key) if self.key is not None else veiled(row)
        return replace(row, status=self.marked.get(row.run, row.status))

    def plan(self, plan: tuple[PlannedTrial, ...]) -> tuple[PlannedTrial, ...]:
        """The stored plan, opened if the session is unblinded."""
        return tuple(opened(trial, self.key) for trial in plan) if self.key is not None else plan


def journal_summary(session: Path) -> JournalSummary:
    """The summary of a session's journal, as far as it can be read."""
    found = JournalSummary()
    for event, _, about in read_events(session):
        if event is BEGUN:
            found.begun[about["run"]] = about
        elif event is SKIPPED and about["block"]:
            found.skipped[about["run"]] = about
        elif event is REDONE or event is EXCLUDED:
            found.marked[about["run"]] = event.name
        elif event is POSTPONED:
            found.postponed.append(about["run"])
        elif event is SKIPPED or (event is PRACTICE_ENDED and about["status"] in COUNTED):
            found.practised[about["configuration"]] += 1
        elif event is UNBLINDED:
            found.key = {str(code): int(number) for code, number in about["key"].items()}
    return found


def recorded_row(recording: Recording, folder: Path, journal: JournalSummary) -> TrialRow:
    """The row of a recorded trial for a table in `folder`. InputError if the recording cannot give one."""
    return journal.row(row_of(recording, folder))


#: what marks a run afterwards -> the statuses of the runs that can be marked, and why others cannot
MARKS = {
    REDONE.name: (SETTLED, "its trial comes again by itself, there is nothing to do again"),
    EXCLUDED.name: (COUNTED, "it does not count anyway, there is nothing to exclude"),
}


def mark_run(
    folder: Path, rows: Sequence[TrialRow], run: int, event: Event, reason: str, sync: bool = True
) -> list[TrialRow]:
    """Journal that a run of these rows is redone or excluded; the rows, with its status changed.

    InputError if there is no such run, its status does not allow it, or an exclusion has no reason.
    """
    found = next((row for row in rows if row.run == run), None)
    if found is None:
        raise InputError(f"run {run}: is not done yet")
    if event is EXCLUDED and not reason.strip():
        raise InputError(f"run {run}: a reason is needed to exclude it")
    of, otherwise = MARKS[event.name]
    if found.status not in of:
        raise InputError(f"run {run}: is {found.status}: {otherwise}")
    write_event(folder, event, sync, run=run, reason=reason)
    return [replace(row, status=event.name) if row is found else row for row in rows]


def exclude_run(folder: Path, run: int, reason: str) -> None:
    """Exclude a run of a session that is not open, for a reason; the tables follow.

    InputError: a live process has the session, the disk does not take it, or the run does not count anyway.
    """
    data_dir = folder.parents[1]
    try:
        lock = hold_lock(folder)
        try:
            write_table(folder / TABLE, mark_run(folder, rows_of(folder), run, EXCLUDED, reason), replacing=True)
            if (data_dir / TABLE).exists():
                write_pooled_table(data_dir)
        finally:
            lock.release()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({reason_of(error)})") from None


def exclusion_of(folder: Path, run: int) -> str:
    """The reason for which a run was excluded."""
    reasons = [about["reason"] for event, _, about in read_events(folder) if event is EXCLUDED and about["run"] == run]
    return reasons[-1] if reasons else "the journal does not give the reason"


def rows_as_journalled(session: Path, rows: Sequence[TrialRow], journal: JournalSummary) -> list[TrialRow]:
    """A table's rows as the journal wants them.

    What a coded row left out comes from its recording. A stream that has become Parquet since is named as that.
    """

    def as_journalled(row: TrialRow) -> TrialRow:
        if journal.key is not None and isinstance(row.controller, str) and row.recording:
            recording = read_recording(session / row.recording)
            row = row_of(recording, session) if recording.whole else row
        row, parquet = journal.row(row), row.recording.removesuffix(STREAM_SUFFIX) + PARQUET_SUFFIX
        became_parquet = row.recording.endswith(STREAM_SUFFIX) and (session / parquet).exists()
        return replace(row, recording=parquet) if became_parquet else row

    return [as_journalled(row) for row in rows]


def rows_without_recording(session: Path, journal: JournalSummary) -> list[TrialRow]:
    """Rows of trials that have no recording: skipped ones, and those of which a crash left not one tick to read."""
    rows = [unmeasured_row(session, event, "skipped") for event in journal.skipped.values()]
    for run, event in journal.begun.items():
        lost = any(session.glob(f"trials/run-{run:03d}{STREAM_SUFFIX}.{CRASHED}*"))
        if lost and not (session / f"trials/run-{run:03d}{PARQUET_SUFFIX}").exists():
            rows.append(unmeasured_row(session, event, "recovered"))
    return sorted(map(journal.row, rows), key=lambda row: row.run)


def unmeasured_row(session: Path, event: Mapping[str, Any], status: str) -> TrialRow:
    """The row of a trial of which nothing was measured, from its place in the plan as the journal has it."""
    participant = session.parent.name.removeprefix("sub-")
    return TrialRow(participant, *(event[name] for name in PlannedTrial._fields), status)
