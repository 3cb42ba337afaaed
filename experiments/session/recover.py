"""`phd recover`: what a crash left of a session is put in order, and nothing that was recorded is thrown away.

A stream without its end: every whole batch becomes run-007.parquet with the outcome "recovered", read back and
compared; the stream itself stays beside it as run-007.arrows.crashed. A stream that was closed: becomes the Parquet
file that the crash prevented. A recording without a row: gets its row, and so does a trial that was skipped; a row
that lags behind the journal (redone, unblinded) follows it. Half-written files: removed (each was a copy in the
making). Every step can be cut short by another crash and is then taken up where it was left.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import TrialRow, append_row, read_table, table_bytes, write_table
from experiments.recording.atomic_files import PARTIAL_FILES, set_aside
from experiments.recording.reader import PARQUET_SUFFIX, STREAM_SUFFIX, read_recording
from experiments.recording.schema import Recording
from experiments.recording.writer import convert_to_parquet, save_as_parquet
from experiments.session.files import (
    CRASHED,
    DAMAGED,
    PRACTICE,
    TABLE,
    TRIALS,
    hold_lock,
    pooled_rows,
    rows_of,
    runs_on_disk,
    seen_from,
    sessions_in,
    write_pooled_table,
)
from experiments.session.journal import (
    PUT_IN_ORDER,
    JournalSummary,
    journal_summary,
    recorded_row,
    rows_as_journalled,
    rows_without_recording,
    write_event,
)
from experiments.session.verify import verify

RECOVERED = "recovered"
CUT_OFF = "cut off before its end"


@dataclass
class Rescue:
    """What was done, file by file."""

    recovered: list[str] = field(default_factory=list)  # trials that a crash cut short
    completed: list[str] = field(default_factory=list)  # closed streams that had not become Parquet
    rows_added: list[str] = field(default_factory=list)
    rows_changed: list[str] = field(default_factory=list)  # tables that lagged behind the journal
    set_aside: list[str] = field(default_factory=list)  # kept under another name
    removed: list[str] = field(default_factory=list)  # half-written copies
    not_rescued: list[str] = field(default_factory=list)  # what cannot be helped, and why

    @property
    def did_something(self) -> bool:
        """Whether anything was changed."""
        return any((self.recovered, self.completed, self.rows_added, self.rows_changed, self.set_aside, self.removed))


def recover(folder: Path, progress: Callable[[float], None] | None = None) -> dict:
    """Put every session of a data folder in order; what was done, by file names relative to it, and what is left.

    `faults`: what `verify` still finds. InputError, and nothing is touched, if a live process has the study or one
    of its sessions.
    """
    folder = Path(folder)
    sessions = sessions_in(folder)
    total = Rescue()
    with ExitStack() as locks:
        for place in dict.fromkeys([folder, *sessions]) if sessions else []:
            locks.enter_context(hold_lock(place))
        for number, session in enumerate(sessions, start=1):
            done = recover_session(session)
            place = session.relative_to(folder).as_posix()
            for name, entries in vars(done).items():
                getattr(total, name).extend(f"{place}/{entry}" if place != "." else entry for entry in entries)
            if progress:
                progress(0.5 * number / len(sessions))
        if folder not in sessions and (folder / TABLE).exists():
            _settle_pooled_table(folder, total)
    found = verify(folder, progress and (lambda share: progress(0.5 + 0.5 * share)))
    return {"dir": str(folder), "sessions": len(sessions), **vars(total), "faults": found["faults"]}


def _settle_pooled_table(folder: Path, done: Rescue) -> None:
    """Rewrite the table of all participants where it lags; one that names trials that no session has stays."""
    table = folder / TABLE
    try:
        there = read_table(table)
    except InputError:
        done.set_aside.append(set_aside(table, DAMAGED).name)
        there = []
    try:
        rows = pooled_rows(folder)
    except InputError:  # a session's table cannot be read: it is named among the faults
        return
    if {(row.participant, row.run) for row in there} <= {(row.participant, row.run) for row in rows}:
        if there != rows:
            write_pooled_table(folder)
            added = f"{len(rows) - len(there)} trials added"
            done.rows_changed.append(f"{TABLE}: {added if len(rows) > len(there) else 'as the sessions say'}")


def recover_session(session: Path, sync: bool = True) -> Rescue:
    """Put one session in order; the caller holds its lock. A session that is in order is not touched."""
    done = Rescue()
    places = (PARTIAL_FILES, f"{TRIALS}/{PARTIAL_FILES}", f"{PRACTICE}/{PARTIAL_FILES}")
    for partial in sorted(path for pattern in places for path in session.glob(pattern)):
        partial.unlink()
        done.removed.append(partial.relative_to(session).as_posix())
    for files in (*runs_on_disk(session).values(), *runs_on_disk(session, PRACTICE).values()):
        if STREAM_SUFFIX in files:
            try:
                _settle_stream(session, files[STREAM_SUFFIX], done, sync)
            except InputError as error:
                done.not_rescued.append(seen_from(session, str(error)))
    try:
        _add_rows(session, done)
    except InputError as error:
        done.not_rescued.append(seen_from(session, str(error)))
    if done.did_something:
        write_event(session, PUT_IN_ORDER, sync, **vars(done))
    return done


def _settle_stream(session: Path, path: Path, done: Rescue, sync: bool) -> None:
    name = path.relative_to(session).as_posix()
    target = path.with_suffix(PARQUET_SUFFIX)
    stream = read_recording(path)
    if target.exists() and not read_recording(target).whole:  # the disk failed it: the stream still has all
        done.set_aside.append(set_aside(target, DAMAGED).relative_to(session).as_posix())
    if stream.whole:
        convert_to_parquet(path, sync)
        done.completed.append(name)
        return
    if stream.columns and not (target.exists() and _holds_more(read_recording(target), stream)):
        save_as_parquet(as_recovered(stream), target, sync)
    done.recovered.append(f"{name} ({'; '.join([f'{stream.rows} ticks kept', *stream.damaged])})")
    done.set_aside.append(set_aside(path, CRASHED).relative_to(session).as_posix())


def _holds_more(there: Recording, stream: Recording) -> bool:
    """Whether a whole Parquet file is the closed form of this stream, which was damaged afterwards."""
    return there.outcome.get("status") != RECOVERED and there.metadata == stream.metadata


def as_recovered(stream: Recording) -> Recording:
    """What can be read of a stream, marked as recovered."""
    outcome = {**stream.outcome, "status": RECOVERED, "reason": "; ".join(stream.damaged) or CUT_OFF}
    return replace(stream, outcome=outcome, complete=True, damaged=[])


def _add_rows(session: Path, done: Rescue) -> None:
    try:
        have = {row.run for row in rows_of(session)}
    except InputError:  # every row can be had again from its recording
        done.set_aside.append(set_aside(session / TABLE, DAMAGED).name)
        have = set()
    journal = journal_summary(session)
    bare = {row.run: row for row in rows_without_recording(session, journal)}
    on_disk = runs_on_disk(session)
    table = session / TABLE
    if {*on_disk, *bare} - have and table.exists() and table.read_bytes() != table_bytes(rows_of(session)):
        done.set_aside.append(set_aside(table, DAMAGED).name)  # changed by hand: nothing can be added to it
        have = set()
    for run in sorted({*on_disk, *bare} - have):
        path, row = on_disk.get(run, {}).get(PARQUET_SUFFIX), bare.get(run)
        if path is not None:
            row = _measured(path, session, journal, done)
        if row is None:
            continue
        append_row(session / TABLE, row)
        done.rows_added.append(f"{TABLE}: run {run}, {row.status}")
    rows = rows_of(session)
    right = rows_as_journalled(session, rows, journal)
    if right != rows:
        write_table(session / TABLE, right, replacing=True)
        changed = [str(new.run) for old, new in zip(rows, right, strict=True) if new != old]
        done.rows_changed.append(f"{TABLE}: run {', '.join(changed)}, as the journal says")


def _measured(path: Path, session: Path, journal: JournalSummary, done: Rescue) -> TrialRow | None:
    """The row of a recording; None where it can give none, which is reported; other trials get theirs."""
    try:
        recording = read_recording(path)
        if recording.whole:
            return recorded_row(recording, session, journal)
        done.not_rescued.append(f"{path.relative_to(session).as_posix()}: {'; '.join(recording.damaged)}")
    except InputError as error:
        done.not_rescued.append(seen_from(session, str(error)))
    return None
