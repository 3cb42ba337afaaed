"""The jit decorator of every kernel, and where compiled kernels are kept.

numba's on-disk cache looks only at the file of the function itself: when a kernel that it calls, or a constant that it
uses, lives in another file and changes, the cache serves stale code. So the cache folder is named by a hash of every
file that holds a kernel and of all that these import from this project.
"""

import hashlib
import os
import re
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numba

from core.kernel_compiler import Kernel

try:
    import fcntl
except ImportError:  # Windows has none: nothing is ever removed there
    fcntl = None  # type: ignore[assignment]

#: Our choice: kernels of other versions go when nobody has used them for so long, a few at a start, so that none waits.
UNUSED_DAYS, MOST_REMOVED = 30.0, 8
_IN_USE = ".in-use"
_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("core", "experiments", "hardware", "app")
_OURS = rf"(?:{'|'.join(_PACKAGES)})[.\w]*"
_IMPORT = re.compile(rf"^\s*from ({_OURS}) import (.+)|^\s*import ({_OURS})", re.M)

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


def _cache_home() -> Path:
    """The user's cache folder, or a private temporary one where that cannot be written."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "phd" / "kernels"
    try:
        base.mkdir(parents=True, exist_ok=True)
        if os.access(base, os.W_OK):
            return base
    except OSError:
        pass  # an unwritable home: the temporary folder below serves, at the price of compiling again after a restart
    return Path(tempfile.gettempdir()) / f"phd-kernels-{os.getuid()}"


def keep_in_use(folder: Path) -> int | None:
    """Make the folder and hold it, as long as this process lives; its time is when it was last used."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = os.open(folder / _IN_USE, os.O_RDWR | os.O_CREAT, 0o600)
        os.utime(folder)
        if fcntl:
            fcntl.flock(held, fcntl.LOCK_SH)
    except OSError:
        return None  # it cannot be written or held: nothing is removed then
    return held


def remove_unused(home: Path, days: float = UNUSED_DAYS) -> list[Path]:
    """Remove kernels of other versions that nobody has used for so long and no process holds; those removed."""
    removed: list[Path] = []
    for folder in sorted(home.iterdir()) if fcntl else ():
        if len(removed) == MOST_REMOVED:
            break
        try:
            if not folder.is_dir() or time.time() - folder.stat().st_mtime < 86400.0 * days:
                continue
            held = os.open(folder / _IN_USE, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            continue  # another process removes it, or it is not ours
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
            removed.append(folder)
        except OSError:
            pass  # in use
        finally:
            os.close(held)
    return removed


CACHE_FOLDER = _cache_home() / source_hash()
_held = keep_in_use(CACHE_FOLDER)
if _held is not None:
    remove_unused(CACHE_FOLDER.parent)
numba.config.CACHE_DIR = str(CACHE_FOLDER)


def first_use() -> bool:
    """True while no compiled kernel of these sources is on disk (the next call compiles, some seconds)."""
    return not any(CACHE_FOLDER.rglob("*.nbi"))


#: Without the interpreter lock, division by zero gives inf (no hidden branch). No flag that assumes finite numbers.
#: Without numba's run-time for arrays (_nrt) a kernel that allocates does not compile: that nothing is allocated per
#: tick is checked by the compiler, and arrays cost no reference counting.
_OPTIONS = dict(nopython=True, boundscheck=None, nogil=True, error_model="numpy", _nrt=False)


def kernel(function: Any) -> Any:
    """Compile a function: once for each types of its arguments, kept on disk. Left to Python without the jit."""
    return function if numba.config.DISABLE_JIT else Kernel(function, _OPTIONS)


def inlined(function: Any) -> Any:
    """Compile a kernel always into its caller: the few small ones of which a step is made.

    A call costs more than most of them do; the compiler by itself leaves them out of line and a step takes half as
    long again.
    """
    return function if numba.config.DISABLE_JIT else Kernel(function, {**_OPTIONS, "forceinline": True})
