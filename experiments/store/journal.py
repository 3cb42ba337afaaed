"""The journal of a session: its events, numbered, never rewritten; and what follows from them.

A recording says how its trial ended, and never changes. The journal says what was decided later: trials redone, skipped
or excluded, a key opened. An event and the row that it changes are committed together.

Events stand in the order of their numbers: a wall clock can be set back. A jump of it is an event, too.
"""

import contextlib
import json
import time
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
from experiments.analysis.trials_table import COUNTED, FINISHED, STATUSES, TrialRow, with_name
from experiments.atomic_files import MOST_SHOWN, reason_of
from experiments.plan import PlannedTrial
from experiments.store.blind import blinded, unblinded
from experiments.store.database import Database, reading
from experiments.store.files import hold_lock, put_row, rows_of, write_session_table
from experiments.store.stored import controller_names

CLOCK_JUMP_S = 2.0  # our choice: what the network's time does at once, and no slow correction
NAME = "journal"

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
_TRIAL = {
    "run": _Run, "block": _Count, "configuration": str, "controller": _Count | _Code, "path": _Count,
    "repetition": _Count,
}  # fmt: skip

CREATED = Event("created", {"plan": str})  # hash of the plan
CONSENT = Event("consent", {"agreed": bool, "answered": str})  # ISO, UTC
RESUMED = Event("resumed", {"open": _Count})  # trials still to come
PRACTICE_BEGUN = Event("practice begun", _TRIAL)
PRACTICE_ENDED = Event("practice ended", {"run": _Run, "status": _Status, "reason": str, "configuration": str})
BEGUN = Event("trial begun", _TRIAL)
ENDED = Event("trial ended", {"run": _Run, "status": _Status, "reason": str})
TRIAL_CUT_OFF = Event("trial cut off", {"run": _Run, "reason": str})  # of a study whose disk is full
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
LOOP_LOST = Event("control loop lost", {"run": _Run, "reason": str})
WINDOW_LOST = Event("window lost", {})
REPAIRED = Event(  # what a crash, or a disk that took no more, had left; ticks: that were kept elsewhere
    "repaired", {"trials": list[str], "rows": list[str], "ticks_kept_elsewhere": _Count, "not_repaired": list[str]}
)
CLOCK_JUMPED = Event("clock jumped", {"seconds": float})  # forward, beside the steady clock

EVENTS = {event.name: event for event in tuple(globals().values()) if isinstance(event, Event)}


class JournalEntry(NamedTuple):
    """A line of the journal."""

    event: Event
    time: str  # ISO, UTC
    about: dict[str, Any]  # its fields


def now() -> str:
    """The present time, ISO, UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class JournalWriter:
    """Writes the events of an open session."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._wall_s, self._steady_s = time.time(), time.perf_counter()

    def write(self, event: Event, **about: Any) -> None:
        """Add an event, for the next commit. TypeError: it has other fields."""
        if about.keys() != event.fields.keys():
            raise TypeError(f"{event.name}: its fields are {sorted(event.fields)}, not {sorted(about)}")
        wall_s, steady_s = time.time(), time.perf_counter()
        jump_s = (wall_s - self._wall_s) - (steady_s - self._steady_s)
        self._wall_s, self._steady_s = wall_s, steady_s
        if abs(jump_s) > CLOCK_JUMP_S:
            self._add(CLOCK_JUMPED, {"seconds": round(jump_s, 3)})
        self._add(event, about)

    def _add(self, event: Event, about: dict[str, Any]) -> None:
        text = json.dumps(about, allow_nan=False)
        self._database.add("event", now(), round(self._steady_s, 6), event.name, text)


class Journal(NamedTuple):
    """The readable events of a journal, and its faults."""

    entries: list[JournalEntry]  # in order
    faults: list[str]  # each a sentence: which lines are left out or missing, and why
    notes: list[str]  # each a sentence; no faults


def read_journal(folder: Path) -> Journal:
    """Every valid event of a session, in the order of their numbers, and the faults of the rest.

    Left out are events that do not match their checksum, are not declared or have other fields. InputError: the
    database cannot be read at all.
    """
    journal = Journal([], [], [])
    with contextlib.suppress(FileNotFoundError), reading(folder) as stored:
        for (number, at, _, name, about), whole in stored.rows("event"):
            try:
                if not whole:
                    raise ValueError("does not match its checksum, it was changed")
                if name not in EVENTS:
                    journal.notes.append(f"event {number}: this version does not know its kind")
                else:
                    journal.entries.append(_entry(EVENTS[name], {"time": at, **json.loads(about)}))
            except ValueError as error:
                journal.faults.append(f"event {number}: {str(error)[:MOST_SHOWN]}")
        journal.faults.extend(fault for table, fault in stored.faults().items() if table in ("event", "counts"))
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


# ------------------------------------------------------------------------------------- what follows for table and plan


@dataclass
class JournalSummary:
    """What the journal of a session says about its trials."""

    session: Path
    marked: dict[int, str] = field(default_factory=dict)  # run -> its status since, "redone" or "excluded"
    postponed: list[int] = field(default_factory=list)  # runs, in the order in which that was asked for
    practised: Counter[str] = field(default_factory=Counter)  # configuration -> practice trials done or skipped
    key: dict[str, int] | None = None  # code -> controller, once the session is unblinded
    faults: list[str] = field(default_factory=list)  # why lines are not in it, as in `Journal`
    notes: list[str] = field(default_factory=list)  # as in `Journal`

    @cached_property
    def names(self) -> dict[int, str]:
        """The names of the controllers, for rows that have none."""
        return controller_names(self.session)

    def row(self, row: TrialRow) -> TrialRow:
        """A trial's row as it stands in the table: marked as redone or excluded, with its controller or code."""
        if isinstance(row.controller, str):
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
        if event is REDONE or event is EXCLUDED:
            found.marked[about["run"]] = event.name
        elif event is POSTPONED:
            found.postponed.append(about["run"])
        elif event is SKIPPED and not about["block"] or event is PRACTICE_ENDED and about["status"] in COUNTED:
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
    database: Database, journal: JournalWriter, rows: Sequence[TrialRow], run: int, event: Event, reason: str
) -> list[TrialRow]:
    """Journal that a run is redone or excluded, with the next commit; the rows with its new status.

    rows: all, in their order. InputError if there is no such run, its status does not allow it, or an exclusion has no
    reason.
    """
    place = next((place for place, row in enumerate(rows) if row.run == run), None)
    if place is None:
        raise InputError(f"run {run}: is not done yet")
    if event is EXCLUDED and not reason.strip():
        raise InputError(f"run {run}: a reason is needed to exclude it")
    of, otherwise = MARKS[event.name]
    if rows[place].status not in of:
        raise InputError(f"run {run}: is {rows[place].status}: {otherwise}")
    journal.write(event, run=run, reason=reason)
    marked = replace(rows[place], status=event.name)
    put_row(database, marked, place + 1)
    return [*rows[:place], marked, *rows[place + 1 :]]


def exclude_run(folder: Path, run: int, reason: str) -> None:
    """Exclude a run of a session that is not open, and write its table again.

    InputError: a live process has the session, it cannot be written, or the run does not count anyway.
    """
    try:
        with hold_lock(folder), Database(folder) as database:
            rows = mark_run(database, JournalWriter(database), rows_of(folder), run, EXCLUDED, reason)
            database.commit()
            write_session_table(folder, rows)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({reason_of(error)})") from None


def exclusion_of(folder: Path, run: int) -> str:
    """The reason for which a run was excluded."""
    reasons = [about["reason"] for event, _, about in read_events(folder) if event is EXCLUDED and about["run"] == run]
    return reasons[-1] if reasons else "the journal does not give the reason"


def unmeasured_row(session: Path, event: Mapping[str, Any], status: str) -> TrialRow:
    """The row of a trial without measures, from its place in the plan."""
    place = {name: event[name] for name in PlannedTrial._fields}
    return TrialRow(participant=session.parent.name.removeprefix("sub-"), **place, status=status)
