"""Controllers in files of their own: `algorithm = "damper.py"` in a protocol, declared as the shipped ones are.

The file travels with its controller (`Preset.own`); how it is run: `core.own_files`. A process beside this one runs it
first and says what it declares; here it is run to be compiled, once it is known to do no harm.
"""

import ast
import functools
import json
import math
import re
import threading
from typing import Any

import numpy as np

from core.control.algorithm import OWN, Algorithm, Parameter
from core.files import InputError
from core.kernels import INTERPRETED, kernel
from core.kernels.by_address import Caller
from core.kernels.decorators import Kernel
from core.own_files import NAME, OwnFile, check_own_name, declared_by, run_own

MOST_PARAMETERS = 8  # of any algorithm: the kernels take as many numbers of each
MOST_WORDS = 16  # decisions of its own


KIND = "algorithm"  # of what a file declares
UNDECLARED = -2  # the code of a decision that the file does not declare; `FAILED` (-1) is an error that it raised


def read_own(name: str, text: str) -> OwnFile:
    """The file of this name and text. InputError, one sentence, if it declares no algorithm that can run."""
    check_own_name(f"{name}.py")
    return OwnFile(name, text, json.dumps(declared_by(name, text, declare)))


def declare(name: str, text: str) -> dict[str, Any]:
    """Run the file: what it declares, as JSON holds it. InputError as `read_own`."""
    return {KIND: _plain(_run(name, text))}


def _run(name: str, text: str) -> Algorithm:
    """The algorithm in the file, which is run. InputError as `read_own`."""
    where = f"{name}.py"
    algorithm = getattr(run_own(name, text), "ALGORITHM", None)
    if not isinstance(algorithm, Algorithm):
        raise InputError(f"{where}: must have ALGORITHM = Algorithm(..), see docs/your-own-experiment.md")
    if reason := _why_not(algorithm):
        raise InputError(f"{where}: ALGORITHM: {reason}")
    decide = algorithm.decide
    if not callable(decide) or not INTERPRETED and not isinstance(decide, Kernel):
        raise InputError(f"{where}: ALGORITHM: decide must be a kernel: write @kernel above it")
    if reason := _recursion(text):
        raise InputError(f"{where}: {reason}")
    return algorithm


def _plain(algorithm: Algorithm) -> list[Any]:
    """Its declaration, as JSON holds it."""
    return [[[*parameter[:-1], [*parameter.slider]] for parameter in algorithm.parameters], [*algorithm.own]]


def _recursion(text: str) -> str:
    """Why a kernel could call itself without end, which would end the program; "": none calls itself."""
    functions = {node.name: node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)}
    calls = {
        name: {node.id for node in ast.walk(function) if isinstance(node, ast.Name)} & functions.keys()
        for name, function in functions.items()
    }
    for name, function in functions.items():
        reached, waiting = set[str](), [*calls[name]]
        while waiting:
            reached.add(called := waiting.pop())
            waiting += calls[called] - reached
        if name in reached:
            return f"line {function.lineno}: {name} calls itself, directly or by others, and a controller may not"
    return ""


def algorithm_in(own: OwnFile) -> Algorithm:
    """What the file declares; it is not run. InputError: what is stored of it is damaged."""
    return _algorithm(own)


@functools.cache
def _algorithm(own: OwnFile) -> Algorithm:
    where = f"{own.name}.py"
    try:
        parameters, words = own.declaration(KIND)
        found = tuple(Parameter._make([*about, (least, most)]) for *about, (least, most) in parameters)
        algorithm = Algorithm(where, found, tuple(words), _not_here)
        reason = _why_not(algorithm)
    except (ValueError, TypeError, LookupError, KeyError) as error:
        reason = str(error)
    if reason:
        raise InputError(f"{where}: what it declares is damaged ({reason})")
    return algorithm


def _not_here(*_: Any) -> int:
    raise TypeError("the declaration of a file has no code")


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
    algorithm = _run(own.name, own.text)
    if _plain(algorithm) != own.declaration(KIND):
        raise InputError(f"{own.name}.py: declares something else than what is stored of it")
    decide: Any = algorithm.decide
    end = OWN + len(algorithm.decisions)

    @kernel
    def decide_in_file(controller, field, tick):
        code = np.int64(decide(controller, field, tick))
        return code if 0 <= code < end else np.int64(UNDECLARED)

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
