"""An independent solution of a bench scene: scipy DOP853 on the ten-coordinate form, Eq. (5), patterns by trial.

Nothing of the simulator's own solver is used: which brakes stick is found by trying every pattern on Eq. (5) and
keeping the one that contradicts nothing, and the moment of an event is that of scipy's dense output.
"""

from functools import partial
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from core.ten_coordinates import HANDLE, bodies_of, coordinates, rates, solve
from experiments.benchmark.scenes import COMPARE_S, START, BenchScene

#: Tolerances of DOP853. Looser: the reference is no better than what it judges. Tighter: below what doubles carry.
RTOL, ATOL = 1e-12, 1e-14
#: rad/s; a joint slower than this after an event is the one that has just stopped. Larger: a slow joint is stopped by
#: mistake. Smaller: the dense output's error hides that it has stopped.
STOPPED = 1e-8
#: s; a resting tip is looked at this often.
LOOK_S = 1e-3
#: s; a tip leaves rest this long after the hand has become stronger than the brakes. Larger: it leaves late. Smaller:
#: the excess, and with it the pattern, is rounding.
LEAVE_S = 1e-9


class _Reference:
    """One scene being solved: coordinates z = (q, qdot), 20 numbers, between events."""

    def __init__(self, scene: BenchScene):
        self.scene, self.bodies = scene, bodies_of(scene.device)
        q = coordinates(scene.device, np.array(START))
        self.z = np.append(q, np.zeros(10))
        self.times = np.arange(scene.comparisons + 1) * COMPARE_S
        self.tips = np.full((len(self.times), 2), np.nan)
        self.tips[0] = START
        self.yields = scene.torques[0]
        self.sign = np.zeros(4)
        self.stuck: tuple[int, ...] = ()
        self.loose: dict[int, float] = {}  # joint that has just broken loose -> its sense
        self.braked = [i for i in range(4) if scene.torques[0, i] > 0.0]

    def run(self) -> np.ndarray:
        """Tips (n, 2) at the times of comparison."""
        edges = [*self.scene.times[1:], self.scene.duration_s]
        t = 0.0
        for end, yields in zip(edges, self.scene.torques, strict=True):
            self.yields = yields
            self.take_up_pattern(t)
            while t < end:
                t = self.rest(t, end) if len(self.stuck) > 1 else self.move(t, end)
                self.take_up_pattern(t)
        return self.tips

    def answer(self, t, z, sign, stuck):
        """Eq. (5) with slipping brakes in the senses `sign` and the joints `stuck`."""
        torque = -np.asarray(sign) * self.yields
        return solve(self.bodies, z[:10], z[10:], self.scene.force(t), torque, stuck)

    def margin_at_rest(self, t) -> float:
        """How much more than the hand's force all brakes together hold, in the direction where it is least (N)."""
        g = np.array([self.row(i) for i in self.braked])
        normals = np.stack([-g[:, 1], g[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        hold = np.abs(normals @ g.T) @ self.yields[self.braked]
        return float(np.min(hold - np.abs(normals @ self.scene.force(t))))

    def row(self, i) -> np.ndarray:
        """Rate of joint i per unit of tip velocity (2,)."""
        return np.array([self.bodies.rates[i] @ rates(self.bodies, self.z[:10], axis) for axis in np.eye(2)])

    def take_up_pattern(self, t) -> None:
        """Which brakes stick and which way the others slip from here on."""
        omega = self.bodies.rates @ self.z[10:]
        slow = [i for i in self.braked if abs(omega[i]) < STOPPED]
        if len(slow) > 1:
            self.z[10:] = 0.0
            slow = list(self.braked)
            if self.margin_at_rest(t) >= 0.0:
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
                abs(found.torque[i]) <= self.yields[i] for i in stuck
            ):
                self.sign, self.stuck = sign, stuck
                break
        else:
            raise ArithmeticError(f"bench reference: no pattern at t = {t:g} s")
        if self.stuck:
            self.stop(self.stuck[0])

    def stop(self, i) -> None:
        """Joint i is exactly at rest, and not only to the dense output's error."""
        g, v = self.row(i), self.z[10 + HANDLE :]
        self.z[10:] = rates(self.bodies, self.z[:10], v - g * (g @ v) / (g @ g))

    def rest(self, t, end) -> float:
        """The tip rests until the hand is stronger than the brakes, or to the end."""
        while t < end:
            until = min(t + LOOK_S, end)
            if self.margin_at_rest(until) < 0.0:
                until = min(brentq(self.margin_at_rest, t, until, xtol=1e-15) + LEAVE_S, end)
                self.keep(t, until, lambda _: self.z)
                return until
            self.keep(t, until, lambda _: self.z)
            t = until
        return t

    def move(self, t, end) -> float:
        """Smooth motion up to the next event or the end."""

        def slope(time, z):
            return np.append(z[10:], self.answer(time, z, self.sign, self.stuck).acceleration)

        slipping = [i for i in self.braked if self.sign[i] != 0.0]
        events = [partial(self.slip_left, i) for i in slipping] + [partial(self.hold_left, i) for i in self.stuck]
        for event in events:
            event.terminal, event.direction = True, -1.0
        run = solve_ivp(slope, (t, end), self.z, "DOP853", rtol=RTOL, atol=ATOL, events=events, dense_output=True)
        until = run.t[-1]
        self.keep(t, until, run.sol)
        self.z = run.y[:, -1].copy()
        if self.stuck and len(run.t_events[-1]):
            (j,) = self.stuck
            self.loose[j] = -float(np.sign(self.answer(until, self.z, self.sign, self.stuck).torque[j]))
        for i, times in zip(slipping, run.t_events, strict=False):
            if len(times):
                self.stop(i)
        return until

    def slip_left(self, i, t, z) -> float:
        """The rate of slipping joint i in its sense; zero: it stops."""
        return self.sign[i] * (self.bodies.rates[i] @ z[10:])

    def hold_left(self, i, t, z) -> float:
        """What stuck joint i could hold besides; zero: it breaks loose."""
        return self.yields[i] - abs(self.answer(t, z, self.sign, self.stuck).torque[i])

    def keep(self, t, until, solution) -> None:
        """The tips at the times of comparison in (t, until]."""
        for k in np.flatnonzero((self.times > t + 1e-12) & (self.times <= until + 1e-12)):
            self.tips[k] = solution(min(self.times[k], until))[HANDLE:10]


def reference_tips(scene: BenchScene) -> np.ndarray:
    """Tips (n, 2), m, of an ideal scene at the times of comparison, t = 0 first."""
    return _Reference(scene).run()
