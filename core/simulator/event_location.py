"""Where inside a step the next event lies, located to rounding.

An event is a moment at which the pattern of stick and slip ends. Each kind has a value that stays >= 0 until then:
    0-3    rate of a slipping joint, in its sense             (it stops)
    4      speed along the SDOF path of a held joint          (the whole device stops)
    5, 6   what a held joint can still hold, either way       (it breaks loose)
    7-10   what is left of a brake's backlash                 (its torque sets in)
    11-15  gap to a hard stop                                 (impact)
An event inside the step is seen by its value at the end, or by a dip of its cubic Hermite (a parabola for 5 and 6)
below zero in between: two crossings inside one step must not be missed.
"""

import math

from core.kernels import kernel
from core.mechanism import PLACES
from core.simulator.hermite import hermite_zero, parabola_zero
from core.simulator.lag import joint_acceleration
from core.simulator.runge_kutta import rk4, slip_torques
from core.simulator.solver_numbers import GRAZING, LOCATED, MAX_LOCATE, ROUNDING, SLID_S
from core.simulator.stick_slip import same_line
from core.simulator.stick_slip_mode import update_kinematics
from core.stops import stop_gap

NONE = -1
SPEED, LOOSE_PLUS, LOOSE_MINUS, PLAY, STOP = 4, 5, 6, 7, 11


@kernel
def tangent(body, at):
    """Unit tangent of the held joint's SDOF path, now or after a tried step: the row g, turned to the left."""
    j = body.held
    gx, gy = at.g[j, 0], at.g[j, 1]
    one_over = 1.0 / math.sqrt(gx * gx + gy * gy)
    return -gy * one_over, gx * one_over


@kernel
def path_speed(body, at):
    """Speed along the held joint's SDOF path (m/s), signed by `tangent`."""
    tx, ty = tangent(body, at)
    return tx * at.tip[2] + ty * at.tip[3]


@kernel
def path_sense(body):
    """Sense of motion along the SDOF path at the start of the step: of the speed, or from rest of the acceleration."""
    tx, ty = tangent(body, body)
    speed = tx * body.tip[2] + ty * body.tip[3]
    if speed == 0.0:
        speed = tx * body.acceleration[0] + ty * body.acceleration[1]
    return 1.0 if speed >= 0.0 else -1.0


@kernel
def held_limits(model, body, braking, lag, at, yields):
    """What the held joint's line can hold against + and - motion, now or after the tried step (N m)."""
    brakes, lines, j = model.brakes, model.mechanism.lines, body.held
    plus, minus = 0.0, 0.0
    square = at.g[j, 0] * at.g[j, 0] + at.g[j, 1] * at.g[j, 1]
    for i in range(PLACES):
        if braking.active[i] == 0 or not same_line(i, j, lines):
            continue
        against_plus, against_minus = braking.cost_plus[i], braking.cost_minus[i]
        if lag.lagging != 0 and i < 4 and brakes.present[i] > 0.0:
            held = yields[i]
            no_play = brakes.play[i] == 0.0
            if body.contact[i] <= 0.0 and (no_play or braking.edge[i] > 0.0):
                against_plus = held
            if body.contact[i] >= 0.0 and (no_play or braking.edge[i] < 0.0):
                against_minus = held
        ratio = (at.g[i, 0] * at.g[j, 0] + at.g[i, 1] * at.g[j, 1]) / square
        if ratio > 0.0:
            plus += ratio * against_plus
            minus += ratio * against_minus
        else:
            plus -= ratio * against_minus
            minus -= ratio * against_plus
    return plus, minus


@kernel
def event_value(model, data, kind):
    """Value of one kind of event at the end of the tried step."""
    turned = data.scratch.turned[kind - PLAY] if PLAY <= kind < STOP else 0.0
    return value_at(model, data, data.scratch, data.scratch.torque_yield, turned, kind)


@kernel
def value_at(model, data, at, yields, turned, kind):
    """Value of one kind of event, now or after the tried step; turned since, rad."""
    mechanism, brakes, body, braking, scratch = model.mechanism, model.brakes, data.body, data.braking, data.scratch
    if kind < SPEED:
        return body.sign[kind] * at.rate[kind]
    if kind == SPEED:
        return path_sense(body) * path_speed(body, at)
    if kind < PLAY:
        plus, minus = held_limits(model, body, braking, scratch.lag, at, yields)
        return at.line_torque + plus if kind == LOOSE_PLUS else minus - at.line_torque
    if kind < STOP:
        i = kind - PLAY
        left = brakes.play[i] - braking.play[i] if body.sign[i] > 0.0 else braking.play[i]
        return left - body.sign[i] * turned
    stop_gap(mechanism, body.distal_side, at.tip[0], at.tip[1], scratch.theta, scratch.gap, scratch.gap_side)
    return scratch.gap[kind - STOP]


@kernel
def event_slope(body, scratch, kind):
    """Rate of change of `event_value` at the end of the tried step, where that is known; else 0."""
    if kind < SPEED:
        return body.sign[kind] * joint_acceleration(scratch, kind)
    if kind == SPEED:
        tx, ty = tangent(body, scratch)
        return path_sense(body) * (tx * scratch.acceleration[0] + ty * scratch.acceleration[1])
    if PLAY <= kind < STOP:
        return -body.sign[kind - PLAY] * scratch.rate[kind - PLAY]
    return 0.0


@kernel
def first_event(model, body, braking, scratch, step):
    """The first event inside the step, from start and end alone: (kind, estimated time); NONE where there is none.

    Kinds whose bit is in scratch.seen are passed over.
    """
    mechanism, brakes, seen = model.mechanism, model.brakes, scratch.seen
    kind, first = NONE, math.inf
    for i in range(4):
        sign = body.sign[i]
        if sign == 0.0 or braking.active[i] == 0:
            continue
        v0, v1 = sign * body.rate[i], sign * scratch.rate[i]
        d0, d1 = sign * joint_acceleration(body, i), sign * joint_acceleration(scratch, i)
        if (v1 < -ROUNDING or (d0 < 0.0 and d1 > 0.0)) and not seen >> i & 1:
            s = hermite_zero(v0, d0, v1, d1, step)
            if 0.0 <= s < first:
                kind, first = i, s
        if brakes.play[i] > 0.0 and braking.edge[i] == 0.0 and not seen >> (PLAY + i) & 1:
            v0 = brakes.play[i] - braking.play[i] if sign > 0.0 else braking.play[i]
            v1 = v0 - sign * scratch.turned[i]
            if v1 < -ROUNDING:
                s = hermite_zero(v0, -sign * body.rate[i], v1, -sign * scratch.rate[i], step)
                if 0.0 <= s < first:
                    kind, first = PLAY + i, s
    if body.held >= 0:
        sense = path_sense(body)
        tx, ty = tangent(body, body)
        d0 = sense * (tx * body.acceleration[0] + ty * body.acceleration[1])
        v1 = sense * path_speed(body, scratch)
        tx, ty = tangent(body, scratch)
        d1 = sense * (tx * scratch.acceleration[0] + ty * scratch.acceleration[1])
        if (v1 < -ROUNDING or (d0 < 0.0 and d1 > 0.0)) and not seen >> SPEED & 1:
            s = hermite_zero(sense * path_speed(body, body), d0, v1, d1, step)
            if 0.0 <= s <= first:
                kind, first = SPEED, s
        plus0, minus0 = held_limits(model, body, braking, scratch.lag, body, braking.torque_yield)
        plus1, minus1 = held_limits(model, body, braking, scratch.lag, scratch, scratch.torque_yield)
        plus, minus = 0.5 * (plus0 + plus1), 0.5 * (minus0 + minus1)
        torque0, torque1, middle = body.line_torque, scratch.line_torque, scratch.middle_torque
        s = parabola_zero(torque0 + plus0, middle + plus, torque1 + plus1, step)
        if 0.0 <= s < first and not seen >> LOOSE_PLUS & 1:
            kind, first = LOOSE_PLUS, s
        s = parabola_zero(minus0 - torque0, minus - middle, minus1 - torque1, step)
        if 0.0 <= s < first and not seen >> LOOSE_MINUS & 1:
            kind, first = LOOSE_MINUS, s
    stop, when = first_stop(mechanism, body, scratch, step, seen)
    if stop != NONE and when < first:
        kind, first = stop, when
    return kind, first


@kernel
def first_stop(mechanism, body, scratch, step, seen):
    """The first hard stop that the tried step has run beyond: (kind, estimated time); NONE where there is none."""
    m1, m2 = mechanism.arm_1, mechanism.arm_2
    g, margin = scratch.g, mechanism.margin
    between = g[0, 0] * g[2, 1] - g[0, 1] * g[2, 0]
    clear = (
        -m1.side * scratch.s_1 >= margin * m1.length_1 * m1.length_2
        and -m2.side * scratch.s_2 >= margin * m2.length_1 * m2.length_2
        and body.distal_side * scratch.s_1 * scratch.s_2 * between >= margin * m1.length_2 * m2.length_2
    )
    if clear and mechanism.has_theta_stops == 0:
        return NONE, 0.0
    kind, first = NONE, math.inf
    stop_gap(mechanism, body.distal_side, scratch.tip[0], scratch.tip[1], scratch.theta, scratch.gap, scratch.gap_side)
    for j in range(PLACES):
        if seen >> (STOP + j) & 1:
            continue
        if scratch.gap[j] < -ROUNDING and not (body.held >= 0 and same_line(j, body.held, mechanism.lines)):
            kind, first = STOP + j, 0.5 * step
    return kind, first


@kernel
def locate(model, data, t, step, kind, guess):
    """Shrink the tried step to the first event: (kind, its time). It is left there, the event's value at rounding.

    Bracketed Newton or secant steps on re-integrated steps, where one that is nearly there is slid to the event; where
    another event comes before, that one is taken.
    """
    scratch = data.scratch
    for _ in range(STOP + 5):
        guess = locate_one(model, data, t, step, kind, guess)
        if guess == 0.0:
            break
        # a graze came close to zero and turned back
        grazed = event_value(model, data, kind) > GRAZING
        scratch.seen |= 1 << kind
        other, when = first_event(model, data.body, data.braking, scratch, guess)
        if other == NONE:
            if grazed:
                kind = NONE
            break
        kind, step, guess = other, guess, when
    return kind, guess


@kernel
def locate_one(model, data, t, step, kind, guess):
    """Time in [0, step] at which the value of one kind of event reaches zero."""
    body, braking, scratch = data.body, data.braking, data.scratch
    low, at_low = 0.0, value_at(model, data, data.body, data.braking.torque_yield, 0.0, kind)
    high = step
    if at_low <= ROUNDING:
        # it starts at zero: find a time at which it has risen above, or take the event as present already
        s = step
        risen = False
        for _ in range(MAX_LOCATE):
            s *= 0.5
            if rk4(model, data, t, s):
                value = event_value(model, data, kind)
                if value > ROUNDING:
                    risen = True
                    break
                high = s
        if not risen:
            rk4(model, data, t, 0.0)
            return 0.0
        low, at_low = s, value
        guess = 0.5 * (low + high)
    s = guess if low < guess < high else 0.5 * (low + high)
    last, at_last = low, at_low
    for _ in range(MAX_LOCATE):
        if not rk4(model, data, t, s):
            high = s
            s = 0.5 * (low + high)
            continue
        value = event_value(model, data, kind)
        if abs(value) <= LOCATED:
            break
        if value > 0.0:
            low, at_low = s, value
        else:
            high = s
        if high - low <= 4e-16 * step:
            break
        slope = event_slope(body, scratch, kind)
        if slope == 0.0:
            slope = (value - at_last) / (s - last)
        ahead = s - value / slope
        if scratch.lag.lagging == 0 and kind <= SPEED and low < ahead < high and abs(ahead - s) <= SLID_S:
            slide(model.mechanism, body, braking, scratch, ahead - s)
            return ahead
        last, at_last = s, value
        s = ahead if low < ahead < high else 0.5 * (low + high)
    return s


@kernel
def slide(mechanism, body, braking, scratch, ds):
    """Carry the end of the tried step on by ds (s), at most `SLID_S` either way, along its velocity and acceleration.

    For brakes without lag. What it leaves out is of the second order in ds; an event is followed by a new acceleration.
    """
    tip, a = scratch.tip, scratch.acceleration
    scratch.work += ds * (scratch.hand_force[0] * tip[2] + scratch.hand_force[1] * tip[3])
    torques = slip_torques(body, braking)
    for i in range(4):
        scratch.heat[i] -= ds * torques[i] * scratch.rate[i]
    for k in range(2):
        tip[k] += ds * tip[2 + k]
        tip[2 + k] += ds * a[k]
    update_kinematics(mechanism, scratch)
    if body.held >= 0:
        scratch.rate[body.held] = 0.0
