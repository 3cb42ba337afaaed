"""The jit decorator of every kernel, and where compiled kernels are kept.

numba's on-disk cache looks only at the file of the function itself: when a kernel that it calls lives in another
file and changes, the cache serves stale code. So the cache folder is named by a hash of all kernel sources.
"""

import hashlib
import os
import tempfile
from pathlib import Path

import numba

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES_WITH_KERNELS = ("core", "experiments")


def source_hash(root: Path = _ROOT) -> str:
    """Hash of every source file that may hold a kernel (hex, 16 digits)."""
    digest = hashlib.sha256()
    for package in _PACKAGES_WITH_KERNELS:
        for file in sorted((root / package).rglob("*.py")):
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


CACHE_FOLDER = _cache_home() / source_hash()
numba.config.CACHE_DIR = str(CACHE_FOLDER)


def first_use() -> bool:
    """True while no compiled kernel of these sources is on disk (the next call compiles, some seconds)."""
    return not any(CACHE_FOLDER.rglob("*.nbi"))


#: Every kernel: compiled once, cached, without the interpreter lock, division by zero gives inf (no hidden branch).
#: No flag that assumes finite numbers.
kernel = numba.njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
