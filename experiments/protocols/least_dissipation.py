"""Least dissipation: the force across the path that is wanted, at the least power taken from the hand.

With c_i the force towards the path for each N m of brake i, and low_i, high_i its least and largest torque,
    min sum |omega_i| u_i   over   sum c_i u_i = -(F . n),  low_i <= u_i <= high_i,
a linear programme with one equation. Its solution is a finite list of cases: all brakes at their least, then those that
push the right way one after the other, the one that takes the least power for each newton first, until the force is
there. Where the brakes cannot have it, they come as near as they can.

Our reconstruction: the idea of taking little from the hand is in every comparison of passive displays; we know of no
text with this programme. What is wanted is that of direct_force.py. Our choice: of brakes at one price (at rest every
price is 0) the strongest comes first, so that few brakes act.
"""

import math

from core.control.algorithm import GAP_M, NONE, OWN, Algorithm
from core.control.reflect import MISSED_N, ROUNDING, available, shown_by
from core.control.velocity_field import WANTED
from core.kernels import kernel

WHOLE, IN_PART = OWN, OWN + 4


@kernel
def outward_push(seen, field):
    """What the hand pushes away from the path, N; 0 where it pushes towards it."""
    return max(-(seen.fx * field.n_x + seen.fy * field.n_y), 0.0)


@kernel
def least_power(across, cost, low, high, wanted, torque):
    """Fill torque (4,), N m, low_i <= torque_i <= high_i, so that sum across_i torque_i is nearest to `wanted`, N.

    Of all such the one of least sum of cost_i torque_i; costs >= 0. across, cost, low, high: tuples of four. Returns
    what is missing of `wanted`.
    """
    rest = wanted
    for i in range(4):
        torque[i] = low[i]
        rest -= across[i] * low[i]
    side, used = math.copysign(1.0, rest), 0
    for _ in range(4):
        brake, least, most = -1, math.inf, 0.0
        for i in range(4):
            force = side * across[i] * (high[i] - low[i])
            if not force > 0.0 or used >> i & 1:
                continue
            price = cost[i] / abs(across[i])
            same = abs(price - least) <= ROUNDING * price
            if brake < 0 or (force > most if same else price < least):
                brake, least, most = i, price, force
        if brake < 0 or side * rest <= 0.0:
            return rest
        used |= 1 << brake
        share = min(side * rest / most, 1.0)
        torque[brake] = low[brake] + share * (high[brake] - low[brake])
        rest -= side * share * most
    return rest


@kernel
def decide(controller, field, tick):
    """Show as much force towards the path as the hand pushes away from it, at the least power."""
    rules, memory, current = controller.rules, tick.memory, tick.current
    wanted = outward_push(tick.seen, field)
    memory[WANTED], memory[WANTED + 1] = wanted * field.n_x, wanted * field.n_y
    if not wanted > rules.least_shown:
        return NONE
    ax, ay, low, high = available(tick, rules)
    g, vx, vy = tick.g, tick.seen.vx, tick.seen.vy
    across = (
        ax[0] * field.n_x + ay[0] * field.n_y,
        ax[1] * field.n_x + ay[1] * field.n_y,
        ax[2] * field.n_x + ay[2] * field.n_y,
        ax[3] * field.n_x + ay[3] * field.n_y,
    )
    rates = (
        abs(g[0, 0] * vx + g[0, 1] * vy),
        abs(g[1, 0] * vx + g[1, 1] * vy),
        abs(g[2, 0] * vx + g[2, 1] * vy),
        abs(g[3, 0] * vx + g[3, 1] * vy),
    )
    missed = least_power(across, rates, low, high, wanted, current)
    return (WHOLE if abs(missed) < MISSED_N else IN_PART) + shown_by(current, ax, ay, tick.brakes)


ALGORITHM = Algorithm("least-dissipation", (GAP_M,), ("least {J}", "least {J}, in part"), decide)
