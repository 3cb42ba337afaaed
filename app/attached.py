"""What is attached to this machine, and whether we may use it: for `phd doctor`."""

import getpass
import sys
from collections.abc import Sequence

from app.doctor import BAD, CAUTION, GOOD, UDEV_RULE, Line
from core.errors import InputError
from hardware.discovery import BoardFound, HidDevice, SerialPort, ask_board, hid_devices, serial_ports

NOTHING = "nothing attached (the simulated device needs nothing)"


def attached_lines(boards_at: Sequence[str] = ()) -> list[Line]:
    """Serial ports and six-axis devices, and the rights to them; boards are asked only at the ports named."""
    return [*port_lines(serial_ports()), *(board_line(ask_board(port)) for port in boards_at), *hid_lines()]


def board_line(board: BoardFound) -> Line:
    """Who answers at a port."""
    if board.problem:
        advice = "Is this the board's port, has the board power, and does no other program (phd itself) use the port?"
        return Line("board", BAD, f"{board.port}: {board.problem}", advice)
    found = f"{board.port}: {about(board)}"
    if board.fault:
        return Line("board", CAUTION, found, "Allow the brakes again in the console once what caused it is past.")
    return Line("board", GOOD, found)


def about(board: BoardFound) -> str:
    """A board that answers, in one line."""
    encoders = ", ".join(f"{joint} {counts}" for joint, counts in board.encoders.items())
    brakes = ", ".join(f"{joint} {current:g} A" for joint, current in board.brakes.items())
    return (
        f"{board.board}, wired to {board.device or 'no named device'}, firmware {board.firmware}, protocol "
        f"{board.version}; encoders {encoders}; brakes {brakes}; {board.force_channels} force channels; {board.state}"
        + (f": {board.fault}" if board.fault else "")
    )


def port_lines(ports: list[SerialPort]) -> list[Line]:
    """A line for each port."""
    if not ports:
        return [Line("serial", GOOD, NOTHING)]
    lines = []
    for port in ports:
        identity = f" ({port.usb})" if port.usb else ""
        found = f"{port.port}: {port.name or 'not on USB'}{identity}"
        advice = "" if port.allowed else dialout_advice()
        lines.append(Line("serial", GOOD if port.allowed else CAUTION, found, advice))
    return lines


def hid_lines() -> list[Line]:
    """A line for each six-axis device."""
    try:
        devices: list[HidDevice] = hid_devices()
    except InputError as error:
        return [Line("hand", CAUTION, str(error), "Reinstall: remove the folder .venv and run ./phd again.")]
    if not devices:
        return [Line("hand", GOOD, "no six-axis device attached (the mouse serves)")]
    rule = f"Put this line into /etc/udev/rules.d/70-phd.rules and plug it in again: {UDEV_RULE}"
    return [
        Line("hand", GOOD if device.allowed else CAUTION, f"{device.path}: {device.product} ({device.ids})",
             "" if device.allowed else rule)
        for device in devices
    ]  # fmt: skip


def dialout_advice() -> str:
    """How to get the right to serial ports."""
    if sys.platform != "linux":
        return "Close whatever else uses it, or ask who looks after this machine for the right to it."
    return f"Run: sudo usermod -aG dialout {getpass.getuser()}; then log out and in again."
