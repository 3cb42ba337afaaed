"""A serial port that can die at any moment, and finding it again.

pyserial raises three kinds of errors when a peer dies, and its close can hang: here they are one error, and a thread
closes the port. A port may also be an address, "socket://HOST:NUMBER": a TCP port that passes bytes on as a serial
port does, such as that of an emulated board.
"""

import contextlib
import ctypes
import errno
import os
import re
import select
import socket
import sys
import threading
from typing import Any, NamedTuple

import serial
from serial.tools import list_ports

from core.device_interface import DeviceError
from core.faults import cause
from core.files import InputError

try:
    from termios import error as TerminalError
except ImportError:  # Windows has none
    TerminalError = OSError  # type: ignore[misc,assignment]

BAUD = 921_600  # what any adapter of a UART to USB carries, and the least for a sample a millisecond
#: Clocks of ST-LINK/V2-1 (36 MHz) and board (42 MHz) both divide to it exactly; 921,600 they miss by 0.2 and -0.9 %
ST_LINK_BAUD = 2_000_000
#: (vendor, product) of the serial port of an ST-LINK/V2-1 or V3: a UART, though USB calls it a port of the board's own
ST_LINKS = {(0x0483, product) for product in (0x374B, 0x3752, 0x374E, 0x374F, 0x3753)}
#: vendor of an adapter of a UART to USB -> its name; others on USB are ports of a board's own, which know no baud rate
ADAPTERS = {0x0403: "FTDI", 0x10C4: "CP210x", 0x1A86: "CH34x", 0x067B: "PL2303"}
READ_S = 0.002  # longest wait for the first byte
WRITE_S = 0.004
CLOSE_S = 0.5  # after which a close that hangs is left to itself
BUFFER = 16_384  # bytes that a TCP connection keeps on their way, so that little is old; fewer are lost. Measured
_ADDRESS = re.compile(r"socket://[^/?#:@\s]+:(\d{1,5})")
_UNPLUGGED = (errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF, errno.EPIPE, errno.ECONNRESET)
NO_PORT = "there is no such port"
#: pyserial's words where Windows does not open a port, with the number that a system's error has
_WINDOWS_REFUSED = re.compile(r"could not open port .*: \w+\((\d+),")
#: what pyserial raises when the other end is gone
_DEAD = (serial.SerialException, OSError, TerminalError)


class Link(NamedTuple):
    """What carries the bytes of a port."""

    words: str
    baud: int = BAUD


class Identity(NamedTuple):
    """What stays the same when a USB port is plugged in again, perhaps under another name."""

    vendor: int
    product: int
    serial: str
    #: which port of a device with several (its USB interface); without a serial number also the socket. "": not told
    place: str = ""


def is_address(name: str) -> bool:
    """Whether the name of a port is the address of a TCP port."""
    return (found := _ADDRESS.fullmatch(name)) is not None and 0 < int(found[1]) < 1 << 16


def is_missing(name: str) -> bool:
    """Whether a port cannot be there: its name is no address and, as the system names devices, none of a device."""
    if is_address(name):
        return False
    if sys.platform == "win32":
        found = ctypes.create_unicode_buffer(1024)
        return not ctypes.WinDLL("kernel32").QueryDosDeviceW(name, found, len(found))
    return not os.path.exists(name)


def limit_buffers(end: socket.socket) -> None:
    """Make an end of a TCP connection send at once, and keep little of what the other end does not read."""
    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)


class Port:
    """An open port. DeviceError if it has died."""

    def __init__(self, name: str) -> None:
        self.name, self.not_taken = name, 0
        self._tcp, self._heard = is_address(name), False
        if "://" in name and not self._tcp:
            raise DeviceError(cause("port", name=name, what="an address must be socket://HOST:NUMBER"))
        try:
            wait_s = 0.0 if self._tcp else READ_S
            baud = link_of(name).baud
            self._serial = serial.serial_for_url(name, baud, timeout=wait_s, write_timeout=WRITE_S, exclusive=True)
            if self._tcp:
                with socket.fromfd(self._serial.fileno(), socket.AF_INET, socket.SOCK_STREAM) as end:
                    limit_buffers(end)
            self._serial.reset_input_buffer()
        except _DEAD as error:
            raise DeviceError(cause("port", name=name, what=_reason(error))) from None
        except ValueError as error:
            raise DeviceError(cause("port", name=name, what=error)) from None

    def read(self) -> bytes:
        """What has come; waits READ_S for the first byte."""
        try:
            data = self._read()
        except _DEAD as error:
            raise self._death(error) from None
        self._heard |= bool(data)
        return data

    def _read(self) -> bytes:
        if self._tcp:  # pyserial counts at most one byte that waits there, and its wait would go on after the first
            select.select([self._serial], [], [], READ_S)
            return self._serial.read(BUFFER)
        first = self._serial.read(1)
        return first + self._serial.read(self._serial.in_waiting) if first else first

    def write(self, data: bytes) -> None:
        """Send; what is not taken in time is lost, as on any wire, and if that lasts the board falls silent."""
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            self.not_taken += 1  # the other end does not read, or this program was held up for longer
        except _DEAD as error:
            raise self._death(error) from None

    def _death(self, error: BaseException) -> DeviceError:
        sent_away = self._tcp and not self._heard
        what = _reason(error, "another program is using it" if sent_away else "the board was unplugged")
        return DeviceError(cause("port", name=self.name, what=what))

    def close(self) -> None:
        """Close on a thread; a close that hangs is not waited for."""
        closer = threading.Thread(target=self._close, name=f"close {self.name}", daemon=True)
        closer.start()
        closer.join(CLOSE_S)

    def _close(self) -> None:
        with contextlib.suppress(*_DEAD):  # it is gone: there is nothing left to close
            self._serial.close()


def listed_ports() -> list[Any]:
    """What pyserial lists; nothing while a port comes or goes (it then fails in many ways)."""
    try:
        return list(list_ports.comports())
    except (OSError, TypeError, ValueError):
        return []


def usb_ports() -> dict[str, Identity]:
    found = {}
    for port in listed_ports():
        if port.vid is not None:
            # of its location, "1-2.4:1.0" (socket, interface), what does not change by itself
            place = (port.location or "").partition(":")[2] if port.serial_number else port.location or ""
            found[port.device] = Identity(port.vid, port.pid or 0, port.serial_number or "", place)
    return found


def identity_of(name: str) -> Identity | None:
    """Who has this name now; None where that is not on USB, or another port looks just like it."""
    ports = usb_ports()
    found = ports.get(name)
    return found if found is not None and list(ports.values()).count(found) == 1 else None


def link_of(name: str) -> Link:
    """What a port is, by its name and who it is on USB."""
    if is_address(name):
        return Link("TCP")
    name = name if sys.platform == "win32" else os.path.realpath(name)  # there ports are no files
    identity = usb_ports().get(name)
    if identity is None:
        return Link("pseudo-terminal" if name.startswith("/dev/pts/") else f"UART at {BAUD / 1e3:g} kbaud")
    if identity[:2] in ST_LINKS:
        return Link(f"UART at {ST_LINK_BAUD / 1e3:g} kbaud, by an ST-LINK", ST_LINK_BAUD)
    if adapter := ADAPTERS.get(identity.vendor):
        return Link(f"UART at {BAUD / 1e3:g} kbaud, by an adapter ({adapter})")
    return Link("USB")


def find_port(wanted: str, identity: Identity | None = None) -> str:
    """The name of a port. identity: whom `wanted` was when it was opened; it may have another name by now.

    "auto": the only port on USB. InputError: "auto" finds none or more than one; several ports have the identity; or
    `wanted` is the name of another device now.
    """
    ports = usb_ports()
    if identity is not None:
        named = ports.get(wanted)
        names = [name for name, found in ports.items() if found == identity]
        if named == identity or (not names and (named is None or identity[:3] == named[:3])):  # in another socket
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


def _reason(error: BaseException, parted: str = "the board was unplugged") -> str:
    """Why a port has died. parted: what a vanished other end means."""
    words = str(error)
    number = getattr(error, "errno", None) or getattr(error.__context__, "errno", None)  # pyserial hides the system's
    if windows := _WINDOWS_REFUSED.match(words):
        number = int(windows[1])
    if number in (errno.EAGAIN, errno.EBUSY) or (windows and number == errno.EACCES):  # Windows' ports are open to all
        return "another program is using it"
    if number == errno.EACCES:
        return "permission denied (phd doctor says what to do)"
    if number == errno.ENOENT:
        return NO_PORT
    if number == errno.ECONNREFUSED:
        return "nothing listens there"
    # pyserial's words for it: on Linux, on each system, on Windows
    gone = words.startswith("device reports readiness") or "disconnected" in words or "failed (" in words
    if number in _UNPLUGGED or gone:
        return parted
    text = os.strerror(number) if number else words.strip() or "it is gone"
    if text.startswith(("Could not configure port", "Cannot configure port")):  # likewise, for what is no port at all
        return "it is no serial port"
    return text[0].lower() + text[1:]
