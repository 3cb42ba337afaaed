"""The verbs on this machine: `phd devices` lists what is attached, `phd doctor` checks whether trials can be run."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

from app.verbs.common import DATA_DIR, PORTS, add_verb, answer

#: state -> mark, colour on a terminal
MARKS = {"good": ("ok", "32"), "caution": ("--", "33"), "bad": ("NO", "31")}


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "devices", devices_verb, "list what is attached: serial ports, boards that answer, six-axis devices",
        "Only ports that are named with --port are asked for a board; a port that is in use is not disturbed.\n"
        "Exit 0: done, also where nothing is attached. Exit 1: at a named port no board answers.",
        "phd devices --port /dev/ttyACM0", prints="what was found",
    ).add_argument  # fmt: skip
    option("--port", **PORTS)
    option = add_verb(
        verbs, "doctor", doctor_verb, "check this machine: libraries, screens, scheduling, disk, ports and hands",
        "Gives advice on everything that is not as it should be. Changes nothing.\n"
        "Exit 0: trials can be run. Exit 1: something marked NO stands in the way.",
        "phd doctor --data-dir data", prints="the findings",
    ).add_argument  # fmt: skip
    option("--data-dir", **DATA_DIR)
    option("--port", **PORTS)


def devices_verb(args: argparse.Namespace) -> int:
    from app.doctor import about
    from hardware.discovery import ask_board, hid_devices, serial_ports

    boards = [ask_board(port) for port in args.port]
    ports, hands = serial_ports(), hid_devices()
    found: dict[str, Sequence[Any]] = {"ports": ports, "boards": boards, "hands": hands}
    lines = []
    for port in ports:
        identity = " ".join(filter(None, (port.usb, port.serial, port.name))) or "not on USB"
        lines.append(f"serial port     {port.port}  {identity}{refused(port.allowed)}")
    lines += [f"board           {board.port}  {board.problem or about(board)}" for board in boards]
    lines += [f"six-axis device {hand.path}  {hand.ids} {hand.product}{refused(hand.allowed)}" for hand in hands]
    listed = {name: [one._asdict() for one in many] for name, many in found.items()}
    answer(args, listed, "\n".join(lines) or "nothing attached")
    return 1 if any(board.problem for board in boards) else 0


def refused(allowed: bool) -> str:
    """What stands behind a device that this user may not open."""
    return "" if allowed else "  (not allowed: see phd doctor)"


def doctor_verb(args: argparse.Namespace) -> int:
    from app.doctor import examine
    from app.ipc.messages import BAD

    checks = examine(args.data_dir, args.port)
    coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    width = max(len(check.name) for check in checks)
    lines = []
    for check in checks:
        mark, colour = MARKS[check.state]
        shown = f"\x1b[{colour}m{mark}\x1b[0m" if coloured else mark
        lines.append(f"{shown}  {check.name:{width}}  {check.text}")
        if check.advice:
            lines.append(f"{'':{width + 6}}{check.advice}")
    found = [dict(zip(("name", "state", "found", "advice"), check, strict=True)) for check in checks]
    answer(args, found, "\n".join(lines))
    return 1 if any(check.state == BAD for check in checks) else 0
