"""The files of a data folder: where they are, who may write them, and what is stored about a session or a study.

DATA/sub-01/ses-01/session.json                plan, hash, protocol, device and brake files in full, versions
                   key.json                    of a blind session alone: which controller each code is
                   journal.jsonl               one line an event
                   journal.end                 how long the journal was when the session was last left in order
                   trials/run-001.arrows       a trial in progress, or what a crash left of it
                   trials/run-001.parquet      a trial that is closed and verified
                   trials/run-001.arrows.crashed   the stream of a recovered trial, as the crash left it
                   practice/run-001.parquet    a practice trial, which has no row anywhere
                   trials.csv                  one row a trial, in the order in which they were run
                   .lock                       held by the one process that may write here
DATA/trials.csv                                the rows of all participants
DATA/study.json                                what a study was begun with: operators, population, protocol, in full

Each carries a checksum (recordings: see `recording.schema`; the others: see `checksums`), but for the tables, whose
every cell follows from recordings and journal, and the key, whose SHA-256 stands in session.json.
"""

import contextlib
import math
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Self

import filelock

from core.files import InputError
from experiments.analysis.trials_table import (
    COUNTED,
    FINISHED,
    TrialRow,
    Trials,
    as_rows,
    as_table,
    read_table,
    with_name,
    write_table,
)
from experiments.inputs import INPUTS
from experiments.plan import PlannedTrial, participant_index, plan_from_json, plan_hash
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import reading_stored, write_new_file
from experiments.session.checksums import CHECKSUM, read_sealed, sealed
from experiments.trial.operator import Person
from experiments.trial.population import Population, population_of

LOCK = ".lock"
STORED = "session.json"
STUDY = "study.json"
TABLE = "trials.csv"
TRIALS, PRACTICE = "trials", "practice"
CRASHED, DAMAGED = "crashed", "damaged"  # how files are marked that `phd recover` set aside


def session_folder(data_dir: Path, participant: str) -> Path:
    return data_dir / f"sub-{participant}" / "ses-01"


def run_path(session: Path, run: int, suffix: str, folder: str = TRIALS) -> Path:
    return session / folder / f"run-{run:03d}{suffix}"


def runs_on_disk(session: Path, folder: str = TRIALS) -> dict[int, dict[str, Path]]:
    """Run number -> suffix -> file of every run with a stream or a Parquet file, by rising number."""
    found: dict[int, dict[str, Path]] = {}
    for path in session.glob(f"{folder}/run-*"):
        if path.suffix in (STREAM_SUFFIX, PARQUET_SUFFIX) and (match := re.fullmatch(r"run-(\d+)", path.stem)):
            found.setdefault(int(match[1]), {})[path.suffix] = path
    return dict(sorted(found.items()))


def recordings_in(session: Path) -> list[Path]:
    """The recordings of a session, by run; a stream counts where it has no Parquet file yet."""
    return [files.get(PARQUET_SUFFIX) or files[STREAM_SUFFIX] for files in runs_on_disk(session).values()]


def runs_used(session: Path, folder: str = TRIALS) -> set[int]:
    """Every run number that a file has or had."""
    names = (re.match(r"\.?run-(\d+)\.", path.name) for path in session.glob(f"{folder}/*run-*"))
    return {int(match[1]) for match in names if match}


def is_half_created(session: Path) -> bool:
    """Whether a crash came before the session was stored, so that there is nothing to keep."""
    return not (session / STORED).exists() and not (session / TABLE).exists() and not runs_used(session)


def remove_empty(session: Path) -> None:
    """Remove the empty folders of a session that was not created."""
    for folder in (session / TRIALS, session, session.parent):
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


def sessions_in(folder: Path) -> list[Path]:
    """Every session of a data folder; or the folder itself, if it is a session.

    InputError if there is no such folder, or it holds files but no study or session.
    """
    refuse_no_folder(folder)
    if (folder / STORED).exists() or (folder / TRIALS).is_dir():
        return [folder]
    sessions = sorted(path for path in (*folder.glob("sub-*/ses-*"), *folder.glob("ses-*")) if path.is_dir())
    ours = (STUDY, TABLE, "sub-", ".")
    if not sessions and any(not path.name.startswith(ours) for path in folder.iterdir()):
        raise InputError(f"{folder}: holds no session (sub-*/ses-*), and other files")
    return sessions


def relative_to(folder: Path, sentence: str) -> str:
    """A sentence with its paths relative to the folder."""
    return sentence.replace(f"{folder}{os.sep}", "")


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


@dataclass(frozen=True)
class StoredSession:
    """The content of session.json."""

    participant: str
    protocol: Protocol
    plan: tuple[PlannedTrial, ...]  # over codes if the session was begun blind
    about: dict[str, Any]  # everything

    @property
    def has_checksum(self) -> bool:
        """False: an earlier version stored it."""
        return CHECKSUM in self.about


#: What session.json holds that nothing else can tell -> its type.
_NEEDED = {
    "participant": str, "hand": str, "person": dict | None, "protocol": dict, "blind": bool, "key_sha256": str,
    "plan": list, "plan_sha256": str, "seed": int,
}  # fmt: skip


def read_stored(session: Path) -> StoredSession:
    """Read session.json. InputError if it cannot be read, lacks something or was changed."""
    path = session / STORED
    about = read_sealed(path)
    if missing := [key for key in _NEEDED if key not in about]:
        raise InputError(f"{path}: is damaged (it lacks {' and '.join(missing)})")
    if wrong := [key for key, kind in _NEEDED.items() if not isinstance(about[key], kind)]:
        raise InputError(f"{path}: is damaged ({' and '.join(wrong)} cannot be read)")
    if about["hand"] not in INPUTS:
        raise InputError(f"{path}: hand {about['hand'][:40]!r} is none of {', '.join(INPUTS)}")
    participant_index(about["participant"])  # InputError unless it is a label
    with reading_stored(path):
        plan = plan_from_json(about["plan"])
        if plan_hash(plan) != about["plan_sha256"]:
            raise InputError(f"{path}: plan: does not match plan_sha256, it was changed")
        protocol = protocol_from_json(about["protocol"], str(path))
    for trial in plan:
        refuse_trial(trial, protocol, f"{path}: plan")
    return StoredSession(about["participant"], protocol, plan, about)


def refuse_trial(trial: PlannedTrial | TrialRow, protocol: Protocol, where: str) -> None:
    """InputError if a protocol lacks the device, the path or the controller of a trial."""
    lacks = {
        f"device {trial.configuration}": trial.configuration not in {device.name for device in protocol.devices},
        f"path {trial.segment}": trial.segment not in protocol.paths,
        f"controller {trial.controller}": isinstance(trial.controller, int)
        and trial.controller not in protocol.controllers,
    }
    if any(lacks.values()):
        missing = ", ".join(name for name, is_missing in lacks.items() if is_missing)
        raise InputError(f"{where}: the {protocol.name} protocol of the session has no {missing}")


def stored_person(session: Path, stored: StoredSession) -> Person | None:
    """The simulated operator of a stored session; None: a person. InputError: it cannot be read."""
    about = stored.about["person"]
    with reading_stored(session / STORED):
        person = Person(**about) if about else None
    for name, value in (about or {}).items():
        if not isinstance(value, float | int) or isinstance(value, bool) or not math.isfinite(value):
            raise InputError(f"{session / STORED}: person: {name} must be a number")
    return person


def other_protocol(data_dir: Path, participant: str, protocol: Protocol) -> str:
    """The participant of the newest other session, if that was run by another protocol; else ""."""
    others = [path for path in data_dir.glob(f"sub-*/ses-01/{STORED}") if path.parents[1].name != f"sub-{participant}"]
    for path in sorted(others, key=lambda path: path.stat().st_mtime, reverse=True):
        with contextlib.suppress(InputError), reading_stored(path):  # one that cannot be read does not count
            same = read_sealed(path)["protocol"] == protocol_to_json(protocol)
            return "" if same else path.parents[1].name.removeprefix("sub-")
    return ""


def controller_names(session: Path) -> dict[int, str]:
    """Controller -> its name in the session's protocol; empty if that cannot be read (`phd verify` says why)."""
    with contextlib.suppress(InputError):
        return {number: preset.name for number, preset in read_stored(session).protocol.controllers.items()}
    return {}


def rows_of(session: Path) -> list[TrialRow]:
    """The rows of a session's table, with names of controllers; empty if there is no table yet."""
    table = session / TABLE
    rows = as_rows(read_table(table)) if table.exists() else []
    if all(row.controller_name is not None for row in rows):
        return rows
    names = controller_names(session)
    return [with_name(row, names) for row in rows]


def cell(trial: PlannedTrial | TrialRow) -> tuple:
    """The cell of the plan that a trial fills, whatever its run number."""
    return trial.block, trial.configuration, trial.controller, trial.segment, trial.repetition


def place(trial: PlannedTrial | TrialRow, plan: Sequence[PlannedTrial]) -> int:
    """The place (1 ..) in the plan of a trial, which may be a repetition with a run number of its own."""
    return next((number for number, planned in enumerate(plan, start=1) if cell(planned) == cell(trial)), trial.run)


def finished_cells(rows: Iterable[TrialRow]) -> tuple[set[tuple], set[tuple]]:
    """The cells of the plan that need no further trial, and those of them without a result."""
    rows = list(rows)
    finished = {cell(row) for row in rows if row.status in FINISHED}
    return finished, finished - {cell(row) for row in rows if row.status in COUNTED}


def open_trials(
    plan: tuple[PlannedTrial, ...], rows: list[TrialRow], postponed: Sequence[int] = ()
) -> list[PlannedTrial]:
    """The planned trials still to be run, in order; those of postponed runs come last in their configuration."""
    finished, _ = finished_cells(rows)
    waiting = [trial for trial in plan if cell(trial) not in finished]
    if postponed:
        cells = [cell(row) for run in postponed for row in rows if row.run == run]
        devices = list(dict.fromkeys(trial.configuration for trial in plan))
        turn = {last: place for place, last in enumerate(cells, start=1)}  # asked for twice: the later place
        waiting.sort(key=lambda trial: (devices.index(trial.configuration), turn.get(cell(trial), 0)))
    return waiting


def pooled_rows(data_dir: Path) -> list[TrialRow]:
    """The rows of all sessions, by session and run, as DATA/trials.csv holds them."""
    rows = []
    for table in sorted(data_dir.glob(f"sub-*/ses-*/{TABLE}")):
        place = table.parent.relative_to(data_dir).as_posix()
        rows += [row.in_folder(place) for row in sorted(rows_of(table.parent), key=lambda row: row.run)]
    return rows


def write_pooled_table(data_dir: Path) -> Trials:
    """Rewrite DATA/trials.csv from the sessions' tables; returns it."""
    trials = as_table(pooled_rows(data_dir))
    write_table(data_dir / TABLE, trials, replacing=True)
    return trials


# -------------------------------------------------------------------------------------------------------------- a study


@dataclass(frozen=True)
class StudyPlan:
    """Protocol, population and number of operators of a study."""

    operators: int
    protocol: Protocol
    population: Population
    has_checksum: bool = True  # by a checksum; not if an earlier version began it


def refuse_study(folder: Path) -> None:
    """InputError if the folder holds a study, whose tables are of simulated operators alone."""
    if (folder / STUDY).exists():
        raise InputError(f"{folder}: holds a study, which takes no other session; choose another data folder")


def write_study(folder: Path, study: StudyPlan) -> None:
    """Store a new study. OSError if it cannot be written."""
    about = {
        "operators": study.operators,
        "population": {"name": study.population.name, "text": study.population.text},
        "protocol": protocol_to_json(study.protocol),
    }
    write_new_file(folder / STUDY, sealed(about), sync=True)


def read_study(folder: Path) -> StudyPlan:
    """The study that a folder was begun with. InputError if there is none or it cannot be read."""
    path = folder / STUDY
    if not path.exists():
        raise InputError(f"{folder}: holds no study to resume (no {STUDY})")
    about = read_sealed(path)
    with reading_stored(path):
        operators = about["operators"]
        if not isinstance(operators, int) or isinstance(operators, bool) or operators < 1:
            raise InputError(f"{path}: operators must be a whole number of at least 1")
        population = population_of(about["population"]["text"], f"{path}: population")
        return StudyPlan(operators, protocol_from_json(about["protocol"], str(path)), population, CHECKSUM in about)


def refuse_other(folder: Path, study: StudyPlan, options: Mapping[str, object]) -> None:
    """InputError if the options differ from those with which the study was begun.

    options: operators, seed, rules, low_gain -> value; devices, protocol, population -> the object.
    """
    own = {"operators": study.operators, "protocol": study.protocol, "population": study.population}
    own |= {"low_gain": study.protocol.assumptions.low_gain or study.protocol.low_gain}
    for name, value in options.items():
        begun, words = _content(name, own[name] if name in own else getattr(study.protocol, name))
        if _content(name, value)[0] != begun:
            option = {"devices": "--device", "protocol": "PROTOCOL.toml"}.get(name, f"--{name.replace('_', '-')}")
            raise InputError(
                f"{folder / STUDY}: {option}: the study was begun with {words}; leave the option out to resume it"
            )


def _content(name: str, value: Any) -> tuple[object, str]:
    """The content of an option that is compared (texts of files, or the value), and its name in a refusal."""
    if isinstance(value, Protocol | Population):
        return value.text, f"another {name} ({value.name})"
    if isinstance(value, tuple):
        texts = [(device.name, device.text, device.brake_texts) for device in value]
        return texts, f"other devices: {', '.join(device.name for device in value)}"
    return value, "none" if value is None else f"{value:g}" if isinstance(value, float) else f"{value}"
