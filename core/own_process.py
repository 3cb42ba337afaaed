"""Runs a function on code of one's own in a process beside this one, whatever that code does.

An error, an exit, recursion without end, a changed folder, closed files, a minute without an answer: each becomes one
sentence, and this process goes on. The other process is started at the first call and serves all later ones; after one
that it did not survive a new one is started.
"""

import atexit
import contextlib
import faulthandler
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from core.files import InputError
from core.own_consent import allow_everything

LONGEST_S = 60.0  # that a call may take
_ROOT = Path(__file__).resolve().parents[1]
_lock = threading.Lock()
_other: subprocess.Popen | None = None
_starter = 0  # the process that started it: a forked one starts its own


class OwnCodeFailed(Exception):
    """One sentence: what the code did."""


def call_apart(what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """The function's result, which JSON must hold, from the other process.

    what: begins the sentence. OwnCodeFailed: the function raised an error, or the process did not survive it.
    """
    global _other
    with _lock:
        other, began = _running(), time.perf_counter()
        assert other.stdin is not None and other.stdout is not None  # both are pipes
        try:
            with contextlib.suppress(BrokenPipeError):
                pickle.dump((LONGEST_S, what, function, arguments), other.stdin)
                other.stdin.flush()
            line = other.stdout.readline()
        except BaseException:  # an interrupt: what it would still answer belongs to no later call
            _end()
            raise
        if not line.endswith(b"\n"):
            code = other.wait()
            _other = None
            raise OwnCodeFailed(f"{what}: {_how_it_ended(code, time.perf_counter() - began)}")
        answer = json.loads(line)
        if "spoilt" in answer:  # that process serves no other call
            _end()
    if "failed" in answer:
        raise OwnCodeFailed(answer["failed"])
    return answer["result"]


def _running() -> subprocess.Popen:
    global _other, _starter
    if _other is None or _starter != os.getpid() or _other.poll() is not None:
        path = os.environ.get("PYTHONPATH", "")
        found = os.environ | {"PYTHONPATH": f"{_ROOT}{os.pathsep}{path}" if path else str(_ROOT)}
        command = [sys.executable, "-P", "-c", "from core.own_process import main; main()"]
        hidden: dict[str, Any] = {}
        if sys.platform == "win32":
            hidden["creationflags"] = subprocess.CREATE_NO_WINDOW
        _other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=found, **hidden)
        _starter = os.getpid()
    return _other


def _how_it_ended(code: int, after_s: float) -> str:
    if after_s >= LONGEST_S:
        return f"took longer than {LONGEST_S:.0f} s and was ended"
    if code in {-getattr(signal, name) for name in ("SIGSEGV", "SIGABRT", "SIGBUS") if hasattr(signal, name)}:
        return f"crashed its process ({signal.Signals(-code).name}), as recursion without end does"
    return f"ended its process (exit status {code})"


@atexit.register
def _end() -> None:
    global _other
    if _other is not None and _starter == os.getpid():
        _other.kill()
        _other.wait()
        for pipe in (_other.stdin, _other.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
    _other = None


# -------------------------------------------------------------------------------------------------- the other process


def main() -> None:
    """Answer calls until the process that started this one is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other one gets it, too, and ends this one
    allow_everything()
    calls, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(2, 1)  # what the code prints
    with open(os.devnull, "wb") as unread:
        while True:
            try:
                longest_s, what, function, arguments = pickle.load(calls)
            except EOFError:
                return
            faulthandler.dump_traceback_later(longest_s, exit=True, file=unread)
            folder = os.getcwd()
            answer = _answer(what, function, arguments)
            disturbed = _disturbed(folder)
            faulthandler.cancel_dump_traceback_later()
            answers.write(_line({"failed": f"{what}: {disturbed}", "spoilt": True}) if disturbed else answer)
            answers.flush()


def _answer(what: str, function: Callable[..., Any], arguments: tuple) -> bytes:
    """A line of JSON: the result, or the sentence."""
    try:
        return _line({"result": function(*arguments)})
    except InputError as error:
        return _line({"failed": str(error)})
    except BaseException as error:  # whatever the code does
        words = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
        return _line({"failed": f"{what}: {words}"})


def _line(answer: dict[str, Any]) -> bytes:
    return f"{json.dumps(answer)}\n".encode()


def _disturbed(folder: str) -> str:
    """What the code has changed in its process that no code of one's own may change; "": nothing."""
    try:
        if os.getcwd() != folder:
            return "changed the current folder, which is the program's"
        for number in range(3):
            os.fstat(number)
    except OSError:
        return "closed a file, or removed a folder, that is the program's"
    return ""
