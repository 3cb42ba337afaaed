"""`phd verify`: is every recording of a folder whole, or marked as recovered, and do the tables say the same?

Nothing is written. No faults: an unfinished plan, an empty folder, one that was hardly begun, and, in a session that a
live process holds, the trial in progress. Faults, each by file: every damaged batch or part of a recording; a trial
that was cut off and not yet recovered; a recording that trials.csv or the journal names and that is not there; a trial
without a row; a row that its recording and the journal (skipped, redone, unblinded) contradict; a stored plan that was
changed; a blind session without its key. Practice trials have recordings and no rows: none is missing.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import COLUMNS, TrialRow, read_table
from experiments.recording.reader import PARQUET_SUFFIX, STREAM_SUFFIX, read_recording
from experiments.recording.schema import Recording
from experiments.session.blind import KEY, read_key
from experiments.session.files import (
    PRACTICE,
    STORED,
    TABLE,
    is_half_created,
    is_in_use,
    pooled_rows,
    read_stored,
    rows_of,
    runs_on_disk,
    seen_from,
    sessions_in,
)
from experiments.session.journal import JournalSummary, journal_summary, recorded_row, rows_without_recording
from experiments.session.study_file import STUDY, read_study

#: Largest share by which a number of the table may differ from what the recording gives: library versions round apart.
TOLERANCE = 1e-6


@dataclass
class Findings:
    """What was found in a session."""

    whole: int = 0
    recovered: int = 0
    in_progress: int = 0
    faults: list[tuple[str, str]] = field(default_factory=list)  # file (relative to the session), what is wrong
    warnings: list[tuple[str, str]] = field(default_factory=list)  # file, why its motion may be wrong, though whole


def verify(folder: Path, progress: Callable[[float], None] | None = None) -> dict:
    """Check every session of a data folder; the summary, with `faults` as a list of {"file", "fault"}.

    `warnings` likewise: recordings that are whole, of motion that the simulator's own energy ledger contradicts.

    InputError if there is no such folder or it holds no session but other files.
    """
    folder = Path(folder)
    sessions = sessions_in(folder)
    live = [session for session in sessions if is_in_use(session)]
    running = bool(live) or is_in_use(folder)
    total = Findings()
    if (folder / STUDY).exists():
        try:
            read_study(folder)
        except InputError as error:
            total.faults.append((STUDY, seen_from(folder, str(error))))
    for number, session in enumerate(sessions, start=1):
        found = verify_session(session, session in live)
        place = session.relative_to(folder).as_posix()
        total.whole += found.whole
        total.recovered += found.recovered
        total.in_progress += found.in_progress
        total.faults += [(f"{place}/{file}" if place != "." else file, fault) for file, fault in found.faults]
        total.warnings += [(f"{place}/{file}" if place != "." else file, text) for file, text in found.warnings]
        if progress:
            progress(number / len(sessions))
    if folder not in sessions and (folder / TABLE).exists() and not running:
        total.faults += [(TABLE, fault) for fault in _pooled_faults(folder)]
    return {
        "dir": str(folder),
        "sessions": len(sessions),
        "in_use": len(live),
        "whole": total.whole,
        "recovered": total.recovered,
        "in_progress": total.in_progress,
        "faults": [{"file": file, "fault": fault} for file, fault in total.faults],
        "warnings": [{"file": file, "warning": text} for file, text in total.warnings],
    }


def verify_session(session: Path, live: bool = False) -> Findings:
    """Check one session; `live`: a process is writing in it."""
    found = Findings()
    if is_half_created(session):
        return found
    journal = journal_summary(session)
    try:
        about = read_stored(session).about
        if about.get("blind") and journal.key is None:
            _check_key(session, about, found)
    except InputError as error:
        found.faults.append((STORED, seen_from(session, str(error))))
    try:
        rows = {row.run: row for row in rows_of(session)}
    except InputError as error:
        found.faults.append((TABLE, seen_from(session, str(error))))
        rows = None

    on_disk = runs_on_disk(session)
    for files in on_disk.values():
        recording = _check_files(session, files, live, found)
        if recording is not None and rows is not None:
            _check_row(session, recording, rows, journal, live, found)
    for files in runs_on_disk(session, PRACTICE).values():
        _check_files(session, files, live, found)
    if rows is not None:
        _check_bare_rows(session, rows, journal, live, found)
    for run, row in sorted((rows or {}).items()):
        if row.recording and not (session / row.recording).is_file():
            found.faults.append((row.recording, f"missing: {TABLE} names it as the recording of run {run}"))
    for run in sorted(set(journal.begun) - set(on_disk) - set(rows or {})):
        if not any(session.glob(f"trials/run-{run:03d}.*")):
            found.faults.append((f"trials/run-{run:03d}", "missing: the journal says that this trial was begun"))
        elif not live:
            found.faults.append((TABLE, f"has no row for run {run}, which the journal says was begun"))
    return found


def _check_key(session: Path, about: dict, found: Findings) -> None:
    try:
        read_key(session, str(about.get("key_sha256")))
    except InputError as error:
        found.faults.append((KEY, seen_from(session, str(error))))


def _check_bare_rows(
    session: Path, rows: dict[int, TrialRow], journal: JournalSummary, live: bool, found: Findings
) -> None:
    """Rows without a recording against the journal, both ways."""
    bare = {row.run: row for row in rows_without_recording(session, journal)}
    for run, right in bare.items():
        if run in rows:
            found.faults += [(TABLE, fault) for fault in differences(rows[run], right, "the journal")]
        elif not live and run in journal.skipped:
            found.faults.append((TABLE, f"has no row for run {run}, which the journal says was skipped: recover it"))
    for run, row in sorted(rows.items()):
        if not row.recording and run not in bare:
            found.faults.append((TABLE, f"run {run}: is {row.status} without a recording, the journal does not say so"))


def _check_files(session: Path, files: dict[str, Path], live: bool, found: Findings) -> Recording | None:
    """Check the files of one trial; the recording that its row must match, None where there is none to trust."""
    result = None
    for suffix in (PARQUET_SUFFIX, STREAM_SUFFIX):
        if suffix not in files:
            continue
        path = files[suffix]
        name = path.relative_to(session).as_posix()
        try:
            recording = read_recording(path)
        except InputError as error:
            if not (live and not path.exists()):  # else: closed and converted while we looked
                found.faults.append((name, seen_from(session, str(error))))
            continue
        if recording.whole:
            if result is None:  # a stream beside its Parquet file counts once
                result = recording
                is_recovered = recording.outcome.get("status") == "recovered"
                found.recovered += is_recovered
                found.whole += not is_recovered
                found.warnings += [(name, text) for text in recording.outcome.get("warnings", ())]
        elif live and suffix == STREAM_SUFFIX and not recording.complete and not _faults_but_header(recording):
            found.in_progress += 1
        else:
            found.faults += [(name, fault) for fault in recording.damaged]
            if not recording.complete and suffix == STREAM_SUFFIX:
                found.faults.append((name, f"cut off before its end, {recording.rows} ticks are whole: recover it"))
    return result


def _faults_but_header(recording: Recording) -> list[str]:
    """Damage other than a header that is just being written."""
    return recording.damaged if recording.columns else []


def _check_row(
    session: Path,
    recording: Recording,
    rows: dict[int, TrialRow],
    journal: JournalSummary,
    live: bool,
    found: Findings,
) -> None:
    name = recording.path.relative_to(session).as_posix()
    try:
        right = recorded_row(recording, session, journal)
    except InputError as error:
        found.faults.append((name, seen_from(session, str(error))))
        return
    if f"run-{right.run:03d}" != recording.path.stem:
        found.faults.append((name, f"says that it is run {right.run}"))
    row = rows.get(right.run)
    if row is not None:
        found.faults += [(TABLE, fault) for fault in differences(row, right)]
    elif not live:
        found.faults.append((TABLE, f"has no row for run {right.run} ({name}): recover it"))


def differences(row: TrialRow, right: TrialRow, source: str = "its recording") -> Iterator[str]:
    """Where a row differs from what its recording, with the journal's additions, gives."""
    for column in COLUMNS:
        there, true = getattr(row, column), getattr(right, column)
        if column == "recording":
            there, true = Path(there).stem, Path(true).stem  # a stream that is still to become Parquet
        same = there == true
        if isinstance(there, float) and isinstance(true, float):
            same = math.isclose(there, true, rel_tol=TOLERANCE, abs_tol=1e-12)
        if not same:
            yield f"run {row.run}: {column} is {_shown(there)}, {source} gives {_shown(true)}"


def _shown(value: object) -> str:
    return "empty" if value in (None, "") else str(value)


def _pooled_faults(folder: Path) -> Iterator[str]:
    """How DATA/trials.csv differs from the tables of the sessions."""
    try:
        pooled = {(row.participant, row.run): row for row in read_table(folder / TABLE)}
    except InputError as error:
        yield seen_from(folder, str(error))
        return
    try:
        rows = {(row.participant, row.run): row for row in pooled_rows(folder)}
    except InputError:  # named already
        return
    for key in sorted({*pooled, *rows}):
        trial = f"run {key[1]} of participant {key[0]}"
        if key not in rows:
            yield f"{trial}: no session's {TABLE} has it"
        elif key not in pooled:
            yield f"{trial}: is missing, the session's {TABLE} has it: recover it"
        elif pooled[key] != rows[key]:
            yield f"{trial}: differs from the session's {TABLE}"
