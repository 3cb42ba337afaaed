"""Velocity ratio control in joint space: brake the joints that are too fast for the wanted ratio of joint rates.

The desired direction beta gives each joint its part of the wanted rates, r_i = g_i . beta; those of the tip are
omega_i = g_i . v. With the pace s = max(0, sum omega_i r_i / sum r_i^2) that fits best, joint i is too fast by
    e_i = sign(omega_i) (omega_i - s r_i),
and its brake is asked for the torque from K (e_i - b |g_i|) to K e_i that is nearest to its last one, for none where
e_i < 0. With brakes on two joints that is the comparison of two ratios: e_A > 0 where omega_A / r_A > omega_B / r_B,
and then e_B < 0.

Our reconstruction of Swanson's velocity ratio controller (with Book, 2003, "Path-following control for dissipative
passive haptic displays"), of which the paper says only that it works in joint space and that proportional velocity
control was adapted from it. Our choice: the pace by least squares, which takes any number of brakes; a torque that
grows with the excess from 0 on, on every joint that is too fast, so that nothing jumps from brake to brake; no lock;
b is the rules' `back_speed` (four times the velocity's noise or more), so that noise seldom moves a current. The sense
of a joint that hardly turns is that of the settled rules. The default of K is assumed: with twice as much the loop
oscillates where encoders give the velocity, which is then 8 ms old (docs/what-it-shows.md).
"""

import math

from core.brake import current_for_torque
from core.control.algorithm import GAP_M, NONE, OWN, Algorithm, Parameter
from core.control.proportional import push_of, sense_of
from core.control.velocity_field import KEPT
from core.kernels import kernel

GAIN = Parameter("ratio_gain_N_m_s", "rate gain", "N m s", 1.0, 25.0, (1.0, 1000.0))


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
    """A torque within its bounds on each joint that is too fast; the decision names the largest."""
    brakes, g, rules, v = tick.brakes, tick.g, controller.rules, (tick.seen.vx, tick.seen.vy)
    along = square = 0.0
    for i in range(4):
        if brakes.present[i] != 0.0:
            wanted = g[i, 0] * field.beta_x + g[i, 1] * field.beta_y
            along += (g[i, 0] * v[0] + g[i, 1] * v[1]) * wanted
            square += wanted * wanted
    pace = along / square if along > 0.0 else 0.0
    off_x, off_y = v[0] - pace * field.beta_x, v[1] - pace * field.beta_y
    push = push_of(tick, rules)
    fastest, most = -1, 0.0
    for i in range(4):
        if brakes.present[i] != 0.0:
            excess = sense_of(g, i, v, push, rules.still_rate) * (g[i, 0] * off_x + g[i, 1] * off_y)
            noise = rules.back_speed * math.hypot(g[i, 0], g[i, 1])
            torque = ask_within(tick, i, controller.values[1] * (excess - noise), controller.values[1] * excess)
            if torque > most:
                fastest, most = i, torque
    return OWN + fastest if fastest >= 0 else NONE


ALGORITHM = Algorithm("velocity-ratio", (GAP_M, GAIN), ("ratio {J}",), decide)
