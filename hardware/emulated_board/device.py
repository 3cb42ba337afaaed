"""The device behind the emulated board: the simulator with its brakes, a hand at the handle, and what sensors read."""

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from core.device import Device
from core.files import InputError
from core.simulator.hand import Hand, new_hand, spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.workspace import tip_is_free
from hardware.emulated_board.board import TICK_US, Readings
from hardware.emulated_board.line_faults import SENSED, LineFault
from hardware.emulated_board.sensors import EmulatedSensors
from hardware.wire.messages import Four, Hello

TICK_S = TICK_US * 1e-6
WORKSPACE_M = 2.0  # an order further out than this is a slip of the pen
LARGEST_N = 1000.0


class EmulatedHand(Protocol):
    """Who holds the handle."""

    hand: Hand  # what the simulated device feels

    def tick(self, x: float, y: float) -> None:
        """Before each tick (1 ms), with the tip (m): set `hand` for it."""

    def obey(self, order: dict) -> None:
        """An order from outside. InputError where it is none of this hand's."""


class HeldHand:
    """A hand that pulls the handle by a spring to where an order sent it, or does not hold it.

    Assumed: 400 N/m, 20 N s/m, at most 40 N, an arm of 1 kg.
    """

    def __init__(self, tip: tuple[float, float], holds: bool = True) -> None:
        if holds:
            self.hand = spring_hand((400.0, 0.0, 400.0), (20.0, 0.0, 20.0), 40.0, 1.0, tip)
        else:
            self.hand = new_hand()
            self.hand.grips["spring"][0] = 1  # without stiffness: only the force that is ordered

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
    """Two numbers of at most `most`, from an order. InputError where they are not."""
    if isinstance(value, list) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        x, y = float(value[0]), float(value[1])
        if abs(x) <= most and abs(y) <= most:  # false for NaN
            return x, y
    raise InputError(f"{name} must be two numbers of at most {most:g}, not {value!r}")


class EmulatedDevice:
    """The simulated device at the board's wires, with its sensors and the hand that holds it."""

    def __init__(
        self, device: Device, hello: Hello, hand: EmulatedHand, tip: tuple[float, float], seed: int
    ) -> None:
        """InputError where the handle cannot be at `tip` (m)."""
        if not bool(tip_is_free(device.mechanism, *tip)):
            raise InputError(f"device {device.name}: the handle cannot be at ({tip[0]:g}, {tip[1]:g}) m")
        self.hand = hand
        self.sensors = EmulatedSensors(device, hello, tip, seed)
        self._simulated = SimulatedDevice(device, tip, hand.hand)
        #: views of the state: tip x, y, vx, vy (m, m/s), acceleration (m/s2), hand force (N)
        self.motion, self.acceleration, self.hand_force = (
            self._simulated.state[name].view(np.ndarray)[0] for name in ("tip", "acceleration", "hand_force")
        )
        self._ticks = 0

    @property
    def tip(self) -> tuple[float, float]:
        """Where the handle is, m."""
        return float(self.motion[0]), float(self.motion[1])

    def sense(self, currents: Four, faults: Iterable[LineFault]) -> Readings:
        """The hand's next tick begins; what the sensors read while these currents (mA) flow."""
        self.hand.tick(*self.tip)
        self._simulated.settle(1e-3 * np.array(currents), self._ticks * TICK_S)
        joints: dict[str, set[int]] = {kind: set() for kind in SENSED}
        for fault in faults:
            if fault.kind in joints:
                joints[fault.kind].add(int(fault.value))
        stuck, bad, over, saturated = joints.values()
        return self.sensors.read(
            self.tip, self.hand_force, self.acceleration, currents, stuck, bad, bool(saturated), over
        )

    def advance(self, currents: Four) -> None:
        """The device moves for a tick with these currents (mA)."""
        self._simulated.move(1e-3 * np.array(currents), self._ticks * TICK_S, TICK_S)
        self._ticks += 1
