"""From a board's samples to SI units: pose, motion, hand force, currents, with what is remembered in between."""

import numpy as np

from core.device import Device
from core.device_interface import DeviceSample, ZeroRecord
from core.faults import cause
from hardware.sensing.board_clock import ClockModel
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.force_sensor import ForceSensing
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
