"""Smooth motion between events: one fixed-step RK4 in tip coordinates with the pattern of stick and slip held fixed.

The pattern: a slipping brake pushes with a known torque against its sense, a stuck one is the constraint
g . a = -gdot . v. Work, heat and joint angles are integrated with the same stages, so the ledger closes to the
order of the method.
"""

import math

import numpy as np

from core.dynamics import combined, motion
from core.kernels import inlined, kernel
from core.linkage import coupled_angle
from core.mechanism import PLACES, STOP_E, D
from core.simulator.hand import grip_force, prescribed_force
from core.simulator.lag import LAG, begin_stages, end_stages, lagging_torques, next_stage
from core.simulator.solver_numbers import ENERGY_ERROR, LEAST_ENERGY, NEAR_SINGULAR, REACH, STEP_ERROR
from core.simulator.state import MOTION
from core.simulator.stick_slip import solve_mass
from core.simulator.stick_slip_mode import distal_row, on_circle, slip_torque, store

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
        ("lag", LAG),
        # only where there is a lag
        ("torque_yield", "f8", (4,)),  # N m, at the end of the step
        ("steady", "f8", (4,)),  # N m, torque of a slipping brake whose yield has come to K
        ("swing", "f8", (4,)),  # N m, so much more while all of the yield's lack is left
        ("left", "f8", (2, 4)),  # share of the lack in the middle of the step, and at its end
        ("per_lag", "f8", (3, 4)),  # 1/s, 1/a in the later stages
        ("seen", "i8"),  # bits of the kinds of events that need not be looked for any more
        # work space of the stops
        ("theta", "f8", (4,)),
        ("gap", "f8", (PLACES,)),
        ("gap_side", "f8", (PLACES,)),
    ]
)


@inlined
def slip_torques(body, braking):
    """Torques of the slipping brakes A, E, B, C, N m, at the start of a step; 0 for the others."""
    a, e = slip_torque(body, braking, 0), slip_torque(body, braking, 1)
    return a, e, slip_torque(body, braking, 2), slip_torque(body, braking, 3)


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
def stage(mechanism, grip, held, slip, prescribed, tip):
    """One evaluation of the equations of motion under a prescribed force (N) and the grip; tip: x, y, vx, vy.

    Returns (ax, ay, holding torque, sensed hand force fx, fy, Motion).
    """
    x, y, vx, vy = tip
    q = motion(mechanism, x, y, vx, vy)
    sx, sy = grip_force(grip, x, y, vx, vy)
    fx, fy, arm_mass = prescribed[0] + sx, prescribed[1] + sy, grip.mass
    p, r = q.arm_1, q.arm_2
    if mechanism.coupled != 0:
        slip = torques_on_joints(mechanism, slip)
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
def rk4(model, data, t, dt):
    """One RK4 step of dt seconds from `body` into `scratch`; False where a stage left the region where the arms close.

    The first stage is the acceleration that the body already has; the last evaluation, at the end, is the next
    step's first.
    """
    mechanism, hand, body, braking, scratch = model.mechanism, data.hand, data.body, data.braking, data.scratch
    grip = hand.grips[0]
    held = body.held
    first = slip_torques(body, braking)
    torques2 = torques3 = torques4 = last = first
    if scratch.lag.lagging != 0:
        begin_stages(model.brakes, body, braking, scratch, dt)
        torques2 = lagging_torques(scratch, 0)
    half = 0.5 * dt
    in_the_middle, at_the_end = prescribed_force(hand, t + half), prescribed_force(hand, t + dt)
    x, y, vx, vy = body.tip[0], body.tip[1], body.tip[2], body.tip[3]
    ax1, ay1 = body.acceleration[0], body.acceleration[1]
    x2, y2, vx2, vy2 = x + half * vx, y + half * vy, vx + half * ax1, vy + half * ay1
    ax2, ay2, torque2, hx2, hy2, q2 = stage(mechanism, grip, held, torques2, in_the_middle, (x2, y2, vx2, vy2))
    rates2 = rates_of(mechanism, q2)
    if scratch.lag.lagging != 0:
        next_stage(body, scratch, rates2, half, 0)
        torques3 = lagging_torques(scratch, 0)
    x3, y3, vx3, vy3 = x + half * vx2, y + half * vy2, vx + half * ax2, vy + half * ay2
    ax3, ay3, torque3, hx3, hy3, q3 = stage(mechanism, grip, held, torques3, in_the_middle, (x3, y3, vx3, vy3))
    rates3 = rates_of(mechanism, q3)
    if scratch.lag.lagging != 0:
        next_stage(body, scratch, rates3, dt, 1)
        torques4 = lagging_torques(scratch, 1)
    x4, y4, vx4, vy4 = x + dt * vx3, y + dt * vy3, vx + dt * ax3, vy + dt * ay3
    ax4, ay4, _, hx4, hy4, q4 = stage(mechanism, grip, held, torques4, at_the_end, (x4, y4, vx4, vy4))
    rates4 = rates_of(mechanism, q4)
    if scratch.lag.lagging != 0:
        end_stages(body, scratch, rates4, dt)
        last = lagging_torques(scratch, 1)
    sixth = dt / 6.0
    scratch.tip[0] = x + sixth * (vx + 2.0 * (vx2 + vx3) + vx4)
    scratch.tip[1] = y + sixth * (vy + 2.0 * (vy2 + vy3) + vy4)
    scratch.tip[2] = vx + sixth * (ax1 + 2.0 * (ax2 + ax3) + ax4)
    scratch.tip[3] = vy + sixth * (ay1 + 2.0 * (ay2 + ay3) + ay4)
    scratch.work = sixth * (
        body.hand_force[0] * vx
        + body.hand_force[1] * vy
        + 2.0 * (hx2 * vx2 + hy2 * vy2 + hx3 * vx3 + hy3 * vy3)
        + hx4 * vx4
        + hy4 * vy4
    )
    for i in range(4):
        w1, w2, w3, w4 = body.rate[i], rates2[i], rates3[i], rates4[i]
        scratch.turned[i] = sixth * (w1 + 2.0 * (w2 + w3) + w4)
        taken = first[i] * w1 + 2.0 * (torques2[i] * w2 + torques3[i] * w3) + torques4[i] * w4
        scratch.heat[i] = -sixth * taken
    scratch.middle_torque = 0.5 * (torque2 + torque3)
    put_back = keep_on_line(mechanism, body, scratch, held) if held >= 0 else 0.0
    tip = scratch.tip
    arrived = tip[0], tip[1], tip[2], tip[3]
    ax, ay, torque, hx, hy, end = stage(mechanism, grip, held, last, at_the_end, arrived)
    scratch.error = abs(ax - ax4) + abs(ay - ay4) + (put_back / dt if put_back > 0.0 else 0.0)
    scratch.acceleration[0], scratch.acceleration[1] = ax, ay
    scratch.hand_force[0], scratch.hand_force[1] = hx, hy
    scratch.line_torque = torque
    scratch.s_1, scratch.s_2 = end.arm_1.s, end.arm_2.s
    store(mechanism, scratch, end)
    m1, m2 = mechanism.arm_1, mechanism.arm_2
    limit = REACH * mechanism.margin
    least_1 = min(min(abs(q2.arm_1.s), abs(q3.arm_1.s)), min(abs(q4.arm_1.s), abs(end.arm_1.s)))
    least_2 = min(min(abs(q2.arm_2.s), abs(q3.arm_2.s)), min(abs(q4.arm_2.s), abs(end.arm_2.s)))
    if held >= 0:
        scratch.rate[held] = 0.0
    area_1, area_2 = m1.length_1 * m1.length_2, m2.length_1 * m2.length_2
    if least_1 < NEAR_SINGULAR * area_1 or least_2 < NEAR_SINGULAR * area_2:
        scratch.error = max(scratch.error, energy_error(body, scratch) * (STEP_ERROR / ENERGY_ERROR))
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
def rates_of(mechanism, q):
    """Rates of the brakes A, E, B, C in a `Motion` (rad/s)."""
    a, e, b, c = q.arm_1.base_rate, q.arm_1.elbow_rate, q.arm_2.base_rate, q.arm_2.elbow_rate
    coupled, combination = mechanism.coupled, mechanism.combination
    if coupled != 0:
        e = combination[1, 0] * a + combination[1, 1] * b if coupled & 2 != 0 else e
        c = combination[3, 0] * a + combination[3, 1] * b if coupled & 8 != 0 else c
    return a, e, b, c


@kernel
def kinetic(at):
    """Kinetic energy (J) of the device, now or after a tried step, without any arm mass beyond the sensor."""
    m, v = at.mass, at.tip
    return 0.5 * (m[0] * v[2] * v[2] + 2.0 * m[1] * v[2] * v[3] + m[2] * v[3] * v[3])


@kernel
def energy_error(body, scratch):
    """What the ledger of the tried step leaves unexplained, share of the energy that changed hands."""
    heat = scratch.heat[0] + scratch.heat[1] + scratch.heat[2] + scratch.heat[3]
    made, work = kinetic(scratch) - kinetic(body), scratch.work
    return abs(made + heat - work) / (abs(made) + abs(heat) + abs(work) + LEAST_ENERGY)


@kernel
def keep_on_line(mechanism, body, at, j):
    """Put a tip back on the SDOF path of held joint j, position and velocity (removes the method's error only).

    Returns the speed that this took away, m/s.
    """
    tip = at.tip
    if on_circle(mechanism, j):
        rx, ry = tip[0] - body.circle[0], tip[1] - body.circle[1]
        one_over = 1.0 / math.sqrt(rx * rx + ry * ry)
        nx, ny = rx * one_over, ry * one_over
        tip[0], tip[1] = body.circle[0] + body.circle[2] * nx, body.circle[1] + body.circle[2] * ny
    else:
        nx, ny = keep_angle(mechanism, body, tip, j)
    along = nx * tip[2] + ny * tip[3]
    tip[2] -= along * nx
    tip[3] -= along * ny
    return abs(along)


@kernel
def keep_angle(mechanism, body, tip, j):
    """Move the tip along the row of D or of coupling j to where its angle is held; the unit normal of that path there.

    D is held at the margin between the distal links, a coupling at the angle at which it stuck.
    """
    gx, gy = 1.0, 0.0
    for _ in range(4):  # Newton steps from a place that is off by the method's error only
        q = motion(mechanism, tip[0], tip[1], 0.0, 0.0)
        gx, gy, _ = row_of(mechanism, q, j)
        square = gx * gx + gy * gy
        if j == 4:
            off = off_margin(mechanism, body, q)
        else:
            turned = (body.circle[0] - coupled_angle(mechanism, j, tip[0], tip[1])) / (2.0 * math.pi)
            off = 2.0 * math.pi * (turned - math.floor(turned + 0.5))
        tip[0] += gx * off / square
        tip[1] += gy * off / square
        if abs(off) < 1e-9:
            break
    one_over = 1.0 / math.sqrt(gx * gx + gy * gy)
    return gx * one_over, gy * one_over


@kernel
def off_margin(mechanism, body, q):
    """How far D is from the margin between the distal links in a `Motion` (rad)."""
    m1, m2, p, r = mechanism.arm_1, mechanism.arm_2, q.arm_1, q.arm_2
    sine = p.s * r.s * (p.base_x * r.base_y - p.base_y * r.base_x) / (m1.length_2 * m2.length_2)
    cosine = p.s * r.s * (p.base_x * r.base_x + p.base_y * r.base_y) / (m1.length_2 * m2.length_2)
    target = math.asin(mechanism.margin)
    if cosine < 0.0:
        target = math.pi - target
    return body.distal_side * target - math.atan2(sine, cosine)
