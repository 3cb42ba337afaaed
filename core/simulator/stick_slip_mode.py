"""The pattern of stick and slip at an instant: which joint is held, which way each other brake slips.

`decide` is the one door: it asks the exact solver how the device goes on from what the state holds. `resolve`, the
stage at the start of a step, goes through it, and so does each event (`event`).
"""

import math

from core.dynamics import combined, motion
from core.kernels import inlined, kernel
from core.linkage import coupled_angle, links
from core.mechanism import PLACES, STOP_E, D
from core.simulator.hand import hand_force
from core.simulator.load_sharing import leave_stops_their_share, share_at_rest, share_on_line
from core.simulator.solver_numbers import HAND_ROUNDING, RATE_ROUNDING
from core.simulator.stick_slip import (
    FREE,
    STILL,
    Joints,
    holding_torque,
    line_limits,
    same_line,
    solve_at_rest,
    solve_mass,
)


@kernel
def update_kinematics(mechanism, body):
    """Stage: compute rows, rates, mass and velocity terms from position and velocity, into the body."""
    tip = body.tip
    store(mechanism, body, motion(mechanism, tip[0], tip[1], tip[2], tip[3]))


@inlined
def store(mechanism, body, q):
    """Copy a `Motion` into the body's arrays; row D is the rate of the angle between the distal links.

    A coupling has the place of its brake, and the elbow there another, for its stops.
    """
    g, rate, bias, p, r = body.g, body.rate, body.bias, q.arm_1, q.arm_2
    g[0, 0], g[0, 1], g[1, 0], g[1, 1] = p.base_x, p.base_y, p.elbow_x, p.elbow_y
    g[2, 0], g[2, 1], g[3, 0], g[3, 1] = r.base_x, r.base_y, r.elbow_x, r.elbow_y
    g[4, 0], g[4, 1], bias[4] = distal_row(q)
    rate[0], rate[1], rate[2], rate[3] = p.base_rate, p.elbow_rate, r.base_rate, r.elbow_rate
    rate[4] = r.base_rate + r.elbow_rate - p.base_rate - p.elbow_rate
    bias[0], bias[1], bias[2], bias[3] = p.base_bias, p.elbow_bias, r.base_bias, r.elbow_bias
    body.mass[0], body.mass[1], body.mass[2] = q.mass_xx, q.mass_xy, q.mass_yy
    body.bias_force[0], body.bias_force[1] = q.bias_x, q.bias_y
    if mechanism.coupled != 0:
        for i in (1, 3):
            if mechanism.coupled >> i & 1 != 0:
                k = STOP_E + i // 2
                g[k, 0], g[k, 1], rate[k], bias[k] = g[i, 0], g[i, 1], rate[i], bias[i]
                g[i, 0], g[i, 1], rate[i], bias[i] = combined(mechanism, i, q)


@inlined
def distal_row(q):
    """Row g and bias gdot . v of D, the angle between the distal links."""
    p, r = q.arm_1, q.arm_2
    return (
        r.base_x + r.elbow_x - p.base_x - p.elbow_x,
        r.base_y + r.elbow_y - p.base_y - p.elbow_y,
        r.base_bias + r.elbow_bias - p.base_bias - p.elbow_bias,
    )


@kernel
def set_costs(brakes, body, braking):
    """Set what each joint holds against + and - motion: yield, off torque inside the backlash, infinite at a stop.

    False where nothing has changed.
    """
    changed = False
    for i in range(4):
        held = braking.torque_yield[i]
        plus = minus = held
        if brakes.play[i] > 0.0:
            off = min(brakes.k[i, 1], held)
            if braking.edge[i] <= 0.0:
                plus = off
            if braking.edge[i] >= 0.0:
                minus = off
        if body.contact[i] == 0.0 and (braking.cost_plus[i] != plus or braking.cost_minus[i] != minus):
            changed = True
        braking.cost_plus[i], braking.cost_minus[i] = plus, minus
        braking.active[i] = 1 if brakes.present[i] > 0.0 else 0
    for j in range(PLACES):
        if j >= D:
            braking.cost_plus[j] = braking.cost_minus[j] = 0.0
            braking.active[j] = 0
        if body.contact[j] > 0.0:
            braking.cost_plus[j], braking.active[j], changed = math.inf, 1, True
        elif body.contact[j] < 0.0:
            braking.cost_minus[j], braking.active[j], changed = math.inf, 1, True
    return changed


@kernel
def slip_torque(body, braking, i):
    """Torque of joint i in the sense in which it slips (N m); 0 where it does not, or has nothing but a stop."""
    torque = 0.0
    if braking.active[i] != 0 and body.sign[i] != 0.0:
        torque = -braking.cost_plus[i] if body.sign[i] > 0.0 else braking.cost_minus[i]
    return 0.0 if math.isinf(torque) else torque


@kernel
def slipping_force(body, braking, held, lines):
    """Force of the slipping brakes on the tip, sum of g_i torque_i over joints off the held line (N)."""
    fx = fy = 0.0
    for i in range(4):
        if not (held >= 0 and same_line(i, held, lines)):
            torque = slip_torque(body, braking, i)
            fx += body.g[i, 0] * torque
            fy += body.g[i, 1] * torque
    return fx, fy


@kernel
def resolve(model, data, t):
    """Stage: the pattern at time t for the yields now in the state; fills held, sign, acceleration and torque.

    Where the last step left the pattern of a moving tip settled and nothing has changed since, it stands.
    """
    mechanism, brakes, hand, body, braking = model.mechanism, model.brakes, data.hand, data.body, data.braking
    changed = set_costs(brakes, body, braking)
    if body.settled != 0 and not changed and hand.grips[0].spring == 0:
        for i in range(4):
            braking.torque[i] = slip_torque(body, braking, i)
        if body.held >= 0:
            share_on_line(body, braking, body.held, body.line_torque, mechanism.lines)
        return
    tip, arm_mass = body.tip, hand.grips[0].mass
    fx, fy = hand_force(hand, t, tip[0], tip[1], tip[2], tip[3])
    if tip[2] != 0.0 or tip[3] != 0.0:
        see_rates(mechanism, body, braking, fx, fy, arm_mass)
    decide(model, body, braking, body.held, (fx, fy), arm_mass)


@inlined
def see_rates(mechanism, body, braking, fx, fy, arm_mass):
    """Look at the rate of each joint that is not held: without one it sticks or slips, else it slips as it moves."""
    if body.held == STILL:
        body.held = FREE
    for i in range(PLACES):
        rate = body.rate[i]
        if braking.active[i] == 0 or (body.held >= 0 and same_line(i, body.held, mechanism.lines)):
            continue
        at_stop = body.contact[i] != 0.0 and body.contact[i] * rate > -RATE_ROUNDING
        if not at_stop and body.sign[i] * rate >= RATE_ROUNDING:
            continue
        at_rest = at_stop or rate == 0.0 or (body.sign[i] == 0.0 and abs(rate) <= RATE_ROUNDING)
        if at_rest and body.held == FREE:
            stick_or_slip(mechanism, body, braking, i, (fx, fy), arm_mass)
        elif abs(rate) > RATE_ROUNDING or body.sign[i] == 0.0:
            body.sign[i] = 1.0 if rate > 0.0 else -1.0


@kernel
def decide(model, body, braking, j, force, arm_mass):
    """Decide which brakes stick under the hand force (N); fills held, sign, acceleration and torque.

    A tip at rest, be it only since a joint stuck, stays or leaves as the forces let it: all brakes rest, none slips. In
    motion joint j, which has no rate, sticks or slips on; FREE: no joint is in question. Expects the costs set
    (`set_costs`).
    """
    mechanism, brakes, (fx, fy) = model.mechanism, model.brakes, force
    if body.tip[2] == 0.0 and body.tip[3] == 0.0:
        from_rest(mechanism, body, braking, fx, fy, arm_mass)
    elif j >= 0:
        stick_or_slip(mechanism, body, braking, j, force, arm_mass)
    settle_edges(brakes, body, braking)
    finish(mechanism, body, braking, fx, fy, arm_mass)


@inlined
def joints_of(mechanism, body, braking):
    """The joints' rows and holding torques, as `stick_slip` takes them."""
    return Joints(body.g, braking.active, braking.cost_plus, braking.cost_minus, mechanism.lines)


@inlined
def moved_mass(body, arm_mass):
    """Mass of the tip and of the arm that moves with it: xx, xy, yy, kg."""
    return body.mass[0] + arm_mass, body.mass[1], body.mass[2] + arm_mass


@kernel
def from_rest(mechanism, body, braking, fx, fy, arm_mass):
    """The pattern in which a resting tip goes on under the hand force f."""
    mass = moved_mass(body, arm_mass)
    held, _, _ = solve_at_rest(joints_of(mechanism, body, braking), mass, (fx, fy), body.sign)
    body.held = held
    if held >= 0:
        enter_line(mechanism, body, held)


@kernel
def hand_changed(hand, body, t):
    """True where the hand force at time t is not the one under which the last step ended: it is another hand."""
    fx, fy = hand_force(hand, t, body.tip[0], body.tip[1], body.tip[2], body.tip[3])
    arm_mass = hand.grips[0].mass
    dx = fx - arm_mass * body.acceleration[0] - body.hand_force[0]
    dy = fy - arm_mass * body.acceleration[1] - body.hand_force[1]
    return not abs(dx) + abs(dy) <= HAND_ROUNDING * (1.0 + abs(fx) + abs(fy))


@kernel
def stick_or_slip(mechanism, body, braking, j, force, arm_mass):
    """Joint j has no rate while the tip moves: it sticks, or slips on in the sense that the forces give it.

    A soft threshold on its SDOF line; joints on the same line (E and C on coaxial bases) go with it.
    """
    g, (fx, fy) = body.g, force
    for i in range(PLACES):
        if braking.active[i] != 0 and abs(body.rate[i]) <= RATE_ROUNDING and not same_line(i, j, mechanism.lines):
            stick_or_slip_parallel(mechanism, body, braking, j, force, arm_mass)
            return
    sx, sy = slipping_force(body, braking, j, mechanism.lines)
    force = fx + sx - body.bias_force[0], fy + sy - body.bias_force[1]
    torque = holding_torque(moved_mass(body, arm_mass), (g[j, 0], g[j, 1]), body.bias[j], force)
    plus, minus = line_limits(g, braking.active, braking.cost_plus, braking.cost_minus, mechanism.lines, j)
    if torque < -plus:
        release(mechanism, body, j, 1.0)
    elif torque > minus:
        release(mechanism, body, j, -1.0)
    else:
        hold(mechanism, body, j)


@kernel
def hold(mechanism, body, j):
    """Joint j and those on its line stick."""
    if body.held != j:
        body.held = j
        for i in range(PLACES):
            if same_line(i, j, mechanism.lines):
                body.sign[i] = 0.0
        enter_line(mechanism, body, j)


@kernel
def has_no_rate(mechanism, body, braking, i, j):
    """True where joint i, on the line of joint j or not, stands while the tip moves."""
    return braking.active[i] != 0 and (same_line(i, j, mechanism.lines) or abs(body.rate[i]) <= RATE_ROUNDING)


@kernel
def stick_or_slip_parallel(mechanism, body, braking, j, force, arm_mass):
    """Joint j and another on a different line have no rate while the tip moves: their rows are parallel for an instant.

    With s = g_j . a every such joint k turns at r_k = ratio_k s + gdot_k . v, and the motion is
        argmin over s of 1/2 (s - s_free)^2 / (g_j . M^-1 g_j) + sum of costs of r_k:
    convex, with one kink a line. The line whose kink is the minimum sticks; where none is, all slip.
    """
    g, bias, mass, (fx, fy) = body.g, body.bias, body.mass, force
    rx, ry = fx - body.bias_force[0], fy - body.bias_force[1]
    for i in range(4):
        if not has_no_rate(mechanism, body, braking, i, j):
            torque = slip_torque(body, braking, i)
            rx += g[i, 0] * torque
            ry += g[i, 1] * torque
    mxx, mxy, myy = mass[0] + arm_mass, mass[1], mass[2] + arm_mass
    ax, ay = solve_mass(mxx, mxy, myy, rx, ry)
    hx, hy = solve_mass(mxx, mxy, myy, g[j, 0], g[j, 1])
    free, compliance = g[j, 0] * ax + g[j, 1] * ay, g[j, 0] * hx + g[j, 1] * hy
    square = g[j, 0] * g[j, 0] + g[j, 1] * g[j, 1]
    sticks = FREE
    for k in range(PLACES):
        if has_no_rate(mechanism, body, braking, k, j):
            left, right = slopes_at_kink(mechanism, body, braking, k, j, (free, compliance))
            ratio = (g[k, 0] * g[j, 0] + g[k, 1] * g[j, 1]) / square
            body.sign[k] = 1.0 if ratio * right < 0.0 else -1.0
            if left <= 0.0 <= right and sticks == FREE:
                sticks = k
    if sticks == FREE:
        body.held = FREE
        return
    s = -bias[sticks] * square / (g[sticks, 0] * g[j, 0] + g[sticks, 1] * g[j, 1])
    for k in range(PLACES):
        if has_no_rate(mechanism, body, braking, k, j):
            if same_line(k, sticks, mechanism.lines):
                body.sign[k] = 0.0
            else:
                ratio = (g[k, 0] * g[j, 0] + g[k, 1] * g[j, 1]) / square
                body.sign[k] = 1.0 if ratio * s + bias[k] > 0.0 else -1.0
    hold(mechanism, body, sticks)


@kernel
def slopes_at_kink(mechanism, body, braking, k, j, slide):
    """Slopes of the objective of `stick_or_slip_parallel` below and above the s where joint k has no acceleration."""
    g, bias, (free, compliance) = body.g, body.bias, slide
    square = g[j, 0] * g[j, 0] + g[j, 1] * g[j, 1]
    s = -bias[k] * square / (g[k, 0] * g[j, 0] + g[k, 1] * g[j, 1])
    left = right = (s - free) / compliance
    for i in range(PLACES):
        if has_no_rate(mechanism, body, braking, i, j):
            ratio = (g[i, 0] * g[j, 0] + g[i, 1] * g[j, 1]) / square
            above = ratio * braking.cost_plus[i] if ratio > 0.0 else -ratio * braking.cost_minus[i]
            below = -ratio * braking.cost_minus[i] if ratio > 0.0 else ratio * braking.cost_plus[i]
            if same_line(i, k, mechanism.lines):
                left += below
                right += above
            elif (ratio * s + bias[i]) * ratio > 0.0:
                left += above
                right += above
            else:
                left += below
                right += below
    return left, right


@kernel
def release(mechanism, body, j, sense):
    """Joint j starts to slip in `sense` (+1 or -1), the joints on its line with it."""
    body.held = FREE
    g = body.g
    for i in range(PLACES):
        if same_line(i, j, mechanism.lines):
            body.sign[i] = sense if g[i, 0] * g[j, 0] + g[i, 1] * g[j, 1] > 0.0 else -sense


@kernel
def enter_line(mechanism, body, j):
    """Joint j is held from here on: its angle is held, not only its rate.

    On a circle the tip turns about an elbow (A, B) or a base (the others).
    """
    x, y = body.tip[0], body.tip[1]
    arm = mechanism.arm_1 if j < 2 or j == STOP_E else mechanism.arm_2
    cx, cy = arm.base_x, arm.base_y
    if j == 0 or j == 2:
        e1x, e1y, _, _, _ = links(arm, x, y)
        cx, cy = cx + e1x, cy + e1y
    body.circle[0], body.circle[1] = cx, cy
    body.circle[2] = math.sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy))
    if j < 4 and not on_circle(mechanism, j):
        body.circle[0] = coupled_angle(mechanism, j, x, y)
    gx, gy = body.g[j, 0], body.g[j, 1]
    along = (gx * body.tip[2] + gy * body.tip[3]) / (gx * gx + gy * gy)
    body.tip[2] -= along * gx
    body.tip[3] -= along * gy


@kernel
def on_circle(mechanism, j):
    """Whether the tip moves on a circle while joint j is held.

    Not with D on bases that are apart, nor with a coupling that does not depend on the distance from base to tip alone.
    """
    if j == 4:
        return mechanism.coaxial != 0
    return mechanism.coupled >> j & 1 == 0 or same_line(j, 4, mechanism.lines)


@kernel
def settle_edges(brakes, body, braking):
    """A brake that slips away from the edge of its backlash leaves it."""
    for i in range(4):
        if brakes.play[i] > 0.0 and body.sign[i] * braking.edge[i] < 0.0:
            braking.edge[i] = 0.0
            off = min(brakes.k[i, 1], braking.torque_yield[i])
            if not math.isinf(braking.cost_plus[i]):
                braking.cost_plus[i] = off
            if not math.isinf(braking.cost_minus[i]):
                braking.cost_minus[i] = off


@kernel
def finish(mechanism, body, braking, fx, fy, arm_mass):
    """Acceleration, torques and the sensed hand force that the pattern implies under the hand force f."""
    g, held = body.g, body.held
    if held == STILL:
        body.acceleration[0] = body.acceleration[1] = 0.0
        body.hand_force[0], body.hand_force[1] = fx, fy
        share_at_rest(body, braking, fx, fy)
        leave_stops_their_share(body, braking)
        return
    for i in range(PLACES):
        braking.torque[i] = slip_torque(body, braking, i) if i < 4 else 0.0
    sx, sy = slipping_force(body, braking, held, mechanism.lines)
    rx, ry = fx + sx - body.bias_force[0], fy + sy - body.bias_force[1]
    mass = moved_mass(body, arm_mass)
    if held >= 0:
        torque = holding_torque(mass, (g[held, 0], g[held, 1]), body.bias[held], (rx, ry))
        rx += g[held, 0] * torque
        ry += g[held, 1] * torque
        body.line_torque = torque
        share_on_line(body, braking, held, torque, mechanism.lines)
        leave_stops_their_share(body, braking)
    ax, ay = solve_mass(mass[0], mass[1], mass[2], rx, ry)
    body.acceleration[0], body.acceleration[1] = ax, ay
    body.hand_force[0], body.hand_force[1] = fx - arm_mass * ax, fy - arm_mass * ay
