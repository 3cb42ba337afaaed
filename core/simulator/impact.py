"""A joint runs into a hard stop."""

from core.kernels import kernel
from core.mechanism import PLACES
from core.simulator.stick_slip import FREE, STILL, same_line, solve_mass
from core.simulator.stick_slip_mode import update_kinematics


@kernel
def hit_stop(mechanism, body, ledger, j, side, arm_mass):
    """Joint j runs into its stop (side +1: at the high end): plastic impact, brakes give no impulse.

    v+ = argmin 1/2 (v - v-)' M (v - v-) with the stop's rate >= 0; the loss goes to the ledger as an entry of its own.
    """
    mass, g, tip = body.mass, body.g, body.tip
    mxx, mxy, myy = mass[0] + arm_mass, mass[1], mass[2] + arm_mass
    body.contact[j] = side
    before = 0.5 * (mxx * tip[2] * tip[2] + 2.0 * mxy * tip[2] * tip[3] + myy * tip[3] * tip[3])
    arm_before = 0.5 * arm_mass * (tip[2] * tip[2] + tip[3] * tip[3])
    hx, hy = solve_mass(mxx, mxy, myy, g[j, 0], g[j, 1])
    impulse = (g[j, 0] * tip[2] + g[j, 1] * tip[3]) / (g[j, 0] * hx + g[j, 1] * hy)
    tip[2] -= hx * impulse
    tip[3] -= hy * impulse
    for i in range(PLACES):
        if i != j and body.contact[i] * (g[i, 0] * tip[2] + g[i, 1] * tip[3]) > 0.0:
            tip[2] = tip[3] = 0.0  # wedged between two stops
    after = 0.5 * (mxx * tip[2] * tip[2] + 2.0 * mxy * tip[2] * tip[3] + myy * tip[3] * tip[3])
    ledger.lost_at_stops += before - after
    ledger.work_hand += arm_before - 0.5 * arm_mass * (tip[2] * tip[2] + tip[3] * tip[3])
    update_kinematics(mechanism, body)
    body.held = STILL if tip[2] == 0.0 and tip[3] == 0.0 else FREE
    for i in range(PLACES):
        if same_line(i, j, mechanism.lines):
            body.rate[i] = 0.0  # exactly: `decide` says how it goes on
        rate = body.rate[i]
        body.sign[i] = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
