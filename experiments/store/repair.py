"""Puts right what a crash, or a disk that took no more, has left of a session, as it is opened."""

import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from core.files import InputError
from experiments.analysis.trials_table import row_of
from experiments.recording import Recording
from experiments.store.cells import trial_names
from experiments.store.database import Database, StoredTrial, reading, trials_in
from experiments.store.files import TRIALS, add_row, rows_of
from experiments.store.journal import JournalSummary
from experiments.store.recording import as_json, batches, close_trial, digest_of, read_trial

RECOVERED = "recovered"
TAKEN = "taken"  # fact about a session: the SHA-256 of what it took from another place


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
    runs, closed, made = {row.run for row in rows_of(session)}, [], []
    for trial, whole in trials:
        if not whole:
            done.not_repaired.append(f"{trial.name}: its description was changed")
            continue
        recording = None
        if not trial.sha256 and (trial.ticks or not trial.outcome):
            recording = _close_again(database, trial, sync)
            closed.append((trial, recording.rows))
        if trial.folder == TRIALS and trial.run not in runs:
            try:
                row = summary.row(row_of(recording or _read(session, trial), session))
                add_row(database, row)
                made.append(row)
            except InputError as error:
                done.not_repaired.append(str(error))
        database.commit()
    rows = {row.run: row for row in (*rows_of(session), *made)}.values()  # a full disk may not have taken those made
    names = {run: name for (_, run), name in trial_names(rows).items()}
    for trial, ticks in closed:
        name = names.get(trial.run, f"trial {trial.run}") if trial.folder == TRIALS else f"practice {trial.run}"
        done.trials.append(f"{name}, {ticks:,} ticks")
    done.rows += [f"{names[row.run]} is {row.status}" for row in made]
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


def _close_again(database: Database, trial: StoredTrial, sync: bool) -> Recording:
    """Close a trial that was cut off; one that has lost ticks counts as cut off, too."""
    with reading(database.path.parent) as stored:
        found = [(part.shape[1], fault) for part, fault in batches(stored, trial)]
    faults = [fault for _, fault in found if fault]
    if faults or not trial.outcome:
        outcome = {"status": RECOVERED, "reason": "; ".join(faults) or "cut off before its end"}
        trial = trial._replace(outcome=as_json(outcome, "outcome"), ticks=sum(ticks for ticks, _ in found))
        database.put("trial", *trial)
    return close_trial(database, trial, sync)


def _read(session: Path, trial: StoredTrial) -> Recording:
    with reading(session) as stored:
        return read_trial(stored, trial, True, session / trial.name)


def rescue_places(identity: str) -> Iterator[Path]:
    """Where a session that ends while its disk takes nothing leaves what is in memory, the best place first."""
    own = os.environ.get("XDG_DATA_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "share"
    for folder in (Path(own) / "phd-rescued", Path(tempfile.gettempdir()) / f"phd-rescued-{Path.home().name}"):
        yield folder / f"{identity}.db"
