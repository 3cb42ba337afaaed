"""How a program reaches a device on the bench, whatever wire is between them. SI units, joint order A, E, B, C."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from core.device import Device

#: 1/s: the noise (rms) of the velocity that a link tells, over its encoders' step at the tip (hardware/motion_filter)
VELOCITY_NOISE_HZ = 17.0


class LinkSample(NamedTuple):
    """One tick of a device as its sensors tell it. Positions in m, forces in N, currents in A, times in s."""

    t_s: float  # host's monotonic clock at which the sensors were read, by the clock model
    board_us: int  # the board's own clock, as it came
    sequence: int  # the board's ticks; a gap is a loss
    echo: int  # sequence of the command that it had taken in
    counts: tuple[int, ...]  # encoders, as they came
    force_counts: tuple[int, ...]  # force channels, as they came
    theta: tuple[float, float, float, float]  # rad
    tip: tuple[float, float]
    velocity: tuple[float, float]  # m/s
    acceleration: tuple[float, float]  # m/s2
    hand_force: tuple[float, float]
    current: tuple[float, float, float, float]  # measured
    closed: bool  # the encoders' angles are those of a linkage that closes; else the tip is the last that was
    homed: bool  # all encoders have been homed: without it the tip means nothing
    fault: str  # latched on the board, in words; its currents are zero. "": none


class ZeroRecord(NamedTuple):
    """What sensors and amplifiers read with nothing on the handle and no current: kept with the session."""

    samples: int
    force_counts: tuple[float, ...]  # mean of each channel
    force_spread: tuple[float, ...]  # standard deviation of each channel
    current: tuple[float, float, float, float]  # A, mean of what is measured without current


class LinkError(Exception):
    """The device cannot be reached, or did not do what it was told; one sentence."""


class DeviceLink(Protocol):
    """A device on the bench. `exchange` belongs to the control loop: it never waits longer than a few ms."""

    device: Device
    encoders: str  # letters of the joints that have one, as "AB"; known once it is open
    force_channels: int  # likewise

    @property
    def problem(self) -> str:
        """Why there are no samples, one sentence; "" while they come."""

    def open(self) -> None:
        """Reach the device. InputError: there is none, or it is another one than the device file says."""

    def exchange(self, currents: Sequence[float]) -> LinkSample | None:
        """Currents (4,) in A to the brakes, clamped to their limits; the newest sample, or None: nothing came."""

    def samples(self) -> list[LinkSample]:
        """Every sample since the last call, oldest first: `exchange` returns the last of them."""

    def report(self) -> dict:
        """Health and clock of the link, as JSON holds them: for the device page and for each recording."""

    def home(self, tip: tuple[float, float]) -> None:
        """The handle is held at `tip` (m) now: set the encoders. LinkError if that could not be done."""

    def zero(self) -> ZeroRecord:
        """Nobody touches the handle: take what force sensor and amplifiers read as zero. About a second, no current."""

    def stop(self) -> None:
        """Brakes off, latched on the board until `reset`."""

    def reset(self) -> None:
        """Forget the board's faults, where their causes are past. LinkError: one still stands."""

    def close(self) -> None:
        """Zero currents and leave. Never waits for long, whatever hangs."""
