"""Writes files and folders whole or not at all: under another name first, then renamed in one step.

On Windows a file that another program (a virus scanner, OneDrive) has open can be neither renamed nor removed:
`retry_while_locked` tries again.
"""

import contextlib
import errno
import itertools
import os
import shutil
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from core.files import InputError

PARTIAL_FILES = ".*.partial"  # what a crash in the middle of writing leaves
PRIVATE_FILE, PRIVATE_FOLDER = 0o600, 0o700  # answers of participants are in them, and keys of blind sessions
HELD_OPEN = (5, 32, 33)  # winerror: access denied (so a replaced file that is open), sharing violation, locked
MOST_SHOWN = 200  # characters of a reason
TRIES, TRY_S = 40, 0.05  # 2 s. Our choice: such programs keep a new file for some 100 ms


def is_wrong_path(error: OSError) -> bool:
    """Whether the path is at fault, rather than a full or broken disk."""
    return isinstance(
        error, FileNotFoundError | FileExistsError | NotADirectoryError | IsADirectoryError | PermissionError
    ) or error.errno in (errno.EROFS, errno.ENAMETOOLONG, errno.EINVAL, errno.ELOOP)


def reason_of(error: OSError) -> str:
    """Why the system refused, in lower case."""
    return (error.strerror or str(error)).lower()


def retry_while_locked(do: Callable[..., object], *arguments: object) -> None:
    """Rename, link or remove files; try again, up to `TRIES` times, while another program has one open.

    PermissionError with that reason if it is still open then.
    """
    for left in reversed(range(TRIES)):
        try:
            do(*arguments)
            return
        except PermissionError as error:
            if getattr(error, "winerror", None) not in HELD_OPEN:
                raise
            if not left:
                reason = f"another program has it open, or it is protected; tried for {TRIES * TRY_S:.0f} s"
                raise PermissionError(error.errno, reason, error.filename) from None
        time.sleep(TRY_S)


def rename(path: Path, target: Path) -> None:
    """Rename a file or folder in one step. An existing file is replaced on POSIX systems, an OSError on Windows."""
    retry_while_locked(os.rename, path, target)


def remove(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        retry_while_locked(os.unlink, path)


@contextlib.contextmanager
def refusing(path: Path, what: str) -> Iterator[None]:
    """Turn an OSError that is the path's fault into the InputError "PATH: WHAT (reason)"; a full disk stays one."""
    try:
        yield
    except OSError as error:
        if not is_wrong_path(error):
            raise
        raise InputError(f"{path}: {what} ({reason_of(error)})") from error


@contextlib.contextmanager
def reading_stored(path: Path) -> Iterator[None]:
    """Turn any error of reading a stored file into an InputError with its path."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({reason_of(error)})") from None
    except RecursionError:
        raise InputError(f"{path}: is damaged (nested too deeply)") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(f"{path}: is damaged ({type(error).__name__}: {str(error)[:MOST_SHOWN]})") from None


def refuse_existing_files(files: Iterable[Path]) -> None:
    """InputError if one of these files exists."""
    for file in files:
        if os.path.lexists(file):
            raise InputError(f"{file}: exists already and is never overwritten")


def make_empty_folder(folder: Path, needs: str, besides: Collection[str] = ()) -> None:
    """Make a folder, or accept one that is empty but for files of these names; else InputError."""
    with refusing(folder, "cannot be used"):
        make_folders(folder)
        if {path.name for path in folder.iterdir()} - set(besides):
            raise InputError(f"{folder}: is not empty; {needs}")


def partial_name(target: Path) -> Path:
    """The name of a file or folder until it is whole."""
    return target.with_name(f".{target.name}.partial")


def _why_taken(place: Path) -> str:
    """Why a new folder cannot take this place; "": it can."""
    if not os.path.lexists(place):
        return ""
    if not place.is_dir():
        return "is a file"
    if any(place.iterdir()):
        return "is not empty"
    return "is the folder you are in (go to another one first)" if place.samefile(Path.cwd()) else ""


@contextlib.contextmanager
def new_folders(places: Sequence[Path], needs: str) -> Iterator[list[Path]]:
    """Yield a folder to be filled for each place; all get their names at the end, or none is left after an error.

    needs: what needs a new folder, for the refusal. InputError if a place is taken by anything but an empty folder, is
    the folder that this process is in, or cannot be made. OSError if a disk is full.
    """
    for place in places:
        with refusing(place, "cannot be created"):
            if wrong := _why_taken(place):
                raise InputError(f"{place}: {wrong}; {needs} needs a new or empty folder")
    final = [place.resolve() for place in places]
    filled = [partial_name(place) for place in final]
    try:
        for place, partial in zip(places, filled, strict=True):
            with refusing(place, "cannot be created"):
                shutil.rmtree(partial, ignore_errors=True)  # left by a kill
                make_folders(partial, sync=False)
        yield filled
        for place, partial in zip(final, filled, strict=True):
            with contextlib.suppress(FileNotFoundError):
                place.rmdir()  # Windows gives no name that an empty folder has
            rename(partial, place)
    finally:
        for partial in filled:
            shutil.rmtree(partial, ignore_errors=True)


def first_free(folder: Path, name: str) -> Path:
    """The first of NAME-1, NAME-2, .. that does not exist in a folder."""
    return next(place for number in itertools.count(1) if not (place := folder / f"{name}-{number}").exists())


def write_new_file(file: Path, content: bytes, sync: bool = False) -> None:
    """Write a new file, whole or not at all. InputError if it exists or cannot be written there."""
    refuse_existing_files([file])
    with refusing(file, "cannot be written"), written_beside(file, content, sync) as partial:
        give_new_name(partial, file)


def replace_file(file: Path, content: bytes, sync: bool = True) -> None:
    """Write a file, whole or not at all, replacing an existing one. InputError if it cannot be written there."""
    with refusing(file, "cannot be written"), written_beside(file, content, sync) as partial:
        retry_while_locked(os.replace, partial, file)


def write_new_files(contents: Mapping[Path, bytes]) -> None:
    """Write new files and their folders, all or none. InputError if one cannot be written there."""
    refuse_existing_files(contents)
    folders = {place for file in contents for place in file.parents if not place.exists()}
    written: list[Path] = []
    try:
        for file, content in contents.items():
            with refusing(file, "cannot be written"):
                make_folders(file.parent, sync=False)
            write_new_file(file, content)
            written.append(file)
    except BaseException:
        for file in written:
            remove(file)
        for folder in sorted(folders, reverse=True):  # the inner ones first
            with contextlib.suppress(OSError):  # not made yet
                folder.rmdir()
        raise


@contextlib.contextmanager
def new_beside(target: Path) -> Iterator[Path]:
    """A new empty file beside `target`, to be filled, checked and then renamed; removed at the end if it was not."""
    partial = partial_name(target)
    remove(partial)  # left by a crash; it may be a second name of a file that is whole
    try:
        os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_FILE))
        yield partial
    finally:
        remove(partial)


@contextlib.contextmanager
def written_beside(target: Path, data: bytes, sync: bool) -> Iterator[Path]:
    """The same, with `data` in it. sync: wait until it is on the disk. OSError if it cannot be written."""
    with new_beside(target) as partial:
        with partial.open("wb") as file:
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        yield partial
        if sync:
            sync_folder(target.parent)


def give_new_name(partial: Path, target: Path) -> None:
    """Name the file `target` in one step; FileExistsError if there is one of that name."""
    try:
        retry_while_locked(os.link, partial, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links: the session's lock keeps others away in between
        if target.exists():
            raise FileExistsError(target) from None
        rename(partial, target)


def make_folders(folder: Path, sync: bool = True) -> None:
    """Make a folder and those above it that are missing, for this user alone; one that is there stays as it is."""
    for place in reversed([place for place in (folder, *folder.parents) if not place.exists()]):
        place.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
        if sync:
            sync_folder(place.parent)
    folder.mkdir(exist_ok=True)  # FileExistsError: it is a file


def sync_file(file: Path) -> None:
    """Bring the content of a file to the disk. OSError: it does not take it."""
    handle = os.open(file, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk."""
    with contextlib.suppress(OSError):  # not every system can; the files themselves are on the disk
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
