"""The verbs on this machine: `phd doctor` checks whether trials can be run, and lists what is attached; `phd emulate`
stands for a board.
"""

import argparse
import os
import signal
import sys

from app.ipc.messages import BAD
from app.ipc.scheduling import leave_core, program_cores, take_scheduling
from app.progress import watch_compiling
from app.verbs.common import DATA_DIR, DEFAULT_DEVICES, PORTS, add_verb, print_result, whole_number_of
from core.device import load_device, shipped_devices
from core.path import Segment, build_path
from experiments.protocol import load_protocol
from hardware.emulated_board.line_faults import read_fault

#: state -> mark, colour on a terminal
MARKS = {"good": ("ok", "32"), "caution": ("--", "33"), "bad": ("NO", "31")}


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "doctor", doctor_verb, "check this machine: libraries, screens, scheduling, disk, and what is attached\n"
        "Lists serial ports, six-axis devices, and the boards that answer at ports named with --port; a port in use\n"
        "is not disturbed. Gives advice on everything that is not as it should be. Changes nothing.\n"
        "Exit 0: trials can be run. Exit 1: something marked NO stands in the way.",
        "phd doctor --data-dir data --port /dev/ttyACM0", prints="the findings and what is attached",
    ).add_argument  # fmt: skip
    option("--data-dir", **DATA_DIR)
    option("--port", **PORTS)
    option = add_verb(
        verbs, "emulate", emulate, "emulate a board, with a simulated device behind it, on a serial or TCP port\n"
        "The first line of stdout is its port, for --link serial:PORT; the log goes to stderr. Ctrl-C ends it.\n"
        "The log names a UDP port of this computer that takes orders as JSON objects: "
        '{"target": [x, y]} or\n{"force": [fx, fy]} for a hand that holds still, {"path": {..}} (as in a protocol '
        'file), {"wait": true},\n{"go": true}, {"away": true} for the operator, {"fault": "unplug+1"}, '
        '{"clear": true},\n{"device": "three-brake"} to be wired to that one; the answer to each is\n'
        "the true state of board and handle.\n\n"
        "Faults: KIND[=VALUE][@START][+LENGTH], s; START counts from when a host first asks for samples: drop=0.01,\n"
        "corrupt=0.01, duplicate=0.01 (shares of frames), delay=0.02, jitter=0.005 (s), stall@5+0.3, unplug@5+2, "
        "brown-out@5+0.3, uncounted-start@5+1,\nstuck-encoder=A@5+1, bad-encoder=A@5+1, over-current=A@5+1, "
        "saturated-force@5+1.",
        "phd emulate --device four-brake --hand operator --fault drop=0.01 --fault unplug@10+2",
    ).add_argument  # fmt: skip
    option(
        "--device", metavar="NAME|PATH",
        help="device behind the board (default: the shipped one that a session asks for)",
    )  # fmt: skip
    option(
        "--hand", choices=("operator", "still", "none"), default="still",
        help="what holds the handle: an operator who moves to and fro on the path, a spring that holds it still "
        "(default), or nothing",
    )  # fmt: skip
    path = "start and end of the operator's path, m; the handle begins at its start (default: the paper's path 1)"
    option("--path", nargs=4, type=float, metavar=("X0", "Y0", "X1", "Y1"), help=path)
    fault = "KIND[=VALUE][@START][+LENGTH]"
    option("--fault", action="append", default=[], metavar=fault, help="a fault; repeatable")
    has_terminals = hasattr(os, "openpty")
    option(
        "--socket", metavar="NUMBER",
        nargs="?", type=whole_number_of(1, 65535), const=0, default=None if has_terminals else 0,
        help="TCP port of this computer in place of a serial one (default: a free one)"
        + ("" if has_terminals else "; always so on this system"),
    )  # fmt: skip
    option("--not-homed", action="store_true", help="start with encoders that the host must home")
    option("--seed", type=whole_number_of(0), metavar="N", default=1, help="of noise, faults and operator (default: 1)")


def doctor_verb(args: argparse.Namespace) -> int:
    from app.doctor import examine, look_around

    around = look_around(args.port)
    checks = examine(args.data_dir, around)
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
    attached = {name: [item._asdict() for item in getattr(around, name)] for name in ("ports", "boards", "hands")}
    print_result(args, {"checks": found} | attached, "\n".join(lines))
    return 1 if any(check.state == BAD for check in checks) else 0


def emulate(args: argparse.Namespace) -> None:
    faults = [read_fault(text) for text in args.fault]
    every = dict.fromkeys([DEFAULT_DEVICES[-1], *shipped_devices()])
    devices = list(map(load_device, [args.device] if args.device else every))
    path_file = Segment(tuple(args.path[:2]), tuple(args.path[2:])) if args.path else load_protocol().paths[1]
    path = build_path(path_file, "--path")
    tip = (path.x0, path.y0)
    watch_compiling()
    from app.emulated_operator import drawn_operator
    from hardware.emulated_board.device import EmulatedHand, HeldHand
    from hardware.emulated_board.emulator import Emulator, EmulatorSettings

    hand: EmulatedHand = HeldHand(tip, holds=args.hand == "still")
    if args.hand == "operator":
        hand = drawn_operator(path, args.seed)
    settings = EmulatorSettings(args.seed, not args.not_homed, args.socket)
    emulator = Emulator(devices, hand, tip, faults, settings, log)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        scheduling = low_latency()
        for number in before:
            signal.signal(number, lambda *_: emulator.stop())
        names = [f"{device.name}{' (assumed)' if device.assumed else ''}" for device in devices]
        orders = f"orders to UDP port {emulator.control}"
        log(f"device {' or '.join(names)}, hand: {args.hand}; scheduling {scheduling}; {orders}")
        print(emulator.port, flush=True)
        log(f"in another terminal: phd run --link serial:{emulator.port}")
        emulator.run()
    finally:
        emulator.close()
        for number, handler in before.items():
            signal.signal(number, handler)


def low_latency() -> str:
    """Take the best scheduling, as no program delays a real board, on cores that a control loop leaves free; in words.

    Called last: it ends garbage collection.
    """
    got = take_scheduling()
    leave_core(got.core)
    if got.core < 0:
        return got.words
    cores = " ".join(map(str, sorted(program_cores() - {got.core})))
    return f"{got.means}, core {cores} (a control loop's own is {got.core})"


def log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
