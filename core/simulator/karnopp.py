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
def friction(mechanism, state, force, mass):
    """Torques and acceleration by Eq. (6) under a force (hand minus velocity terms, N); fills held, sign, torque.

    mass: xx, xy, yy of tip and arm together, kg.
    Joints inside the band are stuck until their torque exceeds what they hold; then the worst of them slips, in the
    sense in which it was pushed, and the rest are solved again.
    """
    g, torque, sign = state.g, state.torque, state.sign
    for i in range(PLACES):
        torque[i] = sign[i] = 0.0
        can_hold = state.active[i] != 0 and (state.cost_plus[i] > 0.0 or state.cost_minus[i] > 0.0)
        if state.active[i] == 0 or (can_hold and abs(state.rate[i]) < state.delta_omega):
            continue
        sign[i] = 1.0 if state.rate[i] > 0.0 else -1.0
        limit = state.cost_plus[i] if sign[i] > 0.0 else state.cost_minus[i]
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
        hold(mechanism, state, (rx, ry), mass)
        worst, most = -1, 1.0 + HELD_ROUNDING
        for i in range(PLACES):
            if state.active[i] != 0 and sign[i] == 0.0:
                limit = state.cost_minus[i] if torque[i] > 0.0 else state.cost_plus[i]
                if abs(torque[i]) > most * limit:
                    worst, most = i, abs(torque[i]) / limit if limit > 0.0 else math.inf
        if worst < 0:
            break
        sign[worst] = -1.0 if torque[worst] > 0.0 else 1.0
        torque[worst] = state.cost_minus[worst] if torque[worst] > 0.0 else -state.cost_plus[worst]
    if state.held == STILL:
        return 0.0, 0.0
    rx, ry = force
    for i in range(PLACES):
        rx += g[i, 0] * torque[i]
        ry += g[i, 1] * torque[i]
    return solve_mass(mass[0], mass[1], mass[2], rx, ry)


@kernel
def hold(mechanism, state, force, mass):
    """Torques of the stuck joints (active, sign 0) that make their accelerations zero under a force (N); sets held.

    Two rows that are not parallel hold the tip (its velocity terms inside the band are of order delta_omega^2 and left
    out); else the joints are on one line and hold it together.
    """
    rx, ry = force
    g, torque, lines = state.g, state.torque, mechanism.lines
    lead, several = -1, False
    sxx = sxy = syy = 0.0
    nx, ny = -rx, -ry  # what the joints must exert together, less the middles of their ranges
    for i in range(PLACES):
        if state.active[i] == 0 or state.sign[i] != 0.0:
            continue
        if lead < 0:
            lead = i
        elif not same_line(i, lead, lines):
            several = True
        middle, half = reach_of(state, i)
        nx -= g[i, 0] * middle
        ny -= g[i, 1] * middle
        sxx += half * half * g[i, 0] * g[i, 0]
        sxy += half * half * g[i, 0] * g[i, 1]
        syy += half * half * g[i, 1] * g[i, 1]
    state.held = lead if lead >= 0 else FREE
    if lead < 0:
        return
    det = sxx * syy - sxy * sxy
    if several and det > PARALLEL_ROWS * sxx * syy:
        state.held = STILL
        zx, zy = (syy * nx - sxy * ny) / det, (sxx * ny - sxy * nx) / det
        for i in range(PLACES):
            if state.active[i] != 0 and state.sign[i] == 0.0:
                middle, half = reach_of(state, i)
                torque[i] = middle + half * half * (g[i, 0] * zx + g[i, 1] * zy)
        return
    rest = holding_torque(mass, (g[lead, 0], g[lead, 1]), state.bias[lead], (rx, ry))
    square = g[lead, 0] * g[lead, 0] + g[lead, 1] * g[lead, 1]
    weight = 0.0
    for i in range(PLACES):
        if state.active[i] != 0 and state.sign[i] == 0.0:
            ratio = (g[i, 0] * g[lead, 0] + g[i, 1] * g[lead, 1]) / square
            middle, half = reach_of(state, i)
            rest -= ratio * middle
            weight += ratio * ratio * half * half
    for i in range(PLACES):
        if state.active[i] != 0 and state.sign[i] == 0.0:
            ratio = (g[i, 0] * g[lead, 0] + g[i, 1] * g[lead, 1]) / square
            middle, half = reach_of(state, i)
            torque[i] = middle + (half * half * ratio * rest / weight if weight > 0.0 else 0.0)


@kernel
def evaluate(model, data, t, p, v):
    """Evaluate a stage at time t (s), tip p (2,), m, and velocity v (2,), m/s.

    Fills the state's rows, rates, torques, acceleration and sensed hand force; returns the acceleration.
    """
    (x, y), (vx, vy), mechanism, hand, state = p, v, model.mechanism, data.hand, data.state
    q = motion(mechanism, x, y, vx, vy)
    store(mechanism, state, q)
    set_costs(model.brakes, state)
    arm_mass = hand.grips[0].mass
    fx, fy = hand_force(hand, t, x, y, vx, vy)
    mass = q.mass_xx + arm_mass, q.mass_xy, q.mass_yy + arm_mass
    ax, ay = friction(mechanism, state, (fx - q.bias_x, fy - q.bias_y), mass)
    state.acceleration[0], state.acceleration[1] = ax, ay
    state.hand_force[0], state.hand_force[1] = fx - arm_mass * ax, fy - arm_mass * ay
    return ax, ay


@kernel
def add_stage_to_ledger(state, scratch, vx, vy, share):
    """Add to the ledger the power of the hand and of each brake at a stage, times its share of the step (s)."""
    state.work_hand += share * (state.hand_force[0] * vx + state.hand_force[1] * vy)
    for i in range(4):
        scratch.heat[i] -= share * state.torque[i] * state.rate[i]
        scratch.turned[i] += share * state.rate[i]


@kernel
def resolve_in_band(model, data, t):
    """Stage: torques by Eq. (6) at time t for the yields now in the state."""
    tip = data.state.tip
    evaluate(model, data, t, (tip[0], tip[1]), (tip[2], tip[3]))
    leave_stops_their_share(data.state)


@kernel
def advance_karnopp(model, data, currents, t, h):
    """Move the state from t to t + h (s) by one RK4 step, friction by Eq. (6) in every stage."""
    mechanism, brakes, state, scratch = model.mechanism, model.brakes, data.state, data.scratch
    tip, arm_mass = state.tip, data.hand.grips[0].mass
    begin_lags(brakes, state, scratch.lag, currents, 1 if model.fidelity == MR else 0)
    for i in range(4):
        scratch.heat[i] = scratch.turned[i] = 0.0
    x, y, vx, vy = tip[0], tip[1], tip[2], tip[3]
    sixth, half = h / 6.0, 0.5 * h
    ax, ay = evaluate(model, data, t, (x, y), (vx, vy))
    add_stage_to_ledger(state, scratch, vx, vy, sixth)
    ux, uy = vx + half * ax, vy + half * ay
    age_yields(state, scratch.lag, half)
    bx, by = evaluate(model, data, t + half, (x + half * vx, y + half * vy), (ux, uy))
    add_stage_to_ledger(state, scratch, ux, uy, 2.0 * sixth)
    wx, wy = vx + half * bx, vy + half * by
    cx, cy = evaluate(model, data, t + half, (x + half * ux, y + half * uy), (wx, wy))
    add_stage_to_ledger(state, scratch, wx, wy, 2.0 * sixth)
    zx, zy = vx + h * cx, vy + h * cy
    age_yields(state, scratch.lag, h)
    dx, dy = evaluate(model, data, t + h, (x + h * wx, y + h * wy), (zx, zy))
    add_stage_to_ledger(state, scratch, zx, zy, sixth)
    tip[0] = x + sixth * (vx + 2.0 * (ux + wx) + zx)
    tip[1] = y + sixth * (vy + 2.0 * (uy + wy) + zy)
    tip[2] = vx + sixth * (ax + 2.0 * (bx + cx) + dx)
    tip[3] = vy + sixth * (ay + 2.0 * (by + cy) + dy)
    for i in range(4):
        state.heat[i] += scratch.heat[i]
        if brakes.present[i] > 0.0:
            state.added_by_brakes = max(state.added_by_brakes, -scratch.heat[i])
        if brakes.play[i] > 0.0:
            drift_in_backlash(brakes, state, i, scratch.turned[i])
    for j in range(PLACES):
        if state.sign[j] != 0.0:
            state.contact[j] = 0.0  # it leaves its stop
        elif state.contact[j] != 0.0:
            if state.held == STILL:
                tip[0], tip[1], tip[2], tip[3] = x, y, 0.0, 0.0  # held against a stop: nothing creeps
            else:
                keep_on_line(mechanism, state, state, j)
    struck = stop_on_the_way(mechanism, state, scratch, (x, y), h, arm_mass)
    if struck >= 0:
        enter_line(mechanism, state, struck)
    store(mechanism, state, motion(mechanism, tip[0], tip[1], tip[2], tip[3]))
