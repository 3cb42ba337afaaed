"""The sensors and drivers of the emulated board: what a real one would read off the simulated device.

Encoders count whole steps from where they stood at power-up; the force sensor sits between handle and hand with mass
beyond it, turned as the device file says, with noise, and ends at its full scale.
"""

import math
from collections.abc import Container

import numpy as np

from core.device import Device
from core.device_file import Encoders, ForceSensor, Sensing
from core.kernel import kernel
from core.linkage import joint_angles
from core.mechanism import JOINTS
from core.simulator.state import pack_mechanism
from hardware.emulated_board.board import FULL_BOARD, Readings
from hardware.sensing.samples import sensor_angle
from hardware.wire.messages import Four, Hello

#: Assumed, for a device file without [sensing]: encoders as on the shipped devices, a sensor on the handle.
USUAL = Sensing(encoders=Encoders(A=96000, B=96000), force=ForceSensor(on="handle"))
EMULATED = "EMULATED-"  # begins the serial number of an emulated board
FORCE_UNIT = 1000  # micro-newtons a count
FORCE_FULL_SCALE = 66_700  # counts: 66.7 N, a force sensor of 15 pounds
#: Assumed: of three forces (N), three torques (N m), four currents (mA).
NOISE = np.array([0.02] * 3 + [0.0002] * 3 + [1.0] * 4)
TURN = 2.0 * math.pi


def sensing_of(device: Device) -> tuple[Encoders, ForceSensor | None]:
    """The encoders and the force sensor of a device; the usual ones where its file has no [sensing]."""
    sensing = device.sensing or USUAL
    return sensing.encoders or USUAL.encoders or Encoders(), sensing.force


def hello_of(device: Device, serial: str = "") -> Hello:
    """The Hello of a board that is wired to this device, at its start."""
    encoders, force = sensing_of(device)
    steps = [getattr(encoders, joint) or 0 for joint in JOINTS]
    largest = [round(1000.0 * current) for current in device.brakes.current_max]
    return FULL_BOARD._replace(
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


def mounting_of(sensor: ForceSensor) -> np.ndarray:
    """Of a sensor (6,): the mass beyond it (kg), its angle (rad), and that angle's change with each joint's."""
    changes = [sensor_angle(sensor, tuple(joint)) - sensor.rotation_rad for joint in np.eye(4)]
    return np.array([sensor.inertia_beyond_kg, sensor.rotation_rad, *changes])


class EmulatedSensors:
    """Reads the simulated device at each tick."""

    def __init__(self, device: Device, hello: Hello, tip: tuple[float, float], seed: int) -> None:
        self._mechanisms = pack_mechanism(device.mechanism).view(np.ndarray)
        self._force = sensing_of(device)[1]
        gauges = np.eye(6) if device.calibration is None else np.linalg.inv(device.calibration)
        self._gauges = 1e6 / FORCE_UNIT * gauges  # counts per N and N m
        self.noise = NOISE.copy()
        self._counts, self._channels = np.zeros(4, dtype=np.int64), np.zeros(6, dtype=np.int64)
        self._mounting = np.zeros(6) if self._force is None else mounting_of(self._force)
        self._steps = np.array(hello.counts_per_rev) / TURN  # counts per rad
        self._brakes = hello.brakes
        self._over = [min(2 * most, 32_000) for most in hello.current_max_mA]
        self.theta = np.zeros(4)  # rad, without jumps
        joint_angles(self._mechanisms[0], *tip, self.theta)
        self._at_power_up = self.theta.copy()
        self._last = Readings()
        self.draw_anew(seed)

    def power_up(self) -> None:
        """The counters begin at zero where the joints are now."""
        self._at_power_up = self.theta.copy()

    def draw_anew(self, seed: int) -> None:
        """The noise begins again."""
        self._random = np.random.default_rng([seed, 2])
        self._noise, self._drawn = np.zeros((0, 10)), 0

    def home_counts(self) -> Four:
        """What the counters should stand at now: angle times counts per radian, whole."""
        a, e, b, c = (int(value) for value in np.rint(self.theta * self._steps))
        return a, e, b, c

    def read(
        self, tip: tuple[float, float], hand: np.ndarray, acceleration: np.ndarray, current_mA: Four,
        stuck: set[int], bad: set[int], saturated: bool, over: Container[int] = (),
    ) -> Readings:  # fmt: skip
        """The readings at a tip (m) with a hand force (N) and an acceleration (m/s2), (2,) each.

        stuck, bad: joints of encoders; over: joints whose amplifier measures twice what it can give.
        """
        noise = self._draw()
        read_off(
            self._mechanisms, *tip, self._steps, self._at_power_up, self.theta, self._counts,
            hand, acceleration, self._mounting, self._gauges, noise, self._channels,
        )  # fmt: skip
        counts = self._counts.tolist()
        for i in stuck:
            counts[i] = self._last.counts[i]
        channels = self._channels.tolist() if self._force else []
        if saturated and channels:
            channels[0] = FORCE_FULL_SCALE
        a, e, b, c = (
            round((self._over[i] if i in over else current_mA[i]) + noise[6 + i]) if self._brakes >> i & 1 else 0
            for i in range(4)
        )
        self._last = Readings(
            (counts[0], counts[1], counts[2], counts[3]),
            tuple(channels),
            (a, e, b, c),
            (0 not in bad, 1 not in bad, 2 not in bad, 3 not in bad),
        )
        return self._last

    def _draw(self) -> np.ndarray:
        """The noise of one tick: six loads (N, N m), four currents (mA)."""
        if self._drawn >= len(self._noise):
            self._noise, self._drawn = self.noise * self._random.standard_normal((1024, 10)), 0
        self._drawn += 1
        return self._noise[self._drawn - 1]


@kernel
def read_off(
    mechanisms, x, y, steps, at_power_up, theta, counts, hand, acceleration, mounting, gauges, noise, channels
):  # fmt: skip
    """At a tip (m): joint angles (rad, without jumps), encoder counts since power-up, and force channels (counts).

    mounting (6,): mass beyond the sensor (kg), its angle (rad) and that angle's change with each joint's.
    """
    before_0, before_1, before_2, before_3 = theta[0], theta[1], theta[2], theta[3]
    joint_angles(mechanisms[0], x, y, theta)
    turned = mounting[1]
    for i, before in enumerate((before_0, before_1, before_2, before_3)):
        theta[i] += TURN * np.rint((before - theta[i]) / TURN)
        counts[i] = math.floor((theta[i] - at_power_up[i]) * steps[i] + 0.5)
        turned += mounting[2 + i] * theta[i]
    fx, fy = hand[0] - mounting[0] * acceleration[0], hand[1] - mounting[0] * acceleration[1]
    cos, sin = math.cos(turned), math.sin(turned)
    for n in range(6):
        total = gauges[n, 0] * (cos * fx + sin * fy + noise[0]) + gauges[n, 1] * (cos * fy - sin * fx + noise[1])
        for m in range(2, 6):
            total += gauges[n, m] * noise[m]
        channels[n] = int(np.rint(min(max(total, -FORCE_FULL_SCALE), FORCE_FULL_SCALE)))
