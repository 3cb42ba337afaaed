"""The equations of motion reduced to the two tip coordinates: M(p) a + b(p, v) = hand force + sum of g_i torque_i.

The same physics as Eq. (5) with its ten coordinates and eight constraints, closed exactly: the four links turn at
rates that are linear in the tip velocity, so their inertia is carried to the tip by the rows g.

For one arm with e1, e2, S and C = e1.e2 (core/linkage.py), kinetic energy 1/2 P w1^2 + (kC - J) w1 w2 + 1/2 D w2^2,
    link accelerations   alpha1 = e2.a / S + (w1^2 C + w2^2 L2^2) / S,  alpha2 = -e1.a / S - (w1^2 L1^2 + w2^2 C) / S
    generalised forces   Q1 = P alpha1 + (kC - J) alpha2 - k S w2^2,    Q2 = (kC - J) alpha1 + D alpha2 + k S w1^2
and Q1, Q2 act on the tip through the same rows. The rotors of couplings add squares of the base rates, which are part
of P, and their product.
"""

from typing import NamedTuple

from core.kernels import inlined
from core.linkage import links


class ArmMotion(NamedTuple):
    """One arm at a tip position and velocity, and its inertia and bias force at the tip (SI, radians)."""

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


class Motion(NamedTuple):
    """The terms of the equations of motion at one tip position and velocity (SI, radians)."""

    mass_xx: float  # kg, M
    mass_xy: float
    mass_yy: float
    bias_x: float  # N, b
    bias_y: float
    arm_1: ArmMotion  # joints A and E
    arm_2: ArmMotion  # joints B and C


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
    mxy, bx, by = p.mass_xy + q.mass_xy, p.bias_x + q.bias_x, p.bias_y + q.bias_y
    if mechanism.coupling != 0.0:
        c = mechanism.coupling
        mxx += 2.0 * c * p.base_x * q.base_x
        mxy += c * (p.base_x * q.base_y + p.base_y * q.base_x)
        myy += 2.0 * c * p.base_y * q.base_y
        bx += c * (p.base_x * q.base_bias + q.base_x * p.base_bias)
        by += c * (p.base_y * q.base_bias + q.base_y * p.base_bias)
    return Motion(mxx, mxy, myy, bx, by, p, q)


@inlined
def combined(mechanism, i, q):
    """Row g (x, y), rate and bias gdot . v of the coupling in place i in a `Motion`."""
    a, b = mechanism.combination[i, 0], mechanism.combination[i, 1]
    one, two = q.arm_1, q.arm_2
    return (
        a * one.base_x + b * two.base_x, a * one.base_y + b * two.base_y,
        a * one.base_rate + b * two.base_rate, a * one.base_bias + b * two.base_bias,
    )  # fmt: skip
