"""The content of an open session's folder in memory, for a folder that is deleted, unmounted or unplugged.

With it the session finds out what is missing, and can go on in another folder (`Session.move_to`).
"""

import contextlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from core.files import InputError
from experiments.analysis.trials_table import TrialRow, table_bytes
from experiments.plan import counted
from experiments.recording.atomic_files import PARTIAL_FILES, reason_of, refusing, write_new_file
from experiments.session import files
from experiments.session import journal as events
from experiments.session.blind import KEY
from experiments.session.checksums import END


class InMemory:
    """Small files, lines of the journal and runs of a session, in memory."""

    def __init__(self, session: Path, rows: Sequence[TrialRow]) -> None:
        """session: its folder, which is in order. rows: of its table. InputError if it cannot be read."""
        self._files = {name: (session / name).read_bytes() for name in (files.STORED, KEY) if (session / name).exists()}
        self._lines = list(events.read_events(session))
        #: folder -> run numbers that are used
        self.runs = {files.TRIALS: {line.about["run"] for line in self._lines if line.event is events.BEGUN}}
        self.runs[files.PRACTICE] = {line.about["run"] for line in self._lines if line.event is events.PRACTICE_BEGUN}
        self._missing_before = self._missing_recordings(session, rows)  # when it was opened

    def add_event(self, event: events.Event, about: dict[str, Any]) -> None:
        """Add a line of the journal. about: its fields, with `time` if not now."""
        fields = dict(about)
        self._lines.append(events.JournalEntry(event, fields.pop("time", "") or events.now(), fields))

    def missing_files(self, session: Path, rows: Sequence[TrialRow]) -> str:
        """What is missing from a folder, one sentence without its full stop; "": nothing. Reads the disk.

        rows: those of the session.
        """
        if not session.is_dir():
            return f"{next(path for path in (*reversed(session.parents), session) if not path.is_dir())} is gone"
        for name, content in self._files.items():
            try:
                if (session / name).read_bytes() != content:
                    return f"{session / name} is another session's now, or was changed"
            except FileNotFoundError:
                return f"{session / name} is gone"
            except OSError as error:
                return f"{session / name} cannot be read ({reason_of(error)})"
        expected = [session / events.NAME, session / files.TRIALS, *([session / files.TABLE] if rows else [])]
        gone = [path for path in expected if not path.exists()]
        if missing := self._missing_recordings(session, rows) - self._missing_before:
            gone.append(session / min(missing))
        if not gone:
            return ""
        inside = f", with the {counted(len(missing), 'recording')} in it" if missing else ""
        return f"{gone[0]} is gone{inside}"

    def write_into(self, target: Path, old: Path, rows: Sequence[TrialRow], sync: bool) -> int:
        """Write the session into an empty folder: recordings and journal from the old one if they can be read, all
        else from memory. Returns how many recordings could not be copied.

        InputError or OSError: the new folder cannot be written to.
        """
        for name, content in self._files.items():
            write_new_file(target / name, content, sync)
        if self.is_ours(old):
            for path in sorted(old.rglob("*")):
                place = target / path.relative_to(old)
                ours = path.name not in (files.LOCK, files.TABLE, END) and not path.match(PARTIAL_FILES)
                if ours and path.is_file() and not place.exists():
                    self._copy(path, place, sync)
        if not (target / events.NAME).exists():
            for event, time, about in self._lines:
                events.write_event(target, event, sync, time=time, **about)
        if rows:
            write_new_file(target / files.TABLE, table_bytes(rows), sync)
        events.write_event(target, events.MOVED, sync, **{"from": str(old)})
        self.add_event(events.MOVED, {"from": str(old)})
        behind = self._missing_recordings(target, rows)
        new = len(behind - self._missing_before)
        self._missing_before |= behind
        return new

    def is_ours(self, session: Path) -> bool:
        """Whether a folder holds this session, as far as it can be read."""
        with contextlib.suppress(OSError):
            return (session / files.STORED).read_bytes() == self._files[files.STORED]
        return False

    def _copy(self, path: Path, place: Path, sync: bool) -> None:
        try:
            content = path.read_bytes()
        except OSError:  # it stays behind, and is named as missing
            return
        with refusing(place, "cannot be written"):
            place.parent.mkdir(parents=True, exist_ok=True)
        write_new_file(place, content, sync)

    def _missing_recordings(self, session: Path, rows: Sequence[TrialRow]) -> set[str]:
        """Recordings that the rows name and the folder lacks, as a stream and as Parquet."""
        on_disk: set[str] = set()
        with contextlib.suppress(OSError):
            on_disk = {Path(name).stem for name in os.listdir(session / files.TRIALS) if not name.startswith(".")}
        return {row.recording for row in rows if row.recording and Path(row.recording).stem not in on_disk}


def discard(session: Path) -> None:
    """Remove the folder of a session that could not be moved there."""
    shutil.rmtree(session, ignore_errors=True)
    files.remove_empty(session)


def refuse_place(data_dir: Path, participant: str) -> Path:
    """The folder of a session in another data folder. InputError if it cannot be there."""
    folder = files.session_folder(data_dir, participant)
    files.refuse_study(data_dir)
    if os.path.lexists(folder):
        raise InputError(f"{folder}: exists already, and nothing is overwritten; choose another data folder")
    return folder
