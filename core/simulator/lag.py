"""How the yields follow their lag within a step: Eq. (1), with the time constants of Eq. (4).

    y = K + (y_0 - K) exp(-L)               Eq. (1), `lagged`
    L grows by dt / a
    a = b_0 + b_1 w + b_2 w^2               Eq. (4), `constant`; w is omega_L, the octaves of the joint's speed

K is the gain of a brake, y_0 - K its lack. A step integrates L in the same stages as the motion, so a time constant may
be short beside the step. Each joint's pace, the branch of Eq. (4) for its rate, stays the same within a step like the
pattern of stick and slip: a step ends where a joint comes to another branch (`pace_ends`).

For speed: exponentials and octaves come from `series`; all four brakes are computed side by side, also those without a
lack; and a scene without lag fills nothing but `lagging`.
"""

import math

import numpy as np

from core.brake import below_omega_0, inverse, octaves, torque_gain
from core.kernels import inlined, kernel
from core.simulator.hermite import hermite_zero
from core.simulator.series import exponentials, octaves_grown
from core.simulator.solver_numbers import ARRIVED, EDGE_S, PACE_ROUNDING

#: Paces: below the floor of Eq. (4), from there to omega_0, beyond it. Only a slow joint's time constant changes.
CREEPING, SLOW, FAST = 0, 1, 2
#: Bounds on the share by which a rate grows in a stage, and on a time constant (s), for steps that are tried too long.
LEAST_GROWTH, MOST_GROWTH, LEAST_LAG_S = -0.9, 10.0, 1e-9

#: The lag of the four brakes over one step: `begin_lags` fills it anew in each.
LAG = np.dtype(
    [
        ("lagging", "i8"),  # 1: some yield is on its way; else nothing else here is filled
        ("gain", "f8", (4,)),  # N m, K: what the yield goes to
        ("lack", "f8", (4,)),  # N m, y_0 - K
        ("pace", "i8", (4,)),  # the branch of Eq. (4) for the joint's rate
        ("constants", "f8", (3, 4)),  # s, b_0, b_1, b_2 of that branch
        ("octaves", "f8", (4,)),  # w at the start
        ("per_lag", "f8", (4,)),  # 1/s, 1/a at the start
        ("per_rate", "f8", (4,)),  # s/rad, 1 / rate at the start; 0: the constant does not change with it
    ]
)


@inlined
def lagged(gain, lack, exponential):
    """Eq. (1): the yield (N m) of a brake, from exp(-L)."""
    return gain + lack * exponential


@inlined
def constant(lag, i, w):
    """Eq. (4): the time constant a (s) of brake i at w octaves."""
    return lag.constants[0, i] + (lag.constants[1, i] + lag.constants[2, i] * w) * w


@inlined
def per_lag_at(body, lag, i, rate):
    """1/a of brake i (1/s) at a stage's rate (rad/s). A step over which a rate changes much is cut (`yield_error`)."""
    growth = min(max((rate - body.rate[i]) * lag.per_rate[i], LEAST_GROWTH), MOST_GROWTH)
    return 1.0 / max(constant(lag, i, lag.octaves[i] + octaves_grown(growth)), LEAST_LAG_S)


@kernel
def begin_lags(brakes, body, braking, lag, currents, lagged):
    """Stage: the gain K that each yield goes to in the coming step under the currents (4,), A, and its time constant.

    `lag.lagging`: whether any yield is still on its way; never in a scene without lag.
    """
    lag.lagging = 0
    if lagged == 0:
        return
    for i in range(4):
        lag.lack[i] = lag.per_lag[i] = lag.per_rate[i] = lag.pace[i] = 0
        lag.constants[0, i] = 1.0
        if brakes.present[i] > 0.0:
            lag.gain[i] = torque_gain(brakes, i, currents[i])
            lag.lack[i] = braking.torque_yield[i] - lag.gain[i]
            if abs(lag.lack[i]) <= ARRIVED * lag.gain[i]:
                braking.torque_yield[i], lag.lack[i] = lag.gain[i], 0.0
            else:
                lag.lagging = 1
                begin_brake(brakes, body, lag, i, currents[i])


@inlined
def begin_brake(brakes, body, lag, i, current):
    """Pace and time constant of brake i at the start of a step."""
    rising, rate, growth = lag.lack[i] < 0.0, 0.0, 0.0
    if body.sign[i] != 0.0:
        rate = body.rate[i]
        growth = math.copysign(1.0, rate) * joint_acceleration(body, i)
    speed = abs(rate)
    pace = pace_of(brakes, i, speed, growth)
    lag.pace[i] = pace
    if pace == FAST:
        lag.constants[0, i] = brakes.rise[i, 0] if rising else brakes.fall[i, 0]
        lag.constants[1, i] = lag.constants[2, i] = lag.octaves[i] = 0.0
    else:
        lag.constants[0, i], lag.constants[1, i], lag.constants[2, i] = below_omega_0(brakes, i, current, rising)
        lag.octaves[i] = octaves(min(max(speed, brakes.floor[i]), brakes.omega_0[i]))
        if pace == SLOW:
            lag.per_rate[i] = 1.0 / rate
    lag.per_lag[i] = inverse(constant(lag, i, lag.octaves[i]))


@inlined
def pace_of(brakes, i, speed, growth):
    """The branch of Eq. (4) for the speed (rad/s) of joint i, which grows by `growth` (rad/s2)."""
    for pace in (FAST, SLOW):
        edge = brakes.omega_0[i] if pace == FAST else brakes.floor[i]
        near = PACE_ROUNDING * edge + 2.0 * EDGE_S * abs(growth)
        if speed >= edge + near or (growth > 0.0 and speed >= edge - near):
            return pace
    return CREEPING


@kernel
def age_yields(braking, lag, elapsed):
    """The yields `elapsed` seconds into the step by the time constants of its start: exact while the joints rest."""
    if lag.lagging != 0 and elapsed > 0.0:
        for i in range(4):
            if lag.lack[i] != 0.0:
                braking.torque_yield[i] = lagged(lag.gain[i], lag.lack[i], math.exp(-elapsed * lag.per_lag[i]))


@kernel
def begin_stages(brakes, body, braking, scratch, dt):
    """Begin a step of dt seconds: the parts of the torques, and what is left of each lack in the second stage."""
    lag = scratch.lag
    for i in range(4):
        sign = body.sign[i]
        steady = swing = 0.0
        if sign != 0.0 and braking.active[i] != 0:
            if brakes.play[i] == 0.0 or braking.edge[i] * sign > 0.0:
                steady, swing = -sign * lag.gain[i], -sign * lag.lack[i]
            else:
                steady = -sign * (braking.cost_plus[i] if sign > 0.0 else braking.cost_minus[i])
        scratch.steady[i], scratch.swing[i] = steady, swing
    half, per_lag, left = 0.5 * dt, lag.per_lag, scratch.left[0]
    left[0], left[1], left[2], left[3] = exponentials(
        half * per_lag[0], half * per_lag[1], half * per_lag[2], half * per_lag[3]
    )


@kernel
def next_stage(body, scratch, rates, dt, stage):
    """What is left of each lack dt seconds on, at the rates (A, E, B, C; rad/s) of stage 2 (0) or 3 (1)."""
    lag = scratch.lag
    a, e = per_lag_at(body, lag, 0, rates[0]), per_lag_at(body, lag, 1, rates[1])
    b, c = per_lag_at(body, lag, 2, rates[2]), per_lag_at(body, lag, 3, rates[3])
    per_lag, left = scratch.per_lag[stage], scratch.left[stage]
    per_lag[0], per_lag[1], per_lag[2], per_lag[3] = a, e, b, c
    left[0], left[1], left[2], left[3] = exponentials(dt * a, dt * e, dt * b, dt * c)


@kernel
def end_stages(body, scratch, rates, dt):
    """What is left of each lack at the end of the step, from the rates of all stages; the yields there."""
    lag = scratch.lag
    first, second, third = lag.per_lag, scratch.per_lag[0], scratch.per_lag[1]
    fourth, left = scratch.per_lag[2], scratch.left[1]
    a, e = per_lag_at(body, lag, 0, rates[0]), per_lag_at(body, lag, 1, rates[1])
    b, c = per_lag_at(body, lag, 2, rates[2]), per_lag_at(body, lag, 3, rates[3])
    fourth[0], fourth[1], fourth[2], fourth[3] = a, e, b, c
    sixth = dt / 6.0
    left[0], left[1], left[2], left[3] = exponentials(
        sixth * (first[0] + 2.0 * (second[0] + third[0]) + a),
        sixth * (first[1] + 2.0 * (second[1] + third[1]) + e),
        sixth * (first[2] + 2.0 * (second[2] + third[2]) + b),
        sixth * (first[3] + 2.0 * (second[3] + third[3]) + c),
    )
    for i in range(4):
        scratch.torque_yield[i] = lagged(lag.gain[i], lag.lack[i], left[i])


@inlined
def lagging_torques(scratch, when):
    """Torques of the brakes A, E, B, C, N m, as they slip: in the middle of the step (0) or at its end (1)."""
    steady, swing, left = scratch.steady, scratch.swing, scratch.left[when]
    return (
        steady[0] + swing[0] * left[0], steady[1] + swing[1] * left[1],
        steady[2] + swing[2] * left[2], steady[3] + swing[3] * left[3],
    )  # fmt: skip


@kernel
def yield_error(body, scratch, step):
    """How far a torque of the tried step may be off, which takes a parabola for the course of its yields (N m).

    The largest of the remainders of Simpson's rule: for an exponential, and for a constant that is linear in the
    logarithm of a rate that grows evenly.
    """
    lag = scratch.lag
    largest = 0.0
    for i in range(4):
        if lag.lack[i] == 0.0 or body.sign[i] == 0.0:
            continue
        share = step * lag.per_lag[i]
        off = min(share * share * share * share / 2880.0, 1.0 / 6.0)
        if lag.pace[i] == SLOW:
            start, end = abs(body.rate[i]), abs(scratch.rate[i])
            middle = 0.25 * abs(6.0 * abs(scratch.turned[i]) / step - start - end)
            low, high = min(min(start, end), middle), max(max(start, end), middle)
            spread = 2.0 * (high - low) / (high + low)
            change = max(abs(scratch.per_lag[0, i] - lag.per_lag[i]), abs(scratch.per_lag[2, i] - lag.per_lag[i]))
            off += step * change * spread * spread * spread / 480.0
        largest = max(largest, abs(lag.lack[i]) * off)
    return largest


@kernel
def pace_ends(brakes, body, scratch, step):
    """The first time in the tried step (s) at which a joint comes to another branch of Eq. (4); infinite: none does."""
    lag = scratch.lag
    first = math.inf
    for i in range(4):
        if body.sign[i] != 0.0 and lag.lack[i] != 0.0:
            pace = lag.pace[i]
            if pace != FAST:
                edge = brakes.omega_0[i] if pace == SLOW else brakes.floor[i]
                first = min(first, edge_reached(body, scratch, i, edge, -1.0, step))
            if pace != CREEPING:
                edge = brakes.omega_0[i] if pace == FAST else brakes.floor[i]
                first = min(first, edge_reached(body, scratch, i, edge, 1.0, step))
    return first


@inlined
def edge_reached(body, scratch, i, edge, way, step):
    """When joint i comes down (way 1) or up (-1) to a speed (rad/s) in the tried step, s; infinite: it does not.

    By the cubic through its rates and accelerations: also where it comes back within the step.
    """
    toward = way * body.sign[i]
    start, end = toward * body.rate[i] - way * edge, toward * scratch.rate[i] - way * edge
    falls, falls_at_end = toward * joint_acceleration(body, i), toward * joint_acceleration(scratch, i)
    if end < -PACE_ROUNDING * edge or (falls < 0.0 and falls_at_end > 0.0):
        s = hermite_zero(max(start, 0.0), falls, end, falls_at_end, step)
        if s > EDGE_S:
            return s
    return math.inf


@inlined
def joint_acceleration(at, i):
    """Angular acceleration of joint i (rad/s2), now or after a tried step: g . a + gdot . v."""
    return at.g[i, 0] * at.acceleration[0] + at.g[i, 1] * at.acceleration[1] + at.bias[i]
