"""`phd emulate` as a program of its own, and orders to it."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from hardware.emulated_board.plug import LOOPBACK, emulated_ports

ROOT = Path(__file__).resolve().parents[2]


class Emulated:
    """A running `phd emulate`."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / "log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "app.cli", "emulate", *arguments],
                cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True,
            )  # fmt: skip
        self.port = self.process.stdout.readline().strip()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((LOOPBACK, emulated_ports()[self.port]))
        self._socket.settimeout(200.0)

    def order(self, **order) -> dict:
        """An order; the truth."""
        return self.send(json.dumps(order))

    def send(self, text: str) -> dict:
        """An order as it goes over the wire; the answer."""
        self._socket.send(text.encode())
        return json.loads(self._socket.recv(1 << 16))

    def end(self, number: int = signal.SIGTERM) -> int:
        """End it; its exit code. Windows cannot ask it to end: its exit code 1 then stands for 0."""
        if sys.platform == "win32":
            self.process.kill()
            code = self.process.wait(200) - 1
            while self.port in emulated_ports():  # the sockets of a program that was ended may close a moment later
                time.sleep(0.01)
        else:
            self.process.send_signal(number)
            code = self.process.wait(200)
        self.process.stdout.close()
        self._socket.close()
        return code


def to_zero_s(truth: dict, text: str) -> float:
    """How long (s) after this event the last current was gone; 0 where none flowed then. They must be zero now."""
    assert not any(truth["currents_mA"]), truth["currents_mA"]
    begun = when(truth, text)
    return max((t - begun for t, event in truth["events"] if event == "currents zero" and t >= begun), default=0.0)


def when(truth: dict, text: str) -> float:
    """When the last event of this text was, s of the board's time."""
    return max(t for t, event in truth["events"] if event == text)
