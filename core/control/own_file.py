"""Controllers in files of their own: `algorithm = "damper.py"` in a protocol, declared as the shipped ones are.

The text of the file travels with its controller (`Preset.own`); how it is run: `core.own_files`.
"""

import functools
import hashlib
import math
import re
import threading
from typing import Any, NamedTuple

import numpy as np

from core.control.algorithm import OWN, Algorithm, Parameter
from core.files import InputError
from core.kernels import INTERPRETED, kernel
from core.kernels.by_address import FAILED, Caller
from core.own_files import NAME, check_own_name, run_own

MOST_PARAMETERS = 8  # of any algorithm: the kernels take as many numbers of each
MOST_WORDS = 16  # decisions of its own


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
    where = f"{name}.py"
    check_own_name(where)
    algorithm = getattr(run_own(name, text), "ALGORITHM", None)
    if not isinstance(algorithm, Algorithm):
        raise InputError(f"{where}: must have ALGORITHM = Algorithm(..), see docs/your-own-experiment.md")
    if reason := _why_not(algorithm):
        raise InputError(f"{where}: ALGORITHM: {reason}")
    return algorithm._replace(kind=where)


def _why_not(algorithm: Algorithm) -> str:
    """Why an algorithm of a file cannot be used; "": it can."""
    parameters, words = algorithm.parameters, algorithm.own
    if not isinstance(parameters, tuple) or not all(isinstance(parameter, Parameter) for parameter in parameters):
        return "its parameters must be a tuple of Parameter(..): (PARAMETER,) for a single one"
    for parameter in parameters:
        if not isinstance(parameter.name, str) or not NAME.fullmatch(parameter.name):
            return f"a parameter's name must be of letters (a to z), digits and _, not {parameter.name!r}"
        if not all(isinstance(text, str) and text.isprintable() for text in (parameter.word, parameter.unit)):
            return f"{parameter.name}: word and unit must be text"
        default = 0.0 if parameter.default is None else parameter.default
        if not _numbers(default, parameter.scale, *parameter.slider) or not 0.0 <= default < math.inf:
            return f"{parameter.name}: scale, default and slider must be numbers, the default finite and not negative"
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names) or len(names) > MOST_PARAMETERS:
        return f"it may have up to {MOST_PARAMETERS} parameters, each of another name"
    if not isinstance(words, tuple) or not all(isinstance(word, str) and word.isprintable() for word in words):
        return 'its decisions must be a tuple of texts: ("damped",) for a single one'
    if len(algorithm.decisions) > MOST_WORDS:
        return f"it may have up to {MOST_WORDS} decisions of its own, not {len(algorithm.decisions)}"
    if not callable(algorithm.decide) or not INTERPRETED and not hasattr(algorithm.decide, "entry"):
        return "decide must be a kernel: write @kernel above it"
    return ""


def _numbers(*values: object) -> bool:
    return all(isinstance(value, int | float) and math.isfinite(value) for value in values)


_addresses: dict[OwnFile, int] = {}
_lock = threading.Lock()


def address_in(own: OwnFile, caller: Caller) -> int:
    """The address of its kernel in this process. InputError if it does not compile.

    A first compilation takes seconds; then it is kept on disk.
    """
    with _lock:
        if own not in _addresses:
            _addresses[own] = _compiled(own, caller)
        return _addresses[own]


def _compiled(own: OwnFile, caller: Caller) -> int:
    algorithm = algorithm_in(own)
    decide: Any = algorithm.decide
    end = OWN + len(algorithm.decisions)

    @kernel
    def decide_in_file(controller, field, tick):
        code = np.int64(decide(controller, field, tick))
        return code if 0 <= code < end else np.int64(FAILED)

    if INTERPRETED:
        return caller.address_of(decide_in_file)
    from numba.core.errors import NumbaError, UnsupportedBytecodeError

    try:
        return caller.address_of(decide_in_file)
    except (NumbaError, UnsupportedBytecodeError) as error:
        raise InputError(f"{own.name}.py: does not compile: {_compile_error(str(error), own)}") from None


def _compile_error(message: str, own: OwnFile) -> str:
    """The line of the file and the reason, from a message of numba: without its colours and its long types."""
    plain = re.sub(r"\x1b\[[\d;]*m", "", message)
    lines = [line.strip() for line in plain.splitlines() if line.strip() and "mode pipeline" not in line]
    reason = " ".join(lines[:2]) if lines[1:] and lines[1].startswith(">>>") else lines[0]
    reason = re.sub(r"(of type \w+)\(.*\)", r"\1", reason)
    reason = re.sub(r"Literal\[\w+\]\((.*?)\)", r"\1", reason)
    reason = re.sub(r"Cannot bind .* to signature '(.*)' due to \"TypeError: (.*)\"", r"a call of \1: \2", reason)
    reason = re.sub(r" ?(, defined at|Raised from) .*", "", reason).rstrip(".")
    place = re.search(rf"_{own.name}_\w+\.py(?:\", line | \()(\d+)", plain)
    line = int(place[1]) if place else 0
    if undefined := re.search(r"name '(\w+)' is not defined", reason):  # numba does not say where
        line = 1 + re.split(rf"\b{undefined[1]}\b", own.text)[0].count("\n")
    return f"line {line}: {reason}" if line else reason
