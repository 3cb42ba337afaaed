"""Which brakes stick and which way the others start to slip, solved exactly.

The brakes are set-valued: against motion of joint i in its + direction it holds up to cost_plus_i, against - motion up
to cost_minus_i (they differ inside the backlash; a hard stop is an infinite one). With a_free the acceleration without
the resting joints' torques, the motion is
    argmin over a of 1/2 (a - a_free)' M (a - a_free) + sum of cost_plus_i max(r_i, 0) + cost_minus_i max(-r_i, 0),
    r_i = g_i . a + gdot_i . v,
strictly convex in two unknowns. The same problem over velocities (costs times the step) is the implicit time step.

Two cases are all there is. At rest (v = 0) every r_i is g_i . a, the problem is homogeneous, and its minimiser lies on
one of at most fourteen rays (one joint held), inside one of the sectors between them (none held), or at 0 (all held):
each candidate is a closed formula and the lowest objective is the answer. Moving, only joints with parallel rows can
rest at once, and the problem is one soft threshold.

Joints here are all places of core/mechanism.py: A, E, B, C, then D and elbows that have a stop but no brake.
"""

import math
from typing import NamedTuple

import numpy as np

from core.kernels import inlined, kernel
from core.mechanism import PLACES

STILL = -2  # all held: the tip does not move
FREE = -1  # no joint held; 0 .. 4: that joint is held and the tip moves along its SDOF path


@kernel
def same_line(i, j, lines):
    """True where rows i and j are parallel at every tip (`lines` of the mechanism), and for a joint with itself."""
    return i == j or (lines >> (PLACES * i + j)) & 1 != 0


class Joints(NamedTuple):
    """The torques that the joints can hold, in the order of the places of core/mechanism.py."""

    g: np.ndarray  # (PLACES, 2) 1/m, rows
    active: np.ndarray  # (PLACES,) 1: it carries a brake or touches a stop
    cost_plus: np.ndarray  # (PLACES,) N m, what it holds against + motion
    cost_minus: np.ndarray  # (PLACES,) N m, against - motion
    lines: int  # of the mechanism


@kernel
def largest_excess(joints, fx, fy):
    """How far the force f pushes beyond what the joints hold, along the ray where that is most; at most 0: all hold.

    Along the ray t on which joint j rests: (f . t - sum of the costs of the other joints' rates) / |t|. With symmetric
    costs this is the facet test of the zonotope sum of [-y_i, y_i] g_i. -inf without any joint.
    """
    g, active, cost_plus, cost_minus, lines = joints
    largest = -math.inf
    for j in range(PLACES):
        if active[j] == 0:
            continue
        tx, ty = -g[j, 1], g[j, 0]
        ahead = fx * tx + fy * ty  # along the ray, and against it
        back = -ahead
        for i in range(PLACES):
            if active[i] != 0 and not same_line(i, j, lines):
                rate = g[i, 0] * tx + g[i, 1] * ty
                if rate > 0.0:
                    ahead -= cost_plus[i] * rate
                    back -= cost_minus[i] * rate
                elif rate < 0.0:
                    ahead += cost_minus[i] * rate
                    back += cost_plus[i] * rate
        largest = max(largest, max(ahead, back) / math.sqrt(tx * tx + ty * ty))
    return largest


@kernel
def solve_at_rest(joints, mass, force, sign):
    """The motion from rest under a force f = M a_free: returns (held, ax, ay) and fills sign (PLACES,) of each rate.

    mass (3,): xx, xy, yy, kg; force (2,), N. held is STILL, FREE, or the joint that stays stuck.
    With no active joint the answer is FREE. Exact but for rounding; no tolerance, no iteration.
    """
    g, active, cost_plus, cost_minus, lines = joints
    (mxx, mxy, myy), (fx, fy) = mass, force
    best, held, ax, ay = 0.0, STILL, 0.0, 0.0
    if -math.inf < largest_excess(joints, fx, fy) <= 0.0:
        for i in range(PLACES):
            sign[i] = 0.0
        return held, ax, ay
    any_active = False
    for j in range(PLACES):
        if active[j] == 0:
            continue
        any_active = True
        for side in (1.0, -1.0):
            tx, ty = -g[j, 1] * side, g[j, 0] * side
            px, py = -ty, tx
            excess = fx * tx + fy * ty  # what the force pushes along the ray beyond what the other joints hold
            rx, ry = fx, fy  # what it leaves in the sector just counter-clockwise of the ray
            possible = True
            for i in range(PLACES):
                if active[i] != 0:
                    rate = g[i, 0] * tx + g[i, 1] * ty
                    rests = same_line(i, j, lines) or rate == 0.0
                    if rests:  # just counter-clockwise of the ray it turns: there every rate has one sign
                        rate = g[i, 0] * px + g[i, 1] * py
                    resistance = cost_plus[i] if rate > 0.0 else -cost_minus[i]
                    if not rests:
                        excess -= resistance * rate
                    if math.isinf(resistance):
                        possible = False
                    else:
                        rx -= resistance * g[i, 0]
                        ry -= resistance * g[i, 1]
            if excess > 0.0:
                stiffness = mxx * tx * tx + 2.0 * mxy * tx * ty + myy * ty * ty
                objective = -0.5 * excess * excess / stiffness
                if objective < best:
                    best, held = objective, j
                    ax, ay = tx * excess / stiffness, ty * excess / stiffness
            if not possible:
                continue
            sx, sy = solve_mass(mxx, mxy, myy, rx, ry)
            objective = -0.5 * (sx * rx + sy * ry)
            if objective < best:
                inside = True
                for i in range(PLACES):
                    if active[i] != 0:
                        rate = g[i, 0] * tx + g[i, 1] * ty
                        if same_line(i, j, lines) or rate == 0.0:
                            rate = g[i, 0] * px + g[i, 1] * py
                        if rate * (g[i, 0] * sx + g[i, 1] * sy) < 0.0:
                            inside = False
                            break
                if inside:
                    best, held, ax, ay = objective, FREE, sx, sy
    if not any_active:
        held = FREE
        ax, ay = solve_mass(mxx, mxy, myy, fx, fy)
    for i in range(PLACES):
        rate = g[i, 0] * ax + g[i, 1] * ay
        sign[i] = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
        if held == STILL or (held >= 0 and same_line(i, held, lines)):
            sign[i] = 0.0
    return held, ax, ay


@inlined
def solve_mass(mxx, mxy, myy, fx, fy):
    """Acceleration a with M a = f."""
    scale = 1.0 / (mxx * myy - mxy * mxy)
    return (myy * fx - mxy * fy) * scale, (mxx * fy - mxy * fx) * scale


@kernel
def line_limits(g, active, cost_plus, cost_minus, lines, j):
    """What joint j and all joints on its line hold together, on joint j's own rate: (plus, minus), N m."""
    plus, minus = 0.0, 0.0
    square = g[j, 0] * g[j, 0] + g[j, 1] * g[j, 1]
    for i in range(PLACES):
        if active[i] != 0 and same_line(i, j, lines):
            ratio = (g[i, 0] * g[j, 0] + g[i, 1] * g[j, 1]) / square
            if ratio > 0.0:
                plus += ratio * cost_plus[i]
                minus += ratio * cost_minus[i]
            else:
                plus -= ratio * cost_minus[i]
                minus -= ratio * cost_plus[i]
    return plus, minus


@kernel
def holding_torque(mass, row, bias, force):
    """Torque on a joint with row g that keeps its rate at zero while the force f acts: g.a = -bias (N m, signed)."""
    (mxx, mxy, myy), (gx, gy) = mass, row
    ax, ay = solve_mass(mxx, mxy, myy, force[0], force[1])
    hx, hy = solve_mass(mxx, mxy, myy, gx, gy)
    return -(gx * ax + gy * ay + bias) / (gx * hx + gy * hy)
