"""Work beside the window: a function in a thread, of which only the newest result is shown; verbs in processes."""

import json
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PySide6.QtCore import QObject, Signal

from app.ipc.process import start_python
from app.progress import PROGRESS
from core.files import InputError
from experiments.session.playback import errors, replayed_ticks


class Work(QObject):
    """One thing at a time is asked for; what was asked before is dropped when it comes.

    It has no parent: a thread that outlives its page may still emit.
    """

    done = Signal(object)  # the result, or the InputError that says why there is none

    def __init__(self) -> None:
        super().__init__()
        self._newest = 0
        self._came.connect(self._emit)

    _came = Signal(int, object)

    @property
    def busy(self) -> bool:
        """Whether a result is still to come."""
        return self._newest < 0

    def ask(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call it in a thread."""
        self._newest = -abs(self._newest) - 1
        threading.Thread(target=self._run, args=(self._newest, function, arguments), daemon=True).start()

    def forget(self) -> None:
        """Nothing that was asked is wanted any more."""
        self._newest = abs(self._newest) + 1

    def _run(self, number: int, function: Callable[..., Any], arguments: tuple) -> None:
        try:
            result = function(*arguments)
        except InputError as error:
            result = error
        self._came.emit(number, result)

    def _emit(self, number: int, result: object) -> None:
        if number == self._newest:
            self._newest = abs(number)
            self.done.emit(result)


class Verb(Work):
    """A verb of `phd` in a process of its own; its result is what it prints."""

    progressed = Signal(float)  # the share done

    def __init__(self) -> None:
        super().__init__()
        self._process: subprocess.Popen | None = None

    def begin(self, *arguments: str) -> None:
        """Run it."""
        self.ask(self._through, arguments)

    def stop(self) -> None:
        """End it; what it had begun to write is removed by itself."""
        if self._process is not None:
            self._process.terminate()

    def _through(self, arguments: tuple[str, ...]) -> str:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self._process = start_python("app.cli", *arguments, environment={PROGRESS: "lines"}, **pipes)
        trouble = ""
        for said in self._process.stderr:
            share = said.removeprefix(f"{PROGRESS} ")
            if share != said:
                self.progressed.emit(float(share))
            else:
                trouble = said.strip() or trouble
        text = self._process.communicate()[0]
        if not text:
            raise InputError(trouble or "it was ended early")
        return text


class Replayed(NamedTuple):
    """A trial's hand through another controller."""

    controller: str  # its name
    ticks: np.ndarray  # (n, tick_log.WIDTH), of the movement
    error: np.ndarray  # (n,) m
    metrics: dict[str, dict[str, float | None]]  # name -> before, after, change
    status: str
    text: str  # how it is to be read


class Replay(Work):
    """`phd replay` in a process of its own."""

    def __init__(self) -> None:
        super().__init__()
        self._process: subprocess.Popen | None = None

    def begin(self, path: Path, controller: int, name: str) -> None:
        """The hand of this recording through a controller of its protocol."""
        self.stop()
        self.ask(self._through, path, controller, name)

    def stop(self) -> None:
        """End what runs; its result is not wanted."""
        self.forget()
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()

    def _through(self, path: Path, controller: int, name: str) -> Replayed:
        folder = Path(tempfile.mkdtemp(prefix="phd-replay-"))
        try:
            out = folder / "ticks.csv"
            arguments = ("replay", str(path), "--controller", str(controller), "--out", str(out), "--json")
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            self._process = start_python("app.cli", *arguments, **pipes)
            text, trouble = self._process.communicate()
            if not text:
                raise InputError(trouble.strip().splitlines()[-1] if trouble.strip() else "The replay has ended early.")
            about, ticks = json.loads(text), replayed_ticks(out)
            return Replayed(name, ticks, errors(ticks), about["metrics"], about["after"]["status"], about["says"])
        finally:
            shutil.rmtree(folder, ignore_errors=True)
