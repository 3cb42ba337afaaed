"""Proportional velocity control (Section IV-C, Fig. 14): brake the component of the tip velocity across beta.

The space of desired velocity has its x axis along beta and its y axis 90 degrees to the left of beta.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from core.control.algorithm import (
    GAP_M,
    LOCK_BACK,
    LOCK_BACK_NONE_SELECTED,
    LOCK_NONE_SELECTED,
    OWN,
    RELEASE_NONE_SELECTED,
    Algorithm,
    Parameter,
    actuate,
    lock,
    pushes_away,
)
from core.kernels import kernel
from core.workspace import arm_pose

if TYPE_CHECKING:
    from core.device import Device

GAIN_N_S_M = Parameter("gain_N_s_m", "gain", "N s/m", 1.0, None, (1.0, 20_000.0))  # K_y
GAIN = 1  # its place among the values
USE, CAPPED, BELOW_DRAG = OWN, OWN + 4, OWN + 8


@kernel
def in_beta(a_x, a_y, field):
    """Components of a vector along (x) and across (y) the desired direction."""
    return a_x * field.beta_x + a_y * field.beta_y, a_y * field.beta_x - a_x * field.beta_y


@kernel
def impending_direction(fx, fy, mass):
    """Unit vector along M^-1 F, the way the free tip would start under the hand force; 0 without force.

    mass (3,): M_xx, M_xy, M_yy (kg) of the tip.
    """
    a_x = mass[2] * fx - mass[1] * fy  # M^-1 F times det M > 0
    a_y = mass[0] * fy - mass[1] * fx
    length = math.sqrt(a_x * a_x + a_y * a_y)
    if length <= 0.0:
        return 0.0, 0.0
    return a_x / length, a_y / length


@kernel
def joint_sense(rate, impending_rate, felt, still_rate):
    """Sense in which a joint turns, +1, -1 or 0 (then its brake is no candidate); rates in rad/s.

    Below still_rate the sense of the impending motion, known only where a hand is felt.
    """
    if abs(rate) < still_rate:
        rate = impending_rate if felt else 0.0
    if rate > 0.0:
        return 1.0
    if rate < 0.0:
        return -1.0
    return 0.0


@kernel
def force_direction(g_x, g_y, sense):
    """Direction of a brake's force on the tip, Eq. (13) (our reconstruction), as a unit vector.

    Its angle is atan2(J_iy, J_ix), plus pi if omega_i > 0: a brake opposes the motion of its joint.
    """
    length = math.sqrt(g_x * g_x + g_y * g_y)
    if length <= 0.0:
        return 0.0, 0.0
    return -sense * g_x / length, -sense * g_y / length


@kernel
def influence(fx, fy, v_beta_x, v_beta_y, no_effect, along_beta):
    """One column of the influence matrix H, Eq. (14): (H_x, H_y) of a force (fx along, fy across beta).

    +1 where the force increases the magnitude of that velocity component, -1 where it decreases it, 0 where it has
    no effect (|component| <= no_effect |force|). A component at rest can only grow: +1. Differs from the paper
    where along_beta is set: H_x is +1 for a force along +beta and -1 for one against it, whatever v_beta_x is.
    """
    least = no_effect * math.sqrt(fx * fx + fy * fy)
    h_x = 0
    if abs(fx) > least:
        growing = fx > 0.0 if along_beta else fx * v_beta_x > 0.0 or v_beta_x == 0.0
        h_x = 1 if growing else -1
    h_y = 0
    if abs(fy) > least:
        h_y = 1 if fy * v_beta_y > 0.0 or v_beta_y == 0.0 else -1
    return h_x, h_y


@kernel
def priority(h_x, h_y):
    """Rank of a column of H: 3 for [1 -1], 2 for [0 -1], 1 for [-1 -1], 0 for a brake not to be actuated."""
    return h_x + 2 if h_y == -1 else 0


@kernel
def commanded_force(gain, v_beta_y, force_normalised):
    """Proportional tip force (N), Eq. (15): K_y |v_beta_y|, at most the normalised force (our choice: the cap)."""
    return min(gain * abs(v_beta_y), force_normalised)


class Push(NamedTuple):
    """The direction in which the hand would start the tip."""

    felt: bool  # it pushes harder than noise
    x: float  # unit vector, the impending direction
    y: float


@kernel
def push_of(tick, rules):
    """The direction of the hand's push in this tick."""
    fx, fy = tick.seen.fx, tick.seen.fy
    x, y = impending_direction(fx, fy, tick.mass)
    return Push(fx * fx + fy * fy > rules.felt_force * rules.felt_force, x, y)


@kernel
def decision_velocity(vx, vy, push, rest_speed):
    """The velocity to decide with: the tip's own, or at rest under a felt hand rest_speed along its push."""
    if push.felt and vx * vx + vy * vy < rest_speed * rest_speed:
        return rest_speed * push.x, rest_speed * push.y
    return vx, vy


@kernel
def sense_of(g, i, velocity, push, still_rate):
    """`joint_sense` of joint i at a velocity (2,), m/s; g (4, 2)."""
    g_x, g_y = g[i, 0], g[i, 1]
    return joint_sense(g_x * velocity[0] + g_y * velocity[1], g_x * push.x + g_y * push.y, push.felt, still_rate)


@kernel
def best_brake(tick, field, velocity, push, rules):
    """The brake (0..3) of highest priority in H, the one whose force is nearest to beta among equals; -1: none.

    velocity (2,), m/s: the one to decide with.
    """
    brakes, g = tick.brakes, tick.g
    v_beta_x, v_beta_y = in_beta(velocity[0], velocity[1], field)
    chosen = -1
    highest = 0
    nearest = -2.0  # cosine of the angle between force and beta
    for i in range(4):
        if brakes.present[i] == 0.0:
            continue
        sense = sense_of(g, i, velocity, push, rules.still_rate)
        if sense == 0.0:
            continue
        f_x, f_y = force_direction(g[i, 0], g[i, 1], sense)
        f_along, f_across = in_beta(f_x, f_y, field)
        h_x, h_y = influence(f_along, f_across, v_beta_x, v_beta_y, rules.no_effect, rules.along_beta)
        rank = priority(h_x, h_y)
        if rank > highest or (rank == highest and rank > 0 and f_along > nearest):
            chosen = i
            highest = rank
            nearest = f_along
    return chosen


@kernel
def decide(controller, field, tick):
    """Proportional velocity control (Section IV-C): K_y |v_beta_y| on the best brake, locks included."""
    rules, push = controller.rules, push_of(tick, controller.rules)
    velocity = decision_velocity(tick.seen.vx, tick.seen.vy, push, rules.rest_speed)
    v_beta_x, v_beta_y = in_beta(velocity[0], velocity[1], field)
    i = best_brake(tick, field, velocity, push, rules)

    if i < 0 and pushes_away(tick.seen, field, rules):
        lock(tick)
        return LOCK_NONE_SELECTED
    if v_beta_x < -rules.back_speed:
        lock(tick)
        return LOCK_BACK_NONE_SELECTED if i < 0 else LOCK_BACK
    if i < 0:
        return RELEASE_NONE_SELECTED
    force = commanded_force(controller.values[GAIN], v_beta_y, controller.force_normalised)
    actuate(tick, i, force)
    if tick.current[i] == 0.0:
        return BELOW_DRAG + i
    return CAPPED + i if force == controller.force_normalised else USE + i


ALGORITHM = Algorithm(
    "proportional",
    (GAP_M, GAIN_N_S_M),
    # the last: selected, but the brake does more than asked without current
    ("prop {J}", "prop {J}, at normalised force", "prop {J}, below off-state drag"),
    decide,
)


#: m/s. Our choice: about the largest speed across the path in a guided movement of two seconds.
ACROSS_M_S = 0.1


def least_gain_felt(device: "Device", places: np.ndarray) -> float:
    """The gain (N s/m) from which on a guide can be felt at one of the places (n, 2), m, at `ACROSS_M_S`.

    Below it Eq. (15) asks every brake for less than its off torque k_2, which it does without current.
    """
    drags = []
    for arm, joints in ((device.mechanism.arm_1, (0, 1)), (device.mechanism.arm_2, (2, 3))):
        pose = arm_pose(arm, places[:, 0], places[:, 1])
        reach = np.hypot(pose.e1[0] + pose.e2[0], pose.e1[1] + pose.e2[1])
        for joint, length in zip(joints, (arm.length_2, reach), strict=True):  # |g| = length / |S|
            if device.brakes.present[joint]:
                drags.append(np.min(device.brakes.k[joint, 1] * length / np.abs(pose.s)))
    return float(min(drags, default=0.0)) / ACROSS_M_S
