"""Work beside the window: a function in a thread, of which only the newest result is shown; verbs in processes."""

import atexit
import contextlib
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Any, ClassVar

from PySide6.QtCore import QEvent, QObject, QTimer, Signal
from PySide6.QtWidgets import QWidget

from app.ipc.pipe import start_python
from app.progress import PROGRESS
from core.files import InputError
from experiments.atomic_files import reason_of

LONGEST_END_S = 5.0  # that the end of the program waits for threads
LOOK_MS = 2000  # between two looks of a `Watch`


class BackgroundTask(QObject):
    """One thing at a time is asked for; what was asked before is dropped when it comes.

    It has no parent: a thread that outlives its page may still emit. It is kept until its threads have ended, for a
    QObject must not end in another thread than its own.
    """

    _unfinished: ClassVar[set["BackgroundTask"]] = set()  # those with threads

    done = Signal(object)  # the result, or the InputError that says why there is none; a deleted page hears nothing
    _came = Signal(int, object)  # to this thread: the number of what was asked, and the same

    def __init__(self, done: Callable[[Any], object]) -> None:
        super().__init__()
        self.done.connect(done)
        self._newest = 0  # number of what was asked for last
        self._threads: dict[int, threading.Thread] = {}  # by the number of what was asked
        self.busy = False  # whether its result is still to come
        self._came.connect(self._emit)

    def ask(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call it in a thread."""
        self._newest, self.busy = self._newest + 1, True
        self._unfinished.add(self)
        asked = self._newest, function, arguments
        self._threads[self._newest] = thread = threading.Thread(target=self._run, args=asked, daemon=True)
        thread.start()

    def forget(self) -> None:
        """Nothing that was asked is wanted any more."""
        self._newest, self.busy = self._newest + 1, False

    def _run(self, number: int, function: Callable[..., Any], arguments: tuple) -> None:
        try:
            result = function(*arguments)
        except InputError as error:
            result = error
        except OSError as error:
            result = InputError(f"{error.filename}: {reason_of(error)}")
        self._came.emit(number, result)

    def _emit(self, number: int, result: object) -> None:
        self._threads.pop(number).join()
        if not self._threads:
            self._unfinished.discard(self)
        if number == self._newest:
            self.busy = False
            self.done.emit(result)

    @classmethod
    def finish(cls) -> None:
        """The program ends: wait for its threads, for one that comes back to Python later ends it by a crash.

        One that waits for something that does not come back, as a folder on a network, is left where it is.
        """
        end_s = time.perf_counter() + LONGEST_END_S
        for task in cls._unfinished:
            for thread in task._threads.values():
                thread.join(max(end_s - time.perf_counter(), 0.0))
        cls._unfinished.clear()


atexit.register(BackgroundTask.finish)


class Watch(BackgroundTask):
    """Looks at something again and again while a widget is shown; an answer that takes long is waited for."""

    def __init__(self, widget: QWidget, look: Callable[[], tuple], done: Callable[[Any], object]) -> None:
        """look: every `LOOK_MS`, the function that is called in a thread and its arguments."""
        super().__init__(done)
        self._look = look
        self._timer = QTimer(self, interval=LOOK_MS)
        self._timer.timeout.connect(self.look)
        widget.installEventFilter(self)

    def look(self) -> None:
        """Now, unless the answer before is still to come."""
        if not self.busy:
            self.ask(*self._look())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show:
            self._timer.start()
            self.look()
        elif event.type() == QEvent.Type.Hide:
            self._timer.stop()
        return super().eventFilter(watched, event)


class VerbProcess(BackgroundTask):
    """A verb of `phd`, or another module's `main`, in a process of its own; its result is what it prints."""

    progressed = Signal(int)  # thousandths of it that are done

    def __init__(self, done: Callable[[Any], object]) -> None:
        super().__init__(done)
        self._process: subprocess.Popen | None = None
        self.stopped = False  # it was ended before its end

    def begin(self, *arguments: str, module: str = "app.cli", given: bytes = b"") -> None:
        """Run it. given: what it reads from its standard input."""
        self.stopped = False
        self.ask(self._through, arguments, module, given)

    def stop(self, wait: bool = False) -> None:
        """End it; what it had begun to write is removed by itself. wait: until that has been done."""
        self.stopped = True
        if self._process is not None:
            self._process.terminate()
            if wait:
                self._process.wait()

    def _through(self, arguments: tuple[str, ...], module: str, given: bytes) -> str:
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self._process = process = start_python(module, *arguments, environment={PROGRESS: "lines"}, **pipes)
        if self.stopped:
            process.terminate()
        text = trouble = ""
        assert process.stdin and process.stdout and process.stderr  # all three are pipes
        with process, contextlib.suppress(BrokenPipeError):  # it has ended already: there is nothing that it prints
            process.stdin.write(given)
            process.stdin.close()
            for line in process.stderr:
                text = line.decode(errors="replace")
                share = text.removeprefix(f"{PROGRESS} ")
                if share != text:
                    self.progressed.emit(round(1000.0 * float(share)))
                else:
                    trouble = text.strip() or trouble
            text = process.stdout.read().decode()
        if not text:
            raise InputError(trouble or "it was ended early")
        return text
