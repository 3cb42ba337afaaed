"""`phd devices`: what is attached."""

import argparse
import json

from app.verbs.common import add_verb


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "devices",
        devices,
        "list what is attached: serial ports, boards that answer, six-axis devices",
        "Only ports that are named with --port are asked for a board; a port that is in use is not disturbed.\n"
        "Exit 0: done, also where nothing is attached. Exit 1: at a named port no board answers.",
        "phd devices --port /dev/ttyACM0",
    )
    verb.add_argument(
        "--port", action="append", default=[], metavar="PORT", help="ask for a board there; may be given repeatedly"
    )
    verb.add_argument("--json", action="store_true", help="print what was found as JSON")


def devices(args: argparse.Namespace) -> int:
    from app.doctor import about
    from hardware.discovery import ask_board, hid_devices, serial_ports

    boards = [ask_board(port) for port in args.port]
    ports, hands = serial_ports(), hid_devices()
    if args.json:
        found = {"ports": ports, "boards": boards, "hands": hands}
        print(json.dumps({name: [one._asdict() for one in many] for name, many in found.items()}))
    else:
        for port in ports:
            identity = " ".join(filter(None, (port.usb, port.serial, port.name))) or "not on USB"
            print(f"serial port     {port.port}  {identity}{'' if port.allowed else '  (not allowed: see phd doctor)'}")
        for board in boards:
            print(f"board           {board.port}  {board.problem or about(board)}")
        for hand in hands:
            refused = "" if hand.allowed else "  (not allowed: see phd doctor)"
            print(f"six-axis device {hand.path}  {hand.ids} {hand.product}{refused}")
        if not (ports or boards or hands):
            print("nothing attached")
    return 1 if any(board.problem for board in boards) else 0
