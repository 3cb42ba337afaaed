"""Smooth motion between events: one fixed-step RK4 in tip coordinates with the pattern of stick and slip held fixed.

The pattern: a slipping brake pushes with a known torque against its sense, a stuck one is the constraint
g . a = -gdot . v. Work, heat and joint angles are integrated with the same stages, so the ledger closes to the
order of the method.
"""

import math

import numpy as np

from core.brake import begin_lag, lagged_yield, torque_gain
from core.dynamics import combined, motion
from core.kernel import inlined, kernel
from core.linkage import coupled_angle
from core.mechanism import PLACES, STOP_E, D
from core.simulator.hand import grip_force, prescribed_force
from core.simulator.solver_numbers import ENERGY_ERROR, LEAST_ENERGY, NEAR_SINGULAR, REACH, STEP_ERROR
from core.simulator.state import MOTION
from core.simulator.stick_slip import solve_mass
from core.simulator.stick_slip_mode import distal_row, on_circle, store

STEP_SCRATCH = np.dtype(
    [
        *MOTION,
        ("middle_torque", "f8"),  # N m, what holds the stuck joint in the middle of the step
        ("s_1", "f8"),
        ("s_2", "f8"),
        ("turned", "f8", (4,)),  # rad, how far each joint turned
        ("heat", "f8", (4,)),  # J
        ("work", "f8"),  # J, by the hand
        ("error", "f8"),  # m/s2, how far the step's last stage was from its end: its error estimate over its length
        ("torque_yield", "f8", (2, 4)),  # N m, at the middle and end of the step (only where there is a lag)
        ("seen", "i8"),  # bits of the kinds of events that need not be looked for any more
        # work space of the stops
        ("theta", "f8", (4,)),
        ("gap", "f8", (PLACES,)),
        ("gap_side", "f8", (PLACES,)),
    ]
)


@kernel
def begin(brakes, state, currents, step, lagged):
    """Freeze each brake's lag for the coming step (only where the scene has one)."""
    if lagged == 0:
        return
    signed = brakes.signed != 0.0
    for i in range(4):
        if brakes.present[i] > 0.0:
            rate, acceleration = 0.0, 0.0
            if state.sign[i] != 0.0:
                rate = state.rate[i]
                acceleration = joint_acceleration(state, i)
            gain = torque_gain(brakes, i, currents[i])
            if signed and brakes.play[i] > 0.0 and state.edge[i] == 0.0:
                gain = brakes.k[i, 1]  # inside the backlash; the torque follows with its lag
            gain += state.ripple[i]
            begin_lag(brakes, i, currents[i], gain, state.torque_yield[i], rate, acceleration, step, state.lag)


@kernel
def age_yields(brakes, state, elapsed, lagged):
    """Let the yields follow their lag to `elapsed` seconds into the step."""
    if lagged != 0:
        for i in range(4):
            if brakes.present[i] > 0.0:
                state.torque_yield[i] = lagged_yield(state.lag, i, elapsed)


@inlined
def joint_acceleration(at, i):
    """Angular acceleration of joint i (rad/s2) in a state or a tried step: g . a + gdot . v."""
    return at.g[i, 0] * at.acceleration[0] + at.g[i, 1] * at.acceleration[1] + at.bias[i]


@kernel
def lagged_yields(brakes, lag, step, middle, end):
    """Yields (4,), N m, in the middle and at the end of a step: one exponential where the time constant is one."""
    for i in range(4):
        if brakes.present[i] > 0.0:
            middle[i] = lagged_yield(lag, i, 0.5 * step)
            if 0.0 < step <= lag[i, 3] and lag[i, 1] != lag[i, 0]:
                gone = (middle[i] - lag[i, 0]) / (lag[i, 1] - lag[i, 0])
                end[i] = lag[i, 0] + (middle[i] - lag[i, 0]) * gone
            else:
                end[i] = lagged_yield(lag, i, step)


@inlined
def slip_torques(brakes, state, yields, lagged):
    """Torques of the slipping brakes A, E, B, C while they yield at `yields` (4,), N m; 0 for the others."""
    a = e = b = c = 0.0
    for i in range(4):
        sign = state.sign[i]
        if sign == 0.0 or state.active[i] == 0:
            continue
        held = state.cost_plus[i] if sign > 0.0 else state.cost_minus[i]
        if lagged != 0 and (brakes.play[i] == 0.0 or state.edge[i] * sign > 0.0 or brakes.signed != 0.0):
            held = yields[i]
        torque = -sign * held
        if i == 0:
            a = torque
        elif i == 1:
            e = torque
        elif i == 2:
            b = torque
        else:
            c = torque
    return a, e, b, c


@inlined
def row_of(mechanism, q, j):
    """Row g and bias gdot . v of place j, as `store` has them, in a `Motion`."""
    if mechanism.coupled >> j & 1 != 0:
        x, y, _, bias = combined(mechanism, j, q)
        return x, y, bias
    if j == D:
        return distal_row(q)
    arm = q.arm_1 if j < 2 or j == STOP_E else q.arm_2
    if j == 0 or j == 2:
        return arm.base_x, arm.base_y, arm.base_bias
    return arm.elbow_x, arm.elbow_y, arm.elbow_bias


@inlined
def stage(mechanism, grip, held, slip, px, py, x, y, vx, vy):
    """One evaluation of the equations of motion under the prescribed force p and the grip.

    Returns (ax, ay, holding torque, sensed hand force fx, fy, Motion).
    """
    q = motion(mechanism, x, y, vx, vy)
    sx, sy = grip_force(grip, x, y, vx, vy)
    fx, fy, arm_mass = px + sx, py + sy, grip.mass
    p, r = q.arm_1, q.arm_2
    rx = fx - q.bias_x + slip[0] * p.base_x + slip[1] * p.elbow_x + slip[2] * r.base_x + slip[3] * r.elbow_x
    ry = fy - q.bias_y + slip[0] * p.base_y + slip[1] * p.elbow_y + slip[2] * r.base_y + slip[3] * r.elbow_y
    mxx, mxy, myy = q.mass_xx + arm_mass, q.mass_xy, q.mass_yy + arm_mass
    ax, ay = solve_mass(mxx, mxy, myy, rx, ry)
    torque = 0.0
    if held >= 0:
        gx, gy, bias = row_of(mechanism, q, held)
        hx, hy = solve_mass(mxx, mxy, myy, gx, gy)
        torque = -(gx * ax + gy * ay + bias) / (gx * hx + gy * hy)
        ax += hx * torque
        ay += hy * torque
    return ax, ay, torque, fx - arm_mass * ax, fy - arm_mass * ay, q


@kernel
def rk4(mechanism, brakes, hand, state, scratch, t, dt, lagged):
    """One RK4 step of dt seconds from `state` into `scratch`; False where a stage left the region where the arms close.

    The first stage is the acceleration that the state already holds; the last evaluation, at the end, is the next
    step's first.
    """
    grip = hand.grips[0]
    held = state.held
    first = slip_torques(brakes, state, state.torque_yield, lagged)
    middle, last = first, first
    if lagged != 0:
        lagged_yields(brakes, state.lag, dt, scratch.torque_yield[0], scratch.torque_yield[1])
        middle = slip_torques(brakes, state, scratch.torque_yield[0], lagged)
        last = slip_torques(brakes, state, scratch.torque_yield[1], lagged)
    on_joints, at_end = middle, last
    if mechanism.coupled != 0:
        on_joints, at_end = torques_on_joints(mechanism, middle), torques_on_joints(mechanism, last)
    half = 0.5 * dt
    px, py = prescribed_force(hand, t + half)
    qx, qy = prescribed_force(hand, t + dt)
    x, y, vx, vy = state.tip[0], state.tip[1], state.tip[2], state.tip[3]
    ax1, ay1 = state.acceleration[0], state.acceleration[1]
    x2, y2, vx2, vy2 = x + half * vx, y + half * vy, vx + half * ax1, vy + half * ay1
    ax2, ay2, torque2, hx2, hy2, q2 = stage(mechanism, grip, held, on_joints, px, py, x2, y2, vx2, vy2)
    x3, y3, vx3, vy3 = x + half * vx2, y + half * vy2, vx + half * ax2, vy + half * ay2
    ax3, ay3, torque3, hx3, hy3, q3 = stage(mechanism, grip, held, on_joints, px, py, x3, y3, vx3, vy3)
    x4, y4, vx4, vy4 = x + dt * vx3, y + dt * vy3, vx + dt * ax3, vy + dt * ay3
    ax4, ay4, _, hx4, hy4, q4 = stage(mechanism, grip, held, at_end, qx, qy, x4, y4, vx4, vy4)
    sixth = dt / 6.0
    scratch.tip[0] = x + sixth * (vx + 2.0 * (vx2 + vx3) + vx4)
    scratch.tip[1] = y + sixth * (vy + 2.0 * (vy2 + vy3) + vy4)
    scratch.tip[2] = vx + sixth * (ax1 + 2.0 * (ax2 + ax3) + ax4)
    scratch.tip[3] = vy + sixth * (ay1 + 2.0 * (ay2 + ay3) + ay4)
    scratch.work = sixth * (
        state.hand_force[0] * vx
        + state.hand_force[1] * vy
        + 2.0 * (hx2 * vx2 + hy2 * vy2 + hx3 * vx3 + hy3 * vy3)
        + hx4 * vx4
        + hy4 * vy4
    )
    rate = state.rate
    turned, heat = scratch.turned, scratch.heat
    p2, p3, p4, r2, r3, r4 = q2.arm_1, q3.arm_1, q4.arm_1, q2.arm_2, q3.arm_2, q4.arm_2
    a, e = (p2.base_rate, p3.base_rate, p4.base_rate), (p2.elbow_rate, p3.elbow_rate, p4.elbow_rate)
    b, c = (r2.base_rate, r3.base_rate, r4.base_rate), (r2.elbow_rate, r3.elbow_rate, r4.elbow_rate)
    if mechanism.coupled != 0:
        e, c = coupled_rates(mechanism, 1, a, b, e), coupled_rates(mechanism, 3, a, b, c)
    turned[0], heat[0] = booked(sixth, first[0], middle[0], last[0], rate[0], a)
    turned[1], heat[1] = booked(sixth, first[1], middle[1], last[1], rate[1], e)
    turned[2], heat[2] = booked(sixth, first[2], middle[2], last[2], rate[2], b)
    turned[3], heat[3] = booked(sixth, first[3], middle[3], last[3], rate[3], c)
    scratch.middle_torque = 0.5 * (torque2 + torque3)
    put_back = keep_on_line(mechanism, state, scratch, held) if held >= 0 else 0.0
    tip = scratch.tip
    ax, ay, torque, hx, hy, end = stage(mechanism, grip, held, at_end, qx, qy, tip[0], tip[1], tip[2], tip[3])
    scratch.error = abs(ax - ax4) + abs(ay - ay4) + (put_back / dt if put_back > 0.0 else 0.0)
    scratch.acceleration[0], scratch.acceleration[1] = ax, ay
    scratch.hand_force[0], scratch.hand_force[1] = hx, hy
    scratch.line_torque = torque
    scratch.s_1, scratch.s_2 = end.arm_1.s, end.arm_2.s
    store(mechanism, scratch, end)
    m1, m2 = mechanism.arm_1, mechanism.arm_2
    limit = REACH * mechanism.margin
    least_1 = min(min(abs(p2.s), abs(p3.s)), min(abs(p4.s), abs(end.arm_1.s)))
    least_2 = min(min(abs(r2.s), abs(r3.s)), min(abs(r4.s), abs(end.arm_2.s)))
    if held >= 0:
        scratch.rate[held] = 0.0
    area_1, area_2 = m1.length_1 * m1.length_2, m2.length_1 * m2.length_2
    if least_1 < NEAR_SINGULAR * area_1 or least_2 < NEAR_SINGULAR * area_2:
        scratch.error = max(scratch.error, energy_error(state, scratch) * (STEP_ERROR / ENERGY_ERROR))
    closes = least_1 > limit * area_1 and least_2 > limit * area_2
    return closes and math.isfinite(tip[0] + tip[1] + tip[2] + tip[3])


@inlined
def torques_on_joints(mechanism, torques):
    """Torques on the joints A, E, B, C by brakes with `torques`, some of which act through couplings on A and B."""
    a, e, b, c = torques
    combination = mechanism.combination
    a += combination[1, 0] * e + combination[3, 0] * c
    b += combination[1, 1] * e + combination[3, 1] * c
    return a, 0.0 if mechanism.coupled & 2 != 0 else e, b, 0.0 if mechanism.coupled & 8 != 0 else c


@inlined
def coupled_rates(mechanism, i, a, b, own):
    """Rates of brake i in three stages, from those of the base joints where it is coupled, else its joint's own."""
    if mechanism.coupled >> i & 1 == 0:
        return own
    x, y = mechanism.combination[i, 0], mechanism.combination[i, 1]
    return x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2]


@inlined
def booked(sixth, first, middle, last, w1, later):
    """Angle that a joint turned (rad) and its heat (J) over the step, from torques and rates of the four stages."""
    w2, w3, w4 = later
    turned = sixth * (w1 + 2.0 * (w2 + w3) + w4)
    return turned, -sixth * (first * w1 + 2.0 * middle * (w2 + w3) + last * w4)


@kernel
def kinetic(at):
    """Kinetic energy (J) of the device in a state or after a tried step, without any arm mass beyond the sensor."""
    m, v = at.mass, at.tip
    return 0.5 * (m[0] * v[2] * v[2] + 2.0 * m[1] * v[2] * v[3] + m[2] * v[3] * v[3])


@kernel
def energy_error(state, scratch):
    """What the ledger of the tried step leaves unexplained, share of the energy that changed hands."""
    heat = scratch.heat[0] + scratch.heat[1] + scratch.heat[2] + scratch.heat[3]
    made, work = kinetic(scratch) - kinetic(state), scratch.work
    return abs(made + heat - work) / (abs(made) + abs(heat) + abs(work) + LEAST_ENERGY)


@kernel
def keep_on_line(mechanism, state, at, j):
    """Put a tip back on the SDOF path of held joint j, position and velocity (removes the method's error only).

    Returns the speed that this took away, m/s.
    """
    tip = at.tip
    if on_circle(mechanism, j):
        rx, ry = tip[0] - state.circle[0], tip[1] - state.circle[1]
        one_over = 1.0 / math.sqrt(rx * rx + ry * ry)
        nx, ny = rx * one_over, ry * one_over
        tip[0], tip[1] = state.circle[0] + state.circle[2] * nx, state.circle[1] + state.circle[2] * ny
    else:
        nx, ny = keep_angle(mechanism, state, tip, j)
    along = nx * tip[2] + ny * tip[3]
    tip[2] -= along * nx
    tip[3] -= along * ny
    return abs(along)


@kernel
def keep_angle(mechanism, state, tip, j):
    """Move the tip along the row of D or of coupling j to where its angle is held; the unit normal of that path there.

    D is held at the margin between the distal links, a coupling at the angle at which it stuck.
    """
    gx, gy = 1.0, 0.0
    for _ in range(4):  # Newton steps from a place that is off by the method's error only
        q = motion(mechanism, tip[0], tip[1], 0.0, 0.0)
        gx, gy, _ = row_of(mechanism, q, j)
        square = gx * gx + gy * gy
        if j == 4:
            off = off_margin(mechanism, state, q)
        else:
            turned = (state.circle[0] - coupled_angle(mechanism, j, tip[0], tip[1])) / (2.0 * math.pi)
            off = 2.0 * math.pi * (turned - math.floor(turned + 0.5))
        tip[0] += gx * off / square
        tip[1] += gy * off / square
        if abs(off) < 1e-9:
            break
    one_over = 1.0 / math.sqrt(gx * gx + gy * gy)
    return gx * one_over, gy * one_over


@kernel
def off_margin(mechanism, state, q):
    """How far D is from the margin between the distal links in a `Motion` (rad)."""
    m1, m2, p, r = mechanism.arm_1, mechanism.arm_2, q.arm_1, q.arm_2
    sine = p.s * r.s * (p.base_x * r.base_y - p.base_y * r.base_x) / (m1.length_2 * m2.length_2)
    cosine = p.s * r.s * (p.base_x * r.base_x + p.base_y * r.base_y) / (m1.length_2 * m2.length_2)
    target = math.asin(mechanism.margin)
    if cosine < 0.0:
        target = math.pi - target
    return state.distal_side * target - math.atan2(sine, cosine)
