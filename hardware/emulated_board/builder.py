"""An emulated bench for `phd bring-up`: a hand that obeys its orders, and the mistakes that builders make.

`phd emulate --hand builder` has this hand, `--mistake NAME` one of `MISTAKES`.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from core.device import Device
from core.files import InputError
from core.linkage import joint_angles
from core.mechanism import JOINTS
from core.simulator.hand import spring_hand
from core.simulator.state import pack_mechanism
from core.tick_log import TICK_S
from hardware.emulated_board.board import Board, Readings
from hardware.emulated_board.device import EmulatedDevice, pair
from hardware.emulated_board.line_faults import LineFault
from hardware.sensing.encoders import PoseSensing
from hardware.wire.messages import Four, Hello

# of the hand, all assumed
STIFF, DAMPED = (10_000.0, 0.0, 10_000.0), (150.0, 0.0, 150.0)  # N/m, N s/m: a grip that brings the handle into a jig
FREE = (0.0, 0.0, 0.0)
SPEED_M_S, TURN_RAD, TURN_RAD_S = 0.1, math.radians(18.0), math.radians(20.0)
PUSH_N, PUSH_S = 6.0, 0.4
CIRCLE_M, CIRCLE_S = 0.04, 2.0
PRESS_S = 0.4
HELD_STILL = {0: 2, 1: 0, 2: 0, 3: 2}  # joint that is turned -> joint that the other hand holds
DIRECTIONS = {"right": (1.0, 0.0), "away": (0.0, 1.0)}


class BuilderHand:
    """Turns arms, holds the handle in a jig, pushes it, moves it in circles; presses the emergency stop."""

    def __init__(self, tip: tuple[float, float]) -> None:
        self.hand = spring_hand(STIFF, DAMPED, 60.0, 0.5, tip)
        self.supply = True  # of the amplifiers: False while the emergency stop is pressed
        self._presses, self._press_in = False, 0.0
        self._device: Device | None = None
        self._tip, self._t = tip, 0.0
        self._target: Callable[[float], tuple[float, float]] = lambda t: tip  # by the time since the order
        self._push_until = -math.inf

    def take(self, device: Device) -> None:
        """Set the device whose joints the hand turns."""
        self._device = device

    def tick(self, x: float, y: float) -> None:
        self._tip = (x, y)
        self._t += TICK_S
        self.hand.grips["target"][0, :2] = self._target(self._t)
        self._press_in -= TICK_S
        if self._press_in < 0.0:
            self.supply = not self._presses
        if self._t > self._push_until:
            self.hand.grips["held"][0] = 0.0

    def obey(self, order: dict) -> None:
        """{"do": WHAT}, of "turn A", "push right", "push away", "let go", "press stop", "release stop".

        {"hold": [x, y]}: bring the handle there, m; {"circle": [x, y]}: circles about it. InputError: another order.
        """
        if set(order) == {"hold"}:
            return self._grip(self._way(pair(order["hold"], "hold", 2.0)))
        if set(order) == {"circle"}:
            return self._grip(self._circling(pair(order["circle"], "circle", 2.0)))
        what, _, which = str(order.get("do")).partition(" ")
        if set(order) != {"do"}:
            raise InputError(f"a builder's hand does not know the order {min(set(order) - {'do'}, default='')!r}")
        if what == "turn" and which in JOINTS and which:
            self._grip(self._turning(JOINTS.index(which)))
        elif what == "push" and which in DIRECTIONS:
            self._let_go()
            self.hand.grips["held"][0] = PUSH_N * np.array(DIRECTIONS[which])
            self._push_until = PUSH_S
        elif what == "let":
            self._let_go()
        elif what in ("press", "release"):
            self._presses, self._press_in = what == "press", PRESS_S
        else:
            raise InputError(f"a builder's hand cannot {order['do']!r}")

    def _grip(self, target: Callable[[float], tuple[float, float]]) -> None:
        self._target = target
        self._set(STIFF, DAMPED)

    def _let_go(self) -> None:
        self._set(FREE, FREE)

    def _set(self, stiffness: tuple[float, ...], damping: tuple[float, ...]) -> None:
        grip, self._t = self.hand.grips, 0.0
        grip["stiffness"][0], grip["damping"][0], grip["held"][0] = stiffness, damping, 0.0

    def _way(self, end: tuple[float, float]) -> Callable[[float], tuple[float, float]]:
        """Straight to a place (m)."""
        begin, takes = self._tip, max(math.dist(self._tip, end) / SPEED_M_S, TICK_S)

        def target(t: float) -> tuple[float, float]:
            share = min(t / takes, 1.0)
            return begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])

        return target

    def _turning(self, joint: int) -> Callable[[float], tuple[float, float]]:
        """A joint turns counter-clockwise while the other hand holds another."""
        assert self._device is not None
        pair_of_joints = tuple(sorted((joint, HELD_STILL[joint])))
        angles = np.zeros(4)
        joint_angles(pack_mechanism(self._device.mechanism)[0], *self._tip, angles)
        sensing = PoseSensing(self._device, pair_of_joints, (2.0 * math.pi,) * 4)  # type: ignore[arg-type]
        sensing.pose(tuple(angles[list(pair_of_joints)].tolist()))

        def target(t: float) -> tuple[float, float]:
            now = angles.copy()
            now[joint] += min(TURN_RAD_S * t, TURN_RAD)
            return sensing.pose(tuple(now[list(pair_of_joints)].tolist())).tip

        return target

    def _circling(self, middle: tuple[float, float]) -> Callable[[float], tuple[float, float]]:
        way = self._way(middle)

        def target(t: float) -> tuple[float, float]:
            x, y = way(t)
            radius, turned = CIRCLE_M * min(t, 1.0), 2.0 * math.pi * t / CIRCLE_S
            return x + radius * math.cos(turned), y + radius * math.sin(turned)

        return target


# ------------------------------------------------------------------------------------------ what builders get wrong


class Mistake(NamedTuple):
    """A mistake of wiring, supply or firmware, and what it does to readings and currents."""

    words: str
    readings: Callable[[Readings, np.random.Generator], Readings] | None = None
    drivers: Callable[[Four, "deque[Four]"], Four] | None = None  # mA commanded, those before -> mA that flow
    brakes: Callable[[Four], Four] | None = None  # mA that flow -> mA in the brakes at A, E, B, C
    measured: Callable[[Four], Four] | None = None  # mA that flow -> mA that the board measures
    stop: Callable[[Four, Four], Four] | None = None  # mA that flow, commanded -> .. with the stop pressed
    line: str = ""  # a fault of the line, as `line_faults.read_fault` takes it
    watchdog: bool = True
    clock: float = 1.0  # the board's time over the true one


def exchanged(values: tuple, i: int, j: int) -> tuple:
    """The values with two of them exchanged."""
    swapped = list(values)
    swapped[i], swapped[j] = swapped[j], swapped[i]
    return tuple(swapped)


def scaled(values: tuple, i: int, factor: float) -> tuple:
    """The values with one of them multiplied and rounded."""
    return tuple(round(factor * value) if n == i else value for n, value in enumerate(values))


def noisy(values: tuple, random: np.random.Generator, spread: float) -> tuple:
    return tuple(round(value + spread * random.standard_normal()) for value in values)


def slow(commanded: Four, before: "deque[Four]") -> Four:
    """A current loop of 30 ms at A."""
    last = before[-1][0] if before else 0
    step = (commanded[0] - last) / 30.0
    return (last + (round(step) or int(math.copysign(1, step)) if step else 0), *commanded[1:])


def ringing(commanded: Four, before: "deque[Four]") -> Four:
    """A current loop at B that overshoots: a second-order system of 25 Hz with little damping."""
    if len(before) < 2:
        return commanded
    last, earlier = before[-1][2], before[-2][2]
    value = 1.9 * last - 0.93 * earlier + 0.03 * commanded[2] if commanded[2] or last else 0.0
    return (*commanded[:2], round(value), commanded[3])


MISTAKES = {
    "slow-clock": Mistake("the board's clock runs 4 % slow (wrong crystal in the firmware)", clock=0.96),
    "floating-encoder": Mistake(
        "the line to encoder B is open and counts noise",
        lambda r, random: r._replace(counts=(*r.counts[:2], r.counts[2] + int(random.integers(-20, 21)), r.counts[3])),
    ),
    "amplifier-offset": Mistake(
        "the amplifier at B measures 60 mA without current", measured=lambda i: (*i[:2], i[2] + 60, i[3])
    ),
    "swapped-encoders": Mistake(
        "the plugs of encoders A and B are exchanged", lambda r, _: r._replace(counts=exchanged(r.counts, 0, 2))
    ),
    "inverted-encoder": Mistake(
        "both channels of encoder B are exchanged: it counts down",
        lambda r, _: r._replace(counts=scaled(r.counts, 2, -1.0)),
    ),
    "dead-encoder": Mistake("encoder A has no supply", lambda r, _: r._replace(counts=scaled(r.counts, 0, 0.0))),
    "coarse-encoder": Mistake(
        "encoder B is decoded at two edges in place of four", lambda r, _: r._replace(counts=scaled(r.counts, 2, 0.5))
    ),
    "noisy-force": Mistake(
        "the force sensor's cable has no shield: 0.5 N of noise",
        lambda r, random: r._replace(force=noisy(r.force, random, 500.0)),
    ),
    "inverted-force-x": Mistake(
        "the force sensor's x axis is inverted", lambda r, _: r._replace(force=scaled(r.force, 0, -1.0))
    ),
    "inverted-force-y": Mistake(
        "the force sensor's y axis is inverted", lambda r, _: r._replace(force=scaled(r.force, 1, -1.0))
    ),
    "turned-force": Mistake(
        "the force sensor is mounted a quarter turn off",
        lambda r, _: r._replace(force=scaled(exchanged(r.force, 0, 1), 1, -1.0)),
    ),
    "weak-amplifier": Mistake("the amplifier at E gives 70 % of its current", drivers=lambda i, _: scaled(i, 1, 0.7)),
    "dead-amplifier": Mistake("the brake at E is not plugged in", drivers=lambda i, _: scaled(i, 1, 0.0)),
    "slow-current": Mistake("the current loop at A takes 30 ms", drivers=slow),
    "ringing-current": Mistake("the current loop at B overshoots", drivers=ringing),
    "swapped-sensing": Mistake("current sensing of A and E is exchanged", measured=lambda i: exchanged(i, 0, 1)),
    "dead-watchdog": Mistake("the firmware never looks at its watchdog", watchdog=False),
    "stop-not-wired": Mistake("the emergency stop is not in the supply", stop=lambda flowing, commanded: commanded),
    "stop-misses-B": Mistake(
        "the emergency stop does not cut the amplifier at B, and no contact tells the board",
        stop=lambda flowing, commanded: (0, 0, commanded[2], 0),
    ),
    "crossed-brakes": Mistake("the plugs of brakes A and E are exchanged", brakes=lambda i: exchanged(i, 0, 1)),
    "slipping-brake": Mistake("the clamp of brake A slips on its shaft", brakes=lambda i: scaled(i, 0, 0.0)),
    "lossy-line": Mistake("the cable loses 2 % of all frames", line="drop=0.02"),
    "stuttering-line": Mistake("a hub on the USB cable holds frames back for up to 15 ms", line="jitter=0.015"),
}  # fmt: skip


class BuiltDevice(EmulatedDevice):
    """The simulated device with a builder's hand, and perhaps a mistake."""

    hand: BuilderHand

    def __init__(self, device: Device, hello: Hello, hand: BuilderHand, tip: tuple[float, float], mistake: str) -> None:
        super().__init__(device, hello, hand, tip, seed=1)
        hand.take(device)
        self.mistake = MISTAKES[mistake] if mistake else Mistake("")
        self._random = np.random.default_rng(5)
        self._before: deque[Four] = deque(maxlen=2)  # mA that flowed
        self._flowing: Four = (0, 0, 0, 0)

    def sense(self, currents: Four, faults: Iterable[LineFault]) -> Readings:
        mistake = self.mistake
        self._flowing = mistake.drivers(currents, self._before) if mistake.drivers else currents
        if not self.hand.supply:
            none = (0, 0, 0, 0)
            self._flowing = mistake.stop(none, currents) if mistake.stop else none
        self._before.append(self._flowing)
        readings = super().sense(self._in_brakes(), faults)
        shown = mistake.measured(self._flowing) if mistake.measured else self._flowing
        noise = (read - true for read, true in zip(readings.current_mA, self._in_brakes(), strict=True))
        cut = not self.hand.supply and mistake.stop is None
        readings = readings._replace(current_mA=tuple(a + b for a, b in zip(shown, noise, strict=True)), supply_cut=cut)
        return mistake.readings(readings, self._random) if mistake.readings else readings

    def advance(self, currents: Four) -> None:
        super().advance(self._in_brakes())

    def _in_brakes(self) -> Four:
        return self.mistake.brakes(self._flowing) if self.mistake.brakes else self._flowing


class UnwatchedBoard(Board):
    """A board whose firmware forgot the watchdog."""

    def _check_watchdog(self, now_us: int) -> None:
        return


def board_with(hello: Hello, mistake: str) -> Board:
    """The board of a bench with this mistake; "": none."""
    return (Board if not mistake or MISTAKES[mistake].watchdog else UnwatchedBoard)(hello)
