"""How stuck brakes share the load.

With three or more stuck brakes the split is not unique (the paper cites a lumped-actuator approach that it does not
give). Our choice: the split of least sum of ((torque - middle) / half-width)^2 within what each joint can hold; inside
the backlash middle and half-width differ from 0 and the yield. The motion does not depend on it. A hard stop takes all
that it can, before any brake.
"""

import math

from core.jit import kernel
from core.stick_slip import same_line

_STOP = 1e6  # N m, half-width that stands for a stop: so much stronger than a brake that the brake is left no load
_ROUNDING = 1e-9  # relative: a split at the bound of what the joints hold is accepted this far beyond it


@kernel
def share_at_rest(state, fx, fy):
    """Fill state.torque (5,) with the split that balances the force f (N) on a resting tip, all joints held."""
    if _split(state, fx, fy, 0) < math.inf:
        return
    best, best_pattern = math.inf, 0
    for pattern in range(1, 243):  # each joint free, clamped at its + limit, or at its - limit
        cost = _split(state, fx, fy, pattern)
        if cost < best:
            best, best_pattern = cost, pattern
    _split(state, fx, fy, best_pattern)
    for i in range(5):
        if state.active[i] != 0:
            state.torque[i] = min(max(state.torque[i], -state.cost_plus[i]), state.cost_minus[i])


@kernel
def _split(state, fx, fy, pattern):
    """Split with the joints clamped as the base-3 digits of `pattern` say; its cost, inf where not feasible."""
    rx, ry = -fx, -fy
    sxx = sxy = syy = 0.0
    code = pattern
    for i in range(5):
        state.torque[i] = 0.0
        clamp = code % 3
        code //= 3
        if state.active[i] == 0:
            if clamp > 0:
                return math.inf
            continue
        gx, gy = state.g[i, 0], state.g[i, 1]
        middle, half = reach_of(state, i)
        if clamp > 0:
            if half == _STOP:
                return math.inf
            state.torque[i] = middle + (half if clamp == 1 else -half)
            rx -= gx * state.torque[i]
            ry -= gy * state.torque[i]
        else:
            rx -= gx * middle
            ry -= gy * middle
            square = half * half
            sxx += square * gx * gx
            sxy += square * gx * gy
            syy += square * gy * gy
    det = sxx * syy - sxy * sxy
    if det <= 1e-12 * (sxx * syy):
        return math.inf
    zx, zy = (syy * rx - sxy * ry) / det, (sxx * ry - sxy * rx) / det
    cost = 0.0
    code = pattern
    for i in range(5):
        clamp = code % 3
        code //= 3
        if state.active[i] == 0:
            continue
        middle, half = reach_of(state, i)
        if clamp > 0:
            cost += 1.0
            continue
        share = half * (state.g[i, 0] * zx + state.g[i, 1] * zy)
        state.torque[i] = middle + half * share
        cost += share * share
        over = _ROUNDING * max(half, 1e-3)
        if state.torque[i] < -state.cost_plus[i] - over or state.torque[i] > state.cost_minus[i] + over:
            cost = math.inf
    return cost


@kernel
def reach_of(state, i):
    """(middle, half-width) of the torques of joint i, [-cost_plus, cost_minus]; (0, _STOP) at a stop."""
    plus, minus = state.cost_plus[i], state.cost_minus[i]
    if math.isinf(plus) or math.isinf(minus):
        return 0.0, _STOP
    return 0.5 * (minus - plus), 0.5 * (plus + minus)


@kernel
def share_on_line(state, j, torque, coaxial):
    """Split the torque that holds joint j, on its own rate, among the joints on its line (E, C, D on coaxial bases).

    The same least sum; joints that reach their limit stay there and the others take the rest.
    """
    square = state.g[j, 0] * state.g[j, 0] + state.g[j, 1] * state.g[j, 1]
    clamped = 0
    for _ in range(3):
        rest, weight = torque, 0.0
        for i in range(5):
            if state.active[i] != 0 and same_line(i, j, coaxial):
                ratio = (state.g[i, 0] * state.g[j, 0] + state.g[i, 1] * state.g[j, 1]) / square
                if clamped >> i & 1:
                    rest -= ratio * state.torque[i]
                else:
                    middle, half = reach_of(state, i)
                    rest -= ratio * middle
                    weight += ratio * ratio * half * half
        more = 0
        for i in range(5):
            if state.active[i] != 0 and same_line(i, j, coaxial) and not clamped >> i & 1:
                ratio = (state.g[i, 0] * state.g[j, 0] + state.g[i, 1] * state.g[j, 1]) / square
                middle, half = reach_of(state, i)
                share = middle + (half * half * ratio * rest / weight if weight > 0.0 else 0.0)
                state.torque[i] = min(max(share, -state.cost_plus[i]), state.cost_minus[i])
                if share != state.torque[i]:
                    more |= 1 << i
        if more == 0:
            break
        clamped |= more


@kernel
def leave_stops_their_share(state):
    """Turn joint torques into brake torques: at a stop the brake bears only what the stop cannot."""
    for i in range(4):
        if state.contact[i] > 0.0 and state.torque[i] < 0.0 or state.contact[i] < 0.0 and state.torque[i] > 0.0:
            state.torque[i] = 0.0
    state.torque[4] = 0.0
