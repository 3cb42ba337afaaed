"""One end of the two pipes between a process and the one that started it; neither end ever waits for the other."""

import pickle
import queue
import threading
import time
from typing import BinaryIO

_LOOK_S = 0.005


class Pipe:
    """Sends and receives messages on two threads of its own; `closed` once the other end is gone."""

    def __init__(self, incoming: BinaryIO, outgoing: BinaryIO) -> None:
        """Takes over both files."""
        self.closed = False
        self._inbox: queue.SimpleQueue[object] = queue.SimpleQueue()  # messages; last, _END
        self._outbox: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._waiting = 0  # messages that have been given to `send` ..
        self._written = 0  # .. and to the system
        threading.Thread(target=self._read, args=(incoming,), name="pipe in", daemon=True).start()
        self._writer = threading.Thread(target=self._write, args=(outgoing,), name="pipe out", daemon=True)
        self._writer.start()

    def send(self, message: object) -> None:
        """Send now or, while there is no room, later and in order; nothing is lost while the other end lives."""
        self._waiting += 1
        self._outbox.put(pickle.dumps(message))

    @property
    def behind(self) -> bool:
        """Whether the other end has not yet made room for what was sent."""
        return self._written < self._waiting and self._writer.is_alive()

    def flush(self, wait_s: float) -> None:
        """Wait until everything is sent, or the other end is gone, at most so long."""
        end = time.monotonic() + wait_s
        while self.behind and time.monotonic() < end:
            time.sleep(_LOOK_S)

    def receive(self, wait_s: float = 0.0) -> list:
        """The messages that have come; waits at most `wait_s` for the first."""
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
        """Send what waits, then tell the other end that nothing more will come."""
        self._outbox.put(None)

    def _read(self, incoming: BinaryIO) -> None:
        with incoming:
            while True:
                try:
                    self._inbox.put(pickle.load(incoming))
                except (EOFError, pickle.UnpicklingError, OSError):  # the other end is gone, perhaps in mid-message
                    break
        self._inbox.put(_END)

    def _write(self, outgoing: BinaryIO) -> None:
        try:
            with outgoing:
                while (message := self._outbox.get()) is not None:
                    outgoing.write(message)
                    outgoing.flush()
                    self._written += 1
        except OSError:  # the other end is gone; what it said before is still read, up to its end
            return


_END = object()
