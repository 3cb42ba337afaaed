"""`phd verify`: is every recording of a folder whole, or marked as recovered, and do the tables agree with them?

Nothing is written. No faults: an unfinished plan, an empty folder, one that was hardly begun, and, in a session that a
live process holds, the trial in progress. Faults, each by file: every damaged batch or part of a recording; a trial
that was cut off and not yet recovered; a recording that trials.csv or the journal names and that is not there; a trial
without a row; a row that its recording and the journal (skipped, redone, excluded, unblinded) contradict; a stored plan
that was changed; a blind session without its key. Practice trials have recordings and no rows: none is missing.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import COLUMNS, TrialRow, read_table
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session import files
from experiments.session.blind import KEY, read_key
from experiments.session.journal import journal_summary, recorded_row, rows_without_recording

#: Largest share by which a number of the table may differ from what the recording gives: library versions round apart.
TOLERANCE = 1e-6


def verify(folder: Path, progress: Callable[[float], None] | None = None) -> dict:
    """Check every session of a data folder; the summary, with `faults` as a list of {"file", "fault"}.

    `warnings` likewise: recordings that are whole, of motion that the simulator's own energy ledger contradicts.
    InputError if there is no such folder or it holds no session but other files.
    """
    folder = Path(folder)
    sessions = files.sessions_in(folder)
    checks = []
    faults: list[tuple[str, str]] = []
    warnings: list[tuple[str, str]] = []
    if (folder / files.STUDY).exists():
        try:
            files.read_study(folder)
        except InputError as error:
            faults.append((files.STUDY, files.seen_from(folder, str(error))))
    for number, session in enumerate(sessions, start=1):
        checks.append(_SessionCheck(session))
        inside = "" if session == folder else f"{session.relative_to(folder).as_posix()}/"
        faults += [(f"{inside}{file}", fault) for file, fault in checks[-1].faults]
        warnings += [(f"{inside}{file}", text) for file, text in checks[-1].warnings]
        if progress:
            progress(number / len(sessions))
    in_use = sum(check.live for check in checks)
    if folder not in sessions and (folder / files.TABLE).exists() and not in_use and not files.is_in_use(folder):
        faults += [(files.TABLE, fault) for fault in _pooled_faults(folder)]
    return {
        "dir": str(folder),
        "sessions": len(sessions),
        "in_use": in_use,
        **{name: sum(getattr(check, name) for check in checks) for name in ("whole", "recovered", "in_progress")},
        "faults": [{"file": file, "fault": fault} for file, fault in faults],
        "warnings": [{"file": file, "warning": text} for file, text in warnings],
    }


class _SessionCheck:
    """What is found in one session."""

    def __init__(self, session: Path) -> None:
        """Check it."""
        self.session = session
        self.live = files.is_in_use(session)  # a process is writing in it
        self.whole = self.recovered = self.in_progress = 0  # recordings
        self.faults: list[tuple[str, str]] = []  # file (relative to the session), what is wrong
        self.warnings: list[tuple[str, str]] = []  # file, why its motion may be wrong, though it is whole
        if files.is_half_created(session):
            return
        self.journal = journal_summary(session)
        self.rows: dict[int, TrialRow] = {}
        self._check_stored()
        on_disk = files.runs_on_disk(session)
        recordings = [found for of_run in on_disk.values() if (found := self._check_files(of_run)) is not None]
        for of_run in files.runs_on_disk(session, files.PRACTICE).values():
            self._check_files(of_run)
        try:
            self.rows = {row.run: row for row in files.rows_of(session)}
        except InputError as error:
            self._fault(files.TABLE, error)
        else:
            for recording in recordings:
                self._check_row(recording)
            self._check_rows_without_recording()
        for run in sorted(set(self.journal.begun) - set(on_disk) - set(self.rows)):
            if not any(session.glob(f"trials/run-{run:03d}.*")):
                self._fault(f"trials/run-{run:03d}", "missing: the journal says that this trial was begun")
            elif not self.live:
                self._fault(files.TABLE, f"has no row for run {run}, which the journal says was begun")

    def _fault(self, file: str | Path, what: str | InputError) -> None:
        name = file.relative_to(self.session).as_posix() if isinstance(file, Path) else file
        self.faults.append((name, files.seen_from(self.session, str(what))))

    def _check_stored(self) -> None:
        """session.json, and the key of a session that is still blind."""
        file = files.STORED
        try:
            about = files.read_stored(self.session).about
            if about.get("blind") and self.journal.key is None:
                file = KEY
                read_key(self.session, str(about.get("key_sha256")))
        except InputError as error:
            self._fault(file, error)

    def _check_files(self, of_run: dict[str, Path]) -> Recording | None:
        """Check the files of one trial; the recording that its row must match, None where there is none to trust."""
        result = None
        for suffix in (PARQUET_SUFFIX, STREAM_SUFFIX):
            if (path := of_run.get(suffix)) is None:
                continue
            try:
                recording = read_recording(path)
            except InputError as error:
                if path.exists() or not self.live:  # else: closed and converted in the meantime
                    self._fault(path, error)
                continue
            cut_off = suffix == STREAM_SUFFIX and not recording.complete
            if recording.whole:
                if result is None:  # a stream beside its Parquet file counts once
                    result = recording
                    self._count(recording)
            elif self.live and cut_off and not (recording.columns and recording.damaged):  # or its header is coming
                self.in_progress += 1
            else:
                for fault in recording.damaged:
                    self._fault(path, fault)
                if cut_off:
                    self._fault(path, f"cut off before its end, {recording.rows} ticks are whole: recover it")
        return result

    def _count(self, recording: Recording) -> None:
        is_recovered = recording.outcome.get("status") == "recovered"
        self.recovered += is_recovered
        self.whole += not is_recovered
        name = recording.path.relative_to(self.session).as_posix()
        self.warnings += [(name, text) for text in recording.outcome.get("warnings", ())]

    def _check_row(self, recording: Recording) -> None:
        """The row of a recording against what the recording gives."""
        try:
            right = recorded_row(recording, self.session, self.journal)
        except InputError as error:
            self._fault(recording.path, error)
            return
        if f"run-{right.run:03d}" != recording.path.stem:
            self._fault(recording.path, f"says that it is run {right.run}")
        if (row := self.rows.get(right.run)) is not None:
            self._compare(row, right, "its recording")
        elif not self.live:
            name = recording.path.relative_to(self.session).as_posix()
            self._fault(files.TABLE, f"has no row for run {right.run} ({name}): recover it")

    def _check_rows_without_recording(self) -> None:
        """Rows without a recording against the journal, both ways; rows whose recording is gone."""
        bare = {row.run: row for row in rows_without_recording(self.session, self.journal)}
        for run, right in bare.items():
            if run in self.rows:
                self._compare(self.rows[run], right, "the journal")
            elif not self.live and run in self.journal.skipped:
                self._fault(files.TABLE, f"has no row for run {run}, which the journal says was skipped: recover it")
        for run, row in sorted(self.rows.items()):
            if not row.recording and run not in bare:
                self._fault(files.TABLE, f"run {run}: is {row.status} without a recording, the journal does not say so")
            if row.recording and not (self.session / row.recording).is_file():
                self._fault(row.recording, f"missing: {files.TABLE} names it as the recording of run {run}")

    def _compare(self, row: TrialRow, right: TrialRow, source: str) -> None:
        """Where a row differs from the right one."""
        for column in COLUMNS:
            there, true = getattr(row, column), getattr(right, column)
            if column == "recording":
                there, true = Path(there).stem, Path(true).stem  # a stream that is still to become Parquet
            is_same = there == true
            if isinstance(there, float) and isinstance(true, float):
                is_same = math.isclose(there, true, rel_tol=TOLERANCE, abs_tol=1e-12)
            if not is_same:
                shown, right_shown = ("empty" if value in (None, "") else value for value in (there, true))
                self._fault(files.TABLE, f"run {row.run}: {column} is {shown}, {source} gives {right_shown}")


def _pooled_faults(folder: Path) -> Iterator[str]:
    """How DATA/trials.csv differs from the tables of the sessions."""
    try:
        pooled = {(row.participant, row.run): row for row in read_table(folder / files.TABLE)}
    except InputError as error:
        yield files.seen_from(folder, str(error))
        return
    try:
        rows = {(row.participant, row.run): row for row in files.pooled_rows(folder)}
    except InputError:  # named already
        return
    for key in sorted({*pooled, *rows}):
        trial = f"run {key[1]} of participant {key[0]}"
        if key not in rows:
            yield f"{trial}: no session's {files.TABLE} has it"
        elif key not in pooled:
            yield f"{trial}: is missing, the session's {files.TABLE} has it: recover it"
        elif pooled[key] != rows[key]:
            yield f"{trial}: differs from the session's {files.TABLE}"
