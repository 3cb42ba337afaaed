"""How stuck brakes share the load.

With three or more stuck brakes the split is not unique (the paper cites a lumped-actuator approach that it does not
give). Our choice: the split of least sum of ((torque - middle) / half-width)^2 within what each joint can hold; inside
the backlash middle and half-width differ from 0 and the yield. The motion does not depend on it. A hard stop takes all
that it can, before any brake.
"""

import math

from core.kernels import kernel
from core.mechanism import PLACES
from core.simulator.solver_numbers import SPLIT_ROUNDING, STOP_STRENGTH
from core.simulator.stick_slip import same_line

#: Answers of `_split` in place of the next pattern to try.
_BEST, _NO_SPLIT = -1, -2


@kernel
def share_at_rest(body, braking, fx, fy):
    """Fill braking.torque (PLACES,) with the split that balances the force f (N) on a resting tip, all joints held.

    Joints beyond their limits are clamped, and let go again where that is worse (an active-set search). Convex, so the
    first split that keeps all limits and all optimality conditions is the one; if the search goes round in circles, all
    sets of clamps are tried.
    """
    pattern = 0
    for _ in range(8):
        pattern = _split(body, braking, fx, fy, pattern)
        if pattern == _BEST:
            return
        if pattern == _NO_SPLIT:
            break
    patterns, place = 1, 1
    for i in range(PLACES):
        place *= 3
        if braking.active[i] != 0:
            patterns = place
    for pattern in range(patterns):
        if _split(body, braking, fx, fy, pattern) == _BEST:
            return
    # at the bound to rounding: no set of clamps balances the force exactly; take the split without any, cut to limits
    _split(body, braking, fx, fy, 0)
    for i in range(PLACES):
        if braking.active[i] != 0:
            braking.torque[i] = min(max(braking.torque[i], -braking.cost_plus[i]), braking.cost_minus[i])


@kernel
def _split(body, braking, fx, fy, pattern):
    """Split with joints clamped by the base-3 digits of `pattern` (1: at their + limit, 2: at their - limit).

    _BEST if it is the solution, _NO_SPLIT if the free joints cannot balance the force, else the pattern to try next.
    """
    rx, ry = -fx, -fy
    sxx = sxy = syy = 0.0
    code = pattern
    for i in range(PLACES):
        braking.torque[i] = 0.0
        clamp = 0
        if code > 0:
            clamp = code % 3
            code //= 3
        if braking.active[i] == 0:
            if clamp > 0:
                return _NO_SPLIT
            continue
        gx, gy = body.g[i, 0], body.g[i, 1]
        middle, half = reach_of(braking, i)
        if clamp > 0:
            if half == STOP_STRENGTH:
                return _NO_SPLIT
            braking.torque[i] = middle + (half if clamp == 1 else -half)
            rx -= gx * braking.torque[i]
            ry -= gy * braking.torque[i]
        else:
            rx -= gx * middle
            ry -= gy * middle
            square = half * half
            sxx += square * gx * gx
            sxy += square * gx * gy
            syy += square * gy * gy
    det = sxx * syy - sxy * sxy
    if det <= 1e-12 * (sxx * syy):
        return _NO_SPLIT
    zx, zy = (syy * rx - sxy * ry) / det, (sxx * ry - sxy * rx) / det
    code, place, change = pattern, 1, 0
    for i in range(PLACES):
        clamp = 0
        if code > 0:
            clamp = code % 3
            code //= 3
        if braking.active[i] != 0:
            middle, half = reach_of(braking, i)
            share = half * (body.g[i, 0] * zx + body.g[i, 1] * zy)
            if clamp == 0:
                braking.torque[i] = middle + half * share
                over = SPLIT_ROUNDING * max(half, 1e-3)
                if braking.torque[i] > braking.cost_minus[i] + over:
                    change += place
                elif braking.torque[i] < -braking.cost_plus[i] - over:
                    change += 2 * place
            elif (clamp == 1 and share < 1.0 - SPLIT_ROUNDING) or (clamp == 2 and share > SPLIT_ROUNDING - 1.0):
                change -= clamp * place
        place *= 3
    return _BEST if change == 0 else pattern + change


@kernel
def reach_of(braking, i):
    """(middle, half-width) of the torques of joint i, [-cost_plus, cost_minus]; (0, STOP_STRENGTH) at a stop."""
    plus, minus = braking.cost_plus[i], braking.cost_minus[i]
    if math.isinf(plus) or math.isinf(minus):
        return 0.0, STOP_STRENGTH
    return 0.5 * (minus - plus), 0.5 * (plus + minus)


@kernel
def share_on_line(body, braking, j, torque, lines):
    """Split the torque that holds joint j, on its own rate, among the joints on its line (E, C, D on coaxial bases).

    The same least sum; joints that reach their limit stay there and the others take the rest.
    """
    if lines == 0:  # no line is shared
        braking.torque[j] = min(max(torque, -braking.cost_plus[j]), braking.cost_minus[j])
        return
    square = body.g[j, 0] * body.g[j, 0] + body.g[j, 1] * body.g[j, 1]
    clamped = 0
    for _ in range(3):
        rest, weight = torque, 0.0
        for i in range(PLACES):
            if braking.active[i] != 0 and same_line(i, j, lines):
                ratio = (body.g[i, 0] * body.g[j, 0] + body.g[i, 1] * body.g[j, 1]) / square
                if clamped >> i & 1:
                    rest -= ratio * braking.torque[i]
                else:
                    middle, half = reach_of(braking, i)
                    rest -= ratio * middle
                    weight += ratio * ratio * half * half
        more = 0
        for i in range(PLACES):
            if braking.active[i] != 0 and same_line(i, j, lines) and not clamped >> i & 1:
                ratio = (body.g[i, 0] * body.g[j, 0] + body.g[i, 1] * body.g[j, 1]) / square
                middle, half = reach_of(braking, i)
                share = middle + (half * half * ratio * rest / weight if weight > 0.0 else 0.0)
                braking.torque[i] = min(max(share, -braking.cost_plus[i]), braking.cost_minus[i])
                if share != braking.torque[i]:
                    more |= 1 << i
        if more == 0:
            break
        clamped |= more


@kernel
def leave_stops_their_share(body, braking):
    """Turn joint torques into brake torques: at a stop the brake bears only what the stop cannot."""
    for i in range(4):
        if body.contact[i] > 0.0 and braking.torque[i] < 0.0 or body.contact[i] < 0.0 and braking.torque[i] > 0.0:
            braking.torque[i] = 0.0
    for i in range(4, PLACES):
        braking.torque[i] = 0.0
