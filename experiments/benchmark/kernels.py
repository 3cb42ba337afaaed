"""The compiled loop that `phd bench` times. In a file of its own, so that changes elsewhere compile no kernel anew."""

from core.dynamics import motion
from core.kernels import kernel
from core.simulator.stick_slip import solve_mass


@kernel
def accelerations(mechanisms, torque, tip, count):
    """`count` closed-form accelerations under brake torques (4,), N m, near a tip (x, y, vx, vy), m and m/s.

    Each is at a place that the last one decides: in a Runge-Kutta step no stage can begin before the last has ended.
    Returns the last one's x, m/s2.
    """
    mechanism = mechanisms[0]
    x, y, vx, vy = tip
    px, py, ux, uy = tip
    ax = 0.0
    for _ in range(count):
        q = motion(mechanism, px, py, ux, uy)
        p, r = q.arm_1, q.arm_2
        fx = torque[0] * p.base_x + torque[1] * p.elbow_x + torque[2] * r.base_x + torque[3] * r.elbow_x - q.bias_x
        fy = torque[0] * p.base_y + torque[1] * p.elbow_y + torque[2] * r.base_y + torque[3] * r.elbow_y - q.bias_y
        ax, ay = solve_mass(q.mass_xx, q.mass_xy, q.mass_yy, fx, fy)
        px, py, ux, uy = x + 1e-6 * ax, y + 1e-6 * ay, vx + 1e-6 * ax, vy + 1e-6 * ay
    return ax
