"""The sensors and drivers of the emulated board: what a real one would read off the simulated device.

Encoders count whole steps from where they stood at power-up; the force sensor sits between handle and hand with mass
beyond it, turned as the device file says, with noise, and ends at its full scale.
"""

import math

import numpy as np

from core.device import Device
from core.device_file import Encoders, ForceSensor, Sensing
from core.linkage import joint_angles
from core.mechanism import JOINTS
from core.state import pack_mechanism
from hardware.board_watch import Capability, Readings
from hardware.force_sensing import sensor_angle
from hardware.messages import Four

#: Assumed, for a device file without [sensing]: encoders as on the shipped devices, a sensor on the handle.
USUAL = Sensing(encoders=Encoders(A=96000, B=96000), force=ForceSensor(on="handle"))
FORCE_UNIT = 1000  # micro-newtons a count
FORCE_FULL_SCALE = 66_700  # counts: 66.7 N, a force sensor of 15 pounds
#: Assumed: of three forces (N), three torques (N m), four currents (mA).
NOISE = np.array([0.02] * 3 + [0.0002] * 3 + [1.0] * 4)
TURN = 2.0 * math.pi


def sensing_of(device: Device) -> tuple[Encoders, ForceSensor | None]:
    """The encoders and the force sensor of a device; the usual ones where its file says nothing of sensors."""
    sensing = device.sensing or USUAL
    return sensing.encoders or USUAL.encoders or Encoders(), sensing.force


def capability_of(device: Device, serial: str = "") -> Capability:
    """What a board that is wired to this device says of itself."""
    encoders, force = sensing_of(device)
    steps = [getattr(encoders, joint) or 0 for joint in JOINTS]
    largest = [round(1000.0 * current) for current in device.brakes.current_max]
    return Capability(
        encoders=sum(1 << i for i, step in enumerate(steps) if step),
        brakes=sum(1 << i for i, present in enumerate(device.brakes.present) if present),
        force_channels=6 if force else 0,
        counts_per_rev=(steps[0], steps[1], steps[2], steps[3]),
        current_max_mA=(largest[0], largest[1], largest[2], largest[3]),
        force_unit=FORCE_UNIT,
        force_full_scale=FORCE_FULL_SCALE,
        device=device.name.encode()[:24],
        serial=serial.encode()[:16],
    )


class EmulatedSensors:
    """Reads the simulated device at each tick."""

    def __init__(self, device: Device, capability: Capability, tip: tuple[float, float], seed: int) -> None:
        self._mechanism = pack_mechanism(device.mechanism)[0]
        self._force = sensing_of(device)[1]
        gauges = np.eye(6) if device.calibration is None else np.linalg.inv(device.calibration)
        self._gauges = 1e6 / FORCE_UNIT * gauges  # counts per N and N m
        self._random = np.random.default_rng([seed, 2])
        self._steps = np.array(capability.counts_per_rev) / TURN  # counts per rad
        self._brakes = capability.brakes
        self.theta = np.zeros(4)  # rad, without jumps
        joint_angles(self._mechanism, *tip, self.theta)
        self._at_power_up = self.theta.copy()
        self._last: Readings | None = None
        self._noise = np.zeros((0, 6))
        self._drawn = 0

    def power_up(self) -> None:
        """The counters begin at zero where the joints are now."""
        self._at_power_up = self.theta.copy()

    def home_counts(self) -> Four:
        """What the counters should stand at now: angle times counts per radian, whole."""
        a, e, b, c = (int(value) for value in np.rint(self.theta * self._steps))
        return a, e, b, c

    def read(
        self, tip: tuple[float, float], hand: np.ndarray, acceleration: np.ndarray, current_mA: Four,
        stuck: set[int], bad: set[int], saturated: bool,
    ) -> Readings:  # fmt: skip
        """The readings at a tip (m) with a hand force (N) and an acceleration (m/s2), (2,) each; stuck, bad: joints."""
        before = self.theta.copy()
        joint_angles(self._mechanism, *tip, self.theta)
        self.theta += TURN * np.rint((before - self.theta) / TURN)
        whole = np.floor((self.theta - self._at_power_up) * self._steps + 0.5)
        counts = [int(value) for value in whole.tolist()]
        for i in stuck:
            counts[i] = self._last.counts[i] if self._last else 0
        noise = self._draw()
        a, e, b, c = (
            round(current_mA[i] + NOISE[6 + i] * noise[6 + i]) if self._brakes >> i & 1 else 0 for i in range(4)
        )
        readings = Readings(
            (counts[0], counts[1], counts[2], counts[3]),
            self._channels(hand, acceleration, noise, saturated),
            (a, e, b, c),
            (0 not in bad, 1 not in bad, 2 not in bad, 3 not in bad),
        )
        self._last = readings
        return readings

    def _channels(
        self, hand: np.ndarray, acceleration: np.ndarray, noise: np.ndarray, saturated: bool
    ) -> tuple[int, ...]:
        if self._force is None:
            return ()
        beyond = self._force.inertia_beyond_kg
        fx, fy = (hand[k] - beyond * acceleration[k] for k in range(2))
        turned = sensor_angle(self._force, tuple(self.theta))
        cos, sin = math.cos(turned), math.sin(turned)
        load = np.array([cos * fx + sin * fy, cos * fy - sin * fx, 0.0, 0.0, 0.0, 0.0])
        load += NOISE[:6] * noise[:6]
        counts = [round(count) for count in (self._gauges @ load).tolist()]
        if saturated:
            counts[0] = FORCE_FULL_SCALE
        return tuple(min(max(count, -FORCE_FULL_SCALE), FORCE_FULL_SCALE) for count in counts)

    def _draw(self) -> np.ndarray:
        """Ten normal draws: six channels, four currents."""
        if self._drawn >= len(self._noise):
            self._noise, self._drawn = self._random.standard_normal((1024, 10)), 0
        self._drawn += 1
        return self._noise[self._drawn - 1]
