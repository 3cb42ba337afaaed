"""Closes trials: the ticks of one that has ended become a Parquet file. What a crash left is put right the same way.

In this order: the file under another name, on the disk, compared with the database, named; then in one commit its
SHA-256, the trial's row and the line of the journal, and the ticks leave the database. A crash at any point leaves
ticks and outcome in the database, and closing begins again.
"""

import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from core.files import InputError
from experiments.analysis.trials_table import row_of
from experiments.atomic_files import make_folders, new_beside, retry_while_locked, sync_file, sync_folder
from experiments.recording import Recording
from experiments.store.database import Database, Stored, reading
from experiments.store.files import TRIALS, StoredTrial, add_row, rows_of, trials_in
from experiments.store.journal import JournalSummary, unmeasured_row
from experiments.store.parquet import as_json, described, digest_of, pieces_of, write_parquet
from experiments.store.reader import batches, column_names, pieces, read_trial

RECOVERED = "recovered"
TAKEN = "taken"  # fact about a session: the SHA-256 of what it took from another place


def close_trial(session: Path, database: Database, number: int, sync: bool = True) -> Recording:
    """Make the file of a trial that has ended, and let its ticks leave the database with the next commit.

    OSError: the disk takes no more, and nothing has changed.
    """
    with reading(session) as stored:
        trial = next(trial for trial, _ in trials_in(stored) if trial.number == number)
        path = session / trial.name
        if trial.ticks and not trial.sha256:
            make_folders(path.parent, sync)
            with new_beside(path) as partial:
                write_parquet(partial, trial.about, trial.outcome, pieces(stored, trial))
                _refuse_difference(partial, stored, trial)
                if sync:
                    sync_file(partial)
                trial = trial._replace(bytes=partial.stat().st_size, sha256=digest_of(partial))
                retry_while_locked(os.replace, partial, path)
            if sync:
                sync_folder(path.parent)
            database.put("trial", *trial)
            database.drop_ticks(number)
        return read_trial(stored, trial, True, path)


def _refuse_difference(file: Path, stored: Stored, trial: StoredTrial) -> None:
    """OSError unless the file holds what the database does, bit by bit."""
    about = described(trial.about)
    names = column_names(about)
    for found, right in zip(pieces_of(file, about["words"]), pieces(stored, trial), strict=True):
        for name, values in zip(names, right, strict=True):
            if found[name].astype(np.float64).tobytes() != values.tobytes():
                raise OSError(f"{file}: what was read back differs from what was written")


@dataclass
class Repaired:
    """What was put right as a session was opened; a sentence or name each."""

    trials: list[str] = field(default_factory=list)  # closed now, with the ticks that were kept
    rows: list[str] = field(default_factory=list)
    ticks_kept_elsewhere: int = 0  # that the disk had refused
    not_repaired: list[str] = field(default_factory=list)

    @property
    def is_something(self) -> bool:
        """Whether anything was changed."""
        return bool(self.trials or self.rows or self.ticks_kept_elsewhere)

    def sentence(self) -> str:
        """For the experimenter; "": nothing was changed."""
        parts = []
        if self.ticks_kept_elsewhere:
            parts.append(f"{self.ticks_kept_elsewhere:,} ticks that the disk had refused are in the session now")
        if self.trials:
            parts.append(f"what a crash had left open is closed: {', '.join(self.trials)}")
        if self.rows and not self.trials:
            parts.append(f"rows that were missing are made again: {', '.join(self.rows)}")
        parts += [f"it cannot be repaired: {fault}" for fault in self.not_repaired]
        return ". ".join(part[0].upper() + part[1:] for part in parts) + ("." if parts else "")


def repair(session: Path, database: Database, summary: JournalSummary, sync: bool = True) -> Repaired:
    """Close what a crash left open, and commit it. A session without damage is not touched. OSError: the disk."""
    done = Repaired(not_repaired=list(summary.faults))
    for place in rescue_places(database.identity):
        if place.exists():
            try:
                done.ticks_kept_elsewhere += _take_rescued(session, database, place)
                place.unlink()
            except InputError as error:
                done.not_repaired.append(str(error))
    with reading(session) as stored:
        trials = list(trials_in(stored))
    runs = {row.run for row in rows_of(session)}
    for trial, whole in trials:
        if not whole:
            done.not_repaired.append(f"{trial.name}: its description was changed")
            continue
        if not trial.sha256 and (trial.ticks or not trial.outcome):
            done.trials.append(_close_again(session, database, trial, sync))
        if trial.folder == TRIALS and trial.run not in runs:
            _add_row(session, database, trial.number, summary, done)
    return done


def _take_rescued(session: Path, database: Database, place: Path) -> int:
    """Take what a session that ended left at another place; how many ticks. A crash may have come after that."""
    digest = json.dumps(digest_of(place))
    with reading(session) as stored:
        if (TAKEN, digest) in stored.whole_rows("about", "name = ?", TAKEN):
            return 0
    ticks = database.take_rescued(place)
    database.put("about", TAKEN, digest)
    database.commit()
    return ticks


def _close_again(session: Path, database: Database, trial: StoredTrial, sync: bool) -> str:
    """Close a trial that was cut off; one that has lost ticks counts as cut off, too. Its name and its ticks."""
    with reading(session) as stored:
        faults, ticks = [], 0
        for part, fault in batches(stored, trial):
            ticks += part.shape[1]
            faults += [fault] if fault else []
    if faults or not trial.outcome:
        outcome = {"status": RECOVERED, "reason": "; ".join(faults) or "cut off before its end"}
        database.put("trial", *trial._replace(outcome=as_json(outcome, "outcome"), ticks=ticks))
        database.commit()
    close_trial(session, database, trial.number, sync)
    database.commit()
    return f"run {trial.run}, {ticks:,} ticks" if trial.folder == TRIALS else f"practice {trial.run}, {ticks:,} ticks"


def _add_row(session: Path, database: Database, number: int, summary: JournalSummary, done: Repaired) -> None:
    with reading(session) as stored:
        trial = next(trial for trial, _ in trials_in(stored) if trial.number == number)
        recording = read_trial(stored, trial, True, session / trial.name)
    try:
        if recording.rows:
            row = row_of(recording, session)
        elif trial.run in summary.begun:
            row = unmeasured_row(session, summary.begun[trial.run], RECOVERED)
        else:
            raise InputError(f"{trial.name}: is not in the journal")
    except InputError as error:
        done.not_repaired.append(str(error))
        return
    row = summary.row(row)
    add_row(database, row)
    database.commit()
    done.rows.append(f"run {row.run} is {row.status}")


def rescue_places(identity: str) -> Iterator[Path]:
    """Where a session that ends while its disk takes nothing leaves what is in memory, the best place first."""
    own = os.environ.get("XDG_DATA_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "share"
    for folder in (Path(own) / "phd-rescued", Path(tempfile.gettempdir()) / f"phd-rescued-{Path.home().name}"):
        yield folder / f"{identity}.db"
