"""The device behind the emulated board: the simulated device, a hand at its handle, and its sensors.

Encoders count whole steps from where they stood at power-up; the force sensor sits between handle and hand with mass
beyond it, turned as the device file says, with noise, and ends at its full scale.
"""

import math
from collections.abc import Iterable
from itertools import count
from typing import NamedTuple, Protocol

import numpy as np

from core.device import Device
from core.files import InputError
from core.kernels import kernel
from core.linkage import joint_angles
from core.simulator.hand import Hand, new_hand, spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.state import pack_mechanism
from core.tick_log import TICK_S
from core.workspace import tip_is_free
from hardware.emulated_board.board import FULL_BOARD, Readings
from hardware.emulated_board.line_faults import LineFault
from hardware.sensing.samples import sensing_of, sensor_angle
from hardware.wire.messages import Four, Hello

WORKSPACE_M = 2.0  # an order further out than this is a slip of the pen
LARGEST_N = 1000.0
FORCE_UNIT = 1000  # micro-newtons a count
FORCE_FULL_SCALE = 66_700  # counts: 66.7 N, a force sensor of 15 pounds
#: Assumed: of three forces (N), three torques (N m), four currents (mA).
NOISE = np.array([0.02] * 3 + [0.0002] * 3 + [1.0] * 4)
TURN = 2.0 * math.pi


def hello_of(device: Device, serial: str = "") -> Hello:
    """The Hello of a board that is wired to this device, at its start."""
    encoders, force = sensing_of(device)
    return FULL_BOARD._replace(
        encoders=sum(1 << i for i, step in enumerate(encoders.counts) if step),
        brakes=sum(1 << i for i, present in enumerate(device.brakes.present) if present),
        force_channels=6 if force else 0,
        counts_per_rev=encoders.counts,
        current_max_mA=tuple(round(1000.0 * current) for current in device.brakes.current_max),
        force_unit=FORCE_UNIT,
        force_full_scale=FORCE_FULL_SCALE,
        device=device.name.encode()[:24],
        serial=serial.encode()[:16],
    )


class EmulatedHand(Protocol):
    """The hand at the handle."""

    hand: Hand  # what the simulated device feels

    def tick(self, x: float, y: float) -> None:
        """Before each tick (1 ms), with the tip (m): set `hand` for it."""

    def obey(self, order: dict) -> None:
        """Obey an order from outside. InputError if this hand does not know it."""


class HeldHand:
    """A hand that pulls the handle by a spring to an ordered place, or does not hold it.

    Assumed: 400 N/m, 20 N s/m, at most 40 N, an arm of 1 kg.
    """

    def __init__(self, tip: tuple[float, float], holds: bool = True) -> None:
        if holds:
            self.hand = spring_hand((400.0, 0.0, 400.0), (20.0, 0.0, 20.0), 40.0, 1.0, tip)
        else:
            self.hand = new_hand(spring=1)  # without stiffness: only the force that is ordered

    def tick(self, x: float, y: float) -> None:
        """It does nothing by itself."""

    def obey(self, order: dict) -> None:
        """{"target": [x, y]}, m: pull there; {"force": [fx, fy]}, N: push so, until the next such order."""
        if unknown := set(order) - {"target", "force"}:
            raise InputError(f"a hand that holds still does not know the order {min(unknown)!r}")
        target = pair(order["target"], "target", WORKSPACE_M) if "target" in order else None
        force = pair(order["force"], "force", LARGEST_N) if "force" in order else None
        if target:
            self.hand.grips["target"][0] = (*target, 0.0, 0.0)
        if force:
            self.hand.grips["held"][0] = force


def pair(value: object, name: str, most: float) -> tuple[float, float]:
    """Two numbers of at most `most` from an order, else InputError."""
    if isinstance(value, list) and len(value) == 2:
        if all(isinstance(number, int | float) and abs(number) <= most for number in value):  # false for NaN
            return float(value[0]), float(value[1])
    raise InputError(f"{name} must be two numbers of at most {most:g}, not {value!r}")


class EmulatedDevice:
    """The simulated device behind the board, with its sensors and the hand."""

    def __init__(self, device: Device, hello: Hello, hand: EmulatedHand, tip: tuple[float, float], seed: int) -> None:
        """InputError where the handle cannot be at `tip` (m)."""
        if not bool(tip_is_free(device.mechanism, *tip)):
            raise InputError(f"device {device.name}: the handle cannot be at ({tip[0]:g}, {tip[1]:g}) m")
        self.hand = hand
        self.sensors = EmulatedSensors(device, hello, tip, seed)
        self._simulated = SimulatedDevice(device, tip, hand.hand)
        #: views of the state: tip x, y, vx, vy (m, m/s), acceleration (m/s2), hand force (N)
        self.motion, self.acceleration, self.hand_force = (
            self._simulated.body[name].view(np.ndarray)[0] for name in ("tip", "acceleration", "hand_force")
        )
        self._ticks = 0

    @property
    def tip(self) -> tuple[float, float]:
        return float(self.motion[0]), float(self.motion[1])

    def sense(self, currents: Four, faults: Iterable[LineFault]) -> Readings:
        """Begin the next tick of the hand; the readings while these currents (mA) flow."""
        self.hand.tick(*self.tip)
        self._simulated.settle(1e-3 * np.array(currents), self._ticks * TICK_S)
        return self.sensors.read(self.tip, self.hand_force, self.acceleration, currents, faults)

    def advance(self, currents: Four) -> None:
        """Move the device for a tick with these currents (mA)."""
        self._simulated.move(1e-3 * np.array(currents), self._ticks * TICK_S, TICK_S)
        self._ticks += 1


class Wiring(NamedTuple):
    """The sensors as the kernel reads them off."""

    mechanism: np.ndarray  # one record
    steps: np.ndarray  # (4,) counts per rad
    #: (6,) mass beyond the force sensor (kg), its angle (rad), the change of that angle with each joint's
    mounting: np.ndarray
    gauges: np.ndarray  # (6, 6) counts per N and N m
    # what changes
    at_power_up: np.ndarray  # (4,) rad
    theta: np.ndarray  # (4,) rad, without jumps
    counts: np.ndarray  # (4,) of the encoders, since power-up
    channels: np.ndarray  # (6,) counts of force


class EmulatedSensors:
    """The sensors of the simulated device."""

    def __init__(self, device: Device, hello: Hello, tip: tuple[float, float], seed: int) -> None:
        self._force = sensing_of(device)[1]
        gauges = np.eye(6) if device.calibration is None else np.linalg.inv(device.calibration)
        self.noise = NOISE.copy()
        mounting = np.zeros(6)
        if sensor := self._force:
            changes = [sensor_angle(sensor, tuple(joint)) - sensor.rotation_rad for joint in np.eye(4)]
            mounting[:] = sensor.inertia_beyond_kg, sensor.rotation_rad, *changes
        self._wiring = Wiring(
            pack_mechanism(device.mechanism).view(np.ndarray), np.array(hello.counts_per_rev) / TURN, mounting,
            1e6 / FORCE_UNIT * gauges, np.zeros(4), np.zeros(4), np.zeros(4, dtype=np.int64),
            np.zeros(6, dtype=np.int64),
        )  # fmt: skip
        self._brakes = hello.brakes
        self._over_mA = [min(2 * most, 32_000) for most in hello.current_max_mA]  # measured by a faulty amplifier
        self.theta, self.at_power_up = self._wiring.theta, self._wiring.at_power_up
        joint_angles(self._wiring.mechanism[0], *tip, self.theta)
        self.power_up()
        self._last = Readings()
        self.draw_anew(seed)

    def power_up(self) -> None:
        """The counters begin at zero where the joints are now."""
        self.at_power_up[:] = self.theta

    def draw_anew(self, seed: int) -> None:
        """Restart the noise: for each tick six loads (N, N m) and four currents (mA)."""
        random = np.random.default_rng([seed, 2])
        self._noise = (tick for _ in count() for tick in self.noise * random.standard_normal((1024, 10)))

    def home_counts(self) -> Four:
        """The counts at the present angles: angle times counts per radian, whole."""
        return tuple(np.rint(self.theta * self._wiring.steps).astype(int).tolist())

    def read(
        self, tip: tuple[float, float], hand: np.ndarray, acceleration: np.ndarray, current_mA: Four,
        faults: Iterable[LineFault] = (),
    ) -> Readings:  # fmt: skip
        """The readings at a tip (m) with a hand force (N) and an acceleration (m/s2), (2,) each."""
        acting = {(fault.kind, fault.value) for fault in faults}
        noise = next(self._noise)
        read_off(self._wiring, tip, hand, acceleration, noise)
        counts, measured = self._wiring.counts.tolist(), [0, 0, 0, 0]
        for i in range(4):
            if ("stuck-encoder", i) in acting:
                counts[i] = self._last.counts[i]
            if self._brakes >> i & 1:
                flows = self._over_mA[i] if ("over-current", i) in acting else current_mA[i]
                measured[i] = round(flows + noise[6 + i])
        channels = self._wiring.channels.tolist() if self._force else []
        if channels and ("saturated-force", 0) in acting:
            channels[0] = FORCE_FULL_SCALE
        good = tuple(("bad-encoder", i) not in acting for i in range(4))
        self._last = Readings(tuple(counts), tuple(channels), tuple(measured), good)
        return self._last


@kernel
def read_off(wiring, tip, hand, acceleration, noise):
    """Joint angles, encoder counts and force channels into the `Wiring`; as `EmulatedSensors.read`, noise (10,)."""
    theta, mounting, gauges = wiring.theta, wiring.mounting, wiring.gauges
    before_0, before_1, before_2, before_3 = theta[0], theta[1], theta[2], theta[3]
    joint_angles(wiring.mechanism[0], tip[0], tip[1], theta)
    turned = mounting[1]
    for i, before in enumerate((before_0, before_1, before_2, before_3)):
        theta[i] += TURN * np.rint((before - theta[i]) / TURN)
        wiring.counts[i] = math.floor((theta[i] - wiring.at_power_up[i]) * wiring.steps[i] + 0.5)
        turned += mounting[2 + i] * theta[i]
    fx, fy = hand[0] - mounting[0] * acceleration[0], hand[1] - mounting[0] * acceleration[1]
    cos, sin = math.cos(turned), math.sin(turned)
    for n in range(6):
        total = gauges[n, 0] * (cos * fx + sin * fy + noise[0]) + gauges[n, 1] * (cos * fy - sin * fx + noise[1])
        for m in range(2, 6):
            total += gauges[n, m] * noise[m]
        wiring.channels[n] = int(np.rint(min(max(total, -FORCE_FULL_SCALE), FORCE_FULL_SCALE)))
