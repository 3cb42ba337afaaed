"""Disks that take no more, or lose a bit."""

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments import atomic_files


def full(*_args, **_more):
    """In place of whatever writes."""
    raise OSError(28, "No space left on device")


def locked(*_args, **_more):
    """Likewise: a folder that was made read-only."""
    raise PermissionError(1, "Operation not permitted")


class Disk:
    """A disk that can be told to take no more: databases that are opened from now on, and whole files."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.refuses: Callable[..., None] | None = None  # `full` or `locked`; None: it takes everything
        self.room = 0  # commits that it takes all the same
        self.only_folder: Path | None = None  # the disk on which alone it takes nothing; None: wherever it is
        write, connect, disk = atomic_files.new_beside, sqlite3.connect, self

        class Connection(sqlite3.Connection):
            def __init__(self, place, *of, **how) -> None:
                super().__init__(place, *of, **how)
                self.place = Path(str(place).removeprefix("file://"))

            def execute(self, sql: str, *values):
                if disk.is_on(self.place) and sql.startswith(("BEGIN IMMEDIATE", "VACUUM", "PRAGMA journal_mode=DEL")):
                    try:
                        disk.refuse_unless_room()
                    except OSError as error:  # as SQLite says it
                        said = sqlite3.OperationalError(error.strerror)
                        said.sqlite_errorcode = sqlite3.SQLITE_FULL if error.errno == 28 else sqlite3.SQLITE_PERM
                        raise said from None
                return super().execute(sql, *values)

        def new_beside(target: Path):
            if disk.is_on(target):
                disk.refuse_unless_room()
            return write(target)

        for place in ("experiments.atomic_files", "experiments.store.recording", "experiments.store.database"):
            patch.setattr(f"{place}.new_beside", new_beside)
        patch.setattr("sqlite3.connect", lambda *of, **how: connect(*of, **how, factory=Connection))

    def is_on(self, place: Path) -> bool:
        """Whether this disk takes no more, and the place is on it."""
        return self.refuses is not None and (self.only_folder is None or self.only_folder in place.parents)

    def refuse_unless_room(self) -> None:
        """One more write."""
        if self.room:
            self.room -= 1
        else:
            self.refuses()


def flip_a_bit(path: Path, place: int | None = None, bit: int = 1) -> None:
    """In the middle of a file, or at a byte of it."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2 if place is None else place] ^= 1 << bit
    path.write_bytes(content)
