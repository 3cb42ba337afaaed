"""One end of the two pipes between a process and the one that started it; neither end ever waits for the other."""

import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

from app.ipc.scheduling import program_cores

_ROOT = str(Path(__file__).resolve().parents[2])
_LOOK_S = 0.005
_END = object()


class Pipe:
    """Sends and receives messages on two threads; `closed` once the other end is gone."""

    def __init__(self, incoming: IO[bytes], outgoing: IO[bytes]) -> None:
        """Takes over both files."""
        self.closed = False
        self._inbox: queue.Queue[object] = queue.Queue()  # messages; last, _END; see `receive`
        self._outbox: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._waiting = 0  # messages that have been given to `send` ..
        self._written = 0  # .. and to the system
        threading.Thread(target=self._read, args=(incoming,), name="pipe in", daemon=True).start()
        self._writer = threading.Thread(target=self._write, args=(outgoing,), name="pipe out", daemon=True)
        self._writer.start()

    def send(self, message: object) -> None:
        """Send, later if there is no room now, in order; nothing is lost while the other end lives."""
        self._waiting += 1
        self._outbox.put(pickle.dumps(message))

    @property
    def has_backlog(self) -> bool:
        """Whether messages wait for the other end to make room."""
        return self._written < self._waiting and self._writer.is_alive()

    def flush(self, wait_s: float = 1.0) -> None:
        """Wait until everything is sent or the other end is gone, at most `wait_s`."""
        end = time.perf_counter() + wait_s
        while self.has_backlog and time.perf_counter() < end:
            time.sleep(_LOOK_S)

    def receive(self, wait_s: float = 0.0) -> list:
        """Messages that have arrived; waits at most `wait_s` for the first.

        The inbox is no `SimpleQueue`, whose `get` (Python 3.11) may wait for ever after a signal as its time runs out.
        """
        messages: list = []
        try:
            message = self._inbox.get(timeout=wait_s) if wait_s > 0.0 else self._inbox.get_nowait()
            while message is not _END:
                messages.append(message)
                message = self._inbox.get_nowait()
            self.closed = True
        except queue.Empty:
            pass
        return messages

    def close(self) -> None:
        """Send what waits, then close."""
        self._outbox.put(None)

    def _read(self, incoming: IO[bytes]) -> None:
        with incoming:
            while True:
                try:
                    self._inbox.put(pickle.load(incoming))
                except (EOFError, pickle.UnpicklingError, OSError):  # the other end is gone, perhaps in mid-message
                    break
        self._inbox.put(_END)

    def _write(self, outgoing: IO[bytes]) -> None:
        try:
            with outgoing:
                while (message := self._outbox.get()) is not None:
                    outgoing.write(message)
                    outgoing.flush()
                    self._written += 1
        except OSError:  # the other end is gone; what it sent before is still read, up to its end
            return


class Child(Pipe):
    """A process of this program that we start, connected by its standard input and output."""

    def __init__(self, module: str, *arguments: str, **options: Any) -> None:
        """Run `main` of a module. options: as for Popen."""
        self._process = start_python(module, *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **options)
        assert self._process.stdout is not None and self._process.stdin is not None
        super().__init__(self._process.stdout, self._process.stdin)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether the process has ended and was waited for."""
        return self._process.returncode is not None

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self.end(0.0)

    def end(self, wait_s: float) -> None:
        """Close the pipe, so that the process ends by itself; kill it after `wait_s`."""
        self.close()
        try:
            self._process.wait(max(0.0, wait_s))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def start_python(
    module: str, *arguments: str, environment: dict[str, str] | None = None, **options: Any
) -> subprocess.Popen:
    """Run `main` of a module of this program in a new process, from any folder.

    Not by `-m`, so that what it pickles belongs to that module; `-P`: nothing is imported from the current folder.
    environment: added to ours; options: as for Popen.
    """
    program_cores()  # handed down
    path = os.environ.get("PYTHONPATH", "")
    found = {"PYTHONPATH": f"{_ROOT}{os.pathsep}{path}" if path else _ROOT}
    command = [sys.executable, "-P", "-c", f"from {module} import main; main()", *arguments]
    if sys.platform == "win32":  # neither a console window of its own nor the Ctrl-C of ours
        options["creationflags"] = subprocess.CREATE_NO_WINDOW
    return subprocess.Popen(command, env=os.environ | found | (environment or {}), **options)
