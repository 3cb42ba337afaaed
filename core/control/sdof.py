"""SDOF velocity control (Section IV-B, Fig. 13): of the paths a single locked brake would leave, the best one.

Locking brake i leaves the tip one way to go, its local SDOF path p_i, at right angles to the force of that brake.
"""

import math

from core.control.algorithm import (
    GAP_M,
    LOCK_NO_VALID,
    OWN,
    RELEASE_NO_VALID,
    Algorithm,
    actuate,
    lock,
    pushes_away,
)
from core.kernels import kernel


@kernel
def sdof_direction(g_x, g_y):
    """Local SDOF path of a brake, Eq. (12) (our reconstruction): p_i = (-J_iy, J_ix) / |J_i|, one of two senses.

    Zero where the brake cannot move the tip (J_i = 0).
    """
    length = math.sqrt(g_x * g_x + g_y * g_y)
    if length <= 0.0:
        return 0.0, 0.0
    return -g_y / length, g_x / length


@kernel
def valid_sense(p_x, p_y, field, rounding):
    """+1 or -1: the sense in which a unit vector p lies in the 90 degrees from t to n (ends included), or 0."""
    along = p_x * field.t_x + p_y * field.t_y
    inward = p_x * field.n_x + p_y * field.n_y
    if along >= -rounding and inward >= -rounding:
        return 1.0 if along > rounding or inward > rounding else 0.0  # p = 0 has no direction
    if along <= rounding and inward <= rounding:
        return -1.0
    return 0.0


@kernel
def nearest_valid_brake(brakes, g, field, rules):
    """The brake (0..3) whose valid SDOF path is nearest to beta, -1 if no brake has a valid one; g (4, 2)."""
    chosen = -1
    nearest = -2.0  # cosine of the angle to beta
    for i in range(4):
        if brakes.present[i] == 0.0:
            continue
        p_x, p_y = sdof_direction(g[i, 0], g[i, 1])
        sense = valid_sense(p_x, p_y, field, rules.span_rounding)
        cosine = sense * (p_x * field.beta_x + p_y * field.beta_y)
        if sense != 0.0 and cosine > nearest:
            chosen = i
            nearest = cosine
    return chosen


@kernel
def decide(controller, field, tick):
    """SDOF velocity control (Section IV-B): the normalised force on the brake with the nearest valid path."""
    i = nearest_valid_brake(tick.brakes, tick.g, field, controller.rules)
    if i < 0:
        if pushes_away(tick.seen, field, controller.rules):
            lock(tick)
            return LOCK_NO_VALID
        return RELEASE_NO_VALID
    actuate(tick, i, controller.force_normalised)
    return OWN + i


ALGORITHM = Algorithm("sdof", (GAP_M,), ("sdof {J}",), decide)
