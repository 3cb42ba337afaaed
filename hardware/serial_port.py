"""A serial port that can die at any moment, and finding it again.

pyserial's errors when a peer dies are of three kinds, and its close can hang: here they are one error, and closing has
a thread of its own.
"""

import contextlib
import errno
import os
import threading
from typing import NamedTuple

import serial
from serial.tools import list_ports

from core.device_interface import DeviceError
from core.faults import cause
from core.files import InputError

try:
    from termios import error as TerminalError
except ImportError:  # Windows has none
    TerminalError = OSError  # type: ignore[misc,assignment]

BAUD = 921_600  # means nothing to a USB port
READ_S = 0.002  # longest wait for the first byte
WRITE_S = 0.004
CLOSE_S = 0.5  # after which a close that hangs is left to itself
_UNPLUGGED = (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF)
#: what pyserial raises when the other end is gone
_DEAD = (serial.SerialException, OSError, TerminalError)


class Identity(NamedTuple):
    """What stays the same when a USB port is plugged in again, perhaps under another name."""

    vendor: int
    product: int
    serial: str
    #: which port of a device with several (its USB interface); without a serial number also the socket. "": not told
    place: str = ""

    def made_as(self, other: "Identity") -> bool:
        """Whether the other one may be this device in another socket."""
        return self[:3] == other[:3]


class Port:
    """An open port. DeviceError where it has died."""

    def __init__(self, name: str) -> None:
        self.name, self.not_taken = name, 0
        try:
            self._serial = serial.Serial(name, BAUD, timeout=READ_S, write_timeout=WRITE_S, exclusive=True)
            self._serial.reset_input_buffer()
        except _DEAD as error:
            raise DeviceError(cause("port", name=name, what=_reason(error))) from None
        except ValueError as error:
            raise DeviceError(cause("port", name=name, what=error)) from None

    def read(self) -> bytes:
        """What has come; waits READ_S for the first byte."""
        try:
            first = self._serial.read(1)
            return first + self._serial.read(self._serial.in_waiting) if first else first
        except _DEAD as error:
            raise DeviceError(cause("port", name=self.name, what=_reason(error))) from None

    def write(self, data: bytes) -> None:
        """Send; what is not taken in time is lost, as on any wire, and if that lasts the board falls silent."""
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            self.not_taken += 1  # the other end does not read, or this program was held up for longer
        except _DEAD as error:
            raise DeviceError(cause("port", name=self.name, what=_reason(error))) from None

    def close(self) -> None:
        """Close in a thread of its own, and do not wait for one that hangs."""
        closer = threading.Thread(target=self._close, name=f"close {self.name}", daemon=True)
        closer.start()
        closer.join(CLOSE_S)

    def _close(self) -> None:
        with contextlib.suppress(*_DEAD):  # it is gone: there is nothing left to close
            self._serial.close()


def usb_ports() -> dict[str, Identity]:
    """The serial ports that are on USB, by name; none while one comes or goes (pyserial then fails in many ways)."""
    try:
        ports = list_ports.comports()
    except (OSError, TypeError, ValueError):
        return {}
    return {
        p.device: Identity(p.vid, p.pid or 0, p.serial_number or "", _place(p.location or "", p.serial_number or ""))
        for p in ports
        if p.vid is not None
    }


def identity_of(name: str) -> Identity | None:
    """Who has this name now; None where that is not on USB, or another port looks just like it."""
    ports = usb_ports()
    found = ports.get(name)
    return found if found is not None and list(ports.values()).count(found) == 1 else None


def _place(location: str, serial_number: str) -> str:
    """Of a location as pyserial tells it, "1-2.4:1.0" (socket, interface), what does not change by itself."""
    return location.partition(":")[2] if serial_number else location


def find_port(wanted: str, identity: Identity | None = None) -> str:
    """The name of a port. identity: whom `wanted` was when it was opened; it may have another name by now.

    "auto": the only port on USB. InputError: "auto" finds none or more than one; several ports have the identity; or
    `wanted` is the name of another device now.
    """
    ports = usb_ports()
    if identity is not None:
        there = ports.get(wanted)
        names = [name for name, found in ports.items() if found == identity]
        if there == identity or (not names and (there is None or identity.made_as(there))):
            return wanted
        if not names:
            raise InputError(cause("port", name=wanted, what="another device has this name now"))
        if len(names) > 1:
            both = f"it is gone, and {' and '.join(names)} both look like it"
            raise InputError(cause("port", name=wanted, what=both))
        return names[0]
    if wanted != "auto":
        return wanted
    if len(ports) != 1:
        listed = ", ".join(f"{name} ({i.vendor:04x}:{i.product:04x})" for name, i in ports.items()) or "none"
        raise InputError(f"serial:auto needs exactly one serial port on USB, and there are: {listed}")
    return next(iter(ports))


def _reason(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "another program is using it"
    if number == errno.EACCES:
        return "permission denied (phd doctor says what to do)"
    if number in _UNPLUGGED or str(error).startswith("device reports readiness"):  # pyserial's words for it
        return "the board was unplugged"
    text = os.strerror(number) if number else str(error).strip() or "it is gone"
    if text.startswith("Could not configure port"):  # pyserial's words for what is no terminal at all
        return "it is no serial port"
    return text[0].lower() + text[1:]
