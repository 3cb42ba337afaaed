"""`phd verify`: was nothing in a folder changed or lost, is every recording whole or marked as recovered, and do the
tables agree with them?

Nothing is written. No faults: an unfinished plan, an empty folder, one that was hardly begun, and, in a session that a
live process holds, the trial in progress. Faults, each by file: every damaged batch or part of a recording; one whose
metadata fit neither its name, its session nor the journal; a trial that was cut off and not yet recovered; a recording
that trials.csv or the journal names and that is not there; a line of the journal that was changed, cannot be read, is
missing or doubled; session.json or study.json that was changed or lacks something; a trial without a row, or
with two; a row that its recording and the journal (skipped, redone, excluded, unblinded) contradict; a blind session
without its key. Practice trials have recordings and no rows: none is missing.

Notes are no faults: what an earlier version wrote without a checksum, a line that a crash cut off, numbers of the table
that differ in their last digits from what the recordings give here.

Checksums find accidents, not malice (`checksums`): who changes a file on purpose can change its checksum too.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import COLUMNS, TrialRow, as_rows, is_same_row, read_table, row_of, table_bytes
from experiments.plan import PRACTICE_BLOCK, counted
from experiments.progress import Progress, no_progress
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session import files
from experiments.session.blind import KEY, read_key
from experiments.session.checksums import NO_CHECKSUM
from experiments.session.consent import agreed
from experiments.session.files import cell
from experiments.session.journal import NAME, JournalSummary, journal_summary, rows_without_recording

#: Largest share by which a number of the table may differ from what the recording gives: library versions round apart.
TOLERANCE = 1e-6


def verify(folder: Path, progress: Progress = no_progress) -> dict:
    """Check every session of a data folder; the summary, with `faults` as a list of {"file", "fault"}.

    `warnings`: whole recordings whose motion the simulator's energy ledger contradicts. `notes`: no faults, but worth
    knowing. InputError if there is no such folder, or it holds other files but no session.
    """
    folder = Path(folder)
    sessions = files.sessions_in(folder)
    checks = []
    faults: list[tuple[str, str]] = []
    warnings: list[tuple[str, str]] = []
    notes: list[tuple[str, str]] = []
    if (folder / files.STUDY).exists():
        try:
            notes += [] if files.read_study(folder).has_checksum else [(files.STUDY, NO_CHECKSUM)]
        except InputError as error:
            faults.append((files.STUDY, files.relative_to(folder, str(error))))
    for number, session in enumerate(sessions, start=1):
        checks.append(_SessionCheck(session))
        inside = "" if session == folder else f"{session.relative_to(folder).as_posix()}/"
        faults += [(f"{inside}{file}", fault) for file, fault in checks[-1].faults]
        warnings += [(f"{inside}{file}", text) for file, text in checks[-1].warnings]
        notes += [(f"{inside}{file}", text) for file, text in checks[-1].notes]
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
        "notes": [{"file": file, "note": text} for file, text in notes],
        "warnings": [{"file": file, "warning": text} for file, text in warnings],
    }


class _SessionCheck:
    """The findings in one session."""

    def __init__(self, session: Path) -> None:
        self.session = session
        self.live = files.is_in_use(session)  # a process is writing in it
        self.whole = self.recovered = self.in_progress = 0  # recordings
        self.faults: list[tuple[str, str]] = []  # file (relative to the session), its fault
        self.warnings: list[tuple[str, str]] = []  # file, why its motion may be wrong, though it is whole
        self.notes: list[tuple[str, str]] = []  # file, a remark that is no fault
        if files.is_half_created(session):
            return
        self.journal = JournalSummary(session)
        self.rows: dict[int, TrialRow] = {}
        self.stored: files.StoredSession | None = None
        self._rounded: set[int] = set()  # runs whose numbers differ from their recordings in the last digits
        self._check_journal()
        self._check_stored()
        right_rows = self._check_recordings()
        self._check_table(right_rows)
        self._check_begun()

    def _check_recordings(self) -> list[TrialRow]:
        """Check every recording; the rows that those of trials must have."""
        found = {
            folder: list(filter(None, map(self._check_files, files.runs_on_disk(self.session, folder).values())))
            for folder in (files.TRIALS, files.PRACTICE)
        }
        for recording in found[files.PRACTICE]:
            self._right_row(recording)
        return [row for recording in found[files.TRIALS] if (row := self._right_row(recording)) is not None]

    def _check_table(self, right_rows: Sequence[TrialRow]) -> None:
        """Compare trials.csv with the recordings and the journal."""
        try:
            rows = files.rows_of(self.session)
            self.rows = {row.run: row for row in rows}
            self._check_each_once(rows)
        except InputError as error:
            self._fault(files.TABLE, error)
        else:
            self._check_written_here()
            for right in right_rows:
                self._check_row(right)
            self._check_rows_without_recording()
        if self._rounded:
            text = (
                "numbers differ in their last digits from what the recordings give here: rounding, or a changed digit"
            )
            self.notes.append((files.TABLE, f"{text} ({counted(len(self._rounded), 'run')})"))

    def _check_begun(self) -> None:
        """Name trials that the journal says were begun and that left neither recording nor row."""
        for run in sorted(set(self.journal.begun) - set(files.runs_on_disk(self.session)) - set(self.rows)):
            if not any(self.session.glob(f"trials/run-{run:03d}.*")):
                self._fault(f"trials/run-{run:03d}", "missing: the journal says that this trial was begun")
            elif not self.live:
                self._fault(files.TABLE, f"has no row for run {run}, which the journal says was begun")

    def _fault(self, file: str | Path, problem: str | InputError) -> None:
        name = file.relative_to(self.session).as_posix() if isinstance(file, Path) else file
        self.faults.append((name, files.relative_to(self.session, str(problem))))

    def _check_journal(self) -> None:
        try:
            self.journal = journal_summary(self.session)
        except InputError as error:
            self._fault(NAME, error)
            return
        for fault in self.journal.faults:
            self._fault(NAME, fault)
        self.notes += [(NAME, note) for note in self.journal.notes]
        if not (self.session / NAME).exists() and files.runs_used(self.session):
            self._fault(NAME, "missing")

    def _check_stored(self) -> None:
        """session.json, and the key of a session that was begun blind."""
        file, key = files.STORED, None
        try:
            self.stored = stored = files.read_stored(self.session)
            if not stored.has_checksum:
                self.notes.append((file, NO_CHECKSUM))
            files.stored_person(self.session, stored)
            folder = self.session.parent.name
            if folder.startswith("sub-") and folder != f"sub-{stored.participant}":
                self._fault(file, f"is of participant {stored.participant}, the folder is {folder}")
            if self.journal.plan_sha256 not in ("", stored.about["plan_sha256"]):
                self._fault(NAME, f"is the journal of another plan than that of {file}")
            self._check_consent(stored)
            if stored.about["blind"] and (self.journal.key is None or (self.session / KEY).exists()):
                file = KEY
                key = read_key(self.session, stored.about["key_sha256"])
        except InputError as error:
            self._fault(file, error)
        if key is not None and self.journal.key not in (None, key):
            self._fault(NAME, f"says that the session was opened with another key than {KEY}")

    def _check_consent(self, stored: files.StoredSession) -> None:
        """Whether a participant who was to be asked has agreed, and nothing is kept of one who declined."""
        answer = agreed(stored.about)
        if self.journal.agreed not in (None, answer):
            self._fault(NAME, f"contradicts {files.STORED}: whether the participant agreed to take part")
        if stored.protocol.consent is None or stored.about["person"] is not None:
            return
        if answer is None:
            self._fault(files.STORED, "the participant was not asked for the consent that the protocol wants")
        elif not answer:
            self.notes.append((files.STORED, "the participant declined to take part: nothing else is recorded"))
            if any(files.runs_used(self.session, folder) for folder in (files.TRIALS, files.PRACTICE)):
                self._fault(files.TRIALS, "there are recordings of a participant who declined to take part")

    def _check_files(self, of_run: dict[str, Path]) -> Recording | None:
        """Check the files of one trial; the recording that its row must match, None: none can be trusted."""
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

    def _right_row(self, recording: Recording) -> TrialRow | None:
        """The row of a whole recording, checked against its name, the session and the journal; None: it has none."""
        try:
            right = self.journal.row(row_of(recording, self.session))
        except InputError as error:
            self._fault(recording.path, error)
            return None
        path, is_practice = recording.path, recording.path.parent.name == files.PRACTICE
        if f"run-{right.run:03d}" != path.stem:
            self._fault(path, f"says that it is run {right.run}")
            return right
        if (right.block == PRACTICE_BLOCK) != is_practice:
            self._fault(path, f"says that it is of block {right.block}")
        elif self.stored and not is_practice and cell(right) not in map(cell, self.journal.plan(self.stored.plan)):
            self._fault(path, "says that it is a trial that the plan does not have")
        if self.stored and right.participant != self.stored.participant:
            self._fault(path, f"is of participant {right.participant}, the session of {self.stored.participant}")
        about, begun = recording.metadata, self.journal.begun.get(right.run)
        if right.run not in (self.journal.practice_begun if is_practice else self.journal.begun):
            if not self.live and recording.outcome["status"] != "recovered":  # that of a crash may have none
                self._fault(NAME, f"has no line that says that run {right.run} was begun, {path.name} is there")
        elif not is_practice and begun and any(about[name] != begun[name] for name in begun):
            self._fault(path, f"is not the trial that the journal says was begun as run {right.run}")
        return right

    def _check_each_once(self, rows: Sequence[TrialRow]) -> None:
        for run, count in Counter(row.run for row in rows).items():
            if count > 1:
                self._fault(files.TABLE, f"has {count} rows for run {run}")

    def _check_written_here(self) -> None:
        """Note what reading passes over, as a column whose name has changed."""
        table = self.session / files.TABLE
        if table.is_file() and not self.live and table.read_bytes() != table_bytes(read_table(table)):
            text = "is not as this version writes it: another version or a person wrote it, or a character changed"
            self.notes.append((files.TABLE, text))

    def _check_row(self, right: TrialRow) -> None:
        """Compare the row of a recording with what the recording gives."""
        if (row := self.rows.get(right.run)) is not None:
            self._compare(row, right, "its recording")
        elif not self.live:
            self._fault(files.TABLE, f"has no row for run {right.run} ({right.recording}): recover it")

    def _check_rows_without_recording(self) -> None:
        """Compare rows without a recording with the journal, both ways; name recordings that are gone."""
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
        """Report where a row differs from the right one."""
        has_own = self.stored is not None and self.stored.protocol.measure
        for column in (*COLUMNS, *sorted({*right.own, *(row.own if has_own else ())})):
            stored, right_value = row.value(column), right.value(column)
            if column == "controller_name" and None in (stored, right_value):
                continue  # session.json, which has the names, cannot be read: that is named by itself
            if column == "recording":
                stored, right_value = Path(stored).stem, Path(right_value).stem  # as a stream or as Parquet
            is_same = stored == right_value
            if isinstance(stored, float) and isinstance(right_value, float):
                is_same = math.isclose(stored, right_value, rel_tol=TOLERANCE, abs_tol=1e-12)
                self._rounded |= {row.run} if is_same and stored != right_value else set()
            if not is_same:
                shown, right_shown = (_shown(value) for value in (stored, right_value))
                self._fault(files.TABLE, f"run {row.run}: {column} is {shown}, {source} gives {right_shown}")


def _shown(value: object) -> str:
    text = str(value)
    return "empty" if value in (None, "") else text if len(text) <= 60 else f"{text[:60]}.."


def _pooled_faults(folder: Path) -> Iterator[str]:
    """How DATA/trials.csv differs from the tables of the sessions."""
    try:
        stored = as_rows(read_table(folder / files.TABLE))
        pooled = {(row.participant, row.run): row for row in stored}
    except InputError as error:
        yield files.relative_to(folder, str(error))
        return
    try:
        rows = {(row.participant, row.run): row for row in files.pooled_rows(folder)}
    except InputError:  # named already
        return
    for (participant, run), count in Counter((row.participant, row.run) for row in stored).items():
        if count > 1:
            yield f"run {run} of participant {participant}: has {count} rows"
    for key in sorted({*pooled, *rows}):
        trial = f"run {key[1]} of participant {key[0]}"
        if key not in rows:
            yield f"{trial}: no session's {files.TABLE} has it"
        elif key not in pooled:
            yield f"{trial}: is missing, the session's {files.TABLE} has it: recover it"
        elif not is_same_row(pooled[key], rows[key]):
            yield f"{trial}: differs from the session's {files.TABLE}"
