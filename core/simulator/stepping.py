"""The `stepping` integrator: one implicit time step over velocities, first order.

    v+ = argmin 1/2 (v - v_free)' M (v - v_free) + h sum of costs
with the exact stick-slip solver; a spring-damper hand is taken implicitly, so no stiffness is too large. Near singular
positions a step is halved while the mass matrix changes much on its way, and may create no energy: so the motion stays
finite. A scene may choose it; `event` falls back to it.
"""

import math

from core.dynamics import motion
from core.kernels import kernel
from core.mechanism import PLACES
from core.simulator import solver_numbers as limits
from core.simulator.hand import cap_scale, hand_force, spring_force
from core.simulator.impact import hit_stop
from core.simulator.lag import age_yields, begin_lags
from core.simulator.runge_kutta import keep_on_line, kinetic
from core.simulator.state import MR
from core.simulator.stick_slip import STILL, same_line, solve_at_rest
from core.simulator.stick_slip_mode import enter_line, joints_of, set_costs, update_kinematics
from core.stops import stop_gap


@kernel
def stiffer_than(body, hand, step):
    """True where the hand's spring-damper is too stiff for an explicit step of that length."""
    grip = hand.grips[0]
    if grip.spring == 0:
        return False
    xx, xy, yy = body.mass[0], body.mass[1], body.mass[2]
    least = 0.5 * (xx + yy - math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)) + grip.mass  # eigenvalue
    k, d = grip.stiffness, grip.damping
    stiffness, damping = max(k[0], k[2]) + abs(k[1]), max(d[0], d[2]) + abs(d[1])
    return step * step * stiffness > limits.STIFF * limits.STIFF * least or step * damping > limits.STIFF * least


@kernel
def advance_stepping(model, data, currents, t, h):
    """Move the state from t to t + h (s) in implicit steps: one, or more where the tip goes a long way.

    Expects the state's quantities at t.
    """
    mechanism, body, braking, ledger, scratch = model.mechanism, data.body, data.braking, data.ledger, data.scratch
    lagged = 1 if model.fidelity == MR else 0
    body.settled = 0
    elapsed, step, halvings = 0.0, h, 0
    while elapsed < h:
        step = min(step, h - elapsed)
        begin_lags(model.brakes, body, braking, scratch.lag, currents, lagged)
        speed = implicit_velocity(model, data, t + elapsed, step)
        singular = near_singular(mechanism, body)
        if halvings < limits.MOST_HALVINGS and (
            speed * step > limits.LONGEST_WAY
            or (singular and singularity_change(mechanism, body, scratch) * step > limits.LARGEST_CHANGE)
        ):
            step *= 0.5
            halvings += 1
            continue
        before = balance(body, ledger) if singular else 0.0
        take_step(model, data, step)
        if singular:
            remove_created_energy(body, ledger, before)
        elapsed = h if step == h - elapsed else elapsed + step


@kernel
def near_singular(mechanism, body):
    """True where an elbow is nearly stretched or folded: |g| of its base joint is 1 / (proximal length sine)."""
    g, l_1, l_2 = body.g, mechanism.arm_1.length_1, mechanism.arm_2.length_1
    first = l_1 * l_1 * (g[0, 0] * g[0, 0] + g[0, 1] * g[0, 1])
    second = l_2 * l_2 * (g[2, 0] * g[2, 0] + g[2, 1] * g[2, 1])
    return max(first, second) * (limits.NEAR_SINGULAR * limits.NEAR_SINGULAR) > 1.0


@kernel
def singularity_change(mechanism, body, scratch):
    """How fast the sine of an elbow changes at the tried velocity, relative to itself (1/s); the larger."""
    g, ux, uy = body.g, scratch.tip[2], scratch.tip[3]
    q = motion(mechanism, body.tip[0], body.tip[1], 0.0, 0.0)
    e, c = q.arm_1.elbow_x * ux + q.arm_1.elbow_y * uy, q.arm_2.elbow_x * ux + q.arm_2.elbow_y * uy
    l_1, l_2 = mechanism.arm_1.length_1, mechanism.arm_2.length_1
    first = e * e * l_1 * l_1 * (g[0, 0] * g[0, 0] + g[0, 1] * g[0, 1])
    second = c * c * l_2 * l_2 * (g[2, 0] * g[2, 0] + g[2, 1] * g[2, 1])
    return math.sqrt(max(first, second))


@kernel
def implicit_velocity(model, data, t, h):
    """Velocity after an implicit step of h seconds into scratch.tip[2:]; its size (m/s). The state keeps its motion."""
    hand, body, braking, scratch = data.hand, data.body, data.braking, data.scratch
    tip, mass, grip = body.tip, body.mass, hand.grips[0]
    for i in range(4):
        scratch.torque_yield[i] = braking.torque_yield[i]
    age_yields(braking, scratch.lag, h)
    set_costs(model.brakes, body, braking)
    for i in range(4):
        braking.torque_yield[i] = scratch.torque_yield[i]
    vx, vy = tip[2] + body.carry[0], tip[3] + body.carry[1]
    mxx, mxy, myy = mass[0] + grip.mass, mass[1], mass[2] + grip.mass
    fx, fy = hand_force(hand, t + h, tip[0], tip[1], tip[2], tip[3])
    cxx = cxy = cyy = 0.0  # the hand's own resistance to a change of velocity, h (damping + h stiffness)
    if grip.spring != 0:
        sx, sy = spring_force(grip, tip[0], tip[1], tip[2], tip[3])
        if cap_scale(grip, sx, sy) == 1.0:
            cxx = h * (grip.damping[0] + h * grip.stiffness[0])
            cxy = h * (grip.damping[1] + h * grip.stiffness[1])
            cyy = h * (grip.damping[2] + h * grip.stiffness[2])
            fx -= h * (grip.stiffness[0] * vx + grip.stiffness[1] * vy)
            fy -= h * (grip.stiffness[1] * vx + grip.stiffness[2] * vy)
    px = (mxx + cxx) * vx + (mxy + cxy) * vy + h * (fx - body.bias_force[0])
    py = (mxy + cxy) * vx + (myy + cyy) * vy + h * (fy - body.bias_force[1])
    for i in range(PLACES):
        braking.cost_plus[i] *= h
        braking.cost_minus[i] *= h
    effective_mass = mxx + cxx, mxy + cxy, myy + cyy
    held, ux, uy = solve_at_rest(joints_of(model.mechanism, body, braking), effective_mass, (px, py), scratch.sign)
    scratch.held = held
    scratch.tip[2], scratch.tip[3] = ux, uy
    dvx, dvy = (ux - vx) / h, (uy - vy) / h
    scratch.acceleration[0], scratch.acceleration[1] = dvx, dvy
    scratch.hand_force[0] = fx - cxx * dvx - cxy * dvy - grip.mass * dvx
    scratch.hand_force[1] = fy - cxy * dvx - cyy * dvy - grip.mass * dvy
    return math.sqrt(ux * ux + uy * uy)


@kernel
def take_step(model, data, h):
    """Take the implicit step: move the tip, add to the ledger, and update the kinematics."""
    mechanism, body, braking, scratch = model.mechanism, data.body, data.braking, data.scratch
    tip = body.tip
    age_yields(braking, scratch.lag, h)
    for j in range(PLACES):
        body.sign[j] = scratch.sign[j]
        for k in range(2):
            scratch.g[j, k] = body.g[j, k]
    for k in range(2):
        body.carry[k] = 0.0
        body.acceleration[k], body.hand_force[k] = scratch.acceleration[k], scratch.hand_force[k]
    body.held = scratch.held
    if body.held >= 0:
        enter_line(mechanism, body, body.held)
    x, y = tip[0], tip[1]
    tip[2], tip[3] = scratch.tip[2], scratch.tip[3]
    displace(mechanism, data, h)
    add_to_ledger(model.brakes, data, tip[0] - x, tip[1] - y, h)
    update_kinematics(mechanism, body)


@kernel
def balance(body, ledger):
    """Energy (J) of the device less what the ledger gave it: constant but for the method's error."""
    heat = ledger.heat
    return kinetic(body) + heat[0] + heat[1] + heat[2] + heat[3] + ledger.lost_at_stops - ledger.work_hand


@kernel
def remove_created_energy(body, ledger, before):
    """Slow a tip that has more energy after a step than the ledger gave it: the mass matrix changed on the way."""
    created = balance(body, ledger) - before
    if created <= 0.0:
        return
    energy = kinetic(body)
    if created <= limits.CREATED * energy:
        return
    square = 1.0 - created / energy if created < energy else 0.0
    scale = math.sqrt(square)
    for i in range(2):
        body.tip[2 + i] *= scale
        body.carry[i] *= scale
        body.bias_force[i] *= square
    for j in range(PLACES):
        body.rate[j] *= scale
        body.bias[j] *= square


@kernel
def add_to_ledger(brakes, data, dx, dy, h):
    """Ledger and backlash of one implicit step over the way (dx, dy) that the tip went, by the rows at its start."""
    body, braking, ledger, scratch = data.body, data.braking, data.ledger, data.scratch
    ledger.work_hand += body.hand_force[0] * dx + body.hand_force[1] * dy
    for i in range(4):
        if brakes.present[i] > 0.0 and braking.active[i] != 0 and body.sign[i] != 0.0:
            turned = scratch.g[i, 0] * dx + scratch.g[i, 1] * dy
            cost = braking.cost_plus[i] if turned > 0.0 else braking.cost_minus[i]  # already times h
            if not math.isinf(cost):
                ledger.heat[i] += cost / h * abs(turned)
            if brakes.play[i] > 0.0:
                drift_in_backlash(brakes, braking, i, turned)


@kernel
def displace(mechanism, data, h):
    """Displace the tip by h v; stay on the held joint's SDOF path; hit a hard stop that lies in the way."""
    body, scratch = data.body, data.scratch
    tip = body.tip
    if body.held == STILL:
        return
    x, y = tip[0], tip[1]
    tip[0], tip[1] = x + h * tip[2], y + h * tip[3]
    if body.held >= 0:
        turn_to_path(mechanism, body, body.held)
    for j in range(PLACES):
        if not (body.held >= 0 and same_line(j, body.held, mechanism.lines)):
            body.contact[j] = 0.0
    stop_on_the_way(mechanism, data, (x, y), h)
    if beyond_a_stop(mechanism, body, scratch, tip[0], tip[1]):
        retreat(mechanism, body, scratch, x, y)
    for j in range(PLACES):
        if scratch.gap[j] <= limits.TOUCHING:
            body.contact[j] = scratch.gap_side[j]


@kernel
def turn_to_path(mechanism, body, j):
    """Put the displaced tip on the SDOF path of joint j and turn its velocity to the tangent there.

    What the turn took away stays in `carry` and goes back into the next step's momentum: the joint (or its stop) must
    provide it, a brake out of its yield, as in any time-stepping scheme.
    """
    tip = body.tip
    ux, uy = tip[2], tip[3]
    keep_on_line(mechanism, body, body, j)
    speed, kept = math.sqrt(ux * ux + uy * uy), math.sqrt(tip[2] * tip[2] + tip[3] * tip[3])
    if kept > 0.0:
        tip[2] *= speed / kept
        tip[3] *= speed / kept
    body.carry[0], body.carry[1] = ux - tip[2], uy - tip[3]


@kernel
def stop_on_the_way(mechanism, data, start, h):
    """Hit a hard stop between a start (m) and the tip and slide along it for the rest of the step; its joint, or -1."""
    body, ledger, scratch, arm_mass = data.body, data.ledger, data.scratch, data.hand.grips[0].mass
    tip, (x, y) = body.tip, start
    struck = worst_stop(mechanism, body, scratch, tip[0], tip[1])
    if struck < 0:
        return struck
    # bisect the way for the last place before the stop
    low, high = 0.0, 1.0
    ex, ey = tip[0] - x, tip[1] - y
    for _ in range(60):
        s = 0.5 * (low + high)
        j = worst_stop(mechanism, body, scratch, x + s * ex, y + s * ey)
        if j >= 0:
            high, struck = s, j
        else:
            low = s
    tip[0], tip[1] = x + low * ex, y + low * ey
    worst_stop(mechanism, body, scratch, x + high * ex, y + high * ey)
    side = scratch.gap_side[struck]
    body.carry[0] = body.carry[1] = 0.0
    update_kinematics(mechanism, body)
    hit_stop(mechanism, body, ledger, struck, side, arm_mass)
    if body.held != STILL:
        hit_x, hit_y, rest = tip[0], tip[1], (1.0 - low) * h
        enter_line(mechanism, body, struck)
        tip[0], tip[1] = hit_x + rest * tip[2], hit_y + rest * tip[3]
        turn_to_path(mechanism, body, struck)
        stop_gap(mechanism, body.distal_side, tip[0], tip[1], scratch.theta, scratch.gap, scratch.gap_side)
        for j in range(PLACES):
            if scratch.gap[j] < -limits.TOUCHING and not same_line(j, struck, mechanism.lines):
                tip[0], tip[1] = hit_x, hit_y  # another stop: what is left of the step is lost
                tip[2], tip[3] = tip[2] + body.carry[0], tip[3] + body.carry[1]
                body.carry[0] = body.carry[1] = 0.0
                break
    return struck


@kernel
def beyond_a_stop(mechanism, body, scratch, x, y):
    """True where (x, y) lies beyond any hard stop; fills the scratch's gaps."""
    stop_gap(mechanism, body.distal_side, x, y, scratch.theta, scratch.gap, scratch.gap_side)
    for j in range(PLACES):
        if scratch.gap[j] < -limits.TOUCHING:
            return True
    return False


@kernel
def retreat(mechanism, body, scratch, x, y):
    """Between two stops: take the last place on the way from (x, y) that is beyond neither."""
    tip = body.tip
    ex, ey = tip[0] - x, tip[1] - y
    low, high = 0.0, 1.0
    for _ in range(50):
        s = 0.5 * (low + high)
        if beyond_a_stop(mechanism, body, scratch, x + s * ex, y + s * ey):
            high = s
        else:
            low = s
    tip[0], tip[1] = x + low * ex, y + low * ey
    beyond_a_stop(mechanism, body, scratch, tip[0], tip[1])


@kernel
def worst_stop(mechanism, body, scratch, x, y):
    """The joint that lies furthest beyond its stop at (x, y), not counting one that the tip slides along; -1: none."""
    stop_gap(mechanism, body.distal_side, x, y, scratch.theta, scratch.gap, scratch.gap_side)
    worst, least = -1, 0.0
    for j in range(PLACES):
        if body.contact[j] == 0.0 and scratch.gap[j] < least:
            worst, least = j, scratch.gap[j]
    return worst


@kernel
def drift_in_backlash(brakes, braking, i, turned):
    """Move brake i through its play (first order: an edge reached inside the step counts from the next one)."""
    if braking.edge[i] * turned >= 0.0 and braking.edge[i] != 0.0:
        return
    braking.edge[i] = 0.0
    braking.play[i] += turned
    if braking.play[i] >= brakes.play[i]:
        braking.play[i], braking.edge[i] = brakes.play[i], 1.0
    elif braking.play[i] <= 0.0:
        braking.play[i], braking.edge[i] = 0.0, -1.0
