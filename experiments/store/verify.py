"""`phd verify`: is everything in a folder that was recorded there, and is nothing changed, lost or from elsewhere?

Nothing is written, and no file of the participant's own is run. No faults: an unfinished plan, an empty folder, one
that was hardly begun, and, in a session that a live process holds, the trial in progress. Notes are no faults.
Checksums find accidents, not malice: who changes a file on purpose can change its checksum too.
"""

from collections.abc import Iterator
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import TrialRow, as_table, table_bytes
from experiments.inputs import is_person
from experiments.progress import Progress, no_progress
from experiments.store import files
from experiments.store.consent import agreed
from experiments.store.database import DATABASE, Stored, StoredTrial, reading, trials_in
from experiments.store.journal import read_journal
from experiments.store.recording import batches, fault_of_file, read_trial
from experiments.store.repair import RECOVERED
from experiments.store.stored import StoredSession, read_stored, stored_person
from experiments.store.study_plan import identities_in, read_sessions, read_study

Faults = Iterator[tuple[str, str]]  # file, its fault


def verify(folder: Path, progress: Progress = no_progress) -> dict:
    """Check every session of a data folder; the summary, with `faults` as a list of {"file", "fault"}.

    `warnings`: whole recordings whose motion the simulator's energy ledger contradicts. `notes`: no faults, but worth
    knowing. InputError if there is no such folder, or it holds other files but no session.
    """
    folder = Path(folder)
    sessions = files.sessions_in(folder)
    found = _Found()
    for place, why in sessions.left_out.items():
        found.faults.append((place.relative_to(folder).as_posix(), f"{why}; every reader leaves it out"))
    for number, session in enumerate(sessions.folders, start=1):
        found.check(session, "" if session == folder else f"{session.relative_to(folder).as_posix()}/")
        progress(number / len(sessions.folders))
    if (folder / files.STUDY).exists():
        found.faults += _faults_of_study(folder, bool(found.in_use) or files.is_in_use(folder))
    return {
        "dir": str(folder),
        "sessions": len(sessions.folders),
        **{name: getattr(found, name) for name in ("in_use", "whole", "recovered", "in_progress")},
        "faults": [{"file": file, "fault": fault} for file, fault in found.faults],
        "notes": [{"file": file, "note": text} for file, text in found.notes],
        "warnings": [{"file": file, "warning": text} for file, text in found.warnings],
    }


class _Found:
    """The findings in all sessions."""

    def __init__(self) -> None:
        self.in_use = self.whole = self.recovered = self.in_progress = 0  # sessions; recordings
        self.faults: list[tuple[str, str]] = []  # file, its fault
        self.notes: list[tuple[str, str]] = []
        self.warnings: list[tuple[str, str]] = []

    def check(self, session: Path, inside: str) -> None:
        """inside: begins the names of its files."""
        live = files.is_in_use(session)
        self.in_use += live
        database = f"{inside}{DATABASE}"
        try:
            with reading(session) as stored:
                self.faults += [(database, fault) for fault in (*stored.broken_pages(), *stored.faults().values())]
                for trial, whole in trials_in(stored):
                    self._check_trial(stored, trial, whole, live, inside)
            said = read_stored(session)
            stored_person(session, said)
            self._check_consent(session, said, database)
            journal = read_journal(session)
            self.faults += [(database, fault) for fault in journal.faults if (database, fault) not in self.faults]
            self.notes += [(database, note) for note in journal.notes]
            if not live:
                self._check_rows(session, inside)
        except (InputError, OSError) as error:
            self.faults.append((database, files.relative_to(session, str(error))))

    def _check_consent(self, session: Path, said: StoredSession, database: str) -> None:
        """The answer of a person who was to be asked; nothing was recorded of one who declined."""
        if said.protocol.consent is None or not is_person(said.about["hand"]):
            return
        answer = agreed(said.about)
        if answer is None:
            self.faults.append((database, "the participant was not asked for the consent that the protocol wants"))
        elif not answer and files.runs_used(session):
            self.faults.append((database, "there are recordings of a participant who declined to take part"))
        elif not answer:
            self.notes.append((database, "the participant declined to take part"))

    def _check_trial(self, stored: Stored, trial: StoredTrial, whole: bool, live: bool, inside: str) -> None:
        name, path = f"{inside}{trial.name}", stored.path.parent / trial.name
        if not whole:
            self.faults.append((name, "its description does not match its checksum, it was changed"))
        elif trial.sha256:
            if fault := fault_of_file(trial, path):
                self.faults.append((name, fault))
                return
            outcome = read_trial(stored, trial._replace(sha256="", ticks=0), True, path).outcome
            self.whole += outcome.get("status") != RECOVERED
            self.recovered += outcome.get("status") == RECOVERED
            self.warnings += [(name, text) for text in outcome.get("warnings", ())]
        elif faults := [fault for _, fault in batches(stored, trial) if fault]:
            self.faults += [(name, fault) for fault in faults]
        elif live:
            self.in_progress += 1
        elif trial.ticks or not trial.outcome:
            self.faults.append((name, "cut off before its end; it is closed when the session is opened"))

    def _check_rows(self, session: Path, inside: str) -> None:
        rows = files.rows_of(session)
        with_row = {row.run for row in rows}
        for trial in files.stored_trials(session):
            if trial.sha256 and trial.run not in with_row:
                self.faults.append((f"{inside}{trial.name}", "has no row; it gets one when the session is opened"))
        made = "it is made again at the end of the next trial, or when the session is opened"
        self.faults += _faults_of_table(session / files.TABLE, rows, f"{inside}{files.TABLE}", made)


def _faults_of_study(folder: Path, live: bool) -> Faults:
    """Whether a study has its sessions, and its table their rows."""
    try:
        read_study(folder)
        with reading(folder, files.STUDY) as stored:
            for fault in (*stored.broken_pages(), *stored.faults().values()):
                yield files.STUDY, fault
        there = identities_in(folder)
        for name, identity in read_sessions(folder).items():
            if name not in there:
                yield name, f"is missing, and {files.STUDY} counts it"
            elif there[name] != identity:
                yield name, "is another session than the one that the study ran"
        if not live:
            made = "phd study --resume makes it again"
            yield from _faults_of_table(folder / files.TABLE, files.pooled_rows(folder), files.TABLE, made)
    except InputError as error:
        yield files.STUDY, files.relative_to(folder, str(error))


def _faults_of_table(table: Path, rows: list[TrialRow], name: str, made_again: str) -> Faults:
    """A table is what is written of the rows."""
    if not table.exists():
        if rows:
            yield name, f"is missing; {made_again}"
    elif table.read_bytes() != table_bytes(as_table(rows)):
        yield name, f"is stale or was edited: it differs from the rows in {DATABASE}; {made_again}"
