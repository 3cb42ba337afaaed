"""One end of the pipe between window and control loop, that never makes its owner wait.

A message is sent only while the pipe is mostly empty: a window that hangs holds up nothing in the loop.
"""

import select
from collections import deque
from multiprocessing.connection import Connection


class Mailbox:
    """Sends and receives without waiting; `closed` once the other end is gone."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._outbox: deque = deque()
        self._room = select.poll()
        self._room.register(connection.fileno(), select.POLLOUT)
        self._post = select.poll()
        self._post.register(connection.fileno(), select.POLLIN)
        self.closed = False

    def receive(self, wait_s: float = 0.0) -> list:
        """The messages that have come; waits at most `wait_s` for the first."""
        messages: list = []
        while not self.closed and self._post.poll(0 if messages else 1000.0 * wait_s):
            try:
                messages.append(self._connection.recv())
            except (EOFError, OSError):
                self.closed = True
        return messages

    def send(self, message: object) -> None:
        """Send now or, while there is no room, later and in order; nothing is lost while the other end lives."""
        self._outbox.append(message)
        self.flush()

    def offer(self, message: object) -> bool:
        """Send now, or not at all while there is no room; whether it was sent."""
        self.flush()
        return not self._outbox and self._put(message)

    def flush(self) -> None:
        """Send what waits, as far as there is room."""
        while self._outbox and self._put(self._outbox[0]):
            self._outbox.popleft()

    def close(self) -> None:
        """Close this end."""
        self.closed = True
        self._connection.close()

    def _put(self, message: object) -> bool:
        if self.closed or not self._room.poll(0):  # room: three quarters of the buffer, far more than any message
            return False
        try:
            self._connection.send(message)
        except OSError:
            self.closed = True
        return not self.closed
