"""Where a running bench can be found: DATA/.bench.json names it; a folder of its own holds ring, socket and lock.

The folder is in memory (/dev/shm) where the system has that. It goes with the conductor, on every exit; one that a
killed conductor left is removed by its loop or, at the latest, when the next bench starts.
"""

import contextlib
import errno
import json
import os
import secrets
import shutil
import sys
import tempfile
from multiprocessing.connection import Listener
from pathlib import Path
from typing import NamedTuple

import filelock

NAME = ".bench.json"
_PREFIX = "phd-"
LEAST_BYTES = 16_000_000  # for the ring of a device on the bench, which is the largest, and the rest
_LOCK, _RING, _SOCKET = "lock", "ring", "socket"


class Address(NamedTuple):
    """How a window reaches the conductor of a data folder."""

    pid: int
    socket: str | tuple[str, int]  # path of a Unix socket, or a place on the loop-back interface
    key: bytes  # proves to each end that the other one may read the data folder
    ring: Path
    setup: str  # what the bench was started with, as JSON


def memory_folder() -> Path:
    """Where benches have their folders: in memory where the system has a place for that."""
    home = Path("/dev/shm")
    return home if sys.platform == "linux" and os.access(home, os.W_OK) else Path(tempfile.gettempdir())


class Place:
    """A conductor's own folder, held until `remove` or the end of the process."""

    def __init__(self) -> None:
        """Make it; what dead conductors left is removed first. OSError if there is no room."""
        home = memory_folder()
        _remove_abandoned(home)
        if (free := shutil.disk_usage(home).free) < LEAST_BYTES:
            raise OSError(
                errno.ENOSPC, f"only {free / 1e6:.1f} MB free, a bench needs {LEAST_BYTES / 1e6:.0f}", str(home)
            )
        self.folder = Path(tempfile.mkdtemp(prefix=f".{_PREFIX}", dir=home))  # 0700; hidden until it is locked
        self._lock = filelock.FileLock(self.folder / _LOCK)
        self._lock.acquire(blocking=False)
        if sys.platform != "win32":  # which does not rename what is open: there nothing abandoned is found
            self.folder = self.folder.rename(home / self.folder.name.removeprefix("."))
        self.ring = self.folder / _RING

    def listen(self, setup: str = "") -> tuple[Listener, Address]:
        """A socket in it (on the loop-back interface where there are no Unix sockets), and how to reach that."""
        key = secrets.token_bytes(32)
        if sys.platform == "win32":
            listener = Listener(("127.0.0.1", 0), authkey=key)
        else:
            listener = Listener(str(self.folder / _SOCKET), "AF_UNIX", authkey=key)
        return listener, Address(os.getpid(), listener.address, key, self.ring, setup)

    def remove(self) -> None:
        """Leave nothing behind."""
        self._lock.release()
        shutil.rmtree(self.folder, ignore_errors=True)


def _remove_abandoned(home: Path) -> None:
    for folder in home.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):  # gone meanwhile
            if not os.access(folder / _LOCK, os.W_OK):
                continue
            lock = filelock.FileLock(folder / _LOCK)
            try:
                lock.acquire(blocking=False)
            except filelock.Timeout:
                continue
            lock.release()
            shutil.rmtree(folder, ignore_errors=True)


def publish(data_dir: Path, address: Address) -> None:
    """Write DATA/.bench.json, readable by this user only, whole or not at all."""
    about = {**address._asdict(), "key": address.key.hex(), "ring": str(address.ring)}
    partial = data_dir / f"{NAME}.partial"
    partial.unlink(missing_ok=True)
    with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(about, file)
    partial.replace(data_dir / NAME)


def is_alive(address: Address) -> bool:
    """Whether the bench that said so still runs: its window is not disturbed."""
    lock = filelock.FileLock(address.ring.parent / _LOCK)
    if not Path(lock.lock_file).exists():
        return False
    try:
        lock.acquire(blocking=False)
    except filelock.Timeout:
        return True
    lock.release()
    return False


def find(data_dir: Path) -> Address | None:
    """The bench that last said it runs on a data folder; None: there is none, or it cannot be read."""
    try:
        about = json.loads((data_dir / NAME).read_text(encoding="utf-8"))
        socket = about["socket"] if isinstance(about["socket"], str) else tuple(about["socket"])
        return Address(about["pid"], socket, bytes.fromhex(about["key"]), Path(about["ring"]), about["setup"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
