"""Where compiled kernels are kept, and what they depend on.

numba's on-disk cache looks only at the file of the function itself: when a kernel that it calls, or a constant that it
uses, lives in another file and changes, the cache serves stale code. So the cache folder is named by a hash of every
file that holds a kernel and of all that these import from this project. Folders of other versions stay: about a
megabyte each, in the user's cache.

What lies there is run, so it must be this user's own: folders of mode 0700 and files that nobody else may write, both
looked at where they are opened (on Windows the user's own folder is private by its place). Nothing is unpickled but
what matches its checksum: what was cut short, altered or put there by something else is compiled again. Where no such
folder can be had, a private temporary one serves this process and those that it starts. All of this is told.
"""

import atexit
import contextlib
import functools
import hashlib
import os
import re
import shutil
import stat
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

#: An environment variable: 1 leaves the compiler to numba alone.
PLAIN = os.environ.get("PHD_PLAIN_NUMBA", "0") not in ("", "0")

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("core", "experiments", "hardware", "app")
_OURS = rf"(?:{'|'.join(_PACKAGES)})[.\w]*"
_IMPORT = re.compile(rf"^\s*from ({_OURS}) import (.+)|^\s*import ({_OURS})", re.M)

LINKING = "linking"  # what a watcher is told in place of a name

#: Called before each kernel that is compiled with its number, of how many and its name; with `LINKING` before all are
#: made one, which takes as long again; at the end with an empty name.
watchers: list[Callable[[int, int, str], None]] = []

#: Called with one sentence, the first time of each kind, where the cache is not what it should be.
tellers: list[Callable[[str], None]] = []
problems: Counter[str] = Counter()  # how often, of each kind: "folder", "file", "room"

#: An environment variable: the private temporary folder that a process hands down to those that it starts.
HANDED_DOWN = "PHD_KERNELS"
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


def tell(kind: str, sentence: str) -> None:
    """Count a problem, and tell it where it is the first of its kind in this process."""
    problems[kind] += 1
    if problems[kind] == 1:
        for teller in tellers:
            teller(sentence)


# ------------------------------------------------------------------------------------------------------------- folders


def _user_cache() -> Path | None:
    """Where this system keeps what programs of this user can make again; None where it has no such place."""
    try:
        named = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        return None
    return Path(named) if Path(named).is_absolute() else None  # a relative one would be another in each folder


def make_own(folder: Path) -> str:
    """Make a folder that is this user's alone, or see to it that one is; "" or why it is not. OSError: it cannot be.

    One of this user's that others may look into is closed. What is no folder but a link to one counts as another's:
    who made the link decides where it leads.
    """
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    mode = os.lstat(folder).st_mode
    if not stat.S_ISDIR(mode):  # for the words: a link is not followed below either
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


def _kept_folder() -> tuple[Path | None, str]:
    """The folder of these sources in the user's cache, or why there is none."""
    cache = _user_cache()
    if cache is None:
        return None, "this user has no folder for caches"
    folder = cache / "phd"
    try:
        cache.mkdir(parents=True, exist_ok=True)
        for folder in (cache / "phd", cache / "phd" / "kernels", cache / "phd" / "kernels" / source_hash()):
            if wrong := make_own(folder):
                return None, wrong
    except OSError as error:
        return None, f"{error.filename or folder}: {error.strerror}"
    return folder, ""


def _handed_down() -> Path | None:
    """The private temporary folder of the process that started this one."""
    folder = Path(os.environ.get(HANDED_DOWN, ""))
    try:
        return folder if folder.is_absolute() and folder.exists() and not make_own(folder) else None
    except OSError:
        return None


def _private_folder() -> Path | None:
    """A new temporary folder, which goes with this process."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="phd-kernels-"))  # of mode 0700, under a name that nobody can know before
    except OSError:
        return None
    os.environ[HANDED_DOWN] = str(folder)
    atexit.register(_remove, folder, os.getpid())
    return folder


def _remove(folder: Path, maker: int) -> None:
    if os.getpid() == maker:
        shutil.rmtree(folder, ignore_errors=True)


class Place(NamedTuple):
    """Where this process keeps compiled kernels."""

    folder: Path | None  # None: nowhere
    wrong: str = ""  # why it is not the user's cache, so that all is gone when the command ends
    handed_down: bool = False  # it is that of the process that started this one, and serves that one too


@functools.cache
def cache_place() -> Place:
    """The place of this process, found once; says why where it is not the user's cache."""
    folder, wrong = _kept_folder()
    if folder is None and (handed := _handed_down()) is not None:
        return Place(handed, wrong, True)  # which the process that made it has told
    if folder is None:
        tell("folder", f"compiled kernels are not kept, this command compiles them for itself: {wrong}")
        folder = _private_folder()
    return Place(folder, wrong)


def cache_folder() -> Path | None:
    """Where the kernels compiled from these sources are kept; None: nowhere."""
    return cache_place().folder


# --------------------------------------------------------------------------------------------------------------- files


def _checksum(file: Path, data: bytes) -> bytes:
    """The checksum of a file's content and name: a sound file under another's name is refused."""
    return hashlib.sha256("/".join(file.parts[-3:]).encode() + b"\0" + data).digest()


def wrong_with(file: Path) -> str:
    """Why nothing is to be read from a file of the cache; "": it is sound, or not there."""
    return _proven(file)[1]


def read_kept(file: Path) -> bytes | None:
    """The content of a cache file; None: there is none, or a wrong one, which is reported."""
    data, wrong = _proven(file)
    if wrong:
        tell(
            "file", f"compiled kernels on disk are compiled again where they are not as they were kept: {file}: {wrong}"
        )
    return data


def _proven(file: Path) -> tuple[bytes | None, str]:
    """The content of a file that this user owns and whose checksum is right; else the reason."""
    try:
        with open(os.open(file, _OPEN), "rb") as opened:
            about = os.fstat(opened.fileno())
            if not stat.S_ISREG(about.st_mode):
                return None, "it is no file"
            if _USERS and about.st_uid != os.geteuid():
                return None, f"it belongs to another user (number {about.st_uid})"
            if _USERS and about.st_mode & _OTHERS_WRITE:
                return None, "others may write it"
            kept = opened.read()
    except FileNotFoundError:
        return None, ""
    except OSError as error:
        return None, error.strerror or str(error)
    start = len(_MAGIC) + hashlib.sha256().digest_size
    data = kept[start:]
    if kept[:start] != _MAGIC + _checksum(file, data):
        return None, "it is damaged"
    return data, ""


def keep(file: Path, data: bytes) -> None:
    """Keep this in a file, whole or not at all; where that fails it is told, and this process goes on without."""
    new = file.with_name(f"{file.name}.{os.urandom(8).hex()}.new")
    try:
        if wrong := make_own(file.parent):
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
        if wrong_with(file) or not file.exists():  # else another process has kept it meanwhile
            tell("room", f"compiled kernels cannot be kept, each command compiles them again: "
                         f"{file.parent}: {error.strerror}")  # fmt: skip


def remove_unsound(folder: Path) -> dict[str, str]:
    """Remove every file of a kernel from which nothing would be read; their names below the folder, and why."""
    removed = {}
    for file in list(folder.rglob("*.kernel")):
        if wrong := wrong_with(file):
            with contextlib.suppress(OSError):  # it stays, and is no more read than before
                file.unlink()
            removed[file.relative_to(folder).as_posix()] = wrong
    return removed


def why_no_room(folder: Path) -> str:
    """Why a folder of the cache takes no more; "": it does, by trying as much as a few kernels need."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(1 << 20))
    except OSError as error:
        return f"{folder}: {error.strerror}"
    return ""


def is_compiled(name: str) -> bool:
    """Whether a kernel that Python calls is on disk, compiled from these sources; if not, the next call compiles it."""
    folder = cache_folder()
    if folder is None:
        return False
    if PLAIN:
        return any(folder.rglob(f"*.{name}-*.nbi"))
    return any(read_kept(file) is not None for file in folder.rglob(f"*.{name}-*.kernel"))
