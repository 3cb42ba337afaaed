"""The hand as the simulator feels it: a prescribed force, or a spring-damper to a target, plus an arm's mass.

A spring-damper is evaluated inside every stage of the integrator and only its target is held over a tick: a force that
is held over a tick would add energy. The force acts on the handle (N), positions in m.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from core.kernels import kernel
from core.records import new_record
from core.simulator.solver_numbers import EDGE_S, FORCE_MISSED

GRIP = np.dtype(
    [
        ("cursor", "i8"),  # row of the force table last used
        ("waves", "i8"),  # 0: `wave` is not evaluated
        ("wave", "f8", (2, 3)),  # per axis: amplitude N, rate rad/s, phase rad; adds amplitude sin(rate t + phase)
        ("spring", "i8"),  # 0: nothing below is evaluated
        ("stiffness", "f8", (3,)),  # N/m: xx, xy, yy
        ("damping", "f8", (3,)),  # N s/m: xx, xy, yy
        ("target", "f8", (4,)),  # m, m/s: where the spring pulls to, and its velocity
        ("held", "f8", (2,)),  # N, constant over a tick (noise and tremor of a simulated operator)
        ("force_max", "f8"),  # N, cap of the spring-damper
        ("mass", "f8"),  # kg, arm mass that moves rigidly with the handle, on the hand's side of the force sensor
    ]
)


class Hand(NamedTuple):
    """Hand force = table(t) + wave(t) + clip(stiffness (target - tip) + damping (target velocity - v)) + held."""

    times: np.ndarray  # (n,) s, strictly rising; one row: a constant force
    forces: np.ndarray  # (n, 2) N, linear in between, held beyond the ends
    grips: np.ndarray  # one GRIP record


def new_hand(times: np.ndarray | None = None, forces: np.ndarray | None = None, **grip: Any) -> Hand:
    """A hand that exerts a force given over time, (n,) s and (n, 2) N; none at all without arguments.

    grip: fields of GRIP.
    """
    return Hand(
        np.zeros(1) if times is None else np.ascontiguousarray(times, dtype=float),
        np.zeros((1, 2)) if forces is None else np.ascontiguousarray(forces, dtype=float),
        new_record(GRIP, **{"force_max": math.inf} | grip),
    )


def wave_hand(wave: np.ndarray) -> Hand:
    """A hand that exerts a sine on each axis; wave (2, 3): amplitude N, rate rad/s, phase rad."""
    return new_hand(wave=wave, waves=1)


def spring_hand(
    stiffness: tuple[float, float, float],
    damping: tuple[float, float, float],
    force_max: float = math.inf,
    mass: float = 0.0,
    target: tuple[float, float] = (0.0, 0.0),
) -> Hand:
    """A hand on a spring-damper, stiffness and damping xx, xy, yy in N/m and N s/m, force cap in N, arm mass in kg."""
    at = (*target, 0.0, 0.0)
    return new_hand(spring=1, stiffness=stiffness, damping=damping, force_max=force_max, mass=mass, target=at)


@kernel
def hand_force(hand, t, x, y, vx, vy):
    """Force of the hand (arm side) at time t, s, for a tip state; (fx, fy) in N."""
    px, py = prescribed_force(hand, t)
    sx, sy = grip_force(hand.grips[0], x, y, vx, vy)
    return px + sx, py + sy


@kernel
def prescribed_force(hand, t):
    """The part of the hand force that depends on time alone, (fx, fy) in N."""
    grip = hand.grips[0]
    if hand.times.shape[0] == 1:
        fx, fy = hand.forces[0, 0], hand.forces[0, 1]
    else:
        fx, fy = table_force(hand, knot_before(hand, t), t)
    if grip.waves == 1:
        fx += grip.wave[0, 0] * math.sin(grip.wave[0, 1] * t + grip.wave[0, 2])
        fy += grip.wave[1, 0] * math.sin(grip.wave[1, 1] * t + grip.wave[1, 2])
    return fx, fy


@kernel
def knot_before(hand, t):
    """Row of the force table after which time t lies; the table's cursor goes there."""
    i = hand.grips[0].cursor
    while i < hand.times.shape[0] - 2 and hand.times[i + 1] < t:
        i += 1
    while i > 0 and hand.times[i] > t:
        i -= 1
    hand.grips[0].cursor = i
    return i


@kernel
def table_force(hand, i, t):
    """Force of the table (fx, fy), N, at time t between its rows i and i + 1; held beyond them."""
    share = (t - hand.times[i]) / (hand.times[i + 1] - hand.times[i])
    share = min(max(share, 0.0), 1.0)
    fx = hand.forces[i, 0] + share * (hand.forces[i + 1, 0] - hand.forces[i, 0])
    fy = hand.forces[i, 1] + share * (hand.forces[i + 1, 1] - hand.forces[i, 1])
    return fx, fy


@kernel
def split_at_knots(hand, t, end):
    """The end (s) of a step from t that sees the course of the force table: `end`, or earlier.

    A step evaluates the force at its start, middle and end: it sees a parabola. Where the table leaves that by more
    than `FORCE_MISSED` allows, at a knot or halfway between two, the step ends at the knot next to the worst place.
    """
    n = hand.times.shape[0]
    if n == 1:
        return end
    first = knot_before(hand, t) + 1
    while first < n and hand.times[first] <= t + EDGE_S:
        first += 1
    while first < n and hand.times[first] < end - EDGE_S:
        until = worst_knot(hand, first, t, end)
        if until == end:
            break
        end = until
    return end


@kernel
def worst_knot(hand, first, t, end):
    """The knot between t and `end` (s) next to which the table is furthest off what a step sees; `end`: near enough.

    `first` is the first row inside.
    """
    times, n = hand.times, hand.times.shape[0]
    ax, ay = table_force(hand, first - 1, t)
    middle = 0.5 * (t + end)
    mx, my = table_force(hand, knot_before(hand, middle), middle)
    bx, by = table_force(hand, knot_before(hand, end), end)
    worst, until = FORCE_MISSED / (end - t), end
    k, before = first, t
    while before < end:
        after = times[k] if k < n and times[k] < end - EDGE_S else end
        for at in (0.5 * (before + after), after):
            s = (at - t) / (end - t)
            fx, fy = table_force(hand, min(k, n - 1) - 1, at)
            off_x = fx - ax - s * (4.0 * mx - 3.0 * ax - bx + 2.0 * s * (ax + bx - 2.0 * mx))
            off_y = fy - ay - s * (4.0 * my - 3.0 * ay - by + 2.0 * s * (ay + by - 2.0 * my))
            if abs(off_x) + abs(off_y) > worst:
                worst, until = abs(off_x) + abs(off_y), after if after < end else before
        k, before = k + 1, after
    return until


@kernel
def grip_force(grip, x, y, vx, vy):
    """The part of the hand force that depends on the tip: spring-damper and what it holds over a tick (N)."""
    if grip.spring == 0:
        return 0.0, 0.0
    sx, sy = spring_force(grip, x, y, vx, vy)
    scale = cap_scale(grip, sx, sy)
    return grip.held[0] + scale * sx, grip.held[1] + scale * sy


@kernel
def spring_force(grip, x, y, vx, vy):
    """The spring-damper's force before its cap, (fx, fy) in N."""
    k, d = grip.stiffness, grip.damping
    dx, dy = grip.target[0] - x, grip.target[1] - y
    dvx, dvy = grip.target[2] - vx, grip.target[3] - vy
    return k[0] * dx + k[1] * dy + d[0] * dvx + d[1] * dvy, k[1] * dx + k[2] * dy + d[1] * dvx + d[2] * dvy


@kernel
def cap_scale(grip, sx, sy):
    """Factor that brings the spring-damper's force (sx, sy) to its cap; 1 below it."""
    square = sx * sx + sy * sy
    if square > grip.force_max * grip.force_max:
        return grip.force_max / math.sqrt(square)
    return 1.0
