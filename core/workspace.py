"""The workspace of a device: where the tip can be, and whether it can be anywhere at all.

Outside the kernels, on whole arrays of tip positions: device and scene files are checked with it before they run.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.mechanism import JOINTS, Arm, Mechanism

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Points each way of the grid over the reachable area. Fewer could miss a thin workspace; more takes time.
GRID = 160
#: Smallest det M / (trace M)^2 that counts as invertible: far below any real device (1e-2 within the default
#: margin, 1e-4 within one of 0.001), far above rounding.
SMALLEST_DETERMINANT = 1e-11


class ArmPose(NamedTuple):
    """One arm at many tip positions; NaN where it does not reach. Shapes as the tips'."""

    e1: tuple[Array, Array]  # m, base -> elbow
    e2: tuple[Array, Array]  # m, elbow -> tip
    s: Array  # m2, e1 x e2

    def angles(self) -> tuple[Array, Array]:
        """Base angle from +x and relative elbow angle, rad, in (-pi, pi]."""
        along = self.e1[0] * self.e2[0] + self.e1[1] * self.e2[1]
        return np.arctan2(self.e1[1], self.e1[0]), np.arctan2(self.s, along)


def arm_pose(arm: Arm, x: Array, y: Array) -> ArmPose:
    """Elbow by circle intersection, as `core.linkage.links` for one tip."""
    rx, ry = x - arm.base_x, y - arm.base_y
    with np.errstate(all="ignore"):
        square = rx * rx + ry * ry
        along = 0.5 * (1.0 + (arm.length_1**2 - arm.length_2**2) / square)
        across = arm.side * np.sqrt(arm.length_1**2 / square - along * along)
        e1 = along * rx - across * ry, along * ry + across * rx
        return ArmPose(e1, (rx - e1[0], ry - e1[1]), -across * square)


def tip_is_free(mechanism: Mechanism, x: npt.ArrayLike, y: npt.ArrayLike) -> Mask:
    """Where both arms close with every margin and theta stop kept, and y > 0. Shape as x and y (m)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    first, second = mechanism.arm_1, mechanism.arm_2
    pose_1, pose_2 = arm_pose(first, x, y), arm_pose(second, x, y)
    between = pose_1.e2[0] * pose_2.e2[1] - pose_1.e2[1] * pose_2.e2[0]
    sines = (
        pose_1.s / (first.length_1 * first.length_2),
        pose_2.s / (second.length_1 * second.length_2),
        between / (first.length_2 * second.length_2),
    )
    free = np.asarray(y > 0.0)
    for sine in sines:
        free = free & (np.abs(sine) >= mechanism.margin * (1.0 - 1e-12))  # NaN (out of reach) compares as False
    if mechanism.has_theta_stops:
        for i, theta in enumerate((*pose_1.angles(), *pose_2.angles())):
            low, high = mechanism.theta_low[i], mechanism.theta_high[i]
            if np.isfinite(low):  # in the turn nearest to the middle of the range
                theta = theta - 2.0 * np.pi * np.floor((theta - 0.5 * (low + high)) / (2.0 * np.pi) + 0.5)
                free = free & (theta >= low) & (theta <= high)
    return np.asarray(free)


def free_tips(mechanism: Mechanism) -> Array:
    """Tips (n, 2), m, of a grid over the reachable area at which both arms close; n = 0: none."""
    low, high = np.array([-np.inf, 0.0]), np.array([np.inf, np.inf])
    for arm in (mechanism.arm_1, mechanism.arm_2):
        base, reach = np.array([arm.base_x, arm.base_y]), arm.length_1 + arm.length_2
        low, high = np.maximum(low, base - reach), np.minimum(high, base + reach)
    if np.any(low >= high):
        return np.empty((0, 2))
    fraction = (np.arange(GRID) + 0.5) / GRID
    x, y = np.meshgrid(*(low[i] + (high[i] - low[i]) * fraction for i in range(2)))
    free = tip_is_free(mechanism, x, y)
    return np.column_stack((x[free], y[free]))


def invertible_mass(mechanism: Mechanism, tips: Array) -> Mask:
    """Whether the tip mass matrix has an inverse at each of tips (n, 2)."""
    xx = np.full(len(tips), mechanism.tip_mass)
    yy, xy = xx.copy(), np.zeros(len(tips))
    for arm in (mechanism.arm_1, mechanism.arm_2):
        pose = arm_pose(arm, tips[:, 0], tips[:, 1])
        w1x, w1y = pose.e2[0] / pose.s, pose.e2[1] / pose.s  # rate of the proximal link = w1 . v
        w2x, w2y = -pose.e1[0] / pose.s, -pose.e1[1] / pose.s  # rate of the distal link
        cross = arm.coupling * (pose.e1[0] * pose.e2[0] + pose.e1[1] * pose.e2[1]) - arm.rotor
        xx += arm.proximal * w1x * w1x + 2.0 * cross * w1x * w2x + arm.distal * w2x * w2x
        yy += arm.proximal * w1y * w1y + 2.0 * cross * w1y * w2y + arm.distal * w2y * w2y
        xy += arm.proximal * w1x * w1y + cross * (w1x * w2y + w1y * w2x) + arm.distal * w2x * w2y
    return np.asarray((xx > 0.0) & (xx * yy - xy * xy > SMALLEST_DETERMINANT * (xx + yy) ** 2))


def why_impossible(mechanism: Mechanism) -> str:
    """Why this device cannot exist, as the end of a sentence; empty where it can."""
    tips = free_tips(mechanism)
    if len(tips) == 0:
        return _why_no_tip(mechanism)
    if not np.all(invertible_mass(mechanism, tips)):
        return "mass: too little of it, a force on the tip would accelerate it without bound (tip_kg and links)"
    return ""


def _why_no_tip(mechanism: Mechanism) -> str:
    first, second = mechanism.arm_1, mechanism.arm_2
    apart = float(np.hypot(second.base_x - first.base_x, second.base_y - first.base_y))
    reach_1, reach_2 = first.length_1 + first.length_2, second.length_1 + second.length_2
    lengths = (
        f"L_AE_m = {first.length_1:g}, L_ED_m = {first.length_2:g}, "
        f"L_BC_m = {second.length_1:g}, L_CD_m = {second.length_2:g}"
    )
    if apart >= reach_1 + reach_2:
        return (
            f"geometry: the bases are {apart:g} m apart, more than the arms reach "
            f"({reach_1:g} + {reach_2:g} m; {lengths})"
        )
    stops = [f"theta_{joint}_rad" for i, joint in enumerate(JOINTS) if np.isfinite(mechanism.theta_low[i])]
    within = f"the margin of {mechanism.margin:g}" + (f" and {', '.join(stops)}" if stops else "")
    return (
        f"geometry: no tip position in y > 0 at which both arms close within {within} "
        f"(bases {apart:g} m apart, {lengths})"
    )
