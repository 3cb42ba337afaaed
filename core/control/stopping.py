"""Whether the tip can be stopped in front of an obstacle, whatever the hand does from now on.

A bound by energy, for every history of a hand force of at most P (`push`), with all brakes locked from now on.

On a way of length s the hand puts in at most P s. Brake i takes D_i(theta_i) of it, where theta_i is the angle through
which its joint has turned to and fro: nothing but its drag for the first turn through its play, then its yield, which
has risen with its lag, Eqs. (1) and (4). In an angle theta the yield closes the share exp(-theta / l) of what it lacks,
with l = a(omega) omega at the highest rate on the way: slower joints need less angle for it. So the kinetic energy is

    E(s) <= E_0 + P s - sum_i D_i(theta_i),

D_i convex. The tip gets no further than s where that is negative for all ways of length s. A way is a mixture of
directions u, theta_i = sum of ds |g_i . u|, and the worst mixture is a convex problem in four unknowns. Every set of
slopes c_i bounds it from below (its dual): sum D_i >= sum_i c_i theta_i - K_i(c_i), K_i the conjugate of D_i, so that

    (E_0 + sum_i K_i(c_i)) / min over u of (sum_i c_i |g_i . u| - P) / max(u . n, ..)

is as far as the tip can get in the direction n (with u . n = 1, in any direction). The least over u is where u is at
right angles to a row g_k, for between those directions the expression is concave. The method of Frank and Wolfe finds
the slopes; where it finds none that prove a bound, the tip counts as one that cannot be stopped.

E_0 holds whatever the mass matrix becomes on the way. The rows are those of all places within the circle that the tip
cannot leave (`core.control.levers`): `safe_radius` finds that circle, `furthest` the way in it.
"""

import math

import numpy as np

from core.brake import inverse, time_constant, torque_gain
from core.control.levers import LEVERS, ROWS, make_levers, set_direction, take_places
from core.kernels import kernel
from core.mechanism import Brakes, Mechanism
from core.records import new_record
from core.simulator.state import pack_brakes
from core.tick_log import TICK_S

RATES = 64  # places in the table of lags, up to omega_0; beyond it the lag is constant
ROUNDS = 24  # of the search for slopes
GUESSES = 5  # of a radius that the tip cannot leave
LEAST_RADIUS_M, MOST_RADIUS_M = 1e-3, 0.4
REFINED = 3  # times the bound of the energy on the way is made better
RISE = 0.3  # share of the play over which the slope of D_i rises to the yield: so D_i is smooth, and no larger
TINY = 1e-12

STOPPING = np.dtype(
    [
        ("levers", LEVERS),
        ("push", "f8"),  # N
        # constants of the brakes
        ("full", "f8", (4,)),  # N m, yields at full current
        ("drag", "f8", (4,)),  # N m, inside the play, and without current
        ("width", "f8", (4,)),  # rad, of the play
        ("per_rate", "f8", (4,)),  # s/rad: places in the table of lags
        ("angle", "f8", (4, RATES + 1)),  # rad: l at the highest rate, so far
        ("fast", "f8", (4,)),  # s, the lag from omega_0 on
        ("rising", "f8", (4,)),  # share of the missing yield that a tick brings at least, at any rate
        ("falling", "f8", (4,)),  # share of the yield above the drag that a tick takes at most
        # what is assumed of the brakes
        ("held", "f8", (4,)),  # N m, what each holds at least already
        ("play", "f8", (4,)),  # rad, through which its joint may turn against its drag alone
        # of the largest energy on the way
        ("lag", "f8", (4,)),  # rad, l
        ("free", "f8", (4,)),  # rad, the angle through which only the drag is certain
        ("edge", "f8", (4,)),  # N m, the yield soon after it
        # of the search for slopes
        ("turned", "f8", (4,)),  # rad, theta
        ("slope", "f8", (4,)),  # N m, c
        ("left", "f8", (ROWS,)),  # N, what each direction costs the hand for progress
    ]
)


def make_stopping(mechanism: Mechanism, brakes: Brakes, push: float) -> np.ndarray:
    """A device and the largest push (N) as the kernels here read them; one record."""
    record = new_record(STOPPING, push=push, lag=TINY)
    record["levers"][0] = make_levers(mechanism, brakes)[0]
    fill_brakes(record[0], pack_brakes(brakes, backlash=True)[0])
    assume_brakes(record[0], record["drag"][0], 0.0)
    return record


@kernel
def fill_brakes(stopping, brakes):
    """Fill the constants of the brakes: yields, drag, play, lags."""
    for i in range(4):
        if brakes.present[i] == 0.0:
            continue
        most = brakes.current_max[i]
        full, drag = torque_gain(brakes, i, most), brakes.k[i, 1]
        stopping.full[i], stopping.drag[i] = full, drag
        stopping.width[i] = brakes.play[i]
        stopping.fast[i] = max(brakes.rise[i, 0], 0.0)
        stopping.per_rate[i] = RATES / brakes.omega_0[i] if brakes.omega_0[i] > 0.0 else math.inf
        largest, slowest, quickest = 0.0, stopping.fast[i], max(brakes.fall[i, 0], 0.0)
        for n in range(RATES + 1):
            rate = brakes.omega_0[i] * n / RATES
            lag = time_constant(brakes, i, most, rate, True)
            largest, slowest = max(largest, lag * rate), max(slowest, lag)
            quickest = min(
                quickest, time_constant(brakes, i, 0.0, rate, False), time_constant(brakes, i, most, rate, False)
            )
            stopping.angle[i, n] = largest
        stopping.rising[i] = 1.0 - math.exp(-TICK_S * inverse(slowest))
        stopping.falling[i] = 1.0 - math.exp(-TICK_S * inverse(quickest))


@kernel
def assume_brakes(stopping, held, turns):
    """Assume that each brake holds at least held (4,), N m, and its joint turns back in its play `turns` times at most.

    The lags stay as they are: what holds for more energy holds for less.
    """
    for i in range(4):
        stopping.held[i] = held[i]
        stopping.play[i] = (1.0 + turns) * stopping.width[i]
        set_edge(stopping, i)


@kernel
def slope_and_work(stopping, i, theta):
    """Slope c (N m) and value D (J) of the least work of brake i while its joint turns through theta (rad)."""
    drag, full, lag, free = stopping.drag[i], stopping.full[i], stopping.lag[i], stopping.free[i]
    if theta <= free:
        return drag, drag * theta
    risen, edge = free * (1.0 + RISE), stopping.edge[i]
    if theta < risen:
        past = theta - free
        steep = (edge - drag) / (risen - free)
        return drag + steep * past, drag * theta + 0.5 * steep * past * past
    lacks = full - stopping.held[i]
    at_risen = drag * risen + 0.5 * (edge - drag) * (risen - free)
    remaining = lacks * math.exp(-theta / lag)
    return full - remaining, at_risen + full * (theta - risen) - lag * (full - edge - remaining)


@kernel
def set_lags(stopping, energy):
    """Set the angle of each brake's lag for the highest rate that this kinetic energy (J) allows, and its edge."""
    for i in range(4):
        rate = math.sqrt(2.0 * energy * stopping.levers.swift[i])
        place = rate * stopping.per_rate[i]
        if place < RATES:
            lag = stopping.angle[i, int(place) + 1]
        else:
            lag = max(stopping.angle[i, RATES], stopping.fast[i] * rate)
        stopping.lag[i] = max(lag, TINY)
        set_edge(stopping, i)


@kernel
def set_edge(stopping, i):
    """Set the angle through which only the drag of brake i is certain, and its yield soon after it."""
    drag, full, lag, free = stopping.drag[i], stopping.full[i], stopping.lag[i], stopping.play[i]
    lacks, least = full - stopping.held[i], full - drag
    if least <= 0.0:
        free = math.inf
    elif lacks > least:  # it holds less than its drag so far
        free = max(free, lag * math.log(lacks / least))
    stopping.free[i] = free
    stopping.edge[i] = max(full - lacks * math.exp(-free * (1.0 + RISE) / lag), drag)


@kernel
def set_largest_lags(stopping, energy, radius):
    """Set the lags for the largest kinetic energy (J) on any way of at most `radius` (m).

    The energy that the lags at one bound let through is a smaller bound; this is repeated a few times.
    """
    most = energy + stopping.push * radius
    set_lags(stopping, most)
    for _ in range(REFINED):
        found = energy + largest_gain(stopping, radius)
        if not found < 0.95 * most:
            break
        most = found
        set_lags(stopping, most)


@kernel
def largest_gain(stopping, radius):
    """The most energy (J) that a hand can add, less what the brakes take, on a way of at most `radius` (m).

    An upper bound, by the method of `furthest`.
    """
    begin_search(stopping, stopping.drag)
    best, lost = math.inf, 0.0
    for n in range(ROUNDS // 2):
        weakest, least = weakest_direction(stopping)
        best = min(best, lost - radius * min(least, 0.0))
        _, lost = mix_in(stopping, weakest, radius if least < 0.0 else 0.0, 2.0 / (n + 2.0))
    return best


@kernel
def begin_search(stopping, slopes):
    """Begin a search with an empty mixture and slopes (4,), N m."""
    for i in range(4):
        stopping.turned[i], stopping.slope[i] = 0.0, slopes[i]


@kernel
def weakest_direction(stopping):
    """The row of the direction in which progress costs the hand least, by the present slopes; that cost (N)."""
    levers, left, push = stopping.levers, stopping.left, stopping.push
    lever = levers.lever
    a, e, b, c = stopping.slope[0], stopping.slope[1], stopping.slope[2], stopping.slope[3]
    for k in range(levers.rows):
        held = a * lever[0, k] + e * lever[1, k] + b * lever[2, k] + c * lever[3, k]
        left[k] = (held - push) * levers.per_way[k]
    weakest, least = 0, math.inf
    for k in range(levers.rows):
        if left[k] < least:
            weakest, least = k, left[k]
    return weakest, least


@kernel
def mix_in(stopping, row, length, share):
    """Add a way of this length (m) in a row's direction to the mixture, with this share, and set the slopes there.

    Returns sum of D_i and sum of K_i (J).
    """
    turned, slope = stopping.turned, stopping.slope
    taken = lost = 0.0
    for i in range(4):
        turned[i] += share * (length * stopping.levers.lever[i, row] - turned[i])
        slope[i], work = slope_and_work(stopping, i, turned[i])
        taken += work
        lost += slope[i] * turned[i] - work
    return taken, lost


@kernel
def furthest(stopping, energy, way):
    """An upper bound on how far (m), as `set_direction` counts, any hand brings the tip from this kinetic energy (J).

    Refined until it is less than `way` (m), by the method of Frank and Wolfe: the direction that is weakest by the
    slopes of a mixture joins that mixture.
    """
    begin_search(stopping, stopping.full)
    weakest, least = weakest_direction(stopping)
    if least <= 0.0:
        return math.inf  # more than a full lock holds
    best, length = math.inf, 0.0
    for n in range(ROUNDS):
        share = 2.0 / (n + 2.0)
        further = way * stopping.levers.per_way[weakest]
        length += share * (further - length)
        taken, lost = mix_in(stopping, weakest, further, share)
        weakest, least = weakest_direction(stopping)
        if least > 0.0:
            best = min(best, (energy + lost) / least)
        if best < way or (n > 4 and taken - stopping.push * length <= energy):
            break  # by the second condition the bound cannot become less than this mixture's way
    return best


@kernel
def largest_loss(stopping):
    """Sum of K_i (J) for slopes that are the full yields: the most that play and lag take from the brakes."""
    lost = 0.0
    for i in range(4):
        lost += (stopping.full[i] - stopping.drag[i]) * stopping.play[i]
        lost += (stopping.full[i] - stopping.held[i]) * stopping.lag[i]
    return lost


@kernel
def safe_radius(stopping, x, y, energy):
    """A radius (m) that the tip cannot leave from this kinetic energy (J) on; infinite: none was found.

    Levers and lags are then those of the places within it. It begins with a rough guess.
    """
    take_places(stopping.levers, x, y, 0.0)
    set_direction(stopping.levers, 0.0, 0.0)
    begin_search(stopping, stopping.full)
    _, least = weakest_direction(stopping)
    if least <= 0.0:
        return math.inf
    lost = 0.0
    for _ in range(2):
        set_lags(stopping, energy + 0.25 * lost)
        lost = largest_loss(stopping)
    radius = max((energy + lost) / least, LEAST_RADIUS_M)
    for _ in range(GUESSES):
        if radius > MOST_RADIUS_M:
            break
        take_places(stopping.levers, x, y, radius)
        set_direction(stopping.levers, 0.0, 0.0)
        set_lags(stopping, energy)
        reach = furthest(stopping, energy, radius)
        if reach < radius:  # else it is not certain even if the hand adds no energy
            set_largest_lags(stopping, energy, radius)
            reach = furthest(stopping, energy, radius)
            if reach < radius:
                return radius
        radius = min(max(1.15 * reach, 1.2 * radius), 1.7 * radius)
    return math.inf
