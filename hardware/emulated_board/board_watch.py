"""What a board is made of, what its inputs read, and the conditions among them that latch a fault."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from hardware.wire.messages import (
    SAMPLE_HZ,
    VERSION,
    WATCHDOG_US,
    Fault,
    Four,
    Hello,
    Limits,
    SampleLayout,
    State,
    joints_of,
)

OVER_CURRENT_mA = 100  # a brake may draw this and a tenth of its limit more than its limit
OVER_CURRENT_TICKS = 10
SATURATED_TICKS = 5
SPEED_TICKS = 10  # a joint's speed is taken over this many ticks
ZERO: Four = (0, 0, 0, 0)


class Readings(NamedTuple):
    """What the board's inputs read at a tick. For each joint, in the order A, E, B, C; 0 where there is nothing."""

    counts: Four = ZERO
    force: tuple[int, ...] = ()  # counts, one a channel
    current_mA: Four = ZERO  # measured
    encoder_good: tuple[bool, bool, bool, bool] = (True, True, True, True)


@dataclass(frozen=True)
class Capability:
    """What a board is made of; its Hello says it."""

    encoders: int = 0b0101  # bits of the joints A, E, B, C
    brakes: int = 0b1111
    force_channels: int = 6
    counts_per_rev: Four = (96000, 0, 96000, 0)
    current_max_mA: Four = (1000, 1000, 1000, 1000)
    force_unit: int = 1000
    force_full_scale: int = 66_700
    device: bytes = b""
    serial: bytes = b""
    firmware: tuple[int, int, int] = (1, 0, 0)

    def layout(self) -> SampleLayout:
        """How its samples look."""
        return SampleLayout(self.encoders.bit_count(), self.force_channels, self.brakes.bit_count())

    def hello(self, state: State, faults: Fault, cause: Fault, starts: int) -> Hello:
        """What it says of itself."""
        return Hello(
            VERSION, state, faults, cause, self.firmware, self.encoders, self.brakes, self.force_channels, SAMPLE_HZ,
            WATCHDOG_US // 1000, self.counts_per_rev, self.current_max_mA, self.force_unit, self.force_full_scale,
            starts, self.device, self.serial,
        )  # fmt: skip


class Watch:
    """Looks at every tick's readings; remembers how long something has been wrong."""

    def __init__(self, capability: Capability) -> None:
        self._encoders = joints_of(capability.encoders)
        self._brakes = joints_of(capability.brakes)
        self._full_scale = capability.force_full_scale
        self._past: deque[Four] = deque(maxlen=SPEED_TICKS + 1)  # counts as read
        self._over_current = [0, 0, 0, 0]  # ticks on end
        self._saturated = 0  # ticks on end

    def conditions(self, readings: Readings, limits: Limits) -> Iterator[tuple[Fault, int]]:
        """(fault, index of joint or channel) of all that is wrong at this tick."""
        self._past.append(readings.counts)
        for i in self._brakes:
            most = limits.current_mA[i] + limits.current_mA[i] // 10 + OVER_CURRENT_mA
            self._over_current[i] = self._over_current[i] + 1 if abs(readings.current_mA[i]) > most else 0
            if self._over_current[i] >= OVER_CURRENT_TICKS:
                yield Fault.OVER_CURRENT, i
        for i in self._encoders:
            if self._too_fast(i, limits.speed_counts_s[i]):
                yield Fault.OVER_SPEED, i
            if not readings.encoder_good[i]:
                yield Fault.ENCODER, i
        at_end = [k for k, f in enumerate(readings.force) if abs(f) >= self._full_scale]
        self._saturated = self._saturated + 1 if at_end else 0
        if self._saturated >= SATURATED_TICKS:
            yield Fault.FORCE_SATURATED, at_end[0]

    def _too_fast(self, i: int, most: int) -> bool:
        if most == 0 or len(self._past) <= SPEED_TICKS:
            return False
        turned = (self._past[-1][i] - self._past[0][i] + (1 << 31)) % (1 << 32) - (1 << 31)  # counts go round
        return abs(turned) * SAMPLE_HZ > most * SPEED_TICKS
