"""A controller of one's own: a damper that brakes whatever moves off the path.

Name it in a protocol beside this file: [[controller]] name = "Damper", algorithm = "my_damper.py",
parameters = {damping_N_s_m = 200.0}. Try it on trials: phd check-controller my_damper.py
"""

from core.control.algorithm import GAP_M, NONE, OWN, Algorithm, Parameter, actuate
from core.kernels import kernel

DAMPING = Parameter("damping_N_s_m", "damping", "N s/m", 1.0, 200.0, (10.0, 2000.0))
DAMPED = OWN  # its own decision


@kernel
def decide(controller, field, tick):
    """Asks the brake that opposes the motion off the path most for a force of damping times that speed."""
    damping, seen = controller.values[1], tick.seen
    off_path = seen.vx * field.n_x + seen.vy * field.n_y  # m/s, towards the path; negative away from it
    best, most = -1, 0.0
    for i in range(4):
        g_x, g_y = tick.g[i, 0], tick.g[i, 1]  # 1/m, of joint i: a brake there pulls along -sign(g . v) g
        turning = g_x * seen.vx + g_y * seen.vy
        sense = 1.0 if turning > 0.0 else -1.0
        against = sense * (g_x * field.n_x + g_y * field.n_y) * (1.0 if off_path > 0.0 else -1.0)
        if tick.brakes.present[i] != 0.0 and against > most:
            best, most = i, against
    if best < 0:
        return NONE
    actuate(tick, best, damping * abs(off_path))
    return DAMPED


ALGORITHM = Algorithm("my_damper", (GAP_M, DAMPING), ("damped",), decide)
