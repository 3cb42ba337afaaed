"""Kinematics of the five-bar, Eqs. (7)-(10): from the tip to elbows, joint rates and brake forces.

Tip coordinates need no trigonometry: each elbow is the intersection of two circles. With e1 = elbow - base,
e2 = tip - elbow and S = e1 x e2 = L1 L2 sin(theta_elbow), the link rates are w1 = e2.v / S and w2 = -e1.v / S, so the
rows g (rate of a joint = g . v, force of its brake on the tip = g torque) are
g_base = e2 / S (along the distal link) and g_elbow = -(e1 + e2) / S (along base -> tip).
"""

import math

from core.kernels import inlined, kernel


@inlined
def links(arm, x, y):
    """Vectors of the two links (e1x, e1y, e2x, e2y, S) for a tip at (x, y), m and m2.

    Out of reach the elbow is put on the line base -> tip and S is 0 (callers treat S = 0 as not a state).
    """
    rx, ry = x - arm.base_x, y - arm.base_y
    square = rx * rx + ry * ry
    if square == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    one_over_square = 1.0 / square
    along = 0.5 + 0.5 * (arm.length_1 * arm.length_1 - arm.length_2 * arm.length_2) * one_over_square
    across = arm.side * math.sqrt(max(arm.length_1 * arm.length_1 * one_over_square - along * along, 0.0))
    e1x, e1y = along * rx - across * ry, along * ry + across * rx
    e2x, e2y = rx - e1x, ry - e1y
    return e1x, e1y, e2x, e2y, -across * square


@kernel
def joint_angles(mechanism, x, y, theta):
    """Joint angles theta (4,), rad, order A, E, B, C: A and B from +x, E and C relative, counter-clockwise."""
    a1x, a1y, a2x, a2y, s1 = links(mechanism.arm_1, x, y)
    b1x, b1y, b2x, b2y, s2 = links(mechanism.arm_2, x, y)
    theta[0] = math.atan2(a1y, a1x)
    theta[1] = math.atan2(s1, a1x * a2x + a1y * a2y)
    theta[2] = math.atan2(b1y, b1x)
    theta[3] = math.atan2(s2, b1x * b2x + b1y * b2y)


@kernel
def coupled_angle(mechanism, i, x, y):
    """Angle (rad) of the coupling in place i, up to whole turns."""
    a1x, a1y, _, _, _ = links(mechanism.arm_1, x, y)
    b1x, b1y, _, _, _ = links(mechanism.arm_2, x, y)
    combination = mechanism.combination
    return combination[i, 0] * math.atan2(a1y, a1x) + combination[i, 1] * math.atan2(b1y, b1x)


@kernel
def tip_force_map(mechanism, x, y, g):
    """Rows g (4, 2), 1/m: the map of Eqs. (7) and (8), force on the tip = sum over brakes of g_i torque_i.

    They are the rows of the inverses of both arms' Jacobians, Eqs. (9) and (10), and give the rates on which the brakes
    act, g_i . v (virtual power): of their joints, or of their couplings.
    Eq. (7) lists A, B, C only; read it as A, E, B, C.
    """
    joint_rows(mechanism, x, y, g)
    for i in range(4):
        if mechanism.coupled >> i & 1 != 0:
            for k in range(2):
                g[i, k] = mechanism.combination[i, 0] * g[0, k] + mechanism.combination[i, 1] * g[2, k]


@kernel
def joint_rows(mechanism, x, y, g):
    """`tip_force_map` of a device without couplings."""
    a1x, a1y, a2x, a2y, s1 = links(mechanism.arm_1, x, y)
    b1x, b1y, b2x, b2y, s2 = links(mechanism.arm_2, x, y)
    g[0, 0], g[0, 1] = a2x / s1, a2y / s1
    g[1, 0], g[1, 1] = -(a1x + a2x) / s1, -(a1y + a2y) / s1
    g[2, 0], g[2, 1] = b2x / s2, b2y / s2
    g[3, 0], g[3, 1] = -(b1x + b2x) / s2, -(b1y + b2y) / s2
