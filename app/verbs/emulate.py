"""`phd emulate`: a board on a pseudo-terminal, with the simulated device behind it."""

import argparse
import math
import os
import signal
import sys

from app.verbs.common import add_verb, whole_number_of
from core.errors import InputError

HANDS = ("operator", "still", "none")
START_RADIUS_M, HOLD_S = 0.003, 1.0  # longer at the start than a trial asks for: nobody tells this person to go
END_RADIUS_M, REST_S, LONGEST_S = 0.005, 1.0, 30.0


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "emulate",
        emulate,
        "a board on a pseudo-terminal, with the simulated device behind it",
        "The first line of stdout is its port, for --link serial:PORT; the rest of what it says goes to stderr. Ctrl-C "
        "ends it.\nBeside the port lies a datagram socket, `control`, that takes orders as JSON objects: "
        '{"target": [x, y]} or\n{"force": [fx, fy]} for a hand that holds still, {"start_m": [x, y], "end_m": [x, y]}, '
        '{"wait": true}, {"go": true} for\nthe operator, {"fault": "unplug+1"}, {"clear": true}; each is answered with '
        "the truth.\n\nFaults: KIND[=VALUE][@START][+LENGTH], s: drop=0.01, corrupt=0.01, duplicate=0.01 (shares of "
        "frames),\ndelay=0.02, jitter=0.005 (s), stall@5+0.3, unplug@5+2, brown-out@5+0.3, stuck-encoder=A@5+1,\n"
        "bad-encoder=A@5+1, saturated-force@5+1.",
        "phd emulate --device four-brake --hand operator --fault drop=0.01 --fault unplug@10+2",
    )
    verb.add_argument(
        "--device", default="four-brake", metavar="NAME|PATH", help="the device behind it (default: four-brake)"
    )
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
    from hardware.faults import read_fault

    faults = [read_fault(text) for text in args.fault]
    from app.progress import announce_first_use
    from core.device import load_device
    from core.path_file import build_path
    from experiments.protocol import load_protocol

    device = load_device(args.device)
    path = build_path(load_protocol().paths[1], "path 1")
    start, end = (args.path[:2], args.path[2:]) if args.path else ((path.x0, path.y0), (path.x1, path.y1))
    tip = (float(start[0]), float(start[1]))
    announce_first_use()
    from hardware.emulated_device import HeldHand
    from hardware.emulator import Emulator

    hand = person(start, end, args.seed) if args.hand == "operator" else HeldHand(tip, holds=args.hand == "still")
    emulator = Emulator(device, hand, tip, faults, args.seed, not args.not_homed, log)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        scheduling = prompt()
        for number in before:
            signal.signal(number, lambda *_: emulator.stop())
        print(emulator.port, flush=True)
        assumed = " (assumed)" if device.assumed else ""
        log(f"device {device.name}{assumed}, hand: {args.hand}, {scheduling}; orders to {emulator.control}")
        emulator.run()
    finally:
        emulator.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


def prompt() -> str:
    """Ask not to be held up by other programs, as a board is not; what was got."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except (AttributeError, OSError):  # another system, or no privilege: it runs as any program does
        return "ordinary scheduling"
    return "real-time scheduling"


def log(line: str) -> None:
    """To stderr at once."""
    print(line, file=sys.stderr, flush=True)


def person(start, end, seed: int):
    """A simulated operator on a segment (m) who, untold, goes from start to end, rests, and comes back to the start."""
    import numpy as np

    from core.hand import new_hand
    from core.path import line
    from core.row import APPROACH, END, MOVE
    from experiments.operator import TICK_S, begin_approach, draw_person, new_operator, operate, take_handle
    from experiments.trial import NOISE_DRAWS
    from hardware.emulated_device import WORKSPACE_M, pair

    class Person:
        def __init__(self) -> None:
            self._random = np.random.default_rng([seed, 3])
            self._person = draw_person(self._random)
            self._noise = self._random.standard_normal((NOISE_DRAWS, 2))
            self.hand = new_hand()
            self._grip = self.hand.grips[0]
            self._waits = self._go = False
            self._tick = 0
            self._tip = (float(start[0]), float(start[1]))
            self._take(start, end)

        def _take(self, first, last) -> None:
            self._path = line(first, last)
            take_handle(self._person, self._path, self.hand.grips)
            self._set_out()

        def _set_out(self) -> None:
            self._record = new_operator(self._person, self._random)[0]
            begin_approach(self._record, *self._tip, self._path.x0, self._path.y0)
            self._enter(APPROACH)

        def _enter(self, phase: int) -> None:
            self._phase, self._phase_tick, self._there = phase, 0, 0

        def tick(self, x: float, y: float) -> None:
            self._tip, path = (x, y), self._path
            if self._phase == APPROACH:
                self._there = self._there + 1 if math.hypot(x - path.x0, y - path.y0) <= START_RADIUS_M else 0
                if self._there * TICK_S >= HOLD_S and (self._go or not self._waits):
                    self._go = False
                    self._enter(MOVE)
            elif self._phase == MOVE:
                self._there = self._there + 1 if math.hypot(x - path.x1, y - path.y1) <= END_RADIUS_M else 0
                if self._there * TICK_S >= REST_S or self._phase_tick * TICK_S >= LONGEST_S:
                    self._enter(END)
            elif self._phase_tick * TICK_S >= REST_S:
                self._set_out()
            operate(
                self._record,
                self._grip,
                path,
                self._phase,
                self._tick,
                self._phase_tick,
                x,
                y,
                self._noise,
            )
            self._tick += 1
            self._phase_tick += 1

        def obey(self, order: dict) -> None:
            if unknown := set(order) - {"start_m", "end_m", "wait", "go"}:
                raise InputError(f"the operator does not know the order {min(unknown)!r}")
            if "start_m" in order or "end_m" in order:
                first = pair(order.get("start_m"), "start_m", WORKSPACE_M)
                self._take(first, pair(order.get("end_m"), "end_m", WORKSPACE_M))
            self._waits = bool(order.get("wait", self._waits))
            self._go = bool(order.get("go", self._go))

    return Person()
