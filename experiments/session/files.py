"""The files of a data folder: where they are, who may write them, and what is stored about a session or a study.

DATA/sub-01/ses-01/session.json                plan, hash, protocol, device and brake files in full, versions
                   key.json                    of a blind session alone: which controller each code is
                   journal.jsonl               one line an event
                   trials/run-001.arrows       a trial in progress, or what a crash left of it
                   trials/run-001.parquet      a trial that is closed and verified
                   trials/run-001.arrows.crashed   the stream of a recovered trial, as the crash left it
                   practice/run-001.parquet    a practice trial, which has no row anywhere
                   trials.csv                  one row a trial, in the order in which they were run
                   .lock                       held by the one process that may write here
DATA/trials.csv                                the rows of all participants
DATA/study.json                                what a study was begun with: operators, population, protocol, in full

Blind sessions: the controllers stand as codes, K1, K2, .., everywhere but in the key. The key is drawn from the
system's randomness, so neither seed nor plan gives it away; session.json holds only its SHA-256 (with a salt in the
file: the key cannot be found by trying all). While a session is blind its plan, journal, table and the metadata of its
recordings hold codes, and the table leaves out what reveals a controller by itself. The ticks of a recording hold
currents and decisions: they reveal it to a reader.
"""

import contextlib
import hashlib
import json
import os
import re
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import filelock

from core.files import InputError
from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import COUNTED, SETTLED, TrialRow, read_table, write_table
from experiments.plan import PlannedTrial, codes, plan_from_json, plan_hash
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import reading_stored, replace_file, write_new_file
from experiments.trial.population import Population, population_of

LOCK = ".lock"
STORED = "session.json"
STUDY = "study.json"
KEY = "key.json"
TABLE = "trials.csv"
TRIALS, PRACTICE = "trials", "practice"
CRASHED, DAMAGED = "crashed", "damaged"  # how files are marked that `phd recover` set aside
#: Measures that reveal a controller by themselves.
HIDDEN: dict[str, Any] = {metric.name: None for metric in METRICS if metric.tells_controller}

Coded = TypeVar("Coded", PlannedTrial, TrialRow)


def session_folder(data_dir: Path, participant: str) -> Path:
    """Where a participant's session is kept."""
    return data_dir / f"sub-{participant}" / "ses-01"


def run_path(session: Path, run: int, suffix: str, folder: str = TRIALS) -> Path:
    """The file of a trial, or of a practice trial."""
    return session / folder / f"run-{run:03d}{suffix}"


def runs_on_disk(session: Path, folder: str = TRIALS) -> dict[int, dict[str, Path]]:
    """Run number -> suffix -> its file, of every run that has a stream or a Parquet file; by rising number."""
    found: dict[int, dict[str, Path]] = {}
    for path in session.glob(f"{folder}/run-*"):
        if path.suffix in (STREAM_SUFFIX, PARQUET_SUFFIX) and (match := re.fullmatch(r"run-(\d+)", path.stem)):
            found.setdefault(int(match[1]), {})[path.suffix] = path
    return dict(sorted(found.items()))


def recordings_in(session: Path) -> list[Path]:
    """The recordings of a session, by run; a stream counts where it has no Parquet file yet."""
    return [files.get(PARQUET_SUFFIX) or files[STREAM_SUFFIX] for files in runs_on_disk(session).values()]


def runs_used(session: Path, folder: str = TRIALS) -> set[int]:
    """Every run number that a file has or ever had."""
    names = (re.match(r"\.?run-(\d+)\.", path.name) for path in session.glob(f"{folder}/*run-*"))
    return {int(match[1]) for match in names if match}


def is_half_created(session: Path) -> bool:
    """Whether a crash came before the session was stored: there is nothing to keep."""
    return not (session / STORED).exists() and not (session / TABLE).exists() and not runs_used(session)


def remove_empty(session: Path) -> None:
    """Remove the folders of a session that came to nothing, where there is nothing in them."""
    for folder in (session / TRIALS, session, session.parent):
        with contextlib.suppress(OSError):  # there is something, or it is gone
            folder.rmdir()


def refuse_existing(data_dir: Path, participant: str) -> None:
    """InputError if this participant has a session already."""
    folder = session_folder(data_dir, participant)
    if folder.exists() and not is_half_created(folder):
        raise InputError(f"{folder}: exists already, a session is never overwritten; name another participant")


def free_participant(data_dir: Path, participants: Sequence[str] = ()) -> str:
    """The first of the protocol's participants without a session; where it names none, the first number of two digits.

    InputError if each of them has one.
    """
    for label in participants or (f"{number:02d}" for number in count(1)):
        if not session_folder(data_dir, label).exists():
            return label
    raise InputError(f"{data_dir}: every participant of the protocol has a session ({', '.join(participants)})")


def sessions_in(folder: Path) -> list[Path]:
    """Every session of a data folder; or the session that the folder itself is.

    InputError if there is no such folder or it holds files, but none of a study or session.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: {'is no folder' if folder.exists() else 'there is no such folder'}")
    if (folder / STORED).exists() or (folder / TRIALS).is_dir():
        return [folder]
    sessions = sorted(path for path in (*folder.glob("sub-*/ses-*"), *folder.glob("ses-*")) if path.is_dir())
    ours = (STUDY, TABLE, "sub-", ".")
    if not sessions and any(not path.name.startswith(ours) for path in folder.iterdir()):
        raise InputError(f"{folder}: holds no session (sub-*/ses-*), and other files")
    return sessions


def seen_from(folder: Path, sentence: str) -> str:
    """The sentence with its paths relative to the folder."""
    return sentence.replace(f"{folder}{os.sep}", "")


class _HeldLock(filelock.FileLock):
    """A lock that `with` releases; it is held already."""

    def __enter__(self) -> Self:
        return self


def hold_lock(folder: Path, wait_s: float = 0.0) -> filelock.BaseFileLock:
    """The folder's lock, held until it is released, `with` it ends, or the process ends.

    InputError if a live process holds it, after `wait_s`.
    """
    lock = _HeldLock(folder / LOCK)
    try:
        lock.acquire(timeout=wait_s)
    except filelock.Timeout:
        raise InputError(f"{folder}: is in use by a running process") from None
    return lock


def is_in_use(folder: Path) -> bool:
    """Whether a live process holds the folder's lock; nothing is written."""
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


def read_stored(session: Path) -> StoredSession:
    """The session as it was stored. InputError if it cannot be read or its plan was changed."""
    path = session / STORED
    with reading_stored(path):
        about = json.loads(path.read_text(encoding="utf-8"))
        plan = plan_from_json(about["plan"])
        if plan_hash(plan) != about["plan_sha256"]:
            raise InputError(f"{path}: plan: does not match plan_sha256, it was changed")
        return StoredSession(about["participant"], protocol_from_json(about["protocol"], str(path)), plan, about)


def other_protocol(data_dir: Path, participant: str, protocol: Protocol) -> str:
    """Whose session, the newest besides this participant's, was run by another protocol; "": it is the same one."""
    others = [path for path in data_dir.glob(f"sub-*/ses-01/{STORED}") if path.parents[1].name != f"sub-{participant}"]
    for path in sorted(others, key=lambda path: path.stat().st_mtime, reverse=True):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # one that cannot be read does not count
            same = json.loads(path.read_text(encoding="utf-8"))["protocol"] == protocol_to_json(protocol)
            return "" if same else path.parents[1].name.removeprefix("sub-")
    return ""


def rows_of(session: Path) -> list[TrialRow]:
    """The rows of a session's table; none if there is no table yet."""
    table = session / TABLE
    return read_table(table) if table.exists() else []


def cell(trial: PlannedTrial | TrialRow) -> tuple:
    """The cell of the plan that a trial fills, by whatever run number."""
    return trial.block, trial.configuration, trial.controller, trial.segment, trial.repetition


def settled_cells(rows: Iterable[TrialRow]) -> tuple[set[tuple], set[tuple]]:
    """The cells of the plan that trials have settled, and those of them that are without a result."""
    rows = list(rows)
    settled = {cell(row) for row in rows if row.status in SETTLED}
    return settled, settled - {cell(row) for row in rows if row.status in COUNTED}


def open_trials(
    plan: tuple[PlannedTrial, ...], rows: list[TrialRow], postponed: Sequence[int] = ()
) -> list[PlannedTrial]:
    """The planned trials, in order, that no trial has settled yet; those of postponed runs end their configuration."""
    settled, _ = settled_cells(rows)
    waiting = [trial for trial in plan if cell(trial) not in settled]
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
        rows += [row.seen_from(place) for row in sorted(read_table(table), key=lambda row: row.run)]
    return rows


def write_pooled_table(data_dir: Path) -> list[TrialRow]:
    """Rewrite DATA/trials.csv from the sessions' tables; its rows."""
    rows = pooled_rows(data_dir)
    write_table(data_dir / TABLE, rows, replacing=True)
    return rows


# ------------------------------------------------------------------------------------------- the key of a blind session


def new_key(controllers: Iterable[int]) -> dict[str, int]:
    """Code -> controller, by chance."""
    shuffled = list(controllers)
    secrets.SystemRandom().shuffle(shuffled)
    return dict(zip(codes(len(shuffled)), shuffled, strict=True))


def write_key(session: Path, key: Mapping[str, int], sync: bool = True) -> str:
    """Store the key of a session that is being created; its SHA-256. OSError if it cannot be written."""
    data = json.dumps({"controllers": key, "salt": secrets.token_hex(16)}, indent=1).encode() + b"\n"
    replace_file(session / KEY, data, sync)  # there is none, or one of a session that a crash left half created
    return hashlib.sha256(data).hexdigest()


def read_key(session: Path, sha256: str) -> dict[str, int]:
    """The key of a session. InputError if it is not there or not the one that session.json names."""
    path = session / KEY
    with reading_stored(path):
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() != sha256:
            raise InputError(f"{path}: does not match key_sha256 of session.json, it was changed")
        return {str(code): int(number) for code, number in json.loads(data)["controllers"].items()}


def opened(thing: Coded, key: Mapping[str, int]) -> Coded:
    """A planned trial or a row with its controller in place of the code; as it is where the key has no such code."""
    number = key.get(str(thing.controller), thing.controller)
    if isinstance(thing, TrialRow):
        return replace(thing, controller=number)
    return thing._replace(controller=number)


def veiled(row: TrialRow) -> TrialRow:
    """A coded row without what reveals the controller by itself."""
    return replace(row, **HIDDEN) if isinstance(row.controller, str) else row


# -------------------------------------------------------------------------------------------------------------- a study


@dataclass(frozen=True)
class StudyPlan:
    """What decides a study."""

    operators: int
    protocol: Protocol
    population: Population


def refuse_study(folder: Path) -> None:
    """InputError if the folder is a study's: its tables and statistics are of its simulated operators alone."""
    if (folder / STUDY).exists():
        raise InputError(f"{folder}: holds a study, which takes no other session; choose another data folder")


def write_study(folder: Path, study: StudyPlan) -> None:
    """Store it in a folder that has none yet. OSError if it cannot be written."""
    about = {
        "operators": study.operators,
        "population": {"name": study.population.name, "text": study.population.text},
        "protocol": protocol_to_json(study.protocol),
    }
    write_new_file(folder / STUDY, json.dumps(about, indent=1, sort_keys=True).encode() + b"\n", sync=True)


def read_study(folder: Path) -> StudyPlan:
    """The study that a folder was begun with. InputError if there is none or it cannot be read."""
    path = folder / STUDY
    if not path.exists():
        raise InputError(f"{folder}: holds no study to resume (no {STUDY})")
    with reading_stored(path):
        about = json.loads(path.read_text(encoding="utf-8"))
        population = population_of(about["population"]["text"], f"{path}: population")
        return StudyPlan(int(about["operators"]), protocol_from_json(about["protocol"], str(path)), population)


def refuse_other(folder: Path, study: StudyPlan, asked: Mapping[str, object]) -> None:
    """InputError if what was asked for is not what the study was begun with.

    asked: operators, seed, rules, low_gain -> value; devices, protocol, population -> the thing itself.
    """
    own = {"operators": study.operators, "protocol": study.protocol, "population": study.population}
    own |= {"low_gain": study.protocol.assumptions.low_gain or study.protocol.low_gain}
    for name, value in asked.items():
        begun, words = _content(name, own[name] if name in own else getattr(study.protocol, name))
        if _content(name, value)[0] != begun:
            option = {"devices": "--device", "protocol": "PROTOCOL.toml"}.get(name, f"--{name.replace('_', '-')}")
            raise InputError(
                f"{folder / STUDY}: {option}: the study was begun with {words}; leave the option out to "
                "resume it"
            )


def _content(name: str, thing: Any) -> tuple[object, str]:
    """What is compared of a thing (the texts of its files, or the plain value), and how a refusal names it."""
    if isinstance(thing, Protocol | Population):
        return thing.text, f"another {name} ({thing.name})"
    if isinstance(thing, tuple):
        texts = [(device.name, device.text, device.brake_texts) for device in thing]
        return texts, f"other devices: {', '.join(device.name for device in thing)}"
    return thing, "none" if thing is None else f"{thing:g}" if isinstance(thing, float) else f"{thing}"


# -------------------------------------------------------------------------------------------- a data folder at a glance


class SessionOverview(NamedTuple):
    """One session of a data folder."""

    folder: Path
    participant: str
    protocol: str  # its name
    done: int  # trials of the plan that are settled
    planned: int
    changed_s: float  # s since 1970, of the newest trial
    lacking: int = 0  # settled trials without a result: aborted, skipped, excluded
    problem: str = ""  # why it cannot be read, one sentence

    @property
    def complete(self) -> bool:
        """Whether no trial of its plan is left."""
        return not self.problem and self.done >= self.planned


class DataOverview(NamedTuple):
    """The sessions of a data folder, the newest first."""

    folder: Path
    sessions: tuple[SessionOverview, ...] = ()
    operators: int = 0  # of a study: simulated operators that it was begun with; 0: it is no study
    problem: str = ""  # why the folder is not one of sessions, one sentence

    @property
    def done(self) -> int:
        """Trials that are settled."""
        return sum(session.done for session in self.sessions)

    @property
    def planned(self) -> int:
        """Trials of all plans; of a study those of the operators to come, too."""
        plans = [session.planned for session in self.sessions]
        return sum(plans) + max(self.operators - len(plans), 0) * max(plans, default=0)


def look_into(folder: Path) -> DataOverview:
    """The overview of a folder; one that is not there yet is empty."""
    if not folder.exists():
        return DataOverview(folder)
    try:
        sessions = [_session(path, *map(_stamp, (path / STORED, path / TABLE))) for path in sessions_in(folder)]
    except (InputError, OSError) as error:
        return DataOverview(folder, problem=str(error))
    operators = 0
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # no study, or one that phd study will refuse
        operators = int(json.loads((folder / STUDY).read_text(encoding="utf-8"))["operators"])
    found = (session for session in sessions if session is not None)
    return DataOverview(folder, tuple(sorted(found, key=lambda one: -one.changed_s)), operators)


def _stamp(path: Path) -> int:
    """Changes when the file does; 0: there is none."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=1000)
def _session(folder: Path, stored: int, table: int) -> SessionOverview | None:
    """None: a crash came before the session was stored. stored, table: stamps of its files, by which it is kept."""
    if not stored:
        return None
    changed_s, participant = 1e-9 * max(stored, table), folder.parent.name.removeprefix("sub-")
    try:
        with reading_stored(folder / STORED):
            about = json.loads((folder / STORED).read_text(encoding="utf-8"))
            planned, protocol = len(about["plan"]), str(about["protocol"]["name"])
            done, lacking = map(len, settled_cells(rows_of(folder)))
            return SessionOverview(folder, str(about["participant"]), protocol, done, planned, changed_s, lacking)
    except InputError as error:
        return SessionOverview(folder, participant, "", 0, 0, changed_s, problem=str(error))
