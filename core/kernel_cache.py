"""Where compiled kernels are kept, and what they depend on.

numba's on-disk cache looks only at the file of the function itself: when a kernel that it calls, or a constant that it
uses, lives in another file and changes, the cache serves stale code. So the cache folder is named by a hash of every
file that holds a kernel and of all that these import from this project. Folders of other versions stay: about a
megabyte each, in the user's cache.
"""

import functools
import getpass
import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("core", "experiments", "hardware", "app")
_OURS = rf"(?:{'|'.join(_PACKAGES)})[.\w]*"
_IMPORT = re.compile(rf"^\s*from ({_OURS}) import (.+)|^\s*import ({_OURS})", re.M)

#: Called before each kernel that is compiled with its number, of how many and its name; at the end with an empty name.
watchers: list[Callable[[int, int, str], None]] = []

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
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    base = Path(home) / "phd" / "kernels"
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return base
    except OSError:
        pass  # an unwritable home: the temporary folder below serves, at the price of compiling again after a restart
    return Path(tempfile.gettempdir()) / f"phd-kernels-{getpass.getuser()}"


@functools.cache
def cache_folder() -> Path:
    """Where the kernels compiled from these sources are kept."""
    return _cache_home() / source_hash()


def is_compiled(name: str) -> bool:
    """Whether a kernel that Python calls is on disk, compiled from these sources; if not, the next call compiles it."""
    return any(cache_folder().rglob(f"*.{name}-*.kernel"))
