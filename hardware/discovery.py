"""What is attached: serial ports with who they are on USB, boards that answer, six-axis HID devices."""

import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from core.device_interface import DeviceError
from core.files import InputError
from core.mechanism import JOINTS
from hardware.emulated_board.plug import emulated_ports
from hardware.hid import attached, list_hid
from hardware.sensing.samples import fault_words
from hardware.serial_device import Connection
from hardware.serial_port import NO_PORT, Port, is_missing, listed_ports, usb_ports
from hardware.wire.messages import Hello, State, joints_of

MAX_LOOKS = 4  # at a port where nothing answers. Our choice: a board may take some seconds to start


class SerialPort(NamedTuple):
    """A serial port that the system lists."""

    port: str
    usb: str  # "vendor:product", hexadecimal; "" where it is not on USB
    serial: str
    name: str
    allowed: bool  # whether we may open it


class BoardFound(NamedTuple):
    """The answer at a port."""

    port: str
    board: str = ""  # its number; "" where none answers
    device: str = ""  # that it is wired to
    version: int = 0  # of the protocol
    firmware: str = ""
    encoders: dict[str, int] = {}  # noqa: RUF012  (never changed) joint -> counts per revolution
    brakes: dict[str, float] = {}  # noqa: RUF012  (never changed) joint -> largest current of its driver, A
    force_channels: int = 0
    state: str = ""
    fault: str = ""  # latched, in words
    problem: str = ""  # why none answers; "": one does
    looks: int = 1  # that were taken at it

    @property
    def words(self) -> str:
        """What answers, or why nothing does."""
        return self.problem or f"answers, {self.device or 'names no device'}"


class HidDevice(NamedTuple):
    """A known six-axis device."""

    path: str
    ids: str  # "vendor:product"
    product: str
    allowed: bool


def serial_ports() -> list[SerialPort]:
    """The serial ports of the system, without pseudo-terminals."""
    return [
        SerialPort(
            port.device,
            f"{port.vid:04x}:{port.pid or 0:04x}" if port.vid is not None else "",
            port.serial_number or "",
            port.product or (port.description if port.description != "n/a" else "") or "",
            sys.platform == "win32" or os.access(port.device, os.R_OK | os.W_OK),  # there ports are no files
        )
        for port in sorted(listed_ports())
    ]


def hid_devices() -> list[HidDevice]:
    """The known six-axis devices. InputError where the library that reads them is missing."""
    return [
        HidDevice(name := found.path.decode(errors="replace"), found.ids, found.product,
                  not Path(name).exists() or os.access(name, os.R_OK))
        for found in attached(list_hid())
    ]  # fmt: skip


def ask_board(port: str) -> BoardFound:
    """Ask what answers at a port; a port in use is busy and not disturbed. InputError: there is no such port."""
    if is_missing(port):
        raise InputError(f"serial port {port}: {NO_PORT}")
    try:
        with contextlib.closing(Port(port)) as wire:
            return described(port, Connection(wire).hello())
    except DeviceError as error:  # its sentence names the port, which stands beside it
        return BoardFound(port, problem=str(error).rpartition(f"{port}: ")[2])


def scan_ports(before: Sequence[BoardFound] = (), in_use: str = "") -> tuple[BoardFound, ...]:
    """Every serial port on USB and every emulated board, with what answers.

    before: an earlier result. A port that did not answer is asked again, for a board may still be starting, and no port
    for ever: some devices restart when theirs is opened.
    in_use: a port that this program uses, which is not asked.
    """
    known = {found.port: found for found in before}
    return tuple(_look(port, known.get(port)) for port in (*usb_ports(), *emulated_ports()) if port != in_use)


def _look(port: str, known: BoardFound | None) -> BoardFound:
    if known is None:
        return _found(port)
    if not known.problem or known.looks >= MAX_LOOKS:
        return known
    return _found(port)._replace(looks=known.looks + 1)


def _found(port: str) -> BoardFound:
    try:
        return ask_board(port)
    except InputError as error:  # it has just gone
        return BoardFound(port, problem=str(error))


def described(port: str, hello: Hello) -> BoardFound:
    """Describe a board by its Hello."""
    return BoardFound(
        port,
        hello.serial.decode(errors="replace") or "without a number",
        hello.device.decode(errors="replace"),
        hello.version,
        ".".join(map(str, hello.firmware)),
        {JOINTS[i]: hello.counts_per_rev[i] for i in joints_of(hello.encoders) if i < len(JOINTS)},
        {JOINTS[i]: 1e-3 * hello.current_max_mA[i] for i in joints_of(hello.brakes) if i < len(JOINTS)},
        hello.force_channels,
        next((state.name.capitalize() for state in State if state == hello.state), f"state {hello.state}"),
        fault_words(hello.cause),
    )
