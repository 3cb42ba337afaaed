"""Compiled kernels of other versions of the sources, each in a folder of its own: unused ones are removed.

A process dates the folder that it uses and locks it as long as it lives. When the first process of a new version makes
its folder, it removes those that have been neither used for `UNUSED_DAYS` nor locked.
"""

import contextlib
import os
import shutil
import time
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: there a folder with an open file cannot be renamed
    fcntl = None  # type: ignore[assignment]

UNUSED_DAYS = 60  # Our choice
_DAY_S = 86_400.0
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)


def hold(folder: Path) -> None:
    """Date a folder as used now, and lock it until this process ends."""
    with contextlib.suppress(OSError):  # a disk that can only be read, a file system without locks
        os.utime(folder)
        if fcntl is not None:
            opened = os.open(folder, _FOLDER)  # stays open: the lock is the process's
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)


def remove_unused(folder: Path) -> int:
    """Remove what no process has used for `UNUSED_DAYS` of the folders beside this one; how many there were."""
    oldest = time.time() - UNUSED_DAYS * _DAY_S
    return sum(_remove_unused(other, oldest) for other in others(folder))


def others(folder: Path) -> list[Path]:
    """The folders of other versions."""
    return [other for other in folder.parent.iterdir() if other != folder and other.is_dir() and not other.is_symlink()]


def size_of(folders: list[Path]) -> int:
    """Bytes of the files in these folders."""
    total = 0
    for file in (file for folder in folders for file in folder.rglob("*")):
        with contextlib.suppress(OSError):  # it has just gone
            total += file.lstat().st_size
    return total


def _remove_unused(folder: Path, oldest: float) -> bool:
    """Remove a folder that was last used before `oldest` (s, as files are dated); False: it was used since, or is.

    It is renamed under its lock, so that no process begins to use it meanwhile.
    """
    unused = folder.with_name(f"{folder.name}.unused")
    try:
        if folder.lstat().st_mtime >= oldest:
            return False
        if fcntl is None:
            folder.rename(unused)
        else:
            opened = os.open(folder, _FOLDER)
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
                folder.rename(unused)
            finally:
                os.close(opened)
    except OSError:
        return False
    shutil.rmtree(unused, ignore_errors=True)
    return True
