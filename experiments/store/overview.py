"""What a data folder holds, at a glance: each session with how far it is. Reads only; cheap enough to ask again."""

import contextlib
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from core.files import InputError
from experiments.atomic_files import reading_stored
from experiments.store.cells import finished_cells
from experiments.store.consent import agreed
from experiments.store.database import DATABASE, reading
from experiments.store.files import STUDY, planned_trials, rows_of, sessions_in
from experiments.store.stored import about_in


class SessionOverview(NamedTuple):
    """One session of a data folder."""

    folder: Path
    participant: str
    protocol: str  # its name
    done: int  # trials of the plan that need not be run any more
    planned: int
    changed_s: float  # s since 1970, of the newest trial
    lacking: int = 0  # of these, without a result: aborted, skipped, excluded
    problem: str = ""  # why it cannot be read, one sentence
    declined: bool = False  # the participant does not take part

    @property
    def complete(self) -> bool:
        """Whether the plan is finished."""
        return not self.problem and self.done >= self.planned


class DataOverview(NamedTuple):
    """The sessions of a data folder, the newest first."""

    folder: Path
    sessions: tuple[SessionOverview, ...] = ()
    operators: int = 0  # of a study: simulated operators that it was begun with; 0: it is no study
    problem: str = ""  # why the folder is not one of sessions, one sentence

    @property
    def done(self) -> int:
        """Trials that need not be run any more."""
        return sum(session.done for session in self.sessions)

    @property
    def planned(self) -> int:
        """Trials of all plans; of a study those of coming operators too."""
        plans = [session.planned for session in self.sessions]
        return sum(plans) + max(self.operators - len(plans), 0) * max(plans, default=0)


def scan_folder(folder: Path) -> DataOverview:
    """The overview of a folder; a folder that does not exist is empty."""
    if not folder.exists():
        return DataOverview(folder)
    try:
        there = sessions_in(folder)
    except (InputError, OSError) as error:
        return DataOverview(folder, problem=str(error))
    sessions = [_session(path, _stamp(path)) for path in there.folders]
    sessions += [_left_out(path, why) for path, why in there.left_out.items() if path.is_dir()]
    operators = 0
    with contextlib.suppress(InputError, OSError, KeyError), reading(folder, STUDY) as stored:
        operators = int(about_in(stored)["operators"])  # else: no study, or one that phd study will refuse
    return DataOverview(folder, tuple(sorted(sessions, key=lambda session: -session.changed_s)), operators)


def _stamp(session: Path) -> int:
    """A number that changes when the session's database does."""
    stamps = []
    for name in (DATABASE, f"{DATABASE}-wal"):
        with contextlib.suppress(OSError):
            stamps.append((session / name).stat().st_mtime_ns)
    return max(stamps, default=0)


def _left_out(folder: Path, why: str) -> SessionOverview:
    participant = folder.parent.name.removeprefix("sub-")
    return SessionOverview(folder, participant, "", 0, 0, 1e-9 * _stamp(folder), problem=f"{folder}: {why}")


@lru_cache(maxsize=1000)
def _session(folder: Path, stamp: int) -> SessionOverview:
    """stamp: of its database, for the cache."""
    changed_s = 1e-9 * stamp
    try:
        with reading_stored(folder / DATABASE), reading(folder) as stored:
            about = about_in(stored)
            participant, protocol = str(about["participant"]), str(about["protocol"]["name"])
        if agreed(about) is False:
            return SessionOverview(folder, participant, protocol, 0, 0, changed_s, declined=True)
        planned = planned_trials(folder)
        done, lacking = map(len, finished_cells(rows_of(folder)))
        return SessionOverview(folder, participant, protocol, done, planned, changed_s, lacking)
    except InputError as error:
        return _left_out(folder, str(error))._replace(changed_s=changed_s, problem=str(error))
