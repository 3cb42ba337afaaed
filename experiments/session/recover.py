"""`phd recover`: repairs a session after a crash; nothing that was recorded is thrown away.

A stream without its end: every whole batch becomes run-007.parquet with the outcome "recovered", read back and
compared; the stream itself stays beside it as run-007.arrows.crashed. A stream that was closed: becomes the Parquet
file that the crash prevented. A recording without a row: gets its row, and so does a trial that was skipped; a row
that lags behind the journal (redone, excluded, unblinded) follows it. A table with two rows for one run: is made again.
Half-written files: removed (each was a copy in the making). A line of the journal that cannot be believed stays, is
named, and what the others say holds. After another crash every step continues where it was
cut short.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import (
    append_row,
    as_rows,
    as_table,
    is_same_row,
    read_table,
    row_of,
    table_bytes,
    write_table,
)
from experiments.progress import Progress, no_progress
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import PARTIAL_FILES, remove, set_aside
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.recording.writer import convert_to_parquet, save_as_parquet
from experiments.session import files, journal
from experiments.session.verify import verify

RECOVERED = "recovered"


@dataclass
class Rescue:
    """The files that were recovered; the journal's event has the same fields."""

    recovered: list[str] = field(default_factory=list)  # trials that a crash cut short
    completed: list[str] = field(default_factory=list)  # closed streams that had not become Parquet
    rows_added: list[str] = field(default_factory=list)
    rows_changed: list[str] = field(default_factory=list)  # tables that lagged behind the journal
    set_aside: list[str] = field(default_factory=list)  # kept under another name
    removed: list[str] = field(default_factory=list)  # half-written copies
    not_rescued: list[str] = field(default_factory=list)  # what cannot be helped, and why

    @contextmanager
    def rescuing(self, session: Path) -> Iterator[None]:
        """Note an InputError about one file of a session, and go on with the others.

        One that cannot be written now is no lost one: that InputError goes on.
        """
        try:
            yield
        except InputError as error:
            if isinstance(error.__cause__, OSError):
                raise
            self.not_rescued.append(files.relative_to(session, str(error)))


def recover(folder: Path, progress: Progress = no_progress) -> dict:
    """Recover every session of a data folder. The summary: what was done, by file names, and the faults that are left.

    `faults`: what `verify` still finds. InputError, and nothing is changed, if a live process has the study or a
    session.
    """
    folder = Path(folder)
    sessions = files.sessions_in(folder)
    total = Rescue()
    with ExitStack() as locks:
        for place in dict.fromkeys([folder, *sessions]) if sessions else []:
            locks.enter_context(files.hold_lock(place))
        for number, session in enumerate(sessions, start=1):
            inside = "" if session == folder else f"{session.relative_to(folder).as_posix()}/"
            for name, entries in vars(recover_session(session)).items():
                getattr(total, name).extend(f"{inside}{entry}" for entry in entries)
            progress(0.5 * number / len(sessions))
        if folder not in sessions and (folder / files.TABLE).exists():
            _recover_pooled_table(folder, total)
    found = verify(folder, lambda share: progress(0.5 + 0.5 * share))
    return {"dir": str(folder), "sessions": len(sessions), **vars(total), "faults": found["faults"]}


def _recover_pooled_table(folder: Path, done: Rescue) -> None:
    """Rewrite the table of all participants if it is out of date, unless it names trials that no session has."""
    pooled = []
    try:
        pooled = as_rows(read_table(folder / files.TABLE))
    except InputError:
        done.set_aside.append(set_aside(folder / files.TABLE, files.DAMAGED).name)
    try:
        rows = files.pooled_rows(folder)
    except InputError:  # a session's table cannot be read: it is named among the faults
        return
    pairs = zip(pooled, rows, strict=False)
    is_right = len(pooled) == len(rows) and all(is_same_row(row, right) for row, right in pairs)
    if not is_right and {(row.participant, row.run) for row in pooled} <= {(row.participant, row.run) for row in rows}:
        files.write_pooled_table(folder)
        added = len(rows) - len(pooled)
        done.rows_changed.append(f"{files.TABLE}: {f'{added} trials added' if added > 0 else 'as the sessions say'}")


def recover_session(session: Path, sync: bool = True) -> Rescue:
    """Recover one session, whose lock the caller holds. A session without damage is not touched."""
    done = Rescue()
    places = (session, session / files.TRIALS, session / files.PRACTICE)
    for partial in sorted(path for place in places for path in place.glob(PARTIAL_FILES)):
        remove(partial)
        done.removed.append(partial.relative_to(session).as_posix())
    for folder in (files.TRIALS, files.PRACTICE):
        for of_run in files.runs_on_disk(session, folder).values():
            if STREAM_SUFFIX in of_run:
                with done.rescuing(session):
                    _recover_stream(session, of_run[STREAM_SUFFIX], done, sync)
    with done.rescuing(session):
        _recover_table(session, done)
    if any(entries for name, entries in vars(done).items() if name != "not_rescued"):
        journal.write_event(session, journal.SESSION_RECOVERED, sync, **vars(done))
        journal.close_journal(session, sync)
    return done


def _recover_stream(session: Path, path: Path, done: Rescue, sync: bool) -> None:
    name = path.relative_to(session).as_posix()
    target = path.with_suffix(PARQUET_SUFFIX)
    stream = read_recording(path)
    if target.exists() and not read_recording(target).whole:  # the disk failed it: the stream still has all
        done.set_aside.append(set_aside(target, files.DAMAGED).relative_to(session).as_posix())
    if stream.whole:
        convert_to_parquet(path, sync)
        done.completed.append(name)
        return
    closed = read_recording(target) if target.exists() else None
    # a whole Parquet file of this stream, made before the stream was damaged, holds more
    keeps = closed is not None and closed.outcome.get("status") != RECOVERED and closed.metadata == stream.metadata
    if stream.columns and not keeps:
        save_as_parquet(as_recovered(stream), target, sync)
    done.recovered.append(f"{name} ({'; '.join([f'{stream.rows} ticks kept', *stream.damaged])})")
    done.set_aside.append(set_aside(path, files.CRASHED).relative_to(session).as_posix())


def as_recovered(stream: Recording) -> Recording:
    """The readable part of a stream, marked as recovered."""
    outcome = {**stream.outcome, "status": RECOVERED, "reason": stream.faults}
    return replace(stream, outcome=outcome, complete=True, damaged=[])


def _recover_table(session: Path, done: Rescue) -> None:
    """Add missing rows, then update those that differ from the journal."""
    table = session / files.TABLE
    try:
        rows, is_spoilt = as_rows(read_table(table)) if table.exists() else [], False
    except InputError:  # every row can be made again
        rows, is_spoilt = [], True
    summary = journal.journal_summary(session)
    done.not_rescued += [f"{journal.NAME}: {fault}" for fault in summary.faults]
    is_spoilt = is_spoilt or len({row.run for row in rows}) < len(rows)
    bare = {row.run: row for row in journal.rows_without_recording(session, summary)}
    on_disk = files.runs_on_disk(session)
    missing = {*on_disk, *bare} - {row.run for row in rows}
    by_hand = missing and table.exists() and table.read_bytes() != table_bytes(as_table(rows))
    if is_spoilt or by_hand:
        done.set_aside.append(set_aside(table, files.DAMAGED).name)
        missing = {*on_disk, *bare}
    for run in sorted(missing):
        row, path = bare.get(run), on_disk.get(run, {}).get(PARQUET_SUFFIX)
        with done.rescuing(session):
            if path is not None:
                row = None
                recording = read_recording(path)
                if not recording.whole:
                    raise InputError(f"{path}: {'; '.join(recording.damaged)}")
                row = summary.row(row_of(recording, session))
        if row is not None:
            append_row(table, row, names=summary.names)
            done.rows_added.append(f"{files.TABLE}: run {run}, {row.status}")
    rows = files.rows_of(session)
    right = journal.rows_as_journalled(session, rows, summary)
    if right != rows:
        write_table(table, as_table(right), replacing=True)
        changed = [str(new.run) for old, new in zip(rows, right, strict=True) if new != old]
        done.rows_changed.append(f"{files.TABLE}: run {', '.join(changed)}, as the journal says")
