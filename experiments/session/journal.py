"""journal.jsonl of a session: one line for each event, never rewritten; and what follows from it for the table.

A recording says how its trial ended, and never changes. The journal says what was decided later: trials redone, skipped
or excluded, a key opened. It is written before the table, so that a damaged table can be made again from journal and
recordings, and `phd analyze` gives the same one.
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec

from core.device_interface import ZeroRecord
from core.files import InputError
from experiments.analysis.trials_table import (
    COUNTED,
    FINISHED,
    STATUSES,
    TrialRow,
    as_table,
    row_of,
    with_name,
    write_table,
)
from experiments.plan import PlannedTrial
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import MOST_SHOWN, append_whole, reading_stored, reason_of
from experiments.recording.reader import read_recording
from experiments.session.blind import blinded, unblinded
from experiments.session.checksums import fault_of_end, next_line, note_end, noted_end, read_lines
from experiments.session.files import CRASHED, TABLE, controller_names, hold_lock, rows_of, write_pooled_table

NAME = "journal.jsonl"

# ---------------------------------------------------------------------------------------------------------- the events


class Event(NamedTuple):
    """A kind of event: its name and the fields of its line."""

    name: str
    fields: dict[str, Any]  # name -> type, as `msgspec.convert` takes it


_Count = Annotated[int, msgspec.Meta(ge=0, le=10**9)]
_Run = Annotated[int, msgspec.Meta(ge=1, le=10**6)]
_Code = Annotated[str, msgspec.Meta(pattern=r"^K[1-9]\d{0,5}\Z")]
_Status = Annotated[str, msgspec.Meta(pattern=rf"^({'|'.join(STATUSES)})\Z")]
_Values = dict[str, float | str | bool | None]
_TEXTS = ("recovered", "completed", "rows_added", "rows_changed", "set_aside", "removed")
_TRIAL = {
    "run": _Run, "block": _Count, "configuration": str, "controller": _Count | _Code, "segment": _Count,
    "repetition": _Count,
}  # fmt: skip

CREATED = Event("created", {"plan": str})  # hash of the plan
CONSENT = Event("consent", {"agreed": bool})  # its time: of the answer
RESUMED = Event("resumed", {"open": _Count})  # trials still to come
PRACTICE_BEGUN = Event("practice begun", _TRIAL)
PRACTICE_ENDED = Event("practice ended", {"run": _Run, "status": _Status, "reason": str, "configuration": str})
BEGUN = Event("trial begun", _TRIAL)
ENDED = Event("trial ended", {"run": _Run, "status": _Status, "reason": str})
TRIAL_CUT_OFF = Event("trial cut off", {"run": _Run, "reason": str})  # of a study whose disk is full
LEFT_AS_STREAM = Event("left as a stream", {"file": str, "reason": str})
SKIPPED = Event("skipped", {**_TRIAL, "reason": str})
REDONE = Event("redone", {"run": _Run, "reason": str})
POSTPONED = Event("postponed", {"run": _Run})  # its trial comes again at the end of its configuration
EXCLUDED = Event("excluded", {"run": _Run, "reason": str})  # from every result but the table
UNBLINDED = Event("unblinded", {"who": str, "key": dict[_Code, _Count]})  # code -> controller
KEY_OPENED = Event("key opened", {"who": str, "analysis": str})  # for an analysis; the session stays blind
NOTE = Event("note", {"text": str})
PAUSED = Event("paused", {})
RESUMED_AFTER_PAUSE = Event("resumed after a pause", {"seconds": float})
BREAK_ENDED = Event("break ended", {"settled": _Count})  # trials of the plan
ANSWERS = Event("answers", {"configuration": str, "block": _Count, "values": _Values})
CONTROLLER_ANSWERS = Event(
    "answers of a controller", {"configuration": str, "controller": _Count | _Code, "values": _Values}
)
RERIGGED = Event("re-rigged", {"configuration": str})
HOMED = Event("homed", {"tip_m": list[float], "board": str})
ZEROED = Event("zero taken", dict.fromkeys(ZeroRecord._fields, list) | {"samples": _Count})
BRAKES_OFF = Event("brakes off", {"cause": str})
BRAKES_ALLOWED = Event("brakes allowed", {})
MOVED = Event("moved", {"from": str})  # the session goes on in this folder
LOOP_LOST = Event("control loop lost", {"run": _Run, "reason": str})
WINDOW_LOST = Event("window lost", {})
SESSION_RECOVERED = Event("recovered", dict.fromkeys((*_TEXTS, "not_rescued"), list[str]))

EVENTS = {event.name: event for event in tuple(globals().values()) if isinstance(event, Event)}


class JournalEntry(NamedTuple):
    """A line of the journal."""

    event: Event
    time: str  # ISO, UTC
    about: dict[str, Any]  # its fields


def now() -> str:
    """The present time, ISO, UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def write_event(folder: Path, event: Event, sync: bool = True, time: str = "", **about: object) -> None:
    """Append one line with its checksums (`checksums`), after ending a line that a crash cut off. time: if not now.

    OSError, and no half line, on a full disk. TypeError: the event has other fields.
    """
    if about.keys() != event.fields.keys():
        raise TypeError(f"{event.name}: its fields are {sorted(event.fields)}, not {sorted(about)}")
    handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
    try:
        with os.fdopen(os.dup(handle), "rb") as file:
            content = file.read()
        line = next_line({"time": time or now(), "event": event.name, **about}, content)
        is_cut = bool(content) and not content.endswith(b"\n")
        os.lseek(handle, len(content), os.SEEK_SET)
        append_whole(handle, b"\n" + line if is_cut else line, len(content), sync)
    finally:
        os.close(handle)


class Journal(NamedTuple):
    """The readable events of a journal, and its faults."""

    entries: list[JournalEntry]  # in order
    faults: list[str]  # each a sentence: which lines are left out or missing, and why
    notes: list[str]  # each a sentence; no faults


def read_journal(folder: Path) -> Journal:
    """Read every valid event of a session, in order, and the faults of the rest.

    Left out are lines that do not match their checksum or cannot be read, and events that are not declared or have
    other fields. InputError if the journal exists and cannot be read at all.
    """
    path = folder / NAME
    if not path.exists():
        return Journal([], [], [])
    end, fault = None, ""
    try:
        end = noted_end(folder)
    except InputError as error:
        fault = str(error)
    with reading_stored(path):
        read = read_lines(path.read_bytes())
    journal = Journal([], read.faults, read.notes)
    fault = fault or fault_of_end(end, read)
    for number, about in read.valid.items():
        name = about.get("event")
        event = EVENTS.get(name) if isinstance(name, str) else None
        try:
            if event is None:
                journal.notes.append(f"line {number}: is of an event that this version does not know")
            else:
                journal.entries.append(_entry(event, about))
        except ValueError as error:
            journal.faults.append(f"line {number}: {event.name if event else 'event'}: {str(error)[:MOST_SHOWN]}")
    if fault:
        journal.faults.append(fault)
    return journal


def _entry(event: Event, about: Mapping[str, Any]) -> JournalEntry:
    """ValueError if a field is missing or not as declared."""
    time = about.get("time")
    if not isinstance(time, str) or datetime.fromisoformat(time).tzinfo is None:
        raise ValueError(f"time cannot be {str(time)[:40]!r}")
    fields = {}
    for name, kind in event.fields.items():
        if name not in about:
            raise ValueError(f"lacks {name}")
        try:
            msgspec.convert(about[name], kind)
        except (msgspec.ValidationError, RecursionError):
            raise ValueError(f"{name} cannot be {_shown(about[name])}") from None
        fields[name] = about[name]
    return JournalEntry(event, time, fields)


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        return "that deep or that long"
    return text if len(text) <= 60 else f"{text[:60]}.."


def read_events(folder: Path) -> list[JournalEntry]:
    """The valid events of a session, in order."""
    return read_journal(folder).entries


def close_journal(folder: Path, sync: bool = True) -> None:
    """Note where the journal ends, so that lost last lines are noticed. The caller holds the lock."""
    if (folder / NAME).exists():
        with reading_stored(folder / NAME):
            read = read_lines((folder / NAME).read_bytes())
        note_end(folder, read, sync)


# ------------------------------------------------------------------------------------- what follows for table and plan


@dataclass
class JournalSummary:
    """What the journal of a session says about its trials."""

    session: Path
    begun: dict[int, dict] = field(default_factory=dict)  # run -> the event
    practice_begun: set[int] = field(default_factory=set)  # runs
    skipped: dict[int, dict] = field(default_factory=dict)  # run -> the event
    marked: dict[int, str] = field(default_factory=dict)  # run -> its status since, "redone" or "excluded"
    postponed: list[int] = field(default_factory=list)  # runs, in the order in which that was asked for
    practised: Counter[str] = field(default_factory=Counter)  # configuration -> practice trials done or skipped
    key: dict[str, int] | None = None  # code -> controller, once the session is unblinded
    plan_sha256: str = ""  # of the plan with which the session was created
    agreed: bool | None = None  # the participant, to take part; None: not asked
    faults: list[str] = field(default_factory=list)  # why lines are not in it, as in `Journal`
    notes: list[str] = field(default_factory=list)  # as in `Journal`

    @cached_property
    def names(self) -> dict[int, str]:
        """The names of the controllers, for rows that have none."""
        return controller_names(self.session)

    def row(self, row: TrialRow) -> TrialRow:
        """A trial's row as it stands in the table: marked as redone or excluded, with its controller or code."""
        row = unblinded(row, self.key) if self.key is not None else blinded(row)
        if row.controller_name is None:
            row = with_name(row, self.names)
        return replace(row, status=self.marked.get(row.run, row.status))

    def plan(self, plan: tuple[PlannedTrial, ...]) -> tuple[PlannedTrial, ...]:
        """The stored plan, with controllers if the session is unblinded."""
        return tuple(unblinded(trial, self.key) for trial in plan) if self.key is not None else plan


def journal_summary(session: Path) -> JournalSummary:
    """Read the journal of a session and sum it up. InputError if it exists and cannot be read at all."""
    journal = read_journal(session)
    found = JournalSummary(session, faults=journal.faults, notes=journal.notes)
    for event, _, about in journal.entries:
        if event is BEGUN:
            found.begun[about["run"]] = about
        elif event is PRACTICE_BEGUN:
            found.practice_begun.add(about["run"])
        elif event is CREATED:
            found.plan_sha256 = about["plan"]
        elif event is CONSENT:
            found.agreed = about["agreed"]
        elif event is SKIPPED and about["block"]:
            found.skipped[about["run"]] = about
        elif event is REDONE or event is EXCLUDED:
            found.marked[about["run"]] = event.name
        elif event is POSTPONED:
            found.postponed.append(about["run"])
        elif event is SKIPPED or (event is PRACTICE_ENDED and about["status"] in COUNTED):
            found.practised[about["configuration"]] += 1
        elif event is UNBLINDED:
            found.key = about["key"]
    return found


#: what marks a run afterwards -> the statuses of the runs that can be marked, and why others cannot
MARKS = {
    REDONE.name: (FINISHED, "its trial comes again by itself, there is nothing to do again"),
    EXCLUDED.name: (COUNTED, "it does not count anyway, there is nothing to exclude"),
}


def mark_run(
    folder: Path, rows: Sequence[TrialRow], run: int, event: Event, reason: str, sync: bool = True
) -> list[TrialRow]:
    """Journal that a run is redone or excluded; the rows with its new status.

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
    """Exclude a run of a session that is not open, and rewrite the tables.

    InputError: a live process has the session, it cannot be written, or the run does not count anyway.
    """
    data_dir = folder.parents[1]
    try:
        with hold_lock(folder):
            rows = mark_run(folder, rows_of(folder), run, EXCLUDED, reason)
            write_table(folder / TABLE, as_table(rows), replacing=True)
            close_journal(folder)
            if (data_dir / TABLE).exists():
                write_pooled_table(data_dir)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({reason_of(error)})") from None


def exclusion_of(folder: Path, run: int) -> str:
    """The reason for which a run was excluded."""
    reasons = [about["reason"] for event, _, about in read_events(folder) if event is EXCLUDED and about["run"] == run]
    return reasons[-1] if reasons else "the journal does not give the reason"


def rows_as_journalled(session: Path, rows: Sequence[TrialRow], journal: JournalSummary) -> list[TrialRow]:
    """The rows of a table, updated by the journal.

    What a coded row lacks comes from its recording. A stream that has become Parquet is named as Parquet.
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
    """Rows of trials without a recording: skipped ones, and those of which a crash left no tick."""
    rows = [unmeasured_row(session, event, "skipped") for event in journal.skipped.values()]
    for run, event in journal.begun.items():
        lost = any(session.glob(f"trials/run-{run:03d}{STREAM_SUFFIX}.{CRASHED}*"))
        if lost and not (session / f"trials/run-{run:03d}{PARQUET_SUFFIX}").exists():
            rows.append(unmeasured_row(session, event, "recovered"))
    return sorted(map(journal.row, rows), key=lambda row: row.run)


def unmeasured_row(session: Path, event: Mapping[str, Any], status: str) -> TrialRow:
    """The row of a trial without measures, from its place in the plan."""
    place = {name: event[name] for name in PlannedTrial._fields}
    return TrialRow(participant=session.parent.name.removeprefix("sub-"), **place, status=status)
