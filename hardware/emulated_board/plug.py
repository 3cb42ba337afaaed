"""Where a host plugs in: the board's end of a pseudo-terminal, or of a TCP port of this computer.

Either is a stream of bytes to and from one host at a time, which may come, leave and stop reading at any moment. A
temporary folder announces each emulated board of this user: its file `port` is the terminal, or holds the TCP port's
address; `control` holds the number of the UDP port that takes orders.
"""

import contextlib
import os
import socket
import tempfile
from pathlib import Path
from typing import Any

from core.files import InputError
from hardware.serial_port import limit_buffers

EMULATED = "EMULATED-"  # begins the serial number of an emulated board
FOLDER = "phd-emulated-"  # begins the temporary folder's name
PORT = "port"
CONTROL = "control"
LOOPBACK = "127.0.0.1"
PIECE = 4096  # bytes read at once


def emulated_ports() -> dict[str, int]:
    """The ports of this user's emulated boards, each with the number of the UDP port that takes orders."""
    found = {}
    for file in sorted(Path(tempfile.gettempdir()).glob(f"{FOLDER}*/{PORT}")):
        with contextlib.suppress(OSError):  # it has just ended, or is another user's
            port = file.read_text() if file.is_file() else str(file)
            orders = int(file.with_name(CONTROL).read_text())
            if port and _is_taken(orders):
                found[port] = orders
    return found


def _is_taken(orders: int) -> bool:
    """Whether a program has this UDP port; a board that was killed leaves its folder behind."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((LOOPBACK, orders))
        except OSError:
            return True
    return False


class Terminal:
    """A pseudo-terminal; the host opens a link to its other end, `address`."""

    def __init__(self, folder: Path) -> None:
        import tty  # Windows has none

        self._port, self.address = folder / PORT, str(folder / PORT)
        self._master, self._other = os.openpty()
        tty.setraw(self._other)  # no echo, no line ends; held open, or reading would fail while no host is there
        os.set_blocking(self._master, False)
        self._port.symlink_to(os.ttyname(self._other))

    def descriptors(self) -> list[Any]:
        """What `select` waits for: a host has come, has sent something or has left."""
        return [self._master]

    def read(self) -> bytes:
        """What the host has sent; empty where it has sent nothing."""
        try:
            return os.read(self._master, PIECE)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send to the host; what finds no room is lost, as on a wire that no host reads."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Unplug."""
        self._port.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._other)


class TcpPort:
    """A TCP port of this computer, with the methods of `Terminal`; a second host is refused."""

    def __init__(self, folder: Path, number: int = 0) -> None:
        """number: 0: a free one. InputError: another program has it."""
        try:
            self._listener = socket.create_server((LOOPBACK, number))
        except OSError as error:
            raise InputError(f"TCP port {number} of this computer: {error.strerror}") from None
        self._listener.setblocking(False)
        self.number = self._listener.getsockname()[1]
        self.address = f"socket://{LOOPBACK}:{self.number}"
        self._host: socket.socket | None = None
        self._port = folder / PORT
        self._port.write_text(self.address)

    def descriptors(self) -> list[Any]:
        return [self._listener] + ([self._host] if self._host else [])

    def read(self) -> bytes:
        data = b""
        while piece := self._receive():
            data += piece
        with contextlib.suppress(BlockingIOError):
            host = self._listener.accept()[0]
            if self._host is None:
                host.setblocking(False)
                limit_buffers(host)
                self._host = host
            else:
                host.close()
        return data

    def _receive(self) -> bytes:
        """A piece of what has come; a host that has left makes room for the next."""
        try:
            piece = self._host.recv(PIECE) if self._host else b""
        except BlockingIOError:
            return b""
        except OSError:
            piece = b""
        if not piece:
            self._disconnect()
        return piece

    def _disconnect(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

    def write(self, data: bytes) -> None:
        try:
            if self._host is not None:
                self._host.send(data)
        except BlockingIOError:
            pass  # lost: the host does not read
        except OSError:
            self._disconnect()

    def close(self) -> None:
        self._port.unlink(missing_ok=True)
        self._disconnect()
        self._listener.close()
