"""The `event` integrator: smooth RK4 between events, each located to rounding, the exact solver after each.

Feasible by construction: after an event the motion solves the stick-slip problem, with no tolerance and no creep.
A step whose own error estimate is too large is cut: near singular positions, where a lag's time constant changes
quickly, and where a brake would give energy. Too many events within a short time (chatter) or a hand too stiff for RK4
are given to `stepping`, and that is counted.
"""

from core.kernels import inlined, kernel
from core.mechanism import PLACES
from core.simulator import solver_numbers as limits
from core.simulator.event_location import LOOSE_MINUS, LOOSE_PLUS, NONE, PLAY, SPEED, STOP, first_event, locate
from core.simulator.hand import hand_force
from core.simulator.impact import hit_stop
from core.simulator.lag import age_yields, begin_lags, pace_ends, yield_error
from core.simulator.runge_kutta import rk4
from core.simulator.state import MR
from core.simulator.stepping import advance_stepping, stiffer_than
from core.simulator.stick_slip import FREE, STILL, largest_excess, same_line
from core.simulator.stick_slip_mode import (
    decide,
    finish,
    joints_of,
    release,
    resolve,
    set_costs,
)


@kernel
def advance_event(model, data, currents, t, h):
    """Move the state from t to t + h (s). Expects the pattern resolved at t; leaves the quantities of t + h."""
    mechanism, brakes, hand, scratch = model.mechanism, model.brakes, data.hand, data.scratch
    body, braking, ledger = data.body, data.braking, data.ledger
    lag, lagged = scratch.lag, 1 if model.fidelity == MR else 0
    ledger.steps += 1
    body.settled = 0
    elapsed = 0.0  # s into the step
    longest = h  # s, of a piece: less where one was refused, up to h again where the error is far within its limit
    turn = h  # s, of a piece up to where a lag changes its pace; h: to no such place
    arm_mass = hand.grips[0].mass
    crowd, since = 0, 0.0  # events, counted since that time (s into the step)
    while elapsed < h:
        # The next piece of the step; `stepping` takes it where many events crowd or the hand is too stiff.
        rest = h - elapsed
        step = min(rest, longest, turn)
        if step > limits.FALLBACK_S and stiffer_than(body, hand, step):
            longest = max(limits.FALLBACK_S, 0.5 * step)
            continue
        if crowd > limits.MAX_EVENTS or stiffer_than(body, hand, step):
            ledger.fallbacks += 1
            piece = min(rest, limits.FALLBACK_S * body.tolerance)  # shorter in a check of a run
            advance_stepping(model, data, currents, t + elapsed, piece)
            if piece == rest:
                return
            elapsed += piece
            longest, crowd, since = h, 0, elapsed
            resolve(model, data, t + elapsed)
            continue
        if elapsed - since > limits.FALLBACK_S:
            crowd, since = 0, elapsed
        now = t + elapsed
        begin_lags(brakes, body, braking, lag, currents, lagged)
        if body.held == STILL:
            before = ledger.events
            elapsed = stand_still(model, data, t, elapsed, h)
            crowd += ledger.events - before
            continue
        # Try it; where its error is too large, or a lag changes its pace within it, try a shorter one.
        if not rk4(model, data, now, step):
            ledger.shortened += 1
            longest = 0.5 * step
            if longest < limits.SHORTEST:
                crowd = limits.MAX_EVENTS + 1
            continue
        error = scratch.error
        if lag.lagging != 0:
            error = max(error, yield_error(body, scratch, step) * (limits.STEP_ERROR / limits.YIELD_ERROR))
        if not error <= body.tolerance * limits.STEP_ERROR and step > limits.FINEST:
            ledger.refined += 1
            longest = step * max(0.2, 0.9 * (body.tolerance * limits.STEP_ERROR / error) ** (1.0 / 3.0))
            continue
        # Cut it at its first event; where a brake would give energy, try a shorter one.
        scratch.seen = 0
        kind, guess = first_event(model, body, braking, scratch, step)
        if lag.lagging != 0:
            ends = pace_ends(brakes, body, scratch, step)
            if ends < (guess if kind != NONE else step):
                turn = ends
                continue
        if kind != NONE:
            kind, step = locate(model, data, now, step, kind, guess)
        heat = scratch.heat
        gives_energy = min(min(heat[0], heat[1]), min(heat[2], heat[3])) < -limits.GIVEN  # a joint reversed unseen
        if gives_energy and step > limits.FINEST:
            ledger.refined += 1
            longest = 0.5 * step
            continue
        # Take it.
        if longest < h and 16.0 * error < body.tolerance * limits.STEP_ERROR:
            longest *= 2.0
        accept(model, data, step)
        elapsed = h if step == rest else elapsed + step
        turn = h
        if kind != NONE:
            ledger.events += 1
            crowd += 1
            apply_event(model, data, kind, t + elapsed)
        elif elapsed < h:
            fx, fy = hand_force(hand, t + elapsed, body.tip[0], body.tip[1], body.tip[2], body.tip[3])
            set_costs(brakes, body, braking)
            finish(mechanism, body, braking, fx, fy, arm_mass)
    if lag.lagging != 0 and hand.grips[0].spring == 0:  # with a spring the next step sets the costs itself
        set_costs(brakes, body, braking)
    body.settled = 0 if body.held == STILL else 1


@inlined
def stand_still(model, data, t, elapsed, h):
    """Leave the tip at rest from `elapsed` (s) into the step on, until the hand pushes it loose, an event.

    Returns the time into the step, h if it rests to the end.
    """
    brakes, hand, body, braking, lag = model.brakes, data.hand, data.body, data.braking, data.scratch.lag
    rest, arm_mass = h - elapsed, hand.grips[0].mass
    step = still_until(model, data, t + elapsed, rest)
    age_yields(braking, lag, step)
    elapsed = h if step == rest else elapsed + step
    fx, fy = hand_force(hand, t + elapsed, body.tip[0], body.tip[1], 0.0, 0.0)
    body.hand_force[0], body.hand_force[1] = fx, fy
    if step < rest:
        data.ledger.events += 1
        set_costs(brakes, body, braking)
        decide(model, body, braking, FREE, (fx, fy), arm_mass)
    return elapsed


@kernel
def accept(model, data, step):
    """Take over the tried step: motion, ledger, backlash, yields."""
    brakes, body, braking, ledger, scratch = model.brakes, data.body, data.braking, data.ledger, data.scratch
    for i in range(4):
        body.tip[i] = scratch.tip[i]
        if brakes.present[i] > 0.0:
            ledger.heat[i] += scratch.heat[i]
            if -scratch.heat[i] > ledger.added_by_brakes:
                ledger.added_by_brakes = -scratch.heat[i]
            if brakes.play[i] > 0.0 and body.sign[i] != 0.0 and braking.edge[i] == 0.0:
                braking.play[i] = min(max(braking.play[i] + scratch.turned[i], 0.0), brakes.play[i])
    for i in range(PLACES):
        body.rate[i], body.bias[i] = scratch.rate[i], scratch.bias[i]
        body.g[i, 0], body.g[i, 1] = scratch.g[i, 0], scratch.g[i, 1]
        if body.contact[i] != 0.0 and body.held != i:
            body.contact[i] = 0.0
    for i in range(3):
        body.mass[i] = scratch.mass[i]
    for i in range(2):
        body.bias_force[i] = scratch.bias_force[i]
        body.acceleration[i] = scratch.acceleration[i]
        body.hand_force[i] = scratch.hand_force[i]
    body.carry[0] = body.carry[1] = 0.0
    body.line_torque = scratch.line_torque
    if scratch.lag.lagging != 0:
        for i in range(4):
            braking.torque_yield[i] = scratch.torque_yield[i]
    ledger.work_hand += scratch.work


@kernel
def apply_event(model, data, kind, t):
    """Set the pattern after an event at time t (s): the exact solver decides which joint sticks, which slips on."""
    mechanism, brakes, hand, scratch = model.mechanism, model.brakes, data.hand, data.scratch
    body, braking, ledger = data.body, data.braking, data.ledger
    tip, arm_mass = body.tip, hand.grips[0].mass
    fx, fy = hand_force(hand, t, tip[0], tip[1], tip[2], tip[3])
    set_costs(brakes, body, braking)
    if kind >= STOP:
        hit_stop(mechanism, body, ledger, kind - STOP, scratch.gap_side[kind - STOP], arm_mass)
        set_costs(brakes, body, braking)
    elif kind >= PLAY:
        i = kind - PLAY
        braking.edge[i] = body.sign[i]
        braking.play[i] = brakes.play[i] if body.sign[i] > 0.0 else 0.0
        set_costs(brakes, body, braking)
    joint, at_rest = FREE, tip[2] == 0.0 and tip[3] == 0.0
    if kind == SPEED or at_rest or (kind < SPEED and comes_to_rest(mechanism, body, braking)):
        stop_moving(body)
    elif kind >= STOP:
        joint = kind - STOP
    elif kind < SPEED:
        joint = kind
    elif kind == LOOSE_PLUS or kind == LOOSE_MINUS:
        release(mechanism, body, body.held, 1.0 if kind == LOOSE_PLUS else -1.0)
    decide(model, body, braking, joint, (fx, fy), arm_mass)


@kernel
def comes_to_rest(mechanism, body, braking):
    """True where two joints that are not on one line have no rate, and not because their rows are parallel just now."""
    speed = body.tip[2] * body.tip[2] + body.tip[3] * body.tip[3]
    if speed > limits.REST_SPEED * limits.REST_SPEED:
        return False
    for i in range(PLACES):
        if braking.active[i] != 0 and abs(body.rate[i]) <= limits.RATE_ROUNDING:
            for j in range(i):
                at_rest = braking.active[j] != 0 and abs(body.rate[j]) <= limits.RATE_ROUNDING
                if at_rest and not same_line(i, j, mechanism.lines):
                    return True
    return False


@kernel
def stop_moving(body):
    """The tip is at rest: exact zeros from here on."""
    body.tip[2] = body.tip[3] = 0.0
    for i in range(PLACES):
        body.rate[i] = body.bias[i] = 0.0
    body.bias_force[0] = body.bias_force[1] = 0.0


@kernel
def excess_at(model, data, t, elapsed):
    """Force (N) by which the hand exceeds what the brakes hold at a resting tip, `elapsed` seconds into the step."""
    body, braking = data.body, data.braking
    age_yields(braking, data.scratch.lag, elapsed)
    set_costs(model.brakes, body, braking)
    fx, fy = hand_force(data.hand, t + elapsed, body.tip[0], body.tip[1], 0.0, 0.0)
    return largest_excess(joints_of(model.mechanism, body, braking), fx, fy)


@kernel
def none_falls(lag):
    """True where every lag brings its brake up, or leaves it as it is."""
    for i in range(4):
        if lag.lack[i] > 0.0:
            return False
    return True


@kernel
def still_until(model, data, t, step):
    """The time (s) for which the tip stays at rest: `step`, or until the hand pushes it loose.

    The excess is looked at in the middle and at the end of the step, then bisected to rounding. Under a steady hand the
    tip stays where no yield falls.
    """
    hand, lag = data.hand, data.scratch.lag
    hand_changes = hand.times.shape[0] > 1 or hand.grips[0].waves == 1  # the target of a spring is held over a step
    if not hand_changes and (lag.lagging == 0 or none_falls(lag)):
        return step
    low, high = 0.0, 0.5 * step
    if excess_at(model, data, t, high) <= limits.REST_ROUNDING:
        low, high = high, step
        if excess_at(model, data, t, step) <= limits.REST_ROUNDING:
            return step
    for _ in range(60):
        middle = 0.5 * (low + high)
        if excess_at(model, data, t, middle) > limits.REST_ROUNDING:
            high = middle
        else:
            low = middle
        if high - low <= 1e-16 * step:
            break
    return high
