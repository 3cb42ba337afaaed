"""The folder of compiled kernels: its place on disk, and what is read from it and written to it.

numba's own cache looks only at the file of the function itself: where a kernel that it calls, or a constant of another
file, has changed, it serves stale code. So the folder is named by a hash of every file that holds a kernel and of all
that these import from this project (some 20 MB a version; `old_versions` removes unused ones).

Its files are machine code that runs with the user's rights. So the folder must be the user's own (mode 0700; on Windows
the user's folder is private by its place), and nobody else may be able to write a file of it: both are looked at
through the open handle. A file is unpickled only if its checksum is right; one that was cut short, altered or planted
is compiled again. Where no such folder can be had, nothing is kept, and one sentence on stderr says so.
"""

import contextlib
import functools
import hashlib
import os
import re
import stat
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from core.kernels.old_versions import hold, remove_unused

#: An environment variable: 1 leaves the compiler to numba alone.
PLAIN = os.environ.get("PHD_PLAIN_NUMBA", "0") not in ("", "0")

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("core", "experiments", "hardware", "app")
_OURS = rf"(?:{'|'.join(_PACKAGES)})[.\w]*"
_IMPORT = re.compile(rf"^\s*from ({_OURS}) import (.+)|^\s*import ({_OURS})", re.M)

LINKING = "linking"  # what a watcher is told in place of a name

#: Called before each kernel is compiled, with its number, how many there are, and its name; with `LINKING` before they
#: are linked, which takes as long again; at the end with an empty name.
watchers: list[Callable[[int, int, str], None]] = []

#: Called with one sentence at the first problem of each kind.
tellers: list[Callable[[str], None]] = []
problems: Counter[str] = Counter()  # of each kind, "folder", "file" and "room", how many

_MAGIC = b"PHD kernel 1\n"
_USERS = hasattr(os, "geteuid")  # files belong to users and have modes
_OPEN = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

_DECORATED = re.compile(r"^\s*@(?:kernel|inlined|native|intrinsic)$", re.M)


def kernel_sources(root: Path = _ROOT) -> list[Path]:
    """Every file with a kernel, and every file of this project that one of these imports, however indirectly."""
    files = {file for package in _PACKAGES for file in (root / package).rglob("*.py")}
    found = {file for file in files if _DECORATED.search(file.read_text(encoding="utf-8"))}
    waiting = list(found)
    while waiting:
        for module, names, plain in _IMPORT.findall(waiting.pop().read_text(encoding="utf-8")):
            base = root.joinpath(*(module or plain).split("."))
            candidates = [base.with_suffix(".py"), base / "__init__.py"]
            candidates += [base / f"{name}.py" for name in re.findall(r"\w+", names)]
            for file in candidates:
                if file in files and file not in found:
                    found.add(file)
                    waiting.append(file)
    return sorted(found)


def source_hash(root: Path = _ROOT) -> str:
    """Hash of everything that compiled kernels depend on (hex, 16 digits)."""
    digest = hashlib.sha256()
    for file in kernel_sources(root):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def report(kind: str, sentence: str) -> None:
    """Count a problem; tell the first of its kind in this process."""
    problems[kind] += 1
    if problems[kind] == 1:
        for teller in tellers:
            teller(sentence)


# ------------------------------------------------------------------------------------------------------------- folders


def _user_cache() -> Path | None:
    """The user's folder for caches; None: there is none."""
    try:
        named = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        return None
    return Path(named) if Path(named).is_absolute() else None  # a relative one would be another in each folder


def make_private(folder: Path) -> str:
    """Make a folder that only this user may enter, or make an existing one so; "", or why it cannot be trusted.

    A link to a folder is not trusted: who made the link decides where it leads. OSError: the folder cannot be made.
    """
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    mode = os.lstat(folder).st_mode
    if not stat.S_ISDIR(mode):  # for a better sentence: `_OPEN` follows no link either
        return f"{folder} is {'a link, and not a' if stat.S_ISLNK(mode) else 'no'} folder"
    if not _USERS:
        return ""
    opened = os.open(folder, _OPEN | os.O_DIRECTORY)
    try:
        about = os.fstat(opened)
        if about.st_uid != os.geteuid():
            return f"{folder} belongs to another user (number {about.st_uid})"
        if stat.S_IMODE(about.st_mode) != 0o700:
            os.fchmod(opened, 0o700)
            if stat.S_IMODE(os.fstat(opened).st_mode) & _OTHERS_WRITE:
                return f"{folder} can be written by others"
    finally:
        os.close(opened)
    return ""


class Place(NamedTuple):
    """The folder of compiled kernels that this process uses."""

    folder: Path | None  # None: there is none
    wrong: str = ""  # why there is none
    removed: int = 0  # unused folders of other versions that were removed when it was made


def _folder_in_user_cache() -> Place:
    """The folder of these sources in the user's cache, or why there is none."""
    cache = _user_cache()
    if cache is None:
        return Place(None, "this user has no folder for caches")
    kernels = cache / "phd" / "kernels"
    folder = kernels / source_hash()
    try:
        cache.mkdir(parents=True, exist_ok=True)
        is_new = not folder.exists()
        for own in (cache / "phd", kernels, folder):
            if wrong := make_private(own):
                return Place(None, wrong)
        hold(folder)
        return Place(folder, removed=remove_unused(folder) if is_new else 0)
    except OSError as error:
        return Place(None, f"{error.filename or folder}: {error.strerror}")


@functools.cache
def cache_place() -> Place:
    """The folder of this process, found once; reports why there is none."""
    place = _folder_in_user_cache()
    if place.folder is None:
        report("folder", f"compiled kernels are not kept, each process compiles its own: {place.wrong}")
    return place


def cache_folder() -> Path | None:
    """The folder of the kernels compiled from these sources; None: there is none."""
    return cache_place().folder


# --------------------------------------------------------------------------------------------------------------- files


def _checksum(file: Path, data: bytes) -> bytes:
    """The checksum of a file's content and name: a file under another's name is refused."""
    return hashlib.sha256("/".join(file.parts[-3:]).encode() + b"\0" + data).digest()


def read_file(file: Path) -> bytes | None:
    """The content of a cache file; None: there is none, or an unsound one, which is reported."""
    data, wrong = read_sound(file)
    if wrong:
        report(
            "file", f"compiled kernels on disk are compiled again where they are not as they were kept: {file}: {wrong}"
        )
    return data


def read_sound(file: Path) -> tuple[bytes | None, str]:
    """The content of a file that this user owns and whose checksum is right; else None, and why it is unsound.

    A file that is not there has no content, and is not unsound.
    """
    try:
        with open(os.open(file, _OPEN), "rb") as opened:
            about = os.fstat(opened.fileno())
            if not stat.S_ISREG(about.st_mode):
                return None, "it is no file"
            if _USERS and about.st_uid != os.geteuid():
                return None, f"it belongs to another user (number {about.st_uid})"
            if _USERS and about.st_mode & _OTHERS_WRITE:
                return None, "others may write it"
            content = opened.read()
    except FileNotFoundError:
        return None, ""
    except OSError as error:
        return None, error.strerror or str(error)
    start = len(_MAGIC) + hashlib.sha256().digest_size
    data = content[start:]
    if content[:start] != _MAGIC + _checksum(file, data):
        return None, "it is damaged"
    return data, ""


def write_file(file: Path, data: bytes) -> None:
    """Write a cache file, whole or not at all; a failure is reported, and this process goes on without the file."""
    new = file.with_name(f"{file.name}.{os.urandom(8).hex()}.new")
    try:
        if wrong := make_private(file.parent):
            raise OSError(0, wrong)
        try:
            with open(
                os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600), "wb"
            ) as out:
                out.write(_MAGIC + _checksum(file, data) + data)
            os.replace(new, file)
        except OSError:
            with contextlib.suppress(OSError):
                new.unlink()
            raise
    except OSError as error:
        if read_sound(file)[0] is None:  # else another process has written it meanwhile
            report("room", f"compiled kernels cannot be kept, each command compiles them again: "
                         f"{file.parent}: {error.strerror}")  # fmt: skip


def remove_unsound(folder: Path) -> dict[str, str]:
    """Remove every unsound file of a kernel; by their names below the folder, why they were unsound."""
    removed = {}
    for file in list(folder.rglob("*.kernel")):
        if wrong := read_sound(file)[1]:
            with contextlib.suppress(OSError):  # it stays, and is not read
                file.unlink()
            removed[file.relative_to(folder).as_posix()] = wrong
    return removed


def why_no_room(folder: Path) -> str:
    """Why no file of 1 MB can be written to a folder; "": one can."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(1 << 20))
    except OSError as error:
        return f"{folder}: {error.strerror}"
    return ""


def is_compiled(name: str) -> bool:
    """Whether a kernel that Python calls is on disk, compiled from these sources."""
    folder = cache_folder()
    if folder is None:
        return False
    if PLAIN:
        return any(folder.rglob(f"*.{name}-*.nbi"))
    return any(read_file(file) is not None for file in folder.rglob(f"*.{name}-*.kernel"))
