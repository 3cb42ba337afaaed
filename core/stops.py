"""Hard stops: how far each joint is from where it must stop. One-sided, plastic on impact.

A stop acts on the rate of a joint: the elbow margins on E and C, the margin between the distal links on D, theta stops
on their own joint. So a joint at a stop is a joint with an infinite yield in one direction.
"""

import math

from core.kernels import kernel
from core.linkage import joint_angles, links
from core.mechanism import PLACES, STOP_C, STOP_E, C, E


@kernel
def stop_gap(mechanism, distal_side, x, y, theta, gap, contact_side):  # noqa: PLR0913
    """Distance to the nearest stop of each place: gap (PLACES,), negative beyond it; +1e9 where it has none.

    In rad for theta stops, in units of sine for the margins. contact_side: +1 where that stop limits + motion.
    theta (4,) is work space.
    """
    a1x, a1y, a2x, a2y, s1 = links(mechanism.arm_1, x, y)
    b1x, b1y, b2x, b2y, s2 = links(mechanism.arm_2, x, y)
    for j in range(PLACES):
        gap[j], contact_side[j] = 1e9, 1.0
    e = STOP_E if mechanism.coupled >> E & 1 != 0 else E
    c = STOP_C if mechanism.coupled >> C & 1 != 0 else C
    elbow_stop(mechanism.arm_1, mechanism.margin, a1x * a2x + a1y * a2y, s1, e, gap, contact_side)
    elbow_stop(mechanism.arm_2, mechanism.margin, b1x * b2x + b1y * b2y, s2, c, gap, contact_side)
    across = a2x * b2y - a2y * b2x
    along = a2x * b2x + a2y * b2y
    size = math.sqrt(across * across + along * along)
    sine = distal_side * across / size if size > 0.0 else -1.0
    gap[4] = sine - mechanism.margin
    # the angle from ED to CD has the sign of distal_side; the stop is the low end for an acute angle, the high one else
    contact_side[4] = -distal_side if along > 0.0 else distal_side
    if s1 == 0.0 or s2 == 0.0:
        gap[4] = -1.0
    if mechanism.has_theta_stops and s1 != 0.0 and s2 != 0.0:
        joint_angles(mechanism, x, y, theta)
        for j in range(4):
            if math.isinf(mechanism.theta_low[j]):
                continue
            # the turn in which the angle is nearest to the middle of its range
            middle = 0.5 * (mechanism.theta_low[j] + mechanism.theta_high[j])
            theta[j] -= 2.0 * math.pi * math.floor((theta[j] - middle) / (2.0 * math.pi) + 0.5)
            low, high = theta[j] - mechanism.theta_low[j], mechanism.theta_high[j] - theta[j]
            place = e if j == E else (c if j == C else j)
            if low < gap[place]:
                gap[place], contact_side[place] = low, -1.0
            if high < gap[place]:
                gap[place], contact_side[place] = high, 1.0


@kernel
def elbow_stop(arm, margin, along, s, j, gap, contact_side):  # noqa: PLR0913
    """Gap of one elbow's margin |sin theta| >= margin, and the sense of motion that it limits."""
    # theta has the sign of -side; a stretched elbow (along > 0) stops on the way to 0, a folded one on the way to pi
    gap[j] = -arm.side * s / (arm.length_1 * arm.length_2) - margin
    if s == 0.0:
        gap[j] = -1.0
    contact_side[j] = arm.side if along > 0.0 else -arm.side


@kernel
def distal_sine(mechanism, x, y):
    """Sine of the angle from distal link ED to distal link CD."""
    _, _, a2x, a2y, _ = links(mechanism.arm_1, x, y)
    _, _, b2x, b2y, _ = links(mechanism.arm_2, x, y)
    return (a2x * b2y - a2y * b2x) / (mechanism.arm_1.length_2 * mechanism.arm_2.length_2)
