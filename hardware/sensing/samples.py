"""A board's samples in SI units: pose, motion, hand force, currents."""

import math
from collections.abc import Sequence

import numpy as np

from core.device import Device
from core.device_file import Encoders, ForceSensor, Sensing
from core.device_interface import VELOCITY_WINDOW, DeviceError, DeviceSample, ZeroRecord
from core.faults import FAULTS, cause
from core.files import InputError
from core.tick_log import TICK_S
from hardware.sensing.board_clock import ClockModel
from hardware.sensing.encoders import PoseSensing
from hardware.wire.messages import Fault, Flag, Hello, Sample, joints_of

Vector = tuple[float, float]

#: Assumed, for a device file without [sensing]: encoders as on the shipped devices, a sensor on the handle.
USUAL_ENCODERS = Encoders(A=96000, B=96000)
USUAL = Sensing(encoders=USUAL_ENCODERS, force=ForceSensor(on="handle"))
WINDOW = VELOCITY_WINDOW  # samples that the parabola goes through
GAP_S = 0.05  # after a longer gap between positions the motion filter restarts
ZERO_SAMPLES = 500
STILL_M = 1e-3  # a handle that moved further was touched
NO_ZERO = ZeroRecord(0, (), (), (0.0, 0.0, 0.0, 0.0))  # none has been taken


def sensing_of(device: Device) -> tuple[Encoders, ForceSensor | None]:
    """The encoders and the force sensor of a device; the usual ones if its file has no [sensing]."""
    sensing = device.sensing or USUAL
    return sensing.encoders or USUAL_ENCODERS, sensing.force


class BoardSensing:
    """Converts the counts of one board. InputError if board and device file do not fit."""

    def __init__(self, device: Device, hello: Hello, before: "BoardSensing | None" = None, fault: str = "") -> None:
        """before: of the last connection to the same board, if its zero and clock still hold.

        fault: of the board, found by this host; it stands until the board is reset.
        """
        self.hello = hello
        self.state = hello.state  # of the board, by the newest sample
        self.pose = PoseSensing(device, joints_of(hello.encoders), hello.counts_per_rev)
        self.force = ForceSensing(device, hello.force_channels, hello.force_unit)
        self.clock, self.zero = ClockModel(), NO_ZERO
        self.fault = fault
        if before is not None:
            self.clock = before.clock
            self.set_zero(before.zero)
        self.motion = MotionFilter()
        self._brakes = joints_of(hello.brakes)

    def set_zero(self, zero: ZeroRecord) -> None:
        """Set what force channels and amplifiers read without a hand and without current."""
        self.zero = zero
        if zero.samples:
            self.force.zero = np.array(zero.force_counts)

    def moved(self) -> None:
        """Forget earlier samples: the encoders were set."""
        self.pose.forget()
        self.motion = MotionFilter()

    def take(self, sample: Sample, came_s: float) -> DeviceSample:
        """Convert a sample that arrived at host time `came_s` (s)."""
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
            fault=cause("emergency-stop") if sample.flags & Flag.CUT else fault_words(sample.cause) or self.fault,
        )


def fault_words(number: int) -> str:
    """The latched fault of a board by its number; "": none."""
    if not number:
        return ""
    code = (Fault(number).name or "").lower().replace("_", "-")
    return cause(code) if code in FAULTS else cause("unknown", number=number)


class MotionFilter:
    """Velocity and acceleration of the tip from its measured positions.

    A parabola by least squares through the last 15 ms of positions, at their times by the board's clock: its slope and
    curvature in the middle of the window. Both are 7 ms old, exactly zero while no encoder moves, and lost samples do
    not disturb them. With encoder steps of q at the tip the velocity's noise is 0.017 q per ms (0.35 mm/s for 20 um),
    so that 2 and 5 mm/s, the thresholds of the rules, are far above it; the acceleration's is 0.0089 q per ms2
    (0.18 m/s2).
    """

    def __init__(self, window: int = WINDOW) -> None:
        """window: samples that the parabola goes through, at least 3."""
        self._t = np.zeros(window)  # s, oldest first
        self._p = np.zeros((window, 2))  # m
        self._n = 0
        self._even = slope_and_half(TICK_S * (np.arange(window) - window // 2))
        self._spans = (window - 1) * TICK_S

    def add(self, t_s: float, x: float, y: float) -> tuple[Vector, Vector]:
        """A position (m) at a time (s, rising): velocity (m/s), acceleration (m/s2); zero until the window is full."""
        if self._n and not 0.0 < t_s - self._t[-1] <= GAP_S:
            self._n = 0
        self._t[:-1], self._p[:-1] = self._t[1:], self._p[1:]
        self._t[-1], self._p[-1] = t_s, (x, y)
        self._n = min(self._n + 1, len(self._t))
        if self._n < len(self._t):
            return (0.0, 0.0), (0.0, 0.0)
        from_last = self._p - self._p[-1]  # exact zeros while nothing moves
        even = abs(self._t[-1] - self._t[0] - self._spans) < 0.02 * TICK_S
        middle = 0.5 * (self._t[0] + self._t[-1])
        slope, half = (self._even if even else slope_and_half(self._t - middle)) @ from_last
        return (float(slope[0]), float(slope[1])), (2.0 * float(half[0]), 2.0 * float(half[1]))


def slope_and_half(times: np.ndarray) -> np.ndarray:
    """Weights (2, n) of positions at times (n,), s, for the parabola's slope and half its curvature at time 0."""
    return np.linalg.pinv(np.vander(times, 3, increasing=True))[1:]


class ForceSensing:
    """Converts the counts of the force channels to the hand force, N, in the device's frame.

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
    """The angle (rad) from the frame's x axis to the sensor's; theta (4,) rad, joints A, E, B, C.

    Our choice: the handle itself does not turn (the hand holds it upright), so a sensor on it is turned by a constant.
    """
    if sensor.on == "ED":
        return float(theta[0] + theta[1] + sensor.rotation_rad)
    if sensor.on == "CD":
        return float(theta[2] + theta[3] + sensor.rotation_rad)
    return sensor.rotation_rad


def zero_of(taken: Sequence[DeviceSample], before: ZeroRecord) -> ZeroRecord:
    """The zero shown by samples. before: what was subtracted from their currents. DeviceError: the handle moved."""
    moved = float(np.max(np.ptp(np.array([sample.tip for sample in taken]), axis=0)))
    if not math.isfinite(moved):
        raise DeviceError("zero: the handle cannot be seen to be still; home the encoders first")
    if moved > STILL_M:
        raise DeviceError("zero: the handle moved; let go of it while the zero is taken")
    counts = np.array([sample.force_counts for sample in taken], dtype=float)
    current = np.array([sample.current for sample in taken]).mean(axis=0) + before.current
    means = (counts.mean(axis=0), counts.std(axis=0), current)
    return ZeroRecord(len(taken), *(tuple(values.tolist()) for values in means))
