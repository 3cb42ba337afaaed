"""The guard of obstacles: all brakes lock when the tip could otherwise not be stopped in front of one.

How far the tip can still come is bounded in one dimension. On a way of length s its kinetic energy grows by at most
`push` s (the largest push that is allowed for) and falls by what the brakes take: in a direction u (unit vector) brake
i takes its yield times |g_i . u| for every metre, once its joint has been turned through its play. The yields rise with
their lag, Eqs. (1) and (4), at the joint rates of the highest speed that the energy and the tip's least mass allow: the
lag falls with the rate, but less than in proportion, so that the highest speed needs the longest way. Of all directions
the one in which the brakes take least counts.

The bound is of the pose at hand: mass and rows g are taken as constant on the way, which `MARGIN` is to cover. It does
not hold for a hand that pushes harder, nor for one that turns the joints back and forth inside their play.
"""

import math
from typing import NamedTuple

import numpy as np

from core.brake import inverse, time_constant, torque_gain
from core.control.algorithm import lock
from core.kernel import kernel
from core.obstacles import nearest_obstacle
from core.simulator.state import new_record

DIRECTIONS = 12  # over half a turn
RATES = 32  # of the table of lags, up to omega_0, from which on the lag is constant
STEP_S = 0.002
LONGEST_S = 0.3  # what has not come to rest after it counts as never
#: Share by which the energy is counted larger, for mass and rows that change on the way (a few centimetres), and for
#: the directions between those that are looked at.
MARGIN = 0.15
STANDS_M_S = 0.001  # slower towards the obstacle counts as standing

#: What the guard remembers and works with.
GUARD = np.dtype(
    [
        ("push", "f8"),  # N, the largest push that is allowed for
        ("keep_m", "f8"),  # stop so far before the edge
        ("let_go_force", "f8"),  # N, a pull away from the obstacle that releases; infinite: none does
        ("locked", "i8"),
        ("full", "f8", (4,)),  # N m, yields at full current
        ("growth", "f8", (4, RATES + 1)),  # share of the missing yield that a step brings, by joint rate
        ("per_rate", "f8", (4,)),  # s/rad: places in that table
        ("lever", "f8", (DIRECTIONS, 4)),  # 1/m, |g_i . u|
        ("torque", "f8", (DIRECTIONS, 4)),  # N m, yields on the way in each direction
    ]
)


class GuardNumbers(NamedTuple):
    """What a protocol says of the guard."""

    push_N: float
    keep_m: float
    let_go_force_N: float


def new_guard(numbers: GuardNumbers, brakes: np.recarray) -> np.recarray:
    """A guard at the start of a trial; brakes: as the kernels read them."""
    guard = new_record(GUARD)
    guard["push"], guard["keep_m"], guard["let_go_force"] = numbers
    learn_lags(guard[0], brakes[0])
    return guard


@kernel
def learn_lags(guard, brakes):
    """Fill the tables of full yields and of their growth."""
    for i in range(4):
        if brakes.present[i] != 0.0:
            most = brakes.current_max[i]
            guard.full[i] = torque_gain(brakes, i, most)
            guard.per_rate[i] = RATES / brakes.omega_0[i] if brakes.omega_0[i] > 0.0 else math.inf
            for n in range(RATES + 1):
                lag = time_constant(brakes, i, most, brakes.omega_0[i] * n / RATES, True)
                guard.growth[i, n] = 1.0 - math.exp(-STEP_S * inverse(lag))


@kernel
def least_mass(mass):
    """The smaller eigenvalue (kg) of the tip's mass matrix (3,): xx, xy, yy."""
    middle, half = 0.5 * (mass[0] + mass[2]), 0.5 * (mass[0] - mass[2])
    return middle - math.sqrt(half * half + mass[1] * mass[1])


@kernel
def stopping_distance(guard, brakes, g, mass, vx, vy, off, torque, most):
    """How far (m) the tip can come from now on with all brakes locked, an upper bound; infinite: further than `most`.

    g (4, 2), mass (3,) kg, torque (4,): yields now, N m; off: the brakes have just had no current.
    """
    for k in range(DIRECTIONS):
        angle = math.pi * k / DIRECTIONS
        u_x, u_y = math.cos(angle), math.sin(angle)
        for i in range(4):
            guard.lever[k, i] = abs(g[i, 0] * u_x + g[i, 1] * u_y)
            guard.torque[k, i] = brakes.k[i, 1] if off else torque[i]
    lightest = least_mass(mass)
    energy = 0.5 * (mass[0] * vx * vx + 2.0 * mass[1] * vx * vy + mass[2] * vy * vy) * (1.0 + MARGIN)
    way = 0.0
    for _ in range(round(LONGEST_S / STEP_S)):
        if way > most:
            break
        speed = math.sqrt(2.0 * energy / lightest)
        slowing = (least_hold(guard, brakes, way, speed) - guard.push) / lightest
        if speed <= slowing * STEP_S:  # at rest within the step
            way += 0.5 * speed * speed / slowing if speed > 0.0 else 0.0
            return way if way <= most else math.inf
        step = speed * STEP_S - 0.5 * min(slowing, 0.0) * STEP_S * STEP_S  # no shorter than it can be
        energy = max(energy - slowing * lightest * step, 0.0)
        way += step
    return math.inf


@kernel
def least_hold(guard, brakes, way, speed):
    """What the brakes take (J/m) in the direction in which they take least, `way` (m) after the joints' last turn; then
    a step at this speed (m/s) for the yields.
    """
    least = math.inf
    for k in range(DIRECTIONS):
        held = 0.0
        for i in range(4):
            if brakes.present[i] == 0.0:
                continue
            lever = guard.lever[k, i]
            if way * lever >= brakes.play[i]:
                held += guard.torque[k, i] * lever
            place = min(speed * lever * guard.per_rate[i], float(RATES))
            guard.torque[k, i] += guard.growth[i, int(place)] * (guard.full[i] - guard.torque[k, i])
        least = min(least, held)
    return least


@kernel
def keep_out(guard, edges, brakes, state, current):
    """Lock all brakes where the tip could not be stopped in front of an obstacle; whether they are.

    They stay locked until the tip could be stopped even with brakes that have no torque yet (so a lock never ends in
    the next lock), or the hand pulls away. state: of the device; current (4,) A.
    """
    vx, vy = state.tip[2], state.tip[3]
    near = nearest_obstacle(edges, state.tip[0], state.tip[1])
    room = near.distance - guard.keep_m
    pull = state.hand_force[0] * near.n_x + state.hand_force[1] * near.n_y
    if pull > guard.let_go_force and vx * near.n_x + vy * near.n_y >= -STANDS_M_S:
        guard.locked = 0
        return False
    off = guard.locked != 0
    way = stopping_distance(guard, brakes, state.g, state.mass, vx, vy, off, state.torque_yield, room)
    guard.locked = 1 if way >= room else 0
    if guard.locked != 0:
        lock(brakes, current)
    return guard.locked != 0
