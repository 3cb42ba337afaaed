"""Controllers in files of their own: `algorithm = "damper.py"` in a protocol, declared as the shipped ones are.

The text of the file travels with its controller (`Preset.own`), so that a session, its recordings and every process
have the very code that ran. A file is run as Python: open experiments only of people whom you would let run a program.
"""

import functools
import hashlib
import importlib.util
import os
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from core.control.algorithm import Algorithm
from core.files import InputError
from core.kernels import INTERPRETED, kernel
from core.kernels.by_address import Caller
from core.kernels.cache import cache_folder

MOST_PARAMETERS = 8  # of any algorithm: the kernels take as many numbers of each
MOST_WORDS = 8  # decisions of its own


class OwnFile(NamedTuple):
    """A file with an algorithm."""

    name: str  # without ".py"
    text: str  # in full
    parameters: tuple[str, ...]  # names, as the file declares them

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()


def read_own(name: str, text: str) -> OwnFile:
    """The file of this name and text. InputError, one sentence, if it declares no algorithm that can run."""
    algorithm = _algorithm(name, text)
    return OwnFile(name, text, tuple(parameter.name for parameter in algorithm.parameters))


def algorithm_in(own: OwnFile) -> Algorithm:
    """What the file declares. InputError as `read_own`."""
    return _algorithm(own.name, own.text)


@functools.cache
def _algorithm(name: str, text: str) -> Algorithm:
    module = _run_as_module(name, text)
    algorithm = getattr(module, "ALGORITHM", None)
    where = f"{name}.py"
    if not isinstance(algorithm, Algorithm):
        raise InputError(f"{where}: must have ALGORITHM = Algorithm(..), as docs/examples/protocols/damper.py has")
    names = [parameter.name for parameter in algorithm.parameters]
    if len(set(names)) < len(names) or len(names) > MOST_PARAMETERS:
        raise InputError(f"{where}: may have up to {MOST_PARAMETERS} parameters, each of another name")
    if len(algorithm.decisions) > MOST_WORDS:
        raise InputError(f"{where}: may have up to {MOST_WORDS} decisions of its own, not {len(algorithm.decisions)}")
    if not callable(algorithm.decide) or not INTERPRETED and not hasattr(algorithm.decide, "entry"):
        raise InputError(f"{where}: decide must be a kernel: write @kernel above it")
    return algorithm._replace(kind=name)


def _run_as_module(name: str, text: str) -> ModuleType:
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    module_name = f"phd_own_{name}_{digest}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    path = _place(f"{name}-{digest}.py", text)
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None and spec.loader is not None  # a path that ends in .py has both
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the file does wrong
        del sys.modules[module_name]
        raise InputError(f"{name}.py: cannot be run: {_line(error, path)}{type(error).__name__}: {error}") from None
    return module


def _place(name: str, text: str) -> Path:
    """A file with this text beside the compiled kernels: numba keeps machine code by the file that it is of."""
    folder = (cache_folder() or Path(tempfile.mkdtemp(prefix="phd-own-"))) / "own"
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / name
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        with tempfile.NamedTemporaryFile("w", dir=folder, encoding="utf-8", newline="", delete=False) as new:
            new.write(text)
        os.replace(new.name, path)
    return path


def _line(error: Exception, path: Path) -> str:
    """The line of the file at which it went wrong, in words."""
    found, step = 0, error.__traceback__
    while step is not None:
        found = step.tb_lineno if step.tb_frame.f_code.co_filename == str(path) else found
        step = step.tb_next
    found = error.lineno or 0 if isinstance(error, SyntaxError) else found
    return f"line {found}: " if found else ""


_addresses: dict[OwnFile, int] = {}


def address_in(own: OwnFile, caller: Caller) -> int:
    """The address of its kernel in this process. InputError if it does not compile.

    A first compilation takes seconds; then it is kept on disk.
    """
    if own not in _addresses:
        _addresses[own] = _compiled(own, caller)
    return _addresses[own]


def _compiled(own: OwnFile, caller: Caller) -> int:
    decide: Any = algorithm_in(own).decide

    @kernel
    def decide_in_file(controller, field, tick):
        return np.int64(decide(controller, field, tick))

    if INTERPRETED:
        return caller.address_of(decide_in_file)
    from numba.core.errors import NumbaError

    try:
        return caller.address_of(decide_in_file)
    except NumbaError as error:
        said = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise InputError(f"{own.name}.py: does not compile: {' '.join(said[:4])}") from None
