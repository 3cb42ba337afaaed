"""Python files of one's own beside a protocol, controllers and measures: checked, and run from their text.

The text travels with the experiment, so that a session, its recordings and every process have the very code that ran,
and with it what the file declares, so that nobody runs it to read a session. A file is run as Python: start protocols
only of people whom you would let run a program. Code out of a session's folder: `core.own_consent`.
"""

import ast
import functools
import importlib.util
import json
import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from core.files import InputError, read_text
from core.kernels.cache import cache_folder
from core.kernels.decorators import OWN_MODULE
from core.own_consent import allow, digest_of, refuse_unallowed
from core.own_process import OwnCodeFailed, call_apart

MOST_CHARACTERS = 100_000  # every recording holds the text. Our choice
#: Names are columns of tables, words in tables of kernels and file names on every system.
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_OURS = {"core", "experiments", "hardware", "app", "phd"}
_lock = threading.RLock()


class OwnFile(NamedTuple):
    """A file of one's own."""

    name: str  # without ".py"
    text: str  # in full
    declared: str  # what it declares, JSON

    @property
    def digest(self) -> str:
        return digest_of(self.text)

    def declaration(self, kind: str) -> Any:
        """What it declares of this kind. InputError: nothing that can be read."""
        try:
            return json.loads(self.declared)[kind]
        except (ValueError, LookupError, TypeError, RecursionError):
            raise InputError(f"{self.name}.py: what it declares is damaged") from None


def read_own_text(folder: Path, name: str) -> str:
    """The text of a file of one's own, which may run from now on. InputError, one sentence: it is none."""
    check_own_name(name)
    path = folder / name
    text = read_text(path)
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"{path}: is longer than the {MOST_CHARACTERS} characters that every recording can hold")
    for module in _imported(text):
        if (folder / f"{module}.py").exists() or (folder / module / "__init__.py").exists():
            raise InputError(
                f"{path}: imports {module}, which stands beside it: a session keeps the text of this file alone, so "
                "put all of it into this file"
            )
    allow(text)
    return text


@functools.cache
def declared_by(name: str, text: str, declare: Callable[[str, str], dict[str, Any]]) -> dict[str, Any]:
    """What a file declares, from a process beside this one, which runs it. InputError, one sentence, if it cannot be.

    declare: takes name and text, there.
    """
    refuse_unallowed(f"{name}.py", text)
    try:
        return dict(call_apart(f"{name}.py: cannot be run", declare, name, text))
    except OwnCodeFailed as error:
        raise InputError(str(error)) from None


def check_own_name(name: str) -> None:
    """InputError unless this can be the name of such a file."""
    if not name.endswith(".py") or not NAME.fullmatch(name.removesuffix(".py")):
        raise InputError(f"{name}: must be the name of a Python file, of letters (a to z), digits and _ before .py")


def _imported(text: str) -> set[str]:
    """The modules that a text imports; none of a text that is no Python, which is said when it is run."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or (node.names[0].name if node.level else ""))
    return {name.partition(".")[0] for name in names if name} - _OURS


def run_own(name: str, text: str) -> ModuleType:
    """The module of this text, run once in a process. InputError, one sentence, if it cannot be run."""
    refuse_unallowed(f"{name}.py", text)
    module_name = f"{OWN_MODULE}{name}_{digest_of(text)[:16]}"
    with _lock:  # a module that another thread still runs is not whole
        if module_name in sys.modules:
            return sys.modules[module_name]
        try:
            path = _place(f"{module_name}.py", text)
        except OSError as error:
            raise InputError(f"{name}.py: cannot be run: {error.filename}: {error.strerror}") from None
        spec = importlib.util.spec_from_file_location(module_name, path)
        assert spec is not None and spec.loader is not None  # a path that ends in .py has both
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException as error:  # whatever the file does wrong
            sys.modules.pop(module_name, None)
            if isinstance(error, KeyboardInterrupt):  # of this user; the process beside this one gets none
                raise
            raise InputError(f"{name}.py: cannot be run: {what_failed(error, module_name)}") from None
        return module


def _place(name: str, text: str) -> Path:
    """A file with this text beside the compiled kernels: numba keeps machine code by the file that it is of."""
    folder = (cache_folder() or Path(tempfile.mkdtemp(prefix="phd-own-"))) / "own"
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / name
    if not path.exists() or path.read_bytes() != text.encode():
        with tempfile.NamedTemporaryFile("wb", dir=folder, delete=False) as new:
            new.write(text.encode())
        os.replace(new.name, path)
    return path


def what_failed(error: BaseException, module_name: str) -> str:
    """An error of a file of one's own in words: the line of the file at which it went wrong, and what."""
    found, step = 0, error.__traceback__
    while step is not None:
        found = step.tb_lineno if step.tb_frame.f_globals.get("__name__") == module_name else found
        step = step.tb_next
    if isinstance(error, SyntaxError) and not found:
        found = error.lineno or 0
    words = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    return f"line {found}: {words}" if found else words
