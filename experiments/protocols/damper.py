"""A damper across the path, the baseline: it brakes motion off the path and onto it.

The brake whose force opposes the motion across the path most is asked for the force b |v . n|, n the normal towards the
path. Our own baseline, without a source. Our choice: motion towards the path is braked too, as a dashpot does, so that
the tip does not shoot over it; one brake at a time, as the paper's controllers; the sense of a joint that hardly turns
is that of the settled rules. Our choice, too: the force asked for is the one from b (|v . n| - c) to b |v . n| that is
nearest to the last one, c the rules' `back_speed` (four times the velocity's noise or more), so that noise seldom moves
a current.
"""

from core.brake import current_for_torque
from core.control.algorithm import GAP_M, NONE, OWN, Algorithm, Parameter, torque_for_force
from core.control.proportional import push_of, sense_of
from core.control.velocity_field import KEPT
from core.kernels import kernel

DAMPING = Parameter("damping_N_s_m", "damping", "N s/m", 1.0, 200.0, (10.0, 2000.0))


@kernel
def ask_within(tick, i, least, most):
    """Command brake i to the torque (N m) within two bounds that is nearest to its last one; returns that torque.

    It is at least 0. Noise of the bounds that is smaller than the distance between them changes no current.
    """
    torque = max(min(max(tick.memory[KEPT + i], least), most), 0.0)
    tick.memory[KEPT + i] = torque
    tick.current[i] = current_for_torque(tick.brakes, i, torque)
    return torque


@kernel
def decide(controller, field, tick):
    """b |v . n|, less what may be noise, on the brake that opposes that motion most."""
    seen, g, rules = tick.seen, tick.g, controller.rules
    push, v = push_of(tick, rules), (seen.vx, seen.vy)
    inward = seen.vx * field.n_x + seen.vy * field.n_y  # m/s
    best, most = -1, 0.0
    for i in range(4):
        lever = g[i, 0] * field.n_x + g[i, 1] * field.n_y  # 1/m; a brake pulls along -sense g
        against = sense_of(g, i, v, push, rules.still_rate) * lever * inward
        if tick.brakes.present[i] != 0.0 and against > most:
            best, most = i, against
    for i in range(4):
        damping = torque_for_force(controller.values[1], g[i, 0], g[i, 1]) if i == best else 0.0  # N s
        ask_within(tick, i, damping * (abs(inward) - rules.back_speed), damping * abs(inward))
    return OWN + best if best >= 0 else NONE


ALGORITHM = Algorithm("damper", (GAP_M, DAMPING), ("damp {J}",), decide)
