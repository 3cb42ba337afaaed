"""journal.jsonl of a session: what happened and when, one line an event, never rewritten."""

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.analysis.metrics import NO_METRICS
from experiments.analysis.trials_table import TrialRow, row_of
from experiments.plan import PlannedTrial
from experiments.recording.reader import PARQUET_SUFFIX, STREAM_SUFFIX, read_recording
from experiments.recording.schema import Recording
from experiments.session.blind import opened, veiled
from experiments.session.files import CRASHED, planned_fields

NAME = "journal.jsonl"


def write_event(folder: Path, event: str, sync: bool = True, **about: object) -> None:
    """Append one line; a line that a crash cut off is ended first. OSError, and no half line, on a full disk."""
    line = json.dumps({"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "event": event, **about})
    handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
    try:
        end = os.lseek(handle, 0, os.SEEK_END)
        cut = False
        if end:
            os.lseek(handle, end - 1, os.SEEK_SET)
            cut = os.read(handle, 1) != b"\n"
        data = (b"\n" if cut else b"") + line.encode() + b"\n"
        written = 0
        try:
            while written < len(data):
                written += os.write(handle, data[written:])
            if sync:
                os.fsync(handle)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(handle, end)
            raise
    finally:
        os.close(handle)


def read_events(folder: Path) -> list[dict]:
    """Every event that can be read, in order; a line that a crash cut off is passed over."""
    try:
        lines = (folder / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    events = []
    for line in lines:
        with contextlib.suppress(ValueError):
            event = json.loads(line)
            if isinstance(event, dict):
                events.append(event)
    return events


#: Events of the journal.
BEGUN, ENDED, SKIPPED, REDONE, UNBLINDED = "trial begun", "trial ended", "skipped", "redone", "unblinded"
PRACTICE_ENDED, KEY_OPENED = "practice ended", "key opened"


@dataclass(frozen=True)
class JournalSummary:
    """What the journal of a session says of its trials."""

    begun: dict[int, dict] = field(default_factory=dict)  # run -> the event
    skipped: dict[int, dict] = field(default_factory=dict)  # run -> the event
    redone: dict[int, str] = field(default_factory=dict)  # run -> reason
    practised: dict[str, int] = field(default_factory=dict)  # configuration -> practice trials done or skipped
    key: dict[str, int] | None = None  # code -> controller, once the session is unblinded

    def row(self, row: TrialRow) -> TrialRow:
        """A row, from its recording or of a skipped trial, as it stands in the table."""
        row = opened(row, self.key) if self.key is not None else veiled(row)
        return replace(row, status="redone") if row.run in self.redone else row

    def plan(self, plan: tuple[PlannedTrial, ...]) -> tuple[PlannedTrial, ...]:
        """The stored plan, opened if the session is unblinded."""
        return tuple(opened(trial, self.key) for trial in plan) if self.key is not None else plan


def journal_summary(session: Path) -> JournalSummary:
    """The summary of a session's journal, as far as it can be read."""
    found = JournalSummary()
    key = None
    for event in read_events(session):
        match event:
            case {"event": "trial begun", "run": int(run)}:
                found.begun[run] = event
            case {"event": "skipped", "run": int(run), "block": int(block), "configuration": str(configuration)}:
                if block:
                    found.skipped[run] = event
                else:
                    found.practised[configuration] = found.practised.get(configuration, 0) + 1
            case {"event": "redone", "run": int(run), "reason": str(reason)}:
                found.redone[run] = reason
            case {"event": "practice ended", "configuration": str(configuration), "status": "done" | "timeout"}:
                found.practised[configuration] = found.practised.get(configuration, 0) + 1
            case {"event": "unblinded", "key": dict(opening)}:
                key = {str(code): int(number) for code, number in opening.items()}
    return replace(found, key=key)


def recorded_row(recording: Recording, folder: Path, journal: JournalSummary) -> TrialRow:
    """The row of a recorded trial for a table in `folder`. InputError if the recording cannot give one."""
    return journal.row(row_of(recording, folder))


def rows_as_journalled(session: Path, rows: Sequence[TrialRow], journal: JournalSummary) -> list[TrialRow]:
    """A table's rows as the journal wants them; what a coded row left out comes from its recording.

    A stream that has become Parquet since is named as that.
    """
    right = []
    for row in rows:
        if journal.key is not None and isinstance(row.controller, str) and row.recording:
            recording = read_recording(session / row.recording)
            right.append(recorded_row(recording, session, journal) if recording.whole else journal.row(row))
        else:
            right.append(journal.row(row))
        if right[-1].recording.endswith(STREAM_SUFFIX):
            kept = Path(right[-1].recording).with_suffix(PARQUET_SUFFIX)
            right[-1] = replace(right[-1], recording=kept.as_posix()) if (session / kept).exists() else right[-1]
    return right


def rows_without_recording(session: Path, journal: JournalSummary) -> list[TrialRow]:
    """Rows of trials that have no recording: skipped ones, and those of which a crash left not one tick to read."""
    rows = [journal.row(unmeasured_row(session, event, "skipped")) for event in journal.skipped.values()]
    for run, event in journal.begun.items():
        lost = any(session.glob(f"trials/run-{run:03d}{STREAM_SUFFIX}.{CRASHED}*"))
        if lost and "block" in event and not any(session.glob(f"trials/run-{run:03d}.parquet")):
            rows.append(journal.row(unmeasured_row(session, event, "recovered")))
    return sorted(rows, key=lambda row: row.run)


def unmeasured_row(session: Path, event: Mapping[str, Any], status: str) -> TrialRow:
    """The row of a trial of which nothing was measured, from its place in the plan as the journal has it."""
    participant = session.parent.name.removeprefix("sub-")
    return TrialRow(participant, *planned_fields(event), status).with_metrics(NO_METRICS)
