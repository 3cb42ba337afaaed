"""The `karnopp` integrator: the paper's friction model, Eq. (6), in a fixed-step RK4. For comparison.

    tau_i = tau_yield     where |omega_i| >= delta_omega, or where the applied torque exceeds the yield
    tau_i = tau_applied   else: the brake sticks; tau_applied is what makes the accelerations of the stuck joints zero

Every stage decides for itself, as in a fixed-step Simulink model, and no event is located. So the order is one across
events, and a stuck joint keeps the rate that it had inside the band: it creeps, by at most
delta_omega (`event` and `stepping` hold the angle instead; hard stops do here, too). A brake so strong that one step
carries its joint across the whole band never sticks but chatters; see DELTA_OMEGA.

Three or more stuck brakes: the paper refers to a lumped-actuator approach that it does not give. Our choice: the split
of load_sharing.py, least sum of (torque / yield)^2; the brake that this overloads most slips at its yield, and the
others share the rest.
"""

import math

from core.dynamics import motion
from core.kernels import kernel
from core.mechanism import PLACES
from core.simulator.hand import hand_force
from core.simulator.lag import age_yields, begin_lags
from core.simulator.load_sharing import leave_stops_their_share, reach_of
from core.simulator.runge_kutta import keep_on_line
from core.simulator.solver_numbers import HELD_ROUNDING, PARALLEL_ROWS
from core.simulator.state import MR
from core.simulator.stepping import drift_in_backlash, stop_on_the_way
from core.simulator.stick_slip import FREE, STILL, holding_torque, same_line, solve_mass
from core.simulator.stick_slip_mode import enter_line, set_costs, store


@kernel
def friction(mechanism, body, braking, force, mass):
    """Torques and acceleration by Eq. (6) under a force (hand minus velocity terms, N); fills held, sign, torque.

    mass: xx, xy, yy of tip and arm together, kg.
    Joints inside the band are stuck until their torque exceeds what they hold; then the worst of them slips, in the
    sense in which it was pushed, and the rest are solved again.
    """
    g, torque, sign = body.g, braking.torque, body.sign
    for i in range(PLACES):
        torque[i] = sign[i] = 0.0
        can_hold = braking.active[i] != 0 and (braking.cost_plus[i] > 0.0 or braking.cost_minus[i] > 0.0)
        if braking.active[i] == 0 or (can_hold and abs(body.rate[i]) < body.delta_omega):
            continue
        sign[i] = 1.0 if body.rate[i] > 0.0 else -1.0
        limit = braking.cost_plus[i] if sign[i] > 0.0 else braking.cost_minus[i]
        if math.isinf(limit):
            sign[i] = 0.0  # a stop holds however fast it is approached
        else:
            torque[i] = -sign[i] * limit
    for _ in range(6):
        rx, ry = force
        for i in range(PLACES):
            if sign[i] != 0.0:
                rx += g[i, 0] * torque[i]
                ry += g[i, 1] * torque[i]
        hold(mechanism, body, braking, (rx, ry), mass)
        worst, most = -1, 1.0 + HELD_ROUNDING
        for i in range(PLACES):
            if braking.active[i] != 0 and sign[i] == 0.0:
                limit = braking.cost_minus[i] if torque[i] > 0.0 else braking.cost_plus[i]
                if abs(torque[i]) > most * limit:
                    worst, most = i, abs(torque[i]) / limit if limit > 0.0 else math.inf
        if worst < 0:
            break
        sign[worst] = -1.0 if torque[worst] > 0.0 else 1.0
        torque[worst] = braking.cost_minus[worst] if torque[worst] > 0.0 else -braking.cost_plus[worst]
    if body.held == STILL:
        return 0.0, 0.0
    rx, ry = force
    for i in range(PLACES):
        rx += g[i, 0] * torque[i]
        ry += g[i, 1] * torque[i]
    return solve_mass(mass[0], mass[1], mass[2], rx, ry)


@kernel
def hold(mechanism, body, braking, force, mass):
    """Torques of the stuck joints (active, sign 0) that make their accelerations zero under a force (N); sets held.

    Two rows that are not parallel hold the tip (its velocity terms inside the band are of order delta_omega^2 and left
    out); else the joints are on one line and hold it together.
    """
    rx, ry = force
    g, torque, lines = body.g, braking.torque, mechanism.lines
    lead, several = -1, False
    sxx = sxy = syy = 0.0
    nx, ny = -rx, -ry  # what the joints must exert together, less the middles of their ranges
    for i in range(PLACES):
        if braking.active[i] == 0 or body.sign[i] != 0.0:
            continue
        if lead < 0:
            lead = i
        elif not same_line(i, lead, lines):
            several = True
        middle, half = reach_of(braking, i)
        nx -= g[i, 0] * middle
        ny -= g[i, 1] * middle
        sxx += half * half * g[i, 0] * g[i, 0]
        sxy += half * half * g[i, 0] * g[i, 1]
        syy += half * half * g[i, 1] * g[i, 1]
    body.held = lead if lead >= 0 else FREE
    if lead < 0:
        return
    det = sxx * syy - sxy * sxy
    if several and det > PARALLEL_ROWS * sxx * syy:
        body.held = STILL
        zx, zy = (syy * nx - sxy * ny) / det, (sxx * ny - sxy * nx) / det
        for i in range(PLACES):
            if braking.active[i] != 0 and body.sign[i] == 0.0:
                middle, half = reach_of(braking, i)
                torque[i] = middle + half * half * (g[i, 0] * zx + g[i, 1] * zy)
        return
    rest = holding_torque(mass, (g[lead, 0], g[lead, 1]), body.bias[lead], (rx, ry))
    square = g[lead, 0] * g[lead, 0] + g[lead, 1] * g[lead, 1]
    weight = 0.0
    for i in range(PLACES):
        if braking.active[i] != 0 and body.sign[i] == 0.0:
            ratio = (g[i, 0] * g[lead, 0] + g[i, 1] * g[lead, 1]) / square
            middle, half = reach_of(braking, i)
            rest -= ratio * middle
            weight += ratio * ratio * half * half
    for i in range(PLACES):
        if braking.active[i] != 0 and body.sign[i] == 0.0:
            ratio = (g[i, 0] * g[lead, 0] + g[i, 1] * g[lead, 1]) / square
            middle, half = reach_of(braking, i)
            torque[i] = middle + (half * half * ratio * rest / weight if weight > 0.0 else 0.0)


@kernel
def evaluate(model, data, t, p, v):
    """Evaluate a stage at time t (s), tip p (2,), m, and velocity v (2,), m/s.

    Fills rows, rates, torques, acceleration and sensed hand force; returns the acceleration.
    """
    (x, y), (vx, vy), mechanism, hand, body, braking = p, v, model.mechanism, data.hand, data.body, data.braking
    q = motion(mechanism, x, y, vx, vy)
    store(mechanism, body, q)
    set_costs(model.brakes, body, braking)
    arm_mass = hand.grips[0].mass
    fx, fy = hand_force(hand, t, x, y, vx, vy)
    mass = q.mass_xx + arm_mass, q.mass_xy, q.mass_yy + arm_mass
    ax, ay = friction(mechanism, body, braking, (fx - q.bias_x, fy - q.bias_y), mass)
    body.acceleration[0], body.acceleration[1] = ax, ay
    body.hand_force[0], body.hand_force[1] = fx - arm_mass * ax, fy - arm_mass * ay
    return ax, ay


@kernel
def add_stage_to_ledger(data, vx, vy, share):
    """Add to the ledger the power of the hand and of each brake at a stage, times its share of the step (s)."""
    body, braking, ledger, scratch = data.body, data.braking, data.ledger, data.scratch
    ledger.work_hand += share * (body.hand_force[0] * vx + body.hand_force[1] * vy)
    for i in range(4):
        scratch.heat[i] -= share * braking.torque[i] * body.rate[i]
        scratch.turned[i] += share * body.rate[i]


@kernel
def resolve_in_band(model, data, t):
    """Stage: torques by Eq. (6) at time t for the yields now in the state."""
    tip = data.body.tip
    evaluate(model, data, t, (tip[0], tip[1]), (tip[2], tip[3]))
    leave_stops_their_share(data.body, data.braking)


@kernel
def advance_karnopp(model, data, currents, t, h):
    """Move the state from t to t + h (s) by one RK4 step, friction by Eq. (6) in every stage."""
    mechanism, brakes, scratch = model.mechanism, model.brakes, data.scratch
    body, braking, ledger, tip = data.body, data.braking, data.ledger, data.body.tip
    begin_lags(brakes, body, braking, scratch.lag, currents, 1 if model.fidelity == MR else 0)
    for i in range(4):
        scratch.heat[i] = scratch.turned[i] = 0.0
    x, y, vx, vy = tip[0], tip[1], tip[2], tip[3]
    sixth, half = h / 6.0, 0.5 * h
    ax, ay = evaluate(model, data, t, (x, y), (vx, vy))
    add_stage_to_ledger(data, vx, vy, sixth)
    ux, uy = vx + half * ax, vy + half * ay
    age_yields(braking, scratch.lag, half)
    bx, by = evaluate(model, data, t + half, (x + half * vx, y + half * vy), (ux, uy))
    add_stage_to_ledger(data, ux, uy, 2.0 * sixth)
    wx, wy = vx + half * bx, vy + half * by
    cx, cy = evaluate(model, data, t + half, (x + half * ux, y + half * uy), (wx, wy))
    add_stage_to_ledger(data, wx, wy, 2.0 * sixth)
    zx, zy = vx + h * cx, vy + h * cy
    age_yields(braking, scratch.lag, h)
    dx, dy = evaluate(model, data, t + h, (x + h * wx, y + h * wy), (zx, zy))
    add_stage_to_ledger(data, zx, zy, sixth)
    tip[0] = x + sixth * (vx + 2.0 * (ux + wx) + zx)
    tip[1] = y + sixth * (vy + 2.0 * (uy + wy) + zy)
    tip[2] = vx + sixth * (ax + 2.0 * (bx + cx) + dx)
    tip[3] = vy + sixth * (ay + 2.0 * (by + cy) + dy)
    for i in range(4):
        ledger.heat[i] += scratch.heat[i]
        if brakes.present[i] > 0.0:
            ledger.added_by_brakes = max(ledger.added_by_brakes, -scratch.heat[i])
        if brakes.play[i] > 0.0:
            drift_in_backlash(brakes, braking, i, scratch.turned[i])
    for j in range(PLACES):
        if body.sign[j] != 0.0:
            body.contact[j] = 0.0  # it leaves its stop
        elif body.contact[j] != 0.0:
            if body.held == STILL:
                tip[0], tip[1], tip[2], tip[3] = x, y, 0.0, 0.0  # held against a stop: nothing creeps
            else:
                keep_on_line(mechanism, body, body, j)
    struck = stop_on_the_way(mechanism, data, (x, y), h)
    if struck >= 0:
        enter_line(mechanism, body, struck)
    store(mechanism, body, motion(mechanism, tip[0], tip[1], tip[2], tip[3]))
