"""From a board's samples to SI units: pose, motion, hand force, currents, with what is remembered in between."""

import math
from collections.abc import Sequence

import numpy as np

from core.device import Device
from core.device_file import ForceSensor
from core.device_interface import DeviceError, DeviceSample, ZeroRecord
from core.faults import cause
from core.files import InputError
from hardware.sensing.board_clock import ClockModel
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.tip_motion import MotionFilter
from hardware.wire.messages import Fault, Hello, Sample, joints_of

FAULT_CODES = {
    Fault.WATCHDOG: "watchdog",
    Fault.OVER_CURRENT: "over-current",
    Fault.OVER_SPEED: "over-speed",
    Fault.ENCODER: "bad-encoder",
    Fault.FORCE_SATURATED: "force-saturated",
    Fault.BROWN_OUT: "brown-out",
    Fault.HOST_REQUEST: "host-request",
}
ZERO_SAMPLES = 500
STILL_M = 1e-3  # a handle that moved further was touched
NO_ZERO = ZeroRecord(0, (), (), (0.0, 0.0, 0.0, 0.0))  # none has been taken


class BoardSensing:
    """What one board's counts mean. InputError where board and device file do not fit."""

    def __init__(self, device: Device, hello: Hello, before: "BoardSensing | None" = None) -> None:
        """before: of the connection before this one, whose zero and clock hold where the same board went on."""
        self.hello = hello
        self.state = hello.state  # of the board, by the newest sample
        self.pose = PoseSensing(device, joints_of(hello.encoders), hello.counts_per_rev)
        self.force = ForceSensing(device, hello.force_channels, hello.force_unit)
        self.clock, self.zero = ClockModel(), NO_ZERO
        if before is not None and (before.hello.serial, before.hello.starts) == (hello.serial, hello.starts):
            self.clock = before.clock
            self.set_zero(before.zero)
        self.motion = MotionFilter()
        self._brakes = joints_of(hello.brakes)

    def set_zero(self, zero: ZeroRecord) -> None:
        """What the force channels and amplifiers read without a hand and without current."""
        self.zero = zero
        if zero.samples:
            self.force.zero = np.array(zero.force_counts)

    def moved(self) -> None:
        """The encoders were set anew: nothing before tells where the tip is."""
        self.pose.forget()
        self.motion = MotionFilter()

    def take(self, sample: Sample, came_s: float) -> DeviceSample:
        """A sample that came at host time `came_s` (s)."""
        self.state = sample.state
        self.clock.add(sample.board_us, came_s)
        pose = self.pose.pose(sample.counts)
        velocity, acceleration = self.motion.add(1e-6 * sample.board_us, *pose.tip)
        current = [0.0] * 4
        for i, milliamperes in zip(self._brakes, sample.current_mA, strict=True):
            current[i] = 1e-3 * milliamperes - self.zero.current[i]
        encoders = self.hello.encoders
        return DeviceSample(
            t_s=self.clock.host_s(sample.board_us),
            board_us=sample.board_us,
            sequence=sample.sequence,
            echo=sample.echo,
            counts=sample.counts,
            force_counts=sample.force,
            theta=pose.theta,
            tip=pose.tip,
            velocity=velocity,
            acceleration=acceleration,
            hand_force=self.force.hand_force(sample.force, pose.theta, acceleration),
            current=(current[0], current[1], current[2], current[3]),
            closed=pose.closed,
            homed=sample.flags & encoders == encoders,
            fault=fault_words(sample.cause),
        )


def fault_words(number: int) -> str:
    """The fault that a board has latched, by its number; "" for none."""
    if not number:
        return ""
    code = FAULT_CODES.get(Fault(number))
    return cause(code) if code else cause("unknown", number=number)


class ForceSensing:
    """From the counts of the force channels to the hand force, N, in the frame of the device.

    load (6,) = calibration (6 x 6, the identity without one) x unit x (counts - zero); its first two components, turned
    by how the sensor is mounted, are its reading; hand force = reading + inertia_beyond_kg x acceleration of the tip.
    """

    def __init__(self, device: Device, channels: int, unit: int) -> None:
        """channels: how many the board sends; unit: micro-newtons a count. InputError: they do not fit the file."""
        self._sensor = device.sensing.force if device.sensing else None
        self._sensor = self._sensor or (ForceSensor(on="handle") if channels else None)
        if self._sensor and channels < 2:
            raise InputError(
                f"device {device.name}: its file has a force sensor, but the board sends {channels} channels"
            )
        if device.calibration is not None and channels != 6:
            raise InputError(
                f"device {device.name}: a 6 x 6 calibration needs six force channels, but the board sends {channels}"
            )
        matrix = np.eye(channels) if device.calibration is None else device.calibration
        self._plane = 1e-6 * unit * matrix[:2] if channels else np.zeros((2, 0))
        self.zero = np.zeros(channels)  # counts with nothing on the handle

    def hand_force(
        self, counts: Sequence[int], theta: tuple[float, ...], acceleration: tuple[float, float]
    ) -> tuple[float, float]:
        """The hand force (N) at joint angles theta (4,) with a tip acceleration (m/s2); none without a sensor."""
        if self._sensor is None:
            return 0.0, 0.0
        fx, fy = self._plane @ (np.asarray(counts, dtype=float) - self.zero)
        turned, beyond = sensor_angle(self._sensor, theta), self._sensor.inertia_beyond_kg
        cos, sin = math.cos(turned), math.sin(turned)
        return (
            float(cos * fx - sin * fy) + beyond * acceleration[0],
            float(sin * fx + cos * fy) + beyond * acceleration[1],
        )


def sensor_angle(sensor: ForceSensor, theta: tuple[float, ...]) -> float:
    """How far the sensor's x axis is turned from the frame's, rad; theta (4,) rad, A, E, B, C.

    Our choice: the handle itself does not turn (the hand holds it upright), so a sensor on it is turned by a constant.
    """
    if sensor.on == "ED":
        return float(theta[0] + theta[1] + sensor.rotation_rad)
    if sensor.on == "CD":
        return float(theta[2] + theta[3] + sensor.rotation_rad)
    return sensor.rotation_rad


def zero_of(taken: Sequence[DeviceSample], before: ZeroRecord) -> ZeroRecord:
    """The zero in samples; before: the one that was taken off their currents. DeviceError: the handle moved."""
    moved = float(np.max(np.ptp(np.array([sample.tip for sample in taken]), axis=0)))
    if not math.isfinite(moved):
        raise DeviceError("zero: nobody can tell whether the handle is still; home the encoders first")
    if moved > STILL_M:
        raise DeviceError("zero: the handle moved; nobody may touch it meanwhile")
    counts = np.array([sample.force_counts for sample in taken], dtype=float)
    a, e, b, c = (np.array([sample.current for sample in taken]).mean(axis=0) + before.current).tolist()
    mean, spread = counts.mean(axis=0).tolist(), counts.std(axis=0).tolist()
    return ZeroRecord(len(taken), tuple(mean), tuple(spread), (a, e, b, c))
