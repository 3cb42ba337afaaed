"""A pseudo-terminal that can be unplugged: its host's end stands at a name that stays the same when it is plugged in
again."""

import os
import tty
from pathlib import Path

from core.errors import InputError

PIECE = 4096  # bytes read at once


class Terminal:
    """The board's end of a pseudo-terminal; the host opens `port`, a link to the other end."""

    def __init__(self, port: Path) -> None:
        """InputError where this system has no pseudo-terminals."""
        if not hasattr(os, "openpty"):
            raise InputError("the emulated board needs pseudo-terminals, which this system does not have")
        self.port = port
        self.master, self._other = os.openpty()
        tty.setraw(self._other)  # no echo, no line ends; held open, or reading would fail while no host is there
        os.set_blocking(self.master, False)
        port.symlink_to(os.ttyname(self._other))
        self.lost_bytes = 0  # nobody read them, and the buffer was full

    def read(self) -> bytes:
        """What the host has sent; empty where it has sent nothing."""
        try:
            return os.read(self.master, PIECE)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """To the host; what does not fit into the buffer is lost, as on a wire that nobody reads."""
        try:
            written = os.write(self.master, data)
        except BlockingIOError:
            written = 0
        self.lost_bytes += len(data) - written

    def close(self) -> None:
        """Unplug."""
        self.port.unlink(missing_ok=True)
        os.close(self.master)
        os.close(self._other)
