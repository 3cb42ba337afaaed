"""The equations of motion reduced to the two tip coordinates: M(p) a + b(p, v) = hand force + sum of g_i torque_i.

The same physics as Eq. (5) with its ten coordinates and eight constraints, closed exactly: the four links turn at
rates that are linear in the tip velocity, so their inertia is carried to the tip by the rows g.

For one arm with e1, e2, S and C = e1.e2 (core/linkage.py), kinetic energy 1/2 P w1^2 + (kC - J) w1 w2 + 1/2 D w2^2,
    link accelerations   alpha1 = e2.a / S + (w1^2 C + w2^2 L2^2) / S,  alpha2 = -e1.a / S - (w1^2 L1^2 + w2^2 C) / S
    generalised forces   Q1 = P alpha1 + (kC - J) alpha2 - k S w2^2,    Q2 = (kC - J) alpha1 + D alpha2 + k S w1^2
and Q1, Q2 act on the tip through the same rows.
"""

from typing import NamedTuple

from core.kernel import inlined
from core.linkage import links


class ArmMotion(NamedTuple):
    """One arm at one tip position and velocity, and what it adds at the tip (SI, radians)."""

    base_x: float  # 1/m, row g of the base joint
    base_y: float
    elbow_x: float  # 1/m, row g of the elbow joint
    elbow_y: float
    base_rate: float  # rad/s, g . v
    elbow_rate: float
    base_bias: float  # rad/s2, gdot . v
    elbow_bias: float
    mass_xx: float  # kg
    mass_xy: float
    mass_yy: float
    bias_x: float  # N
    bias_y: float
    s: float  # m2, e1 x e2 = L1 L2 sin(theta_elbow)


class Row(NamedTuple):
    """What a brake acts on (the joint in its place, or a combination of the base rates), or a stop."""

    x: float  # 1/m, row g
    y: float
    rate: float  # rad/s, g . v
    bias: float  # rad/s2, gdot . v


class Motion(NamedTuple):
    """The terms of the equations of motion at one tip position and velocity (SI, radians)."""

    mass_xx: float  # kg, M
    mass_xy: float
    mass_yy: float
    bias_x: float  # N, b
    bias_y: float
    arm_1: ArmMotion  # joints A and E
    arm_2: ArmMotion  # joints B and C
    brake_e: Row
    brake_c: Row
    distal: Row  # D, the angle between the distal links; with couplings E (see `core.stops`)


@inlined
def arm_motion(arm, x, y, vx, vy):
    """One arm's inertia, bias force, rows and rates at tip (x, y) with velocity (vx, vy)."""
    e1x, e1y, e2x, e2y, s = links(arm, x, y)
    one_over_s = 1.0 / s
    c = e1x * e2x + e1y * e2y
    base_x, base_y = e2x * one_over_s, e2y * one_over_s
    link_x, link_y = -e1x * one_over_s, -e1y * one_over_s  # row of the distal link's absolute rate
    w1 = base_x * vx + base_y * vy
    w2 = link_x * vx + link_y * vy
    bias1 = (w1 * w1 * c + w2 * w2 * arm.length_2 * arm.length_2) * one_over_s
    bias2 = -(w1 * w1 * arm.length_1 * arm.length_1 + w2 * w2 * c) * one_over_s
    cross = arm.coupling * c - arm.rotor
    gyro = arm.coupling * s
    q1 = arm.proximal * bias1 + cross * bias2 - gyro * w2 * w2
    q2 = cross * bias1 + arm.distal * bias2 + gyro * w1 * w1
    p1x, p1y = arm.proximal * base_x + cross * link_x, arm.proximal * base_y + cross * link_y
    p2x, p2y = cross * base_x + arm.distal * link_x, cross * base_y + arm.distal * link_y
    return ArmMotion(
        base_x, base_y, link_x - base_x, link_y - base_y, w1, w2 - w1, bias1, bias2 - bias1,
        base_x * p1x + link_x * p2x, base_x * p1y + link_x * p2y, base_y * p1y + link_y * p2y,
        base_x * q1 + link_x * q2, base_y * q1 + link_y * q2, s,
    )  # fmt: skip


@inlined
def motion(mechanism, x, y, vx, vy):
    """`Motion` at tip (x, y), m, and velocity (vx, vy), m/s. Not finite where the tip is out of reach."""
    p = arm_motion(mechanism.arm_1, x, y, vx, vy)
    q = arm_motion(mechanism.arm_2, x, y, vx, vy)
    mxx, myy = mechanism.tip_mass + p.mass_xx + q.mass_xx, mechanism.tip_mass + p.mass_yy + q.mass_yy
    mxy = p.mass_xy + q.mass_xy
    bx, by = p.bias_x + q.bias_x, p.bias_y + q.bias_y
    ex, ey, e_rate, e_bias = p.elbow_x, p.elbow_y, p.elbow_rate, p.elbow_bias
    cx, cy, c_rate, c_bias = q.elbow_x, q.elbow_y, q.elbow_rate, q.elbow_bias
    dx, dy = q.base_x + cx - p.base_x - ex, q.base_y + cy - p.base_y - ey
    d_rate, d_bias = q.base_rate + c_rate - p.base_rate - e_rate, q.base_bias + c_bias - p.base_bias - e_bias
    if mechanism.coupled != 0:
        rotor = mechanism.coupling_rotor
        dx, dy, d_rate, d_bias = ex, ey, e_rate, e_bias
        if mechanism.coupled & 2 != 0:
            ex, ey, e_rate, e_bias = combined(mechanism.combination[1], p, q)
        if mechanism.coupled & 8 != 0:
            cx, cy, c_rate, c_bias = combined(mechanism.combination[3], p, q)
        mxx += rotor[1] * ex * ex + rotor[3] * cx * cx
        mxy += rotor[1] * ex * ey + rotor[3] * cx * cy
        myy += rotor[1] * ey * ey + rotor[3] * cy * cy
        bx += rotor[1] * ex * e_bias + rotor[3] * cx * c_bias
        by += rotor[1] * ey * e_bias + rotor[3] * cy * c_bias
    return Motion(
        mxx, mxy, myy, bx, by, p, q,
        Row(ex, ey, e_rate, e_bias), Row(cx, cy, c_rate, c_bias), Row(dx, dy, d_rate, d_bias),
    )  # fmt: skip


@inlined
def combined(factors, p, q):
    """Row, rate and bias (x, y, rate, bias) of the combination `factors` (2,) of the base joints' rates."""
    a, b = factors[0], factors[1]
    return (
        a * p.base_x + b * q.base_x, a * p.base_y + b * q.base_y,
        a * p.base_rate + b * q.base_rate, a * p.base_bias + b * q.base_bias,
    )  # fmt: skip
