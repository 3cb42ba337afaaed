"""`phd doctor`: is this machine fit to run trials, and what to do about each thing that is not."""

import getpass
import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from packaging.requirements import Requirement

from app.ipc.messages import BAD, CAUTION, GOOD, Check
from app.ipc.scheduling import ADVICE
from app.session_server.preflight import check_disk
from core.files import InputError
from core.kernel import CACHE_FOLDER, first_use
from hardware.discovery import BoardFound, HidDevice, SerialPort, ask_board, hid_devices, serial_ports

#: Text is laid out for these; a smaller screen would clip it.
LEAST_SCREEN = (1280, 720)
NOTHING = "nothing attached (the simulated device needs nothing)"
UDEV_RULE = 'KERNEL=="hidraw*", ATTRS{idVendor}=="046d|256f", MODE="0660", TAG+="uaccess"'
SCREENS_CODE = """
import json
from PySide6.QtGui import QGuiApplication
application = QGuiApplication([])
print(json.dumps([[s.name(), s.size().width(), s.size().height(), s.devicePixelRatio(), s.refreshRate()]
                  for s in application.screens()]))
"""
SCHEDULING_CODE = "from app.ipc.scheduling import take_scheduling; print(take_scheduling()[0])"


def examine(data_dir: Path, boards_at: Sequence[str] = ()) -> list[Check]:
    """Everything, in the order of the report; boards are asked only at the ports named."""
    boards = [board_check(ask_board(port)) for port in boards_at]
    return [
        libraries(), *screens(), scheduling(), cores(), check_disk(data_dir, sync=True)[0], kernels(),
        *port_checks(serial_ports()), *boards, *hid_checks(),
    ]  # fmt: skip


def libraries() -> Check:
    """Whether what is installed is what the project asks for."""
    wrong = []
    for text in importlib.metadata.requires("phd") or []:
        need = Requirement(text)
        if need.marker and not need.marker.evaluate({"extra": ""}):
            continue
        try:
            version = importlib.metadata.version(need.name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{need.name} is missing")
            continue
        if not need.specifier.contains(version, prereleases=True):
            wrong.append(f"{need.name} is {version}, not {need.specifier}")
    if wrong:
        return Check("libraries", BAD, ", ".join(wrong), "Remove the folder .venv and run ./phd again.")
    return Check("libraries", GOOD, f"all there, Python {sys.version.split()[0]}")


def screens() -> list[Check]:
    """What Qt can open windows on: tried in a process of its own, for Qt ends the process where it cannot."""
    tried = subprocess.run([sys.executable, "-c", SCREENS_CODE], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        where = ", ".join(f"{name}={os.environ[name]}" for name in ("DISPLAY", "WAYLAND_DISPLAY") if name in os.environ)
        return [
            Check("screens", BAD, f"Qt finds none ({where or 'DISPLAY and WAYLAND_DISPLAY are not set'})",
                 "Log in at the machine's own desktop; every verb but run and replay works without.")
        ]  # fmt: skip
    lines = []
    for name, width, height, scale, refresh in json.loads(tried.stdout.splitlines()[-1]):
        found = f"{name or 'screen'}: {width} x {height} points, scale {scale:g}, {refresh:.0f} Hz"
        small = width < LEAST_SCREEN[0] or height < LEAST_SCREEN[1]
        less = "Lower the scale" if scale > 1.0 else "Choose a higher resolution or a larger screen"
        advice = f"{less}: windows are laid out for {LEAST_SCREEN[0]} x {LEAST_SCREEN[1]} points."
        lines.append(Check("screen", CAUTION if small else GOOD, found, advice if small else ""))
    if len(lines) == 1:
        lines.append(Check("screens", CAUTION, "only one: participant and experimenter share it",
                          "Plug in a second screen for the participant's view."))  # fmt: skip
    return lines


def scheduling() -> Check:
    """The best scheduling that the control loop gets here; tried in a process of its own."""
    tried = subprocess.run([sys.executable, "-c", SCHEDULING_CODE], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        last = (tried.stderr.strip().splitlines() or ["no reason given"])[-1]
        return Check("scheduling", BAD, f"could not be tried: {last}", "Reinstall: remove .venv and run ./phd again.")
    got = tried.stdout.strip()
    if got.startswith("real-time") and "not locked" not in got:
        return Check("scheduling", GOOD, got)
    return Check("scheduling", CAUTION, got, ADVICE if sys.platform == "linux" else "")


def cores() -> Check:
    """Processor cores that we may use: the loop wants one of its own."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if count < 2:
        return Check("cores", CAUTION, "1: loop and window share it", "Give the machine a second core.")
    return Check("cores", GOOD, f"{count}")


def kernels() -> Check:
    """Whether the compiled kernels are at hand."""
    if first_use():
        return Check("kernels", CAUTION, f"not compiled yet ({CACHE_FOLDER})",
                    "The first trial or study compiles them, a quarter of a minute; nothing to do.")  # fmt: skip
    return Check("kernels", GOOD, f"compiled, in {CACHE_FOLDER}")


# ------------------------------------------------------------------------------------- what is attached, and our rights

def board_check(board: BoardFound) -> Check:
    """Who answers at a port."""
    if board.problem:
        advice = "Is this the board's port, has the board power, and does no other program (phd itself) use the port?"
        return Check("board", BAD, f"{board.port}: {board.problem}", advice)
    found = f"{board.port}: {about(board)}"
    if board.fault:
        return Check("board", CAUTION, found, "Allow the brakes again in the console once what caused it is past.")
    return Check("board", GOOD, found)


def about(board: BoardFound) -> str:
    """A board that answers, in one line."""
    encoders = ", ".join(f"{joint} {counts}" for joint, counts in board.encoders.items())
    brakes = ", ".join(f"{joint} {current:g} A" for joint, current in board.brakes.items())
    return (
        f"{board.board}, wired to {board.device or 'no named device'}, firmware {board.firmware}, protocol "
        f"{board.version}; encoders {encoders}; brakes {brakes}; {board.force_channels} force channels; {board.state}"
        + (f": {board.fault}" if board.fault else "")
    )


def port_checks(ports: list[SerialPort]) -> list[Check]:
    """A check for each port."""
    if not ports:
        return [Check("serial", GOOD, NOTHING)]
    checks = []
    for port in ports:
        identity = f" ({port.usb})" if port.usb else ""
        found = f"{port.port}: {port.name or 'not on USB'}{identity}"
        advice = "" if port.allowed else dialout_advice()
        checks.append(Check("serial", GOOD if port.allowed else CAUTION, found, advice))
    return checks


def hid_checks() -> list[Check]:
    """A check for each six-axis device."""
    try:
        devices: list[HidDevice] = hid_devices()
    except InputError as error:
        return [Check("hand", CAUTION, str(error), "Reinstall: remove the folder .venv and run ./phd again.")]
    if not devices:
        return [Check("hand", GOOD, "no six-axis device attached (the mouse serves)")]
    rule = f"Put this line into /etc/udev/rules.d/70-phd.rules and plug it in again: {UDEV_RULE}"
    return [
        Check("hand", GOOD if device.allowed else CAUTION, f"{device.path}: {device.product} ({device.ids})",
             "" if device.allowed else rule)
        for device in devices
    ]  # fmt: skip


def dialout_advice() -> str:
    """How to get the right to serial ports."""
    if sys.platform != "linux":
        return "Close whatever else uses it, or ask who looks after this machine for the right to it."
    return f"Run: sudo usermod -aG dialout {getpass.getuser()}; then log out and in again."
