"""The interface of every device, simulated or real. SI units, joint order A, E, B, C.

Two classes implement it: `core.simulator.simulated_device.SimulatedDevice` and `hardware.serial_device.SerialDevice`.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from core.device import Device
from core.linkage import joint_rows
from core.simulator.state import pack_mechanism

#: 1/s: the noise (rms) of the velocity that a real device senses, over its encoders' step at the tip
#: (hardware/sensing/samples.MotionFilter), a slope through so many samples
VELOCITY_NOISE_HZ, VELOCITY_WINDOW = 17.0, 15


class AnyDevice(Protocol):
    """A device that a trial runs on."""

    device: Device  # the device file as read

    def begin(self) -> None:
        """Begin a trial: forget samples and counts from before."""

    def end_record(self) -> dict[str, Any]:
        """The device's report on the trial, for the end of its recording, as JSON holds it."""


class DeviceSample(NamedTuple):
    """One tick of a real device, by its sensors. Positions in m, forces in N, currents in A, times in s."""

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
    """Readings of sensors and amplifiers with nothing on the handle and no current, stored with the session."""

    samples: int
    force_counts: tuple[float, ...]  # mean of each channel
    force_spread: tuple[float, ...]  # standard deviation of each channel
    current: tuple[float, float, float, float]  # A, mean of what is measured without current


class DeviceError(Exception):
    """The device cannot be reached, or did not do what it was asked; one sentence."""


class RealDevice(AnyDevice, Protocol):
    """A device on the bench. `exchange` belongs to the control loop: it never waits longer than a few ms."""

    encoders: str  # letters of the joints that have one, as "AB"; known once it is open
    force_channels: int  # number of them; known once it is open
    port: str  # by which it is reached
    clock: Callable[[], float]  # the host's, monotonic, in s: that of `DeviceSample.t_s`

    @property
    def problem(self) -> str:
        """Why there are no samples, one sentence; "" while they come."""

    @property
    def zeroed(self) -> bool:
        """Whether the zero of its force sensor is known, or it has no such sensor."""

    def open(self) -> None:
        """Reach the device. InputError: there is none, or not the one of the device file."""

    def exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        """Currents (4,) in A to the brakes, clamped to their limits; the newest sample, or None: nothing came."""

    def samples(self) -> list[DeviceSample]:
        """Every sample since the last call, oldest first: `exchange` returns the last of them."""

    def report(self) -> dict:
        """Health and clock of the connection, as JSON holds them: for the device page and for each recording."""

    def home(self, tip: tuple[float, float]) -> None:
        """Set the encoders for a handle that is held at `tip` (m) now. DeviceError if that could not be done."""

    def zero(self) -> ZeroRecord:
        """Take the readings of force sensor and amplifiers as zero: nobody touches the handle. A second, no current."""

    def stop(self) -> None:
        """Brakes off, latched on the board until `reset`."""

    def reset(self) -> None:
        """Forget the board's faults, where their causes are past. DeviceError: one still stands."""

    def close(self) -> None:
        """Set the currents to zero and disconnect, within a second or two whatever hangs."""


def encoder_step(device: Device, tip: tuple[float, float], counts_per_rev: Sequence[int]) -> float:
    """The way of the tip (m) for one count of the encoders at a tip (m), in the direction where it is largest.

    counts_per_rev (4,): joints A, E, B, C, 0 without one. The rows are the joint rates for a velocity of the
    tip; infinite where a direction is not sensed.
    """
    rates = np.empty((4, 2))
    joint_rows(pack_mechanism(device.mechanism)[0], tip[0], tip[1], rates)  # 1/m
    counts = rates * np.asarray(counts_per_rev, dtype=float)[:, None] / (2.0 * math.pi)
    least = float(np.linalg.svd(counts, compute_uv=False)[-1])
    return 1.0 / least if least > 0.0 else math.inf


def velocity_noise(device: Device, tip: tuple[float, float], window: int = VELOCITY_WINDOW) -> float:
    """Noise (m/s, rms) of the sensed velocity at a tip (m); 0 where the device file has no encoders.

    window: samples of its filter, through which the noise of a slope falls as (n^3 - n)^-1/2.
    """
    encoders = device.sensing.encoders if device.sensing else None
    if encoders is None:
        return 0.0
    step = encoder_step(device, tip, encoders.counts)
    return VELOCITY_NOISE_HZ * step * math.sqrt((VELOCITY_WINDOW**3 - VELOCITY_WINDOW) / (window**3 - window))
