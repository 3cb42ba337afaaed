"""Faults of cable, buffers, supply and sensors that the emulated board can be given; random ones from a seed.

    drop=0.01            a hundredth of all frames is lost, each way
    corrupt=0.01         .. has one bit flipped
    duplicate=0.01       .. comes twice
    delay=0.02           everything comes 20 ms later
    jitter=0.005         each frame comes 0 to 5 ms later, in order
    stall@5+0.3          at 5 s nothing passes for 0.3 s, then everything that waited
    unplug@5+2           at 5 s the port is gone, for 2 s; the board goes on
    brown-out@5+0.3      at 5 s the supply falls, for 0.3 s
    uncounted-start@5+1  at 5 s the supply is off, for 1 s; the board then gives the same number of starts
    stuck-encoder=A@5+1  the encoder at A stays where it is
    bad-encoder=A@5+1    the encoder at A says that its signal is bad
    over-current=A@5+1   the amplifier at A measures twice what it can give
    saturated-force@5+1  the force sensor is at the end of its range

KIND[=VALUE][@START][+LENGTH], s. START counts from when a host first asks for samples; in an order, from the order.
Without @: from the start; without +: until the end.
"""

import math
import re
from collections import deque
from typing import NamedTuple

import numpy as np

from core.files import InputError
from core.mechanism import JOINTS

SHARES = ("drop", "corrupt", "duplicate")
TIMES = ("delay", "jitter")
AT_JOINT = ("stuck-encoder", "bad-encoder", "over-current")
POWER = ("brown-out", "uncounted-start")
PLAIN = ("stall", "unplug", *POWER, "saturated-force")
KINDS = SHARES + TIMES + PLAIN + AT_JOINT
LONGEST_S = 3600.0  # a time that is longer is a slip of the pen

_WRITTEN = re.compile(r"^(?P<kind>[a-z-]+)(=(?P<value>[^@+]+))?(@(?P<start>[0-9.]+))?(\+(?P<length>[0-9.]+))?$")


class LineFault(NamedTuple):
    """A requested fault."""

    kind: str
    value: float = 0.0  # a share, a time (s), or the index of a joint
    start_s: float = 0.0
    end_s: float = math.inf

    def acts(self, now_s: float) -> bool:
        return self.start_s <= now_s < self.end_s

    def after(self, now_s: float) -> "LineFault":
        """The same fault, its times counted from `now_s`."""
        return self._replace(start_s=now_s + self.start_s, end_s=now_s + self.end_s)


def read_fault(text: str, now_s: float = 0.0) -> LineFault:
    """Read a fault; its start counts from `now_s`. InputError if it makes no sense."""
    match = _WRITTEN.match(text)
    if not match or match["kind"] not in KINDS:
        raise InputError(f"fault {text!r}: must be KIND[=VALUE][@START][+LENGTH] with a kind of {', '.join(KINDS)}")
    kind, value = match["kind"], match["value"]
    if kind in AT_JOINT:
        if value is None or len(value) != 1 or value not in JOINTS:
            raise InputError(f"fault {text!r}: needs a joint, such as {kind}=A")
        number = float(JOINTS.index(value))
    elif kind in PLAIN:
        if value is not None:
            raise InputError(f"fault {text!r}: {kind} takes no value")
        number = 0.0
    else:
        number = _number(value, text, 1.0 if kind in SHARES else LONGEST_S)
    start = now_s + (_number(match["start"], text, LONGEST_S) if match["start"] else 0.0)
    return LineFault(
        kind, number, start, start + _number(match["length"], text, LONGEST_S) if match["length"] else math.inf
    )


def _number(value: str | None, text: str, most: float) -> float:
    try:
        number = float(value or "")
    except ValueError:
        number = math.nan
    if not 0.0 <= number <= most:
        raise InputError(f"fault {text!r}: needs a number from 0 to {most:g}")
    return number


class Line:
    """One direction of the wire, in order: frames come out later, never, twice or damaged."""

    def __init__(self, faults: list[LineFault], seed: int, direction: int) -> None:
        """faults: the list itself; faults that are added to it later act too. direction: 0 or 1."""
        self._faults = faults
        self._random = np.random.default_rng([seed, direction])
        self._queue: deque[tuple[float, bytes]] = deque()  # s at which it arrives, frame
        self.counts = dict.fromkeys((*SHARES, *TIMES, "stall"), 0)

    def put(self, frame: bytes, now_s: float) -> None:
        """Put a frame, or a piece of one, onto the wire."""
        acting = [fault for fault in self._faults if fault.acts(now_s)]
        arrives, copies = now_s, 1
        for fault in acting:
            if fault.kind in SHARES:
                if self._random.random() >= fault.value:
                    continue
                if fault.kind == "drop":
                    copies = 0
                elif fault.kind == "duplicate":
                    copies += 1
                else:
                    at = int(self._random.integers(8 * len(frame)))
                    frame = b"%b%c%b" % (frame[: at // 8], frame[at // 8] ^ 1 << at % 8, frame[at // 8 + 1 :])
            elif fault.kind in TIMES:
                arrives += fault.value * (1.0 if fault.kind == "delay" else self._random.random())
            elif fault.kind == "stall":
                arrives = max(arrives, fault.end_s)
            else:
                continue
            self.counts[fault.kind] += 1
        if self._queue:
            arrives = max(arrives, self._queue[-1][0])
        self._queue.extend([(arrives, frame)] * copies)

    def take(self, now_s: float) -> bytes:
        """Everything that has arrived."""
        out = b""
        while self._queue and self._queue[0][0] <= now_s:
            out += self._queue.popleft()[1]
        return out

    def next_s(self) -> float:
        """When the next bytes arrive; infinite: nothing is on the way."""
        return self._queue[0][0] if self._queue else math.inf

    def clear(self) -> None:
        """Lose what is on the wire: unplugged, or without power."""
        self._queue.clear()
