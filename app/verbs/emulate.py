"""`phd emulate`: a board on a pseudo-terminal, with the simulated device behind it."""

import argparse
import os
import signal
import sys

from app.verbs.common import add_verb, whole_number_of

HANDS = ("operator", "still", "none")


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "emulate",
        emulate,
        "a board on a pseudo-terminal, with the simulated device behind it",
        "The first line of stdout is its port, for --link serial:PORT; the rest of what it says goes to stderr. Ctrl-C "
        "ends it.\nBeside the port lies a datagram socket, `control`, that takes orders as JSON objects: "
        '{"target": [x, y]} or\n{"force": [fx, fy]} for a hand that holds still, {"path": {..}} (as in a protocol '
        'file), {"wait": true},\n{"go": true}, {"away": true} for the operator, {"fault": "unplug+1"}, '
        '{"clear": true},\n{"device": "three-brake"} to be wired to that one; each is answered with\nthe truth.\n\n'
        "Faults: KIND[=VALUE][@START][+LENGTH], s: drop=0.01, corrupt=0.01, "
        "duplicate=0.01 (shares of frames),\ndelay=0.02, jitter=0.005 (s), stall@5+0.3, unplug@5+2, brown-out@5+0.3, "
        "stuck-encoder=A@5+1, bad-encoder=A@5+1,\nsaturated-force@5+1.",
        "phd emulate --device four-brake --hand operator --fault drop=0.01 --fault unplug@10+2",
    )
    verb.add_argument(
        "--device", metavar="NAME|PATH",
        help="the device behind it (default: the shipped one that a session asks for, as if the bench were re-rigged)",
    )  # fmt: skip
    verb.add_argument(
        "--hand",
        choices=HANDS,
        default="still",
        help="who holds the handle: a simulated operator who goes to and fro on the path, a hand that holds it still "
        "on a spring, or nobody (default: still)",
    )
    verb.add_argument(
        "--path",
        nargs=4,
        type=float,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="m, from start to end; the handle is at the start at first (default: segment 1)",
    )
    verb.add_argument(
        "--fault", action="append", default=[], metavar="KIND[=VALUE][@START][+LENGTH]", help="may be given repeatedly"
    )
    verb.add_argument("--not-homed", action="store_true", help="as after power-up: the host must home the encoders")
    verb.add_argument("--seed", type=whole_number_of(0), default=1, help="of noise, faults and operator (default: 1)")


def emulate(args: argparse.Namespace) -> int:
    from hardware.emulated_board.line_faults import read_fault

    faults = [read_fault(text) for text in args.fault]
    from app.progress import announce_first_use
    from core.device import load_device, shipped_devices
    from core.path import Segment, build_path
    from experiments.protocol import load_protocol

    device, *others = map(load_device, [args.device] if args.device else shipped_devices())
    path_file = Segment(tuple(args.path[:2]), tuple(args.path[2:])) if args.path else load_protocol().paths[1]
    path = build_path(path_file, "--path")
    tip = (path.x0, path.y0)
    announce_first_use()
    from hardware.emulated_board.device import HeldHand
    from hardware.emulated_board.emulator import Emulator

    hand = operator(path, args.seed) if args.hand == "operator" else HeldHand(tip, holds=args.hand == "still")
    emulator = Emulator(device, hand, tip, faults, args.seed, not args.not_homed, log, others)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        scheduling = prompt()
        for number in before:
            signal.signal(number, lambda *_: emulator.stop())
        print(emulator.port, flush=True)
        names = [f"{one.name}{' (assumed)' if one.assumed else ''}" for one in (device, *others)]
        log(f"device {' or '.join(names)}, hand: {args.hand}; scheduling {scheduling}; orders to {emulator.control}")
        emulator.run()
    finally:
        emulator.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


def prompt() -> str:
    """Ask not to be held up by other programs, as a board is not, on cores that a control loop here leaves free; what
    was got. Called last: what is there by then is never looked through for garbage again, and nothing else is."""
    from app.ipc.scheduling import leave_core, take_scheduling

    got, core = take_scheduling()
    leave_core(core)
    if core < 0:
        return got
    cores = " ".join(map(str, sorted(os.sched_getaffinity(0))))
    return got.replace(f"core {core}", f"core {cores} (a control loop's own is {core})")


def log(line: str) -> None:
    """To stderr at once."""
    print(line, file=sys.stderr, flush=True)


def operator(path, seed: int):
    """A simulated operator drawn from a seed, at the start of a path."""
    import numpy as np

    from app.emulated_operator import EmulatedOperator
    from experiments.trial.population import load_population

    generator = np.random.default_rng([seed, 3])
    return EmulatedOperator(load_population().draw(generator), path, (path.x0, path.y0), generator)
