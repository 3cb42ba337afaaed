"""An independent solution of a bench scene: scipy DOP853 on the ten-coordinate form, Eq. (5), patterns by trial.

Nothing of the simulator's own solver is used: which brakes stick is found by trying every pattern on Eq. (5) and
keeping the one that contradicts nothing, and the moment of an event is that of scipy's dense output. Where brakes lag
(fidelity mr), Eq. (1) is one more differential equation for each brake, dy/dt = (K - y) / a: with K of Eq. (2) and a of
Eq. (4), written here anew, at the joint's rate of that very moment. Nothing is frozen over a step.

It knows no hard stops: it ends where the first one is touched.
"""

import math
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from core.device_file import BrakeFile
from core.mechanism import JOINTS
from experiments.benchmark.scenes import COMPARE_S, START, BenchScene
from experiments.benchmark.ten_coordinates import (
    CD,
    ED,
    HANDLE,
    THETA_AE,
    THETA_BC,
    Solution,
    bodies_of,
    coordinates,
    rates,
    solve,
)

#: Tolerances of DOP853. Looser: the reference is no better than what it judges. Tighter: below what doubles carry.
RTOL, ATOL = 1e-12, 1e-14
#: rad/s, m/s; a joint slower than this after an event is the one that has just stopped; a tip slower than this rests.
#: Larger: a slow joint is stopped by mistake. Smaller: the dense output's error hides that it has stopped.
STOPPED = 1e-8
#: s; a resting tip is looked at this often.
LOOK_S = 1e-3
#: s; a tip leaves rest this long after the hand has become stronger than the brakes. Larger: it leaves late. Smaller:
#: the excess, and with it the pattern, is rounding.
LEAVE_S = 1e-9
#: s; the first step after an event. Larger: a rate that has just left zero is back at zero within it, and that counts
#: as one event at its start, again and again. Smaller: more steps.
FIRST_S = 1e-6

RATES, YIELDS = slice(10, 20), slice(20, 24)  # of z


def torque_gain(brake: BrakeFile, current: float) -> float:
    """K (N m) at a current (A), Eq. (2)."""
    k1, k2, k3, k4, k5 = brake.equation_2
    return k1 * current + k2 if current < brake.knee_A else k3 * current**2 + k4 * current + k5


def time_constant(brake: BrakeFile, current: float, rate: float, rising: bool) -> float:
    """a (s) at a commanded current (A) and a joint rate (rad/s), Eq. (4); constant below the file's floor."""
    surface, rpm = brake.rise if rising else brake.fall, abs(rate) * 30.0 / math.pi
    if rpm >= brake.omega_0_rpm:
        return surface.a_avg_s
    a1, a2, a3, a4, a5, a6 = surface.a
    w = math.log2(max(rpm, brake.floor_rpm))
    return a1 * current + a2 * w + a3 * current * w + a4 * w**2 + a5 * current * w**2 + a6


def sines(z: np.ndarray) -> np.ndarray:
    """Sines of both elbows and of the angle between the distal links."""
    a, b, e, c = z[THETA_AE], z[THETA_BC], z[ED + 2], z[CD + 2]
    return np.sin([e - a, c - b, c - e])


class _Reference:
    """One scene being solved: z = (q, qdot, yields), 24 numbers, between events."""

    def __init__(self, scene: BenchScene, fidelity: str):
        self.scene, self.bodies = scene, bodies_of(scene.device)
        files = scene.device.brake_files if fidelity == "mr" else {}
        self.brakes = [files.get(joint) for joint in JOINTS]
        self.commands = scene.commands(fidelity)  # yields, or currents
        self.command = self.commands[0]
        q = coordinates(scene.device, np.array(START))
        off = [0.0 if brake is None else brake.equation_2[1] for brake in self.brakes]
        self.z = np.concatenate([q, np.zeros(10), off])
        self.times = np.arange(scene.comparisons + 1) * COMPARE_S
        self.tips = np.full((len(self.times), 2), np.nan)
        self.tips[0] = START
        self.sign = np.zeros(4)
        self.stuck: tuple[int, ...] = ()
        self.loose: dict[int, float] = {}  # joint that has just broken loose -> its sense
        self.braked = [i for i in range(4) if scene.torques[0, i] > 0.0]
        self.side = np.sign(sines(self.z))
        self.at_stop = False

    def run(self) -> np.ndarray:
        """Tips (n, 2) at the times of comparison; not a number from the first touch of a hard stop on."""
        edges = [*self.scene.times[1:], self.scene.duration_s]
        t = 0.0
        at_once = [brake is None for brake in self.brakes]
        for end, command in zip(edges, self.commands, strict=True):
            if self.at_stop:
                break
            self.command = command
            self.z[YIELDS] = np.where(at_once, command, self.z[YIELDS])
            self.take_up_pattern(t)
            while t < end and not self.at_stop:
                t = self.rest(t, end) if len(self.stuck) > 1 else self.move(t, end)
                if not self.at_stop:
                    self.take_up_pattern(t)
        return self.tips

    def answer(self, t: float, z: np.ndarray, sign: np.ndarray, stuck: tuple[int, ...]) -> Solution:
        """Eq. (5) with slipping brakes in the senses `sign` and the joints `stuck`."""
        return solve(self.bodies, z[:10], z[RATES], self.scene.force(t), -np.asarray(sign) * z[YIELDS], stuck)

    def yield_rates(self, z: np.ndarray) -> np.ndarray:
        """dy/dt (4,), N m/s, Eq. (1); 0 for a brake without lag."""
        found, turning = np.zeros(4), self.bodies.rates @ z[RATES]
        for i, brake in enumerate(self.brakes):
            if brake is not None:
                lacking = torque_gain(brake, self.command[i]) - z[20 + i]
                found[i] = lacking / time_constant(brake, self.command[i], turning[i], lacking > 0.0)
        return found

    def margin_at_rest(self, t: float, z: np.ndarray) -> float:
        """How much more than the hand's force all brakes together hold, in the direction where it is least (N)."""
        g = np.array([self.row(i) for i in self.braked])
        normals = np.stack([-g[:, 1], g[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        hold = np.abs(normals @ g.T) @ z[YIELDS][self.braked]
        return float(np.min(hold - np.abs(normals @ self.scene.force(t))))

    def row(self, i: int) -> np.ndarray:
        """Rate of joint i per unit of tip velocity (2,)."""
        return np.array([self.bodies.rates[i] @ rates(self.bodies, self.z[:10], axis) for axis in np.eye(2)])

    def take_up_pattern(self, t: float) -> None:
        """Which brakes stick and which way the others slip from here on."""
        omega = self.bodies.rates @ self.z[RATES]
        slow = [i for i in self.braked if abs(omega[i]) < STOPPED]
        if len(slow) > 1 and np.linalg.norm(self.z[10 + HANDLE : 20]) < STOPPED:
            self.z[RATES] = 0.0
            slow = list(self.braked)
            if self.margin_at_rest(t, self.z) >= 0.0:
                self.sign[:], self.stuck = 0.0, tuple(self.braked)
                return
        moving = {i: float(np.sign(omega[i])) for i in self.braked if i not in slow} | self.loose
        slow = [i for i in slow if i not in self.loose]
        self.loose = {}
        for choice in product((0.0, 1.0, -1.0), repeat=len(slow)):
            sign = np.zeros(4)
            for i, s in [*moving.items(), *zip(slow, choice, strict=True)]:
                sign[i] = s
            stuck = tuple(i for i in slow if sign[i] == 0.0)
            if len(stuck) > 1:
                continue
            found = self.answer(t, self.z, sign, stuck)
            turning = self.bodies.rates @ found.acceleration
            if all(turning[i] * sign[i] > 0.0 for i in slow if sign[i] != 0.0) and all(
                abs(found.torque[i]) <= self.z[20 + i] for i in stuck
            ):
                self.sign, self.stuck = sign, stuck
                break
        else:
            raise ArithmeticError(f"bench reference: no pattern at t = {t:g} s")
        if self.stuck:
            self.stop(self.stuck[0])

    def stop(self, i: int) -> None:
        """Joint i is exactly at rest, and not only to the dense output's error."""
        g, v = self.row(i), self.z[10 + HANDLE : 20]
        self.z[RATES] = rates(self.bodies, self.z[:10], v - g * (g @ v) / (g @ g))

    def rest(self, t: float, end: float) -> float:
        """The tip rests until the hand is stronger than the brakes, or to the end."""

        def slope(_: float, z: np.ndarray) -> np.ndarray:
            return np.append(np.zeros(20), self.yield_rates(z))

        solution = solve_ivp(slope, (t, end), self.z, "DOP853", rtol=RTOL, atol=ATOL, dense_output=True).sol

        def margin(time: float) -> float:
            return self.margin_at_rest(time, solution(time))

        until = t
        while until < end:
            last, until = until, min(until + LOOK_S, end)
            if margin(until) < 0.0:
                until = min(brentq(margin, last, until, xtol=1e-15) + LEAVE_S, end)
                break
        self.keep(t, until, solution)
        self.z = solution(until)
        return until

    def move(self, t: float, end: float) -> float:
        """Smooth motion up to the next event or the end."""

        def slope(time: float, z: np.ndarray) -> np.ndarray:
            acceleration = self.answer(time, z, self.sign, self.stuck).acceleration
            return np.concatenate([z[RATES], acceleration, self.yield_rates(z)])

        def stop_left(_: float, z: np.ndarray) -> float:
            """How far the sines that have hard stops are above their margin."""
            return float(np.min(self.side * sines(z))) - self.scene.device.mechanism.margin

        def slip_left(i: int, _: float, z: np.ndarray) -> float:
            """The rate of slipping joint i in its sense; zero: it stops."""
            return self.sign[i] * (self.bodies.rates[i] @ z[RATES])

        def hold_left(i: int, time: float, z: np.ndarray) -> float:
            """The load that stuck joint i could hold besides; at zero it breaks loose."""
            return z[20 + i] - abs(self.answer(time, z, self.sign, self.stuck).torque[i])

        slipping = [i for i in self.braked if self.sign[i] != 0.0]
        events: list[Any] = [stop_left, *(partial(slip_left, i) for i in slipping)]
        events += [partial(hold_left, i) for i in self.stuck]
        for event in events:
            event.terminal, event.direction = True, -1.0
        run = solve_ivp(
            slope, (t, end), self.z, "DOP853", rtol=RTOL, atol=ATOL, events=events, dense_output=True,
            first_step=min(FIRST_S, end - t),
        )  # fmt: skip
        until = run.t[-1]
        self.keep(t, until, run.sol)
        self.z = run.y[:, -1].copy()
        self.at_stop = len(run.t_events[0]) > 0
        if self.stuck and len(run.t_events[-1]):
            (j,) = self.stuck
            self.loose[j] = -float(np.sign(self.answer(until, self.z, self.sign, self.stuck).torque[j]))
        for i, times in zip(slipping, run.t_events[1:], strict=False):
            if len(times):
                self.stop(i)
        return until

    def keep(self, t: float, until: float, solution: Callable[[float], np.ndarray]) -> None:
        """The tips at the times of comparison in (t, until]."""
        for k in np.flatnonzero((self.times > t + 1e-12) & (self.times <= until + 1e-12)):
            self.tips[k] = solution(min(self.times[k], until))[HANDLE:10]


def reference_tips(scene: BenchScene, fidelity: str = "ideal") -> np.ndarray:
    """Tips (n, 2), m, of a scene at the times of comparison, t = 0 first; fidelity ideal, or mr without backlash.

    Not a number from the first touch of a hard stop on.
    """
    return _Reference(scene, fidelity).run()
