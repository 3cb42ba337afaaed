"""Work beside the window, so that nothing blocks it."""

import contextlib
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from PySide6.QtCore import QObject, QProcess, QProcessEnvironment, Signal

from app.ipc.process import ROOT
from app.progress import PROGRESS
from core.files import InputError


class Background(QObject):
    """Runs functions one after the other in a thread; their results arrive in the window's thread."""

    _arrived = Signal(object, object)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="beside the window")
        self._newest: dict[str, int] = {}  # question -> how often it was asked
        self._arrived.connect(lambda then, result: then(result))

    def ask(self, question: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Let `then` have what `work` returns, or its InputError; asked again meanwhile, only the newest answer."""
        number = self._newest[question] = self._newest.get(question, 0) + 1

        def answer(result: Any) -> None:
            if isinstance(result, Exception) and not isinstance(result, InputError):
                raise result
            if self._newest[question] == number:
                then(result)

        def run() -> None:
            if self._newest[question] != number:
                return
            try:
                result = work()
            except Exception as error:  # raised again where the window can say so
                result = error
            with contextlib.suppress(RuntimeError):  # the window is gone
                self._arrived.emit(answer, result)

        self._thread.submit(run)

    def forget(self, question: str) -> None:
        """Drop the answer that is still to come, if any."""
        self._newest[question] = self._newest.get(question, 0) + 1

    def close(self) -> None:
        """Begin nothing more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


class Verb(QObject):
    """A verb of `phd` in a process of its own, one at a time."""

    progressed = Signal(float)  # the share done
    ended = Signal(str)  # why it failed; "": it did not

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._process = QProcess(self)
        self._process.setReadChannel(QProcess.ProcessChannel.StandardError)
        self._process.finished.connect(self._finished)
        self._process.readyReadStandardError.connect(self._listen)
        self._said = ""

    @property
    def busy(self) -> bool:
        """Whether one runs."""
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self, *arguments: str) -> None:
        """Begin; a signal tells the end."""
        self._said = ""
        environment = QProcessEnvironment.systemEnvironment()
        environment.insert(PROGRESS, "lines")
        environment.insert("PYTHONPATH", f"{ROOT}{os.pathsep}{environment.value('PYTHONPATH')}")
        self._process.setProcessEnvironment(environment)
        self._process.start(sys.executable, ["-m", "app.cli", *arguments])

    def cancel(self) -> None:
        """Stop it: what it had begun to write is removed by itself."""
        self._process.terminate()

    def _listen(self) -> None:
        while self._process.canReadLine():
            said = bytes(self._process.readLine().data()).decode(errors="replace").strip()
            share = said.removeprefix(f"{PROGRESS} ")
            if share != said:
                self.progressed.emit(float(share))
            else:
                self._said = said or self._said

    def _finished(self, code: int, how: QProcess.ExitStatus) -> None:
        self._listen()
        self.ended.emit("" if code == 0 and how == QProcess.ExitStatus.NormalExit else self._said or "it was ended")
