"""The files of a data folder: where they are, which sessions belong there, and who may write them.

DATA/sub-01/ses-01/session.db                everything about the session (`database`)
                   trials/run-001.parquet    the ticks of a trial that has ended; practice/run-001.parquet: of practice
                   trials.csv                the rows, one a trial, in the order in which they were run: made from it
                   .lock                     held by the one process that may write here
DATA/study.db                                what a study was begun with, and its sessions
DATA/trials.csv                              of a study: the rows of all participants
"""

import contextlib
import json
import os
import sys
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import NamedTuple, Self

import filelock

from core.files import InputError
from experiments.analysis.trials_table import TrialRow, Trials, as_table, table_bytes, write_table
from experiments.atomic_files import reading_stored, replace_file
from experiments.store.database import DATABASE, Database, Stored, StoredTrial, reading, trials_in

LOCK = ".lock"
STUDY = "study.db"
TABLE = "trials.csv"
TRIALS, PRACTICE = "trials", "practice"
SESSION = "ses-01"


def session_folder(data_dir: Path, participant: str) -> Path:
    return data_dir / f"sub-{participant}" / SESSION


def is_half_created(session: Path) -> bool:
    """Whether nothing of the session was stored, so that there is nothing to keep."""
    database = session / DATABASE  # empty: the power failed in a study, which does not wait for the disk
    return not database.exists() or not database.stat().st_size


def remove_empty(session: Path) -> None:
    """Remove the empty folders of a session that was not created."""
    for folder in (session, session.parent):
        with contextlib.suppress(OSError):  # there is something, or it is gone
            folder.rmdir()


def refuse_existing(data_dir: Path, participant: str) -> None:
    folder = session_folder(data_dir, participant)
    if folder.exists() and not is_half_created(folder):
        raise InputError(f"{folder}: exists already, a session is never overwritten; name another participant")


def free_participant(data_dir: Path, participants: Sequence[str] = ()) -> str:
    """The first participant of the protocol without a session; if it names none, the first free number of two digits.

    InputError if each of them has a session.
    """
    for label in participants or (f"{number:02d}" for number in count(1)):
        if not session_folder(data_dir, label).exists():
            return label
    raise InputError(f"{data_dir}: every participant of the protocol has a session ({', '.join(participants)})")


def refuse_no_folder(folder: Path) -> None:
    """InputError unless there is such a folder. OSError: it may not be read, which no `glob` in it would say."""
    if not folder.is_dir():
        raise InputError(f"{folder}: {'is not a folder' if folder.exists() else 'there is no such folder'}")
    os.scandir(folder).close()


# ------------------------------------------------------------------------------------------------- which sessions count


class Sessions(NamedTuple):
    """The sessions of a data folder."""

    folders: list[Path]  # of those that belong there
    left_out: dict[Path, str]  # of others -> why; copies, folders that were renamed, databases that cannot be read

    def sentences(self, folder: Path) -> list[str]:
        """What is left out, a sentence each."""
        return [f"{relative_to(folder, f'{path}')} is left out: {why}" for path, why in self.left_out.items()]


def sessions_in(folder: Path) -> Sessions:
    """The sessions of a data folder; or the folder itself, if it is a session.

    InputError if there is no such folder, or it holds files but no study or session.
    """
    refuse_no_folder(folder)
    if (folder / DATABASE).exists():
        places = [folder]
    else:
        places = sorted({file.parent for depth in ("*", "*/*") for file in folder.glob(f"{depth}/{DATABASE}")} | {
            path for path in (*folder.glob("sub-*/ses-*"), *folder.glob("ses-*")) if path.is_dir()
        })  # fmt: skip
    found = Sessions([], {})
    for place in places:
        if why := why_left_out(place):
            found.left_out[place] = why
        elif not is_half_created(place):
            found.folders.append(place)
        for other in place.glob("session*.db"):
            if other.name != DATABASE:
                found.left_out[other] = f"a conflict copy: {DATABASE} beside it is the session"
    ours = (STUDY, TABLE, "sub-", ".")
    if not places and any(not path.name.startswith(ours) for path in folder.iterdir()):
        raise InputError(f"{folder}: holds no session (sub-*/{SESSION}), and other files")
    return found


def why_left_out(session: Path) -> str:
    """Why a session's folder is not the one in which it was recorded, or cannot be read; "": it is."""
    if is_half_created(session):
        return f"its {DATABASE} is missing" if any(session.glob("*/run-*.parquet")) else ""
    try:
        with reading(session) as stored:
            own = f"sub-{participant_of(stored)}"
    except InputError as error:
        return relative_to(session, str(error))
    except OSError as error:
        return f"cannot be read ({error})"
    place = session.absolute()
    if (place.parent.name, place.name) == (own, SESSION):
        return ""
    return f"it holds the session of {own}/{SESSION}: the folder is a copy, or was renamed"


def participant_of(stored: Stored) -> str:
    """Whose session it is. InputError: it does not say."""
    for _, value in stored.whole_rows("about", "name = 'participant'"):
        return str(json.loads(value))
    raise InputError(f"{stored.path}: is damaged (it does not say whose session it is)")


def planned_trials(session: Path) -> int:
    """How many trials a session's plan has. InputError: it cannot be read."""
    with reading_stored(session / DATABASE), reading(session) as stored:
        return sum(1 for _ in stored.whole_rows("plan"))


def relative_to(folder: Path, sentence: str) -> str:
    """A sentence with its paths relative to the folder."""
    return sentence.replace(f"{folder}{os.sep}", "")


# ----------------------------------------------------------------------------------------------- recordings and rows


def stored_trials(session: Path, folder: str = TRIALS) -> list[StoredTrial]:
    """The trials of a session that have begun, by their runs."""
    with contextlib.suppress(FileNotFoundError), reading(session) as stored:
        return sorted((trial for trial, _ in trials_in(stored) if trial.folder == folder), key=lambda trial: trial.run)
    return []


def runs_used(session: Path, folder: str = TRIALS) -> list[int]:
    """The runs that were begun, rising."""
    return [trial.run for trial in stored_trials(session, folder)]


def recordings_in(session: Path) -> list[Path]:
    """The recordings of a session's trials, by run, whether or not their files are there."""
    return [session / trial.name for trial in stored_trials(session) if trial.ticks or not trial.outcome]


def lost_recordings(sessions: Sequence[Path]) -> list[str]:
    """A sentence for each participant some of whose closed trials have no file, or one of another size."""
    sentences = []
    for session in sessions:
        closed = {session / trial.name: trial.bytes for trial in stored_trials(session) if trial.sha256}
        if lost := sum(not file.exists() or file.stat().st_size != size for file, size in closed.items()):
            are, verb = ("recordings", "are") if lost > 1 else ("recording", "is")
            participant = session.parent.name.removeprefix("sub-")
            sentences.append(f"left out: {lost} {are} of participant {participant} {verb} missing or cut")
    return sentences


def rows_of(session: Path) -> list[TrialRow]:
    """The rows of a session, in the order in which they were added; none of one that has no trial yet.

    InputError if one is damaged.
    """
    with contextlib.suppress(FileNotFoundError), reading(session) as stored:
        return [TrialRow(**json.loads(cells)) for _, _, cells in stored.whole_rows("result")]
    return []


def add_row(database: Database, row: TrialRow) -> None:
    """A new row, for the next commit."""
    database.add("result", row.run, _cells(row))


def put_row(database: Database, row: TrialRow, number: int) -> None:
    """A row in place of the one of this number (1 ..), for the next commit."""
    database.put("result", number, row.run, _cells(row))


def _cells(row: TrialRow) -> str:
    return json.dumps({name: value for name, value in vars(row).items() if name != "failed"}, allow_nan=False)


def write_session_table(session: Path, rows: Sequence[TrialRow], sync: bool = True) -> None:
    """Write a session's trials.csv, from its rows, unless it is that already."""
    table, content = session / TABLE, table_bytes(as_table(rows))
    if rows and not (table.exists() and table.read_bytes() == content):
        replace_file(table, content, sync)


def pooled_rows(data_dir: Path) -> list[TrialRow]:
    """The rows of all sessions of a data folder, by session and run."""
    rows = []
    for session in sessions_in(data_dir).folders:
        place = Path(os.path.relpath(session, data_dir)).as_posix()
        rows += [row.in_folder(place) for row in sorted(rows_of(session), key=lambda row: row.run)]
    return rows


def write_pooled_table(data_dir: Path) -> Trials:
    """Write DATA/trials.csv of a study from the sessions; returns it."""
    trials = as_table(pooled_rows(data_dir))
    write_table(data_dir / TABLE, trials, replacing=True)
    return trials


def refuse_study(folder: Path) -> None:
    """InputError if the folder holds a study, whose tables are of simulated operators alone."""
    if (folder / STUDY).exists():
        raise InputError(f"{folder}: holds a study, which takes no other session; choose another data folder")


# ------------------------------------------------------------------------------------------------------- who may write


class _HeldLock(filelock.FileLock):
    """A lock that is held already; `with` releases it."""

    def __enter__(self) -> Self:
        return self


class InUse(InputError):
    """Another process holds the lock of a folder."""


def hold_lock(folder: Path, wait_s: float = 0.0) -> filelock.BaseFileLock:
    """Take the folder's lock, until it is released, `with` it ends, or the process ends.

    InUse if a live process still holds it after `wait_s`. PermissionError: nobody does, but it is another user's.
    """
    lock = _HeldLock(folder / LOCK)
    try:
        lock.acquire(timeout=wait_s)
    except (filelock.Timeout, PermissionError) as error:
        if isinstance(error, PermissionError) and not _is_held_by_another_user(folder / LOCK):
            raise
        raise InUse(f"{folder}: another PHD window or study is using this folder; choose another one") from None
    return lock


def _is_held_by_another_user(lock: Path) -> bool:
    """Whether a live process holds a lock that this user may not take, but read. Windows: not known."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        with lock.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


def is_in_use(folder: Path) -> bool:
    """Whether a live process holds the lock of a folder; writes nothing."""
    try:
        if (folder / LOCK).exists():
            hold_lock(folder).release()
    except InputError:
        return True
    except OSError:  # the lock cannot be opened, as on a read-only disk: no process writes there
        return False
    return False
