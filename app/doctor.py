"""`phd doctor`: is this machine fit to run trials, and what to do about each thing that is not."""

import getpass
import importlib.metadata
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

from app.ipc.messages import BAD, CAUTION, GOOD, Check
from app.ipc.scheduling import ADVICE, program_cores, stolen_share
from app.progress import SCREENS_CODE
from app.session_server.preflight import check_disk
from core.files import InputError
from core.kernels.cache import cache_place, is_compiled, remove_unsound, why_no_room
from core.kernels.old_versions import UNUSED_DAYS, others, size_of
from hardware.discovery import BoardFound, HidDevice, SerialPort, ask_board, hid_devices, serial_ports

#: Text is laid out for these; a smaller screen would clip it.
LEAST_SCREEN = (1280, 720)
UDEV_RULE = 'KERNEL=="hidraw*", ATTRS{idVendor}=="046d|256f", MODE="0660", TAG+="uaccess"'
#: checks of what makes ticks late, the worst first: no priority helps against the host, and a real-time loop suffers
#: little from other programs
LATENESS_CHECKS = ("host", "cores", "scheduling", "load")
MUCH_STOLEN = 0.01  # of all cores' time. Our choice: ticks are then late by milliseconds several times a minute
REINSTALL = "Remove the folder .venv and run ./phd again; where pip installed the program, install it again."
PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


class Around(NamedTuple):
    """What is attached to this machine."""

    ports: list[SerialPort]
    boards: list[BoardFound]  # at the ports that were asked
    hands: list[HidDevice]
    hands_problem: str = ""  # why these cannot be listed


def look_around(boards_at: Sequence[str] = ()) -> Around:
    """List what is attached; boards are searched only at the ports named. InputError: there is no such port."""
    boards, ports = [ask_board(port) for port in boards_at], serial_ports()
    try:
        return Around(ports, boards, hid_devices())
    except InputError as error:
        return Around(ports, boards, [], str(error))


def examine(data_dir: Path, around: Around) -> list[Check]:
    """All checks, in the order of the report."""
    checks = [
        libraries(), *screens(), scheduling(), cores(), host(stolen_share()), load(), check_disk(data_dir), kernels(),
        *port_checks(around.ports), *map(board_check, around.boards), *hand_checks(around),
    ]  # fmt: skip
    return [*checks, first_change(checks)]


def first_change(checks: Sequence[Check]) -> Check:
    """The change that helps most: of a check that blocks trials, else of what makes ticks late most."""
    bad = [check for check in checks if check.state == BAD]
    late = [check for name in LATENESS_CHECKS for check in checks if check.name == name and check.advice]
    for most in (*bad, *late):
        return check("first", f"what helps most: {most.name}", most.advice)
    return check("first", "no change is known that would help")


def check(name: str, found: str, advice: str = "", bad: bool = False) -> Check:
    """No advice: good; with advice: a caution, or bad."""
    return Check(name, GOOD if not advice else BAD if bad else CAUTION, found, advice)


def wanted_libraries() -> list[Requirement]:
    """What the program asks for: its pyproject.toml, or what pip has kept of that where it installed the program."""
    if PYPROJECT.exists():
        lines = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["dependencies"]
    else:
        lines = importlib.metadata.requires("phd") or []
    needs = map(Requirement, lines)
    return [need for need in needs if not need.marker or need.marker.evaluate({"extra": ""})]


def libraries() -> Check:
    """Whether what is installed is what the project asks for."""
    wrong = []
    for need in wanted_libraries():
        try:
            version = importlib.metadata.version(need.name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{need.name} is missing")
            continue
        if not need.specifier.contains(version, prereleases=True):
            wrong.append(f"{need.name} is {version}, not {need.specifier}")
    if wrong:
        return check("libraries", ", ".join(wrong), REINSTALL, bad=True)
    return check("libraries", f"all there, Python {sys.version.split()[0]}")


def run_python(code: str) -> subprocess.CompletedProcess:
    """Run Python code in its own process: Qt ends a process where it cannot work, and scheduling stays with it."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def screens() -> list[Check]:
    """The screens on which Qt can open windows."""
    answer = run_python(SCREENS_CODE)
    if answer.returncode != 0:
        where = ", ".join(f"{name}={os.environ[name]}" for name in ("DISPLAY", "WAYLAND_DISPLAY") if name in os.environ)
        found = f"Qt finds none ({where or 'DISPLAY and WAYLAND_DISPLAY are not set'})"
        advice = "Log in at the machine's own desktop; every verb but run and replay works without."
        return [check("screens", found, advice, bad=True)]
    lines = []
    for name, width, height, scale, refresh, *_ in json.loads(answer.stdout.splitlines()[-1]):
        found = f"{name or 'screen'}: {width} x {height} points, scale {scale:g}, {refresh:.0f} Hz"
        small = width < LEAST_SCREEN[0] or height < LEAST_SCREEN[1]
        less = "Lower the scale" if scale > 1.0 else "Choose a higher resolution or a larger screen"
        advice = f"{less}: windows are laid out for {LEAST_SCREEN[0]} x {LEAST_SCREEN[1]} points."
        lines.append(check("screen", found, advice if small else ""))
    if len(lines) == 1:
        shared, second = "only one: participant and experimenter share it", "Plug in a second one for the participant."
        lines.append(check("screens", shared, second))
    return lines


#: says whether it is the best there is, and what it is
SCHEDULING = """
import json
from app.ipc.scheduling import take_scheduling
got = take_scheduling()
print(json.dumps([got.real_time and got.locked, got.words]))
"""


def scheduling() -> Check:
    """The best scheduling that the control loop gets on this machine."""
    answer = run_python(SCHEDULING)
    if answer.returncode != 0:
        last = (answer.stderr.strip().splitlines() or ["no reason given"])[-1]
        return check("scheduling", f"could not be tried: {last}", REINSTALL, bad=True)
    best, words = json.loads(answer.stdout)
    if best:
        return check("scheduling", words)
    return Check("scheduling", CAUTION, words, ADVICE)


def cores() -> Check:
    """The processor cores that the program may use: the loop wants one of its own."""
    count = len(program_cores())
    if count < 2:
        return check("cores", "1: loop and window share it", "Give the machine a second core.")
    return check("cores", f"{count}")


def host(stolen: float | None) -> Check:
    """stolen: the share of this machine's time that its host keeps; None: not known."""
    if stolen is None:
        return check("host", "not known: this system does not count what a host keeps from it")
    advice = "Give this virtual machine cores of its own, or run trials on a machine that is not virtual."
    found = f"has kept {100.0 * stolen:.1f} % of the cores' time from this machine since its start"
    return check("host", found, advice if stolen > MUCH_STOLEN else "")


def load() -> Check:
    """Whether other programs keep the processor cores busy."""
    if not hasattr(os, "getloadavg"):
        return check("load", "not known: this system does not count the programs that want to run")
    running, count = os.getloadavg()[0], os.cpu_count() or 1
    found = f"{running:.1f} programs wanted to run, on {count} cores (average of the last minute)"
    return check("load", found, "Close other programs before a session." if running > count else "")


def kernels() -> Check:
    """Whether the kernels are compiled, the control loop's last, and can be stored. Damaged files are removed."""
    place = cache_place()
    if place.wrong:
        advice = "Give yourself that folder, or remove it: until then each command compiles for itself, half a minute."
        return check("kernels", f"compiled kernels cannot be stored: {place.wrong}", advice)
    assert place.folder is not None
    if wrong := remove_unsound(place.folder):
        file, why = next(iter(wrong.items()))
        found = f"{len(wrong)} of the files in {place.folder} were damaged and are removed ({file}: {why})"
        return check("kernels", found, "Nothing to do: they are compiled again. If this happens again, check the disk.")
    if no_room := why_no_room(place.folder):
        return check(
            "kernels",
            f"no more kernels can be stored: {no_room}",
            "Make room on that disk: until then each command compiles again.",
        )
    if is_compiled("run_trial"):
        return check("kernels", f"compiled, in {place.folder}{of_other_versions(place.folder)}")
    advice = "The window compiles them as it opens, up to a minute; nothing to do."
    return check("kernels", f"not all compiled yet ({place.folder})", advice)


def of_other_versions(folder: Path) -> str:
    """How many other versions have compiled kernels beside this folder, and when they go; "" where there are none."""
    folders = others(folder)
    if not folders:
        return ""
    megabytes = size_of(folders) / 1e6
    return f"; {len(folders)} of other versions there ({megabytes:.0f} MB), removed when unused for {UNUSED_DAYS} days"


def board_check(board: BoardFound) -> Check:
    """Whether the board at a port answers."""
    if board.problem:
        advice = (
            "Check that this is the board's port, that the board has power, and that no other program uses the port."
        )
        return check("board", f"{board.port}: {board.problem}", advice, bad=True)
    advice = "Turn the brakes on in the window (Ctrl+B) when it is safe." if board.fault else ""
    return check("board", f"{board.port}: {describe_board(board)}", advice)


def describe_board(board: BoardFound) -> str:
    """Describe a board that answers in one line."""
    encoders = ", ".join(f"{joint} {counts}" for joint, counts in board.encoders.items())
    brakes = ", ".join(f"{joint} {current:g} A" for joint, current in board.brakes.items())
    return (
        f"{board.board}, wired to {board.device or 'no named device'}, firmware {board.firmware}, protocol "
        f"{board.version}; encoders {encoders}; brakes {brakes}; {board.force_channels} force channels; {board.state}"
        + (f": {board.fault}" if board.fault else "")
    )


def port_checks(ports: list[SerialPort]) -> list[Check]:
    """The serial ports, and whether this user may open them."""
    if not ports:
        return [check("serial", "nothing attached (the simulated device needs nothing)")]
    dialout = "Close any other program that uses it, or ask this machine's administrator for the right to it."
    if sys.platform == "linux":
        dialout = f"Run: sudo usermod -aG dialout {getpass.getuser()}; then log out and in again."
    return [
        check(
            "serial",
            f"{port.port}: " + (" ".join(filter(None, (port.usb, port.serial, port.name))) or "not on USB"),
            "" if port.allowed else dialout,
        )
        for port in ports
    ]


def hand_checks(around: Around) -> list[Check]:
    """The six-axis devices, and whether this user may open them."""
    if around.hands_problem:
        return [check("hand", around.hands_problem, REINSTALL)]
    if not around.hands:
        return [check("hand", "no six-axis device attached (the mouse serves)")]
    rule = f"Put this line into /etc/udev/rules.d/70-phd.rules and plug it in again: {UDEV_RULE}"
    return [
        check("hand", f"{hand.path}: {hand.ids} {hand.product}", "" if hand.allowed else rule) for hand in around.hands
    ]
