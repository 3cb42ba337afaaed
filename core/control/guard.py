"""The guard of obstacles: all brakes lock when the tip could otherwise not be stopped in front of one.

How far the tip can still come is bounded in one dimension. On a way of length s its kinetic energy grows by at most
`push` s (the largest push that is allowed for) and falls by what the brakes take: in a direction u (unit vector) brake
i takes its yield times |g_i . u| for every metre, once its joint has been turned through its play. The yields rise with
their lag, Eqs. (1) and (4), at the joint rates of the highest speed that the energy and the tip's least mass allow: the
lag falls with the rate, but less than in proportion, so that the highest speed needs the longest way. Of all directions
the one in which the brakes take least counts.

Sensed motion is old: the tip by the delay of its samples, the velocity by the mean age of those in its filter besides.
The tip may have been pushed on since then, against no brake: that way and that speed come first.

The bound is of the pose at hand: mass and rows g are taken as constant on the way, which `MARGIN` is to cover. It does
not hold for a hand that pushes harder, nor for one that turns the joints back and forth inside their play.
"""

import math
from typing import Annotated

import numpy as np

from core.brake import inverse, time_constant, torque_gain
from core.control.algorithm import lock
from core.control.velocity_field import LOCKED
from core.files import NotNegative, Positive, Table, choice
from core.kernel import kernel
from core.mechanism import Brakes, Mechanism
from core.obstacles import MOST_EDGES, ObstacleFile, build_obstacles
from core.simulator.state import new_record, pack_brakes
from core.workspace import brake_rows, held_in_any_direction

DIRECTIONS = 8  # over half a turn
RATES = 32  # of the table of lags, up to omega_0, from which on the lag is constant
STEP_S = 0.002
LONGEST_S = 0.3  # what has not come to rest after it counts as never
#: Share by which the energy is counted larger, for mass and rows that change on the way (a few centimetres), and for
#: the directions between those that are looked at.
MARGIN = 0.15
STANDS_M_S = 0.001  # slower towards the obstacle counts as standing
RELEASE_SHARE = 0.8

#: A trial's obstacles, and what they do to its control: guide (`velocity_field.field_round`) and guard, work space too.
AROUND = np.dtype(
    [
        ("count", "i8"),  # of edges
        ("edges", "f8", (MOST_EDGES, 7)),  # as in core.obstacles
        ("guide", "i8"),  # 1: near an obstacle its field counts in place of the path's
        ("guard", "i8"),
        ("push", "f8"),  # N, the largest push that is allowed for
        ("keep", "f8"),  # m: stop so far before the edge
        ("tip_age", "f8"),  # s, of the position that the controller sees
        ("velocity_age", "f8"),  # s, likewise
        ("let_go_force", "f8"),  # N, a pull away from the obstacle that releases; infinite: none does
        ("full", "f8", (4,)),  # N m, yields at full current
        ("growth", "f8", (4, RATES + 1)),  # share of the missing yield that a step brings, by joint rate
        ("per_rate", "f8", (4,)),  # s/rad: places in that table
        ("lever", "f8", (DIRECTIONS, 4)),  # 1/m, |g_i . u|
        ("torque", "f8", (DIRECTIONS, 4)),  # N m, yields on the way in each direction
    ]
)


class Guard(Table, frozen=True):
    """`[guard]` of a protocol. All assumed."""

    push_N: Positive = 20.0  # the largest push of a hand that it allows for
    keep_m: NotNegative = 0.0  # it stops the tip so far before the edge
    release: Annotated[str, choice("pull", "clear")] = "pull"  # also by a pull, or only once the tip can be stopped
    pull_N: Positive = 2.0  # a pull away from the obstacle that releases


class Around(Table, frozen=True):
    """What a protocol says of the obstacles of its trials."""

    obstacles: tuple[ObstacleFile, ...] = ()
    guide: bool = True
    guard: Guard | None = None


NOTHING = Around()


def make_around(how: Around, brakes: Brakes, age: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """What the kernels read of a trial's obstacles; brakes: of its device; age: of the sensed tip and velocity, s."""
    edges, guard = build_obstacles(how.obstacles), how.guard
    around = new_record(AROUND, count=len(edges), guide=int(how.guide))
    around["edges"][0, : len(edges)] = edges
    if guard is not None:
        around["guard"], around["push"], around["keep"] = 1, guard.push_N, guard.keep_m
        around["tip_age"], around["velocity_age"] = age
        around["let_go_force"] = guard.pull_N if guard.release == "pull" else math.inf
        learn_lags(around[0], pack_brakes(brakes, backlash=False)[0])
    return around


@kernel
def learn_lags(around, brakes):
    """Fill the tables of full yields and of their growth."""
    for i in range(4):
        if brakes.present[i] != 0.0:
            most = brakes.current_max[i]
            around.full[i] = torque_gain(brakes, i, most)
            around.per_rate[i] = RATES / brakes.omega_0[i] if brakes.omega_0[i] > 0.0 else math.inf
            for n in range(RATES + 1):
                lag = time_constant(brakes, i, most, brakes.omega_0[i] * n / RATES, True)
                around.growth[i, n] = 1.0 - math.exp(-STEP_S * inverse(lag))


def least_held(mechanism: Mechanism, brakes: Brakes, places: np.ndarray) -> float:
    """What a full lock holds (N) in whatever direction, at the worst of places (n, 2), m."""
    present = brakes.present > 0.0
    full = make_around(Around(guard=Guard()), brakes)["full"][0]
    return float(held_in_any_direction(brake_rows(mechanism, *places.T)[present], full[present]).min())


@kernel
def least_mass(mass):
    """The smaller eigenvalue (kg) of the tip's mass matrix (3,): xx, xy, yy."""
    middle, half = 0.5 * (mass[0] + mass[2]), 0.5 * (mass[0] - mass[2])
    return middle - math.sqrt(half * half + mass[1] * mass[1])


@kernel
def stopping_distance(around, brakes, g, mass, vx, vy, most):
    """How far (m) the tip can come from now on with all brakes locked, an upper bound; infinite: further than `most`.

    g (4, 2), mass (3,) kg. The brakes are taken to have had no current until now: so the bound needs no more than the
    tip, and what a brake holds already only shortens the way.
    """
    for k in range(DIRECTIONS):
        angle = math.pi * k / DIRECTIONS
        u_x, u_y = math.cos(angle), math.sin(angle)
        for i in range(4):
            around.lever[k, i] = abs(g[i, 0] * u_x + g[i, 1] * u_y)
            around.torque[k, i] = brakes.k[i, 1]
    lightest = least_mass(mass)
    energy = 0.5 * (mass[0] * vx * vx + 2.0 * mass[1] * vx * vy + mass[2] * vy * vy) * (1.0 + MARGIN)
    way, before = 0.0, 0.0
    if around.velocity_age > 0.0:
        speed = math.sqrt(2.0 * energy / lightest) + around.push / lightest * around.velocity_age
        energy, before = 0.5 * lightest * speed * speed, speed * around.tip_age
        most -= before
    for _ in range(round(LONGEST_S / STEP_S)):
        if way > most:
            break
        speed = math.sqrt(2.0 * energy / lightest)
        slowing = (least_hold(around, brakes, way, speed) - around.push) / lightest
        if speed <= slowing * STEP_S:  # at rest within the step
            way += 0.5 * speed * speed / slowing if speed > 0.0 else 0.0
            return before + way if way <= most else math.inf
        step = speed * STEP_S - 0.5 * min(slowing, 0.0) * STEP_S * STEP_S  # no shorter than it can be
        energy = max(energy - slowing * lightest * step, 0.0)
        way += step
    return math.inf


@kernel
def least_hold(around, brakes, way, speed):
    """What the brakes take (J/m) in the direction in which they take least, `way` (m) after the joints' last turn; then
    a step at this speed (m/s) for the yields.
    """
    least = math.inf
    for k in range(DIRECTIONS):
        held = 0.0
        for i in range(4):
            if brakes.present[i] == 0.0:
                continue
            lever = around.lever[k, i]
            if way * lever >= brakes.play[i]:
                held += around.torque[k, i] * lever
            place = min(speed * lever * around.per_rate[i], float(RATES))
            around.torque[k, i] += around.growth[i, int(place)] * (around.full[i] - around.torque[k, i])
        least = min(least, held)
    return least


@kernel
def keep_out(around, near, brakes, memory, vx, vy, fx, fy, g, mass, current):
    """Lock all brakes where the tip could not be stopped in front of the nearest obstacle; whether they are locked.

    They stay locked until the tip could be stopped in `RELEASE_SHARE` of the room (so a lock does not end in the next
    one), or the hand pulls away. Velocity m/s, hand force N; current (4,) A.
    """
    room = near.distance - around.keep
    pull = fx * near.n_x + fy * near.n_y
    if pull > around.let_go_force and vx * near.n_x + vy * near.n_y >= -STANDS_M_S:
        memory[LOCKED] = 0.0
        return False
    share = RELEASE_SHARE if memory[LOCKED] != 0.0 else 1.0
    stops = stopping_distance(around, brakes, g, mass, vx, vy, share * room) < share * room
    memory[LOCKED] = 0.0 if stops else 1.0
    if not stops:
        lock(brakes, current)
    return not stops
