"""A Haply board, byte by byte, with the simulated 2diy behind it; as a wire in simulated time, or on a pseudo-terminal.

It sets torques and reads encoders as the board does: each question that asks for torques is answered at once, and then
the device moves for a tick. So the plant is the clock: a session runs as fast as the machine can.
"""

import contextlib
import math
import os
import select
import struct
import threading
import time
import tty

import numpy as np

from core.device import Device
from core.device_interface import DeviceError
from core.faults import cause
from core.linkage import joint_angles
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import TICK_S
from hardware.emulated_board.device import EmulatedHand

TURN = 2.0 * math.pi
STEPS = 2  # of the plant in a tick: a torque is a force at the tip, held over each
NO_CURRENT = np.zeros(4)
LARGEST = 0.123  # N m, where the firmware ends


class Plant:
    """The simulated 2diy: links, friction, hand, and two motors with torques (N m) at A and B."""

    def __init__(self, device: Device, hand: EmulatedHand, tip: tuple[float, float]) -> None:
        self.hand, self.torques = hand, np.zeros(2)
        self._simulated = SimulatedDevice(device, tip, hand.hand)
        self._held = hand.hand.grips["held"][0]
        state = self._simulated.state
        self._mechanism = self._simulated.mechanism.view(np.ndarray)[0]
        self._motion, self._rows, self._force = (state[name].view(np.ndarray)[0] for name in ("tip", "g", "hand_force"))
        self._angles = np.zeros(4)
        self.theta = self.joint_angles()
        self.work = np.zeros(2)  # of the motors since the start, J
        self.true_force: tuple[float, float] = (0.0, 0.0)
        self._steps = 0

    @property
    def tip(self) -> tuple[float, float]:
        return float(self._motion[0]), float(self._motion[1])

    def joint_angles(self) -> np.ndarray:
        """Of A and B, rad."""
        joint_angles(self._mechanism, *self.tip, self._angles)
        return self._angles[::2].copy()

    def move(self) -> None:
        """A tick."""
        self.hand.tick(*self.tip)
        held, step = self._held.copy(), TICK_S / STEPS
        for _ in range(STEPS):
            before = self.theta
            motors = self.torques @ self._rows[:3:2]
            self._held[:] = held + motors
            self._simulated.move(NO_CURRENT, self._steps * step, step)
            self._steps += 1
            self.theta = self.joint_angles()
            self.work += self.torques * (np.mod(self.theta - before + math.pi, TURN) - math.pi)
        x, y = (self._force - motors).tolist()
        self.true_force = x, y
        self._held[:] = held


class MockHaply:
    """The board's end of the wire."""

    name = "mock"

    def __init__(self, device: Device, hand: EmulatedHand, tip: tuple[float, float], speaks: bool = True) -> None:
        self.plant = Plant(device, hand, tip)
        self.ticks, self.speaks, self.unplugged = 0, speaks, False
        self.heard: list[bytes] = []  # questions
        self.garbage = b""  # in the place of the next answers
        self._in = self._out = b""
        self._counters: list[tuple[float, float]] = []  # of ports 1 and 2: angle at set-up (rad), counts per revolution
        self._sign = 1.0

    def now(self) -> float:
        return TICK_S * self.ticks

    def sleep(self, seconds: float) -> None:
        """Time passes; the motors keep their torques."""
        for _ in range(max(round(seconds / TICK_S), 1)):
            self.tick()

    def tick(self) -> None:
        self.ticks += 1
        self.plant.move()

    def receive(self, data: bytes) -> bytes:
        """What the board answers to bytes."""
        self._in += data
        out = b""
        while self._in:
            size = {0: 2, 1: 26, 2: 10}.get(self._in[0], 1)
            if len(self._in) < size:
                break
            message, self._in = self._in[:size], self._in[size:]
            self.heard.append(message)
            out += self._obey(message)
        return out

    def _obey(self, message: bytes) -> bytes:
        plant = self.plant
        if message[0] == 0:
            plant.torques[:], self._counters = 0.0, []
        elif message[0] == 1:
            assert message[1:10] == bytes((5, 3, 1, 1, 3, 1, 1, 0, 0)), message
            offset_1, per_rev_1, offset_2, per_rev_2 = struct.unpack("<4f", message[10:])
            assert offset_1 == offset_2 == 0.0
            self._counters = [(plant.theta[1], per_rev_1), (plant.theta[0], per_rev_2)]
        elif message[0] == 2 and self._counters:
            torque_b, torque_a = struct.unpack("<2f", message[2:])
            self.tick()
            plant.torques[:] = np.clip((torque_a, torque_b), -LARGEST, LARGEST)
            answer = struct.pack("<B2f", message[1], *self._angles())
            answer, self.garbage = (self.garbage[:9], self.garbage[9:]) if self.garbage else (answer, b"")
            return answer if self.speaks else b""
        return b""

    def _angles(self) -> tuple[float, float]:
        """In degrees, of the encoders at ports 1 and 2."""
        turned = [
            math.floor((self.plant.theta[1 - n] - zero) / TURN * per_rev + 0.5) * 360.0 / per_rev
            for n, (zero, per_rev) in enumerate(self._counters)
        ]
        return turned[0], turned[1]

    # as a wire

    def open(self, name: str) -> "MockHaply":
        self._check()
        return self

    def read(self) -> bytes:
        self._check()
        out, self._out = self._out, b""
        if not out:
            self.sleep(2e-3)  # a port waits so long for a first byte
        return out

    def write(self, data: bytes) -> None:
        self._check()
        self._out += self.receive(data)

    def close(self) -> None:
        """The watchdog takes the torques off, if it still can."""
        if not self.unplugged:
            self.receive(struct.pack("<2B2f", 2, 5, 0.0, 0.0))

    def _check(self) -> None:
        if self.unplugged:
            raise DeviceError(cause("port", name=self.name, what="it is gone"))


class Served:
    """A mock on a pseudo-terminal of its own thread."""

    def __init__(self, mock: MockHaply) -> None:
        self.mock = mock
        mock.tick()  # kernels are compiled, or loaded, before a host waits for an answer
        self._master, other = os.openpty()
        tty.setraw(other)
        self._other, self.port = other, os.ttyname(other)
        self._ends = threading.Event()
        self.torques_at: list[tuple[float, bool]] = []  # time (s) of each question for torques, and whether it had any
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ends.is_set():
            if select.select([self._master], [], [], 0.01)[0]:
                with contextlib.suppress(OSError):  # nobody has the other end
                    answer = self.mock.receive(os.read(self._master, 4096))
                    self.torques_at.append((time.perf_counter(), bool(self.mock.plant.torques.any())))
                    os.write(self._master, answer)

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        for end in (self._master, self._other):
            os.close(end)
