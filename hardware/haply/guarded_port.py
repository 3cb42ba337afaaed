"""A serial port with `watchdog_process` beside it, which takes the torques off when this program does not write."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from core.device_interface import DeviceError
from core.faults import cause
from hardware.haply.wire import NO_TORQUE
from hardware.serial_port import Port

PROCESS = Path(__file__).with_name("watchdog_process.py")


class GuardedPort(Port):
    """A `Port` that tells the watchdog of each write. DeviceError if the watchdog has ended."""

    def __init__(self, name: str) -> None:
        if sys.platform == "win32":
            raise DeviceError(f"serial port {name}: a Haply needs Linux here: its watchdog inherits the port")
        super().__init__(name)
        port = self._serial.fileno()
        command = [sys.executable, "-I", "-S", str(PROCESS), str(port)]
        self._watchdog = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=(port,))

    def write(self, data: bytes) -> None:
        """Send, and tell the watchdog."""
        assert self._watchdog.stdin
        if self._watchdog.poll() is not None:
            raise DeviceError(cause("port", name=self.name, what="its watchdog has ended"))
        with contextlib.suppress(BrokenPipeError):  # found by the next `poll`
            os.write(self._watchdog.stdin.fileno(), b".")
        super().write(data)

    def close(self) -> None:
        """Take the torques off, as the watchdog then does again, and ends; close the port."""
        assert self._watchdog.stdin
        with contextlib.suppress(DeviceError):  # it is gone
            super().write(NO_TORQUE)
        self._watchdog.stdin.close()
        try:
            self._watchdog.wait(1.0)
        except subprocess.TimeoutExpired:  # its port hangs, as ours would
            self._watchdog.kill()
            self._watchdog.wait()
        super().close()
