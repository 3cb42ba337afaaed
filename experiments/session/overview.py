"""What a data folder holds, at a glance: each session with how far it is. Reads only; cheap enough to ask again."""

import contextlib
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from core.files import InputError
from experiments.recording.atomic_files import reading_stored
from experiments.session.checksums import read_sealed
from experiments.session.consent import agreed
from experiments.session.files import STORED, STUDY, TABLE, finished_cells, rows_of, sessions_in


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
        sessions = [_session(path, *map(_stamp, (path / STORED, path / TABLE))) for path in sessions_in(folder)]
    except (InputError, OSError) as error:
        return DataOverview(folder, problem=str(error))
    operators = 0
    with contextlib.suppress(InputError), reading_stored(folder / STUDY):  # no study, or one that phd study will refuse
        operators = int(read_sealed(folder / STUDY)["operators"])
    found = (session for session in sessions if session is not None)
    return DataOverview(folder, tuple(sorted(found, key=lambda session: -session.changed_s)), operators)


def _stamp(path: Path) -> int:
    """A number that changes when the file does; 0: no file."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=1000)
def _session(folder: Path, stored: int, table: int) -> SessionOverview | None:
    """None: a crash came before the session was stored. stored, table: stamps of its files, for the cache."""
    if not stored:
        return None
    changed_s, participant = 1e-9 * max(stored, table), folder.parent.name.removeprefix("sub-")
    try:
        about = read_sealed(folder / STORED)
        with reading_stored(folder / STORED):
            planned, protocol = len(about["plan"]), str(about["protocol"]["name"])
            if agreed(about) is False:
                return SessionOverview(folder, str(about["participant"]), protocol, 0, 0, changed_s, declined=True)
            done, lacking = map(len, finished_cells(rows_of(folder)))
            return SessionOverview(folder, str(about["participant"]), protocol, done, planned, changed_s, lacking)
    except InputError as error:
        return SessionOverview(folder, participant, "", 0, 0, changed_s, problem=str(error))
