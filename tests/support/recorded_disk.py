"""A disk whose every write is recorded (`disk_recorder.c`): what is left of it after a power cut at any moment."""

import os
import random
import shutil
import struct
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

SUPPORT = Path(__file__).resolve().parent
ROOT = SUPPORT.parents[1]
OPEN, WRITE, TRUNCATE, SYNC, RENAME, LINK, UNLINK, MKDIR = range(8)
ACK = "ack"  # the file in which a program says what it has been told is written
#: What a cut leaves: what was synced alone; besides, every new name; or any of the writes that were not synced; or all
#: writes, as kill -9 leaves them.
SYNCED, NAMES, SOME, KILLED = "synced", "names", "some", "killed"


@dataclass
class Node:
    """A file, or a folder."""

    now: bytearray = field(default_factory=bytearray)
    synced: bytes = b""
    waiting: list[tuple[int, int, bytes]] = field(default_factory=list)  # operation, offset, data: since then
    is_folder: bool = False

    def do(self, operation: int, offset: int, data: bytes) -> None:
        change(self.now, operation, offset, data)
        self.waiting.append((operation, offset, data))

    def after_cut(self, draw: random.Random | None) -> bytes:
        """draw: which of the writes that were not synced have reached the disk; None: none."""
        content = bytearray(self.synced)
        for waiting in self.waiting if draw else ():
            if draw is not None and draw.random() < 0.5:
                change(content, *waiting)
        return bytes(content)


def change(content: bytearray, operation: int, offset: int, data: bytes) -> None:
    if operation == TRUNCATE:
        del content[offset:]
        content.extend(bytes(offset - len(content)))
    else:
        content.extend(bytes(max(0, offset - len(content))))
        content[offset : offset + len(data)] = data


class RecordedDisk:
    """What programs did to a folder, to be played until any moment."""

    def __init__(self, folder: Path) -> None:
        """folder: of the program's own; what is recorded is in folder / "root"."""
        self.root, self.log, self.told = folder / "root", folder / "log", folder / "told"
        self.library = folder / "disk_recorder.so"
        if sys.platform != "linux" or shutil.which("cc") is None:
            pytest.skip("a disk is recorded by a C library that Linux loads first, and there is no compiler")
        source = SUPPORT / "disk_recorder.c"
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", self.library, source, "-ldl", "-lpthread"], check=True)
        self.root.mkdir(mode=0o700)

    def run(self, program: str) -> subprocess.CompletedProcess:
        """Run Python code whose writes are recorded; `disk` there is this one's root, `told` the file of refusals."""
        about = {
            "LD_PRELOAD": str(self.library), "DISK_ROOT": str(self.root), "DISK_LOG": str(self.log),
            "DISK_TOLD": str(self.told), "XDG_DATA_HOME": str(self.root / "own"),
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT))),
        }  # fmt: skip
        head = f"from pathlib import Path\ndisk, told = Path({str(self.root)!r}), Path({str(self.told)!r})\n"
        command = [sys.executable, "-c", head + program]
        return subprocess.run(command, env=os.environ | about, capture_output=True, text=True, check=False, cwd=ROOT)

    def records(self) -> list[tuple[int, int, int, str, bytes]]:
        """Operation, inode, offset, path, data; SQLite's shared memory, which no cut keeps, left out."""
        content, at, found = self.log.read_bytes(), 0, []
        while at < len(content):
            what, inode, offset, path, data = struct.unpack_from("5q", content, at)
            at += 40
            name, at = content[at : at + path].decode(), at + path
            found.append((what, inode, offset, name, content[at : at + data]))
            at += data
        return [record for record in found if not record[3].endswith("-shm")]

    def cut(self, records: list, image: Path, how: str, seed: int) -> list[str]:
        """Leave in `image` what the disk has after these records; the lines of `ACK` until then."""
        live: dict[str, Node] = {str(self.root): Node(is_folder=True)}
        synced, inodes = dict(live), dict[int, Node]()
        for what, inode, offset, path, data in records:
            if what == OPEN:
                if path not in live:
                    inodes[inode] = live[path] = Node()
                if offset:
                    live[path].do(TRUNCATE, 0, b"")
            elif what in (WRITE, TRUNCATE):
                inodes[inode].do(what, offset, data)
            elif what == SYNC and offset:
                for name in [name for name in synced if os.path.dirname(name) == path and name not in live]:
                    del synced[name]
                synced |= {name: node for name, node in live.items() if os.path.dirname(name) == path}
            elif what == SYNC:
                inodes[inode].synced, inodes[inode].waiting = bytes(inodes[inode].now), []
            elif what == RENAME:
                live[data.decode()] = live.pop(path)
            elif what == LINK:
                live[data.decode()] = live[path]
            elif what == UNLINK:
                live.pop(path, None)
            elif what == MKDIR:
                live[path] = Node(is_folder=True)
        draw = random.Random(seed) if how == SOME else None
        names = synced if how == SYNCED else live
        for name, node in sorted(names.items()):
            place, parent = image / os.path.relpath(name, self.root), os.path.dirname(name)
            if name != str(self.root) and not (image / os.path.relpath(parent, self.root)).is_dir():
                continue  # in a folder that is not there any more
            if node.is_folder:
                place.mkdir(mode=0o700, exist_ok=True)
            elif os.path.basename(name) != ACK:
                place.write_bytes(node.now if how == KILLED else node.after_cut(draw))
        acks = live.get(str(self.root / ACK))
        return acks.now.decode().splitlines() if acks else []
