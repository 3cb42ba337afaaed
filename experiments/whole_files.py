"""Files that appear whole or not at all: written beside their place, brought to the disk, named in one step."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def written_beside(target: Path, data: bytes, sync: bool = True) -> Iterator[Path]:
    """A file with `data` beside `target`, to be looked at, then given its name; removed at the end if it was not.

    sync: wait until it is on the disk. OSError if it cannot be written.
    """
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as file:  # one left by a crash is overwritten
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        yield partial
        if sync:
            sync_folder(target.parent)
    finally:
        partial.unlink(missing_ok=True)


def give_new_name(partial: Path, target: Path) -> None:
    """Name the file `target` in one step; FileExistsError if there is one of that name."""
    try:
        os.link(partial, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links: the session's lock keeps others away in between
        if target.exists():
            raise FileExistsError(target) from None
        partial.rename(target)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk."""
    with contextlib.suppress(OSError):  # not every system can; the files themselves are on the disk
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
