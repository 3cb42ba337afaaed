"""One end of the line between window and conductor, that never makes its owner wait for the other end."""

import contextlib
import pickle
import select
import socket
import struct
from multiprocessing.connection import Connection

_LENGTH = struct.Struct("!Q")
_PIECE = 1 << 16
#: Bytes that may wait for the other end before what can be left out (`offer`) is left out.
_BACKLOG = 1 << 16


class Mailbox:
    """Sends and receives without waiting; `closed` once the other end is gone."""

    def __init__(self, connection: Connection) -> None:
        """Takes over a connection whose two ends have proved to each other that they know the key."""
        family = getattr(socket, "AF_UNIX", socket.AF_INET)
        self._socket = socket.fromfd(connection.fileno(), family, socket.SOCK_STREAM)
        connection.close()
        self._socket.setblocking(False)
        self._outbox, self._inbox = bytearray(), bytearray()
        self.closed = False

    def send(self, message: object) -> None:
        """Send now or, while there is no room, later and in order; nothing is lost while the other end lives."""
        data = pickle.dumps(message)
        self._outbox += _LENGTH.pack(len(data)) + data
        self.flush()

    def offer(self, message: object) -> bool:
        """Send, or not at all while much is waiting; whether it was sent."""
        if self.behind:
            return False
        self.send(message)
        return True

    @property
    def waiting(self) -> bool:
        """Whether something still waits for the other end, which lives."""
        return bool(self._outbox) and not self.closed

    @property
    def behind(self) -> bool:
        """Whether much waits for the other end, which does not read."""
        self.flush()
        return len(self._outbox) > _BACKLOG

    def flush(self) -> None:
        """Send what waits, as far as there is room."""
        while self._outbox and not self.closed:
            try:
                del self._outbox[: self._socket.send(self._outbox)]
            except BlockingIOError:
                return
            except OSError:  # the other end is gone; what it said before is still read, up to its end
                self._outbox.clear()

    def receive(self, wait_s: float = 0.0) -> list:
        """The messages that have come; waits at most `wait_s` for the first."""
        self.flush()
        if wait_s > 0.0 and not self.closed:
            select.select([self._socket], [], [], wait_s)
        while not self.closed:
            try:
                piece = self._socket.recv(_PIECE)
            except BlockingIOError:
                break
            except OSError:
                piece = b""
            self._inbox += piece
            self.closed = not piece
        return self._whole()

    def close(self) -> None:
        """Close this end; what still waits is sent as far as there is room."""
        with contextlib.suppress(OSError):
            self.flush()
        self.closed = True
        self._socket.close()

    def _whole(self) -> list:
        messages = []
        while len(self._inbox) >= _LENGTH.size:
            end = _LENGTH.size + _LENGTH.unpack_from(self._inbox)[0]
            if len(self._inbox) < end:
                break
            messages.append(pickle.loads(self._inbox[_LENGTH.size : end]))
            del self._inbox[:end]
        return messages
