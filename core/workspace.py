"""The workspace of a device: where the tip can be, and whether it can be anywhere at all.

Outside the kernels, on whole arrays of tip positions: device and scene files are checked with it before they run.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.mechanism import JOINTS, Arm, Mechanism

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: The search for tip positions ends with so many. Fewer would show the workspace coarsely; more takes time.
ENOUGH = 2000
#: m. The search finds every disc of free tip positions of this radius, a step of the shipped encoders.
FINEST_M = 2e-5
#: rad and m: what rounding may do to a bound.
ROUNDING = 1e-9
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


def brake_rows(mechanism: Mechanism, x: npt.ArrayLike, y: npt.ArrayLike) -> Array:
    """Rows g (4, 2, ...) of the brakes at many tips (m), Eqs. (7) and (8); NaN out of reach.

    As `core.linkage.tip_force_map` for one tip.
    """
    x, y, rows = np.asarray(x, dtype=float), np.asarray(y, dtype=float), []
    for arm in (mechanism.arm_1, mechanism.arm_2):
        e1, e2, s = arm_pose(arm, x, y)
        with np.errstate(all="ignore"):
            rows += [np.array(e2) / s, -np.add(e1, e2) / s]
    found = np.array(rows)
    for i in range(4):
        if mechanism.coupled >> i & 1:
            found[i] = np.einsum("k,k...->...", mechanism.combination[i], found[[0, 2]])
    return found


def held_in_any_direction(rows: Array, torque: Array) -> Array:
    """The force (...,), N, that brakes with rows (n, 2, ...) and torques (n,), N m, hold whatever its direction.

    They hold the zonotope sum of [-torque_i, torque_i] g_i; its sides lie along the rows, and the nearest one counts.
    """
    normals = np.stack([-rows[:, 1], rows[:, 0]], axis=1) / np.hypot(rows[:, 0], rows[:, 1])[:, None]
    reach = np.abs(np.einsum("ki...,ji...->kj...", normals, rows))
    return np.asarray(np.einsum("kj...,j->k...", reach, torque).min(axis=0))


def joint_angles(mechanism: Mechanism, x: Array, y: Array) -> Array:
    """Joint angles (4, ...), rad, at many tips (m); NaN out of reach."""
    return np.array([angle for arm in (mechanism.arm_1, mechanism.arm_2) for angle in arm_pose(arm, x, y).angles()])


def sines(mechanism: Mechanism, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Sines of both elbows, with the sign of e1 x e2, and of the angle from ED to CD, at many tips (m)."""
    one, two = mechanism.arm_1, mechanism.arm_2
    first, second = arm_pose(one, x, y), arm_pose(two, x, y)
    between = first.e2[0] * second.e2[1] - first.e2[1] * second.e2[0]
    elbows = first.s / (one.length_1 * one.length_2), second.s / (two.length_1 * two.length_2)
    return *elbows, between / (one.length_2 * two.length_2)


def tip_is_free(mechanism: Mechanism, x: npt.ArrayLike, y: npt.ArrayLike) -> Mask:
    """Where both arms close with every margin and theta stop kept, and y > 0. Shape as x and y (m)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    free = np.asarray(y > 0.0)
    for sine in sines(mechanism, x, y):
        free = free & (np.abs(sine) >= mechanism.margin * (1.0 - 1e-12))  # NaN (out of reach) compares as False
    if mechanism.has_theta_stops:
        stops = zip(joint_angles(mechanism, x, y), mechanism.theta_low, mechanism.theta_high, strict=True)
        for theta, low, high in stops:
            if np.isfinite(low):
                theta = in_turn_of(theta, low, high)
                free = free & (theta >= low) & (theta <= high)
    return np.asarray(free)


def in_turn_of(theta: Array, low: float, high: float) -> Array:
    """The angles (rad) in the turn in which they are nearest to the middle of a range."""
    return theta - 2.0 * np.pi * np.floor((theta - 0.5 * (low + high)) / (2.0 * np.pi) + 0.5)


def free_tips(mechanism: Mechanism) -> Array:
    """Tips (n, 2), m, spread over the area in which the tip is free; n = 0: none."""
    return _search(mechanism)[0]


class _Cells(NamedTuple):
    """Rectangles in the joint angles of one arm, (n,) each, rad: centres and half-widths."""

    base: Array
    elbow: Array
    half_base: Array
    half_elbow: Array


def _search(mechanism: Mechanism) -> tuple[Array, bool]:
    """Free tips (n, 2), m, and, where there is none, whether it is certain that none exists.

    Our choice: bisection of the joint angles that the stops leave one arm (the arm with fewer), so that stops however
    narrow are met. A cell in which no tip can be free, by bounds on all that the other arm does, is dropped; the others
    are halved until enough of their centres are free, or until all are smaller than `FINEST_M`.
    """
    ranges = [_joint_ranges(mechanism, number) for number in (0, 1)]
    sizes = [(high - low) * sum(end - begin for begin, end in elbows) for (low, high), elbows in ranges]
    if min(sizes) <= 0.0:
        return np.empty((0, 2)), True
    number = int(np.argmin(sizes))
    arm = (mechanism.arm_1, mechanism.arm_2)[number]
    (low, high), elbows = ranges[number]
    begin, end = np.array(elbows).T
    ones = np.ones(len(elbows))
    cells = _Cells(0.5 * (low + high) * ones, 0.5 * (begin + end), 0.5 * (high - low) * ones, 0.5 * (end - begin))
    while True:
        possible = _may_be_free(mechanism, number, ranges[1 - number], cells)
        cells = _Cells(*(part[possible] for part in cells))
        x, y, wide, long = _tips_of(arm, cells)
        free = tip_is_free(mechanism, x, y)
        if len(x) == 0 or np.count_nonzero(free) >= ENOUGH or np.max(wide + long) < FINEST_M:
            return np.column_stack((x[free], y[free])), len(x) == 0
        cells = _halved(cells, wide > long)


def _joint_ranges(mechanism: Mechanism, number: int) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    """What margin and theta stops leave the base and the elbow of arm 1 or 2 (rad): one range, and a list of ranges."""
    arm = (mechanism.arm_1, mechanism.arm_2)[number]
    bounds = [(float(mechanism.theta_low[i]), float(mechanism.theta_high[i])) for i in (2 * number, 2 * number + 1)]
    base = bounds[0] if math.isfinite(bounds[0][0]) else (-math.pi, math.pi)
    least = math.asin(mechanism.margin * (1.0 - 1e-12))
    begin, end = sorted((-arm.side * least, -arm.side * (math.pi - least)))
    turns = [2.0 * math.pi * turn for turn in (-1, 0, 1)] if math.isfinite(bounds[1][0]) else [0.0]
    elbows = [(max(begin + turn, bounds[1][0]), min(end + turn, bounds[1][1])) for turn in turns]
    return base, [(low, high) for low, high in elbows if low < high]


def _tips_of(arm: Arm, cells: _Cells) -> tuple[Array, Array, Array, Array]:
    """The tips at the centres, and how far (m) the tip moves at most from there to a cell's end in base and elbow."""
    elbow_x, elbow_y = arm.length_1 * np.cos(cells.base), arm.length_1 * np.sin(cells.base)
    x = elbow_x + arm.length_2 * np.cos(cells.base + cells.elbow)
    y = elbow_y + arm.length_2 * np.sin(cells.base + cells.elbow)
    long = arm.length_2 * cells.half_elbow
    wide = (np.hypot(x, y) + long) * cells.half_base
    return arm.base_x + x, arm.base_y + y, wide, long


def _halved(cells: _Cells, across: Mask) -> _Cells:
    """Both halves of each cell, cut across the base angle where `across`, else across the elbow angle."""
    half_base = np.where(across, 0.5 * cells.half_base, cells.half_base)
    half_elbow = np.where(across, cells.half_elbow, 0.5 * cells.half_elbow)
    off_base, off_elbow = cells.half_base - half_base, cells.half_elbow - half_elbow
    return _Cells(
        np.concatenate((cells.base - off_base, cells.base + off_base)),
        np.concatenate((cells.elbow - off_elbow, cells.elbow + off_elbow)),
        np.tile(half_base, 2),
        np.tile(half_elbow, 2),
    )


def _may_be_free(
    mechanism: Mechanism,
    number: int,
    other_ranges: tuple[tuple[float, float], list[tuple[float, float]]],
    cells: _Cells,
) -> Mask:
    """Whether a cell of one arm may hold a free tip, by bounds on the other arm; True is no promise, False is one.

    r, bearing: of the tip from the other arm's base. The elbow's range is a range of r; the other two angles of the
    triangle base, elbow, tip are functions of r, and with the bearing they give base angle and distal link.
    """
    arm, other = (mechanism.arm_1, mechanism.arm_2)[number], (mechanism.arm_2, mechanism.arm_1)[number]
    (base_low, base_high), elbows = other_ranges
    x, y, wide, long = _tips_of(arm, cells)
    off = wide + long + ROUNDING
    away_x, away_y = x - other.base_x, y - other.base_y
    r = np.hypot(away_x, away_y)
    one, two = other.length_1, other.length_2
    reach = [math.sqrt(one * one + two * two + 2.0 * one * two * math.cos(end)) for ends in elbows for end in ends]
    near, far = np.maximum(r - off, min(reach)), np.minimum(r + off, max(reach))
    possible = (y + off > 0.0) & (near <= far)
    far = np.maximum(near, far)

    bearing, turn = np.arctan2(away_y, away_x), np.where(off < r, np.arcsin(np.minimum(off / r, 1.0)), math.pi)
    at_base, at_base_half = _triangle_angle(one, two, near, far)
    base_off = 0.5 * (base_high - base_low) + at_base_half + turn + ROUNDING
    from_middle = bearing + other.side * at_base - 0.5 * (base_low + base_high)
    possible &= np.abs(in_turn_of(from_middle, 0.0, 0.0)) <= base_off

    at_tip, at_tip_half = _triangle_angle(two, one, near, far)
    between = bearing - other.side * at_tip - cells.base - cells.elbow
    between_off = at_tip_half + turn + cells.half_base + cells.half_elbow + ROUNDING
    from_square = np.abs(in_turn_of(2.0 * between - math.pi, 0.0, 0.0)) / 2.0
    sine = np.cos(np.maximum(from_square - between_off, 0.0))  # the largest |sin| in the cell
    return np.asarray(possible & (sine >= mechanism.margin - ROUNDING))


def _triangle_angle(beside: float, opposite: float, near: Array, far: Array) -> tuple[Array, Array]:
    """Middle and half-width (rad) of the angle between sides r and `beside`, for r from near to far (m)."""
    square = beside * beside - opposite * opposite
    lowest = np.clip(math.sqrt(max(square, 0.0)), near, far)  # the cosine is least there, largest at an end
    cosines = np.array([0.5 * (r + square / r) / beside for r in (near, far, lowest)])
    narrow, broad = np.arccos(np.clip((cosines.max(axis=0), cosines.min(axis=0)), -1.0, 1.0))
    return 0.5 * (narrow + broad), 0.5 * (broad - narrow)


class TipMotion(NamedTuple):
    """The equations of motion at the tip (`core.dynamics.motion`), n states at once."""

    g: Array  # (4, 2, n) 1/m
    turn: Array  # (4, n) rad/s2, gdot . v
    mass: Array  # (2, 2, n) kg
    bias: Array  # (2, n) N


def tip_motion(mechanism: Mechanism, tip: Array, velocity: Array) -> TipMotion:
    """At tips (n, 2), m, with velocities (n, 2), m/s; not finite out of reach."""
    (x, y), v = tip.T, velocity.T
    mass = np.zeros((2, 2, len(x)))
    mass[0, 0] = mass[1, 1] = mechanism.tip_mass
    bias, rows, turns = np.zeros((2, len(x))), [], []
    with np.errstate(all="ignore"):  # out of reach
        for arm in (mechanism.arm_1, mechanism.arm_2):
            e1, e2, s = (np.array(part) for part in arm_pose(arm, x, y))
            base, link = e2 / s, -e1 / s  # rows of the rates of both links
            w1, w2, c = (base * v).sum(axis=0), (link * v).sum(axis=0), (e1 * e2).sum(axis=0)
            bias_1 = (w1 * w1 * c + w2 * w2 * arm.length_2**2) / s
            bias_2 = -(w1 * w1 * arm.length_1**2 + w2 * w2 * c) / s
            cross, gyro = arm.coupling * c - arm.rotor, arm.coupling * s
            p1, p2 = arm.proximal * base + cross * link, cross * base + arm.distal * link
            mass += base[:, None] * p1 + link[:, None] * p2
            bias += base * (arm.proximal * bias_1 + cross * bias_2 - gyro * w2 * w2)
            bias += link * (cross * bias_1 + arm.distal * bias_2 + gyro * w1 * w1)
            rows += [base, link - base]
            turns += [bias_1, bias_2 - bias_1]
    g, turn = np.array(rows), np.array(turns)
    mass += mechanism.coupling * (g[0][:, None] * g[2] + g[2][:, None] * g[0])
    bias += mechanism.coupling * (g[0] * turn[2] + g[2] * turn[0])
    for i in range(4):
        if mechanism.coupled >> i & 1:
            one, two = mechanism.combination[i]
            g[i], turn[i] = one * g[0] + two * g[2], one * turn[0] + two * turn[2]
    return TipMotion(g, turn, mass, bias)


def invertible_mass(mechanism: Mechanism, tips: Array) -> Mask:
    """Whether the tip mass matrix has an inverse at each of tips (n, 2)."""
    (xx, xy), (_, yy) = tip_motion(mechanism, tips, np.zeros_like(tips)).mass
    return np.asarray((xx > 0.0) & (xx * yy - xy * xy > SMALLEST_DETERMINANT * (xx + yy) ** 2))


def why_impossible(mechanism: Mechanism) -> str:
    """Why this device cannot exist, as the end of a sentence; empty where it can."""
    tips, certain = _search(mechanism)
    if len(tips) == 0:
        return _why_no_tip(mechanism, certain)
    if not np.all(invertible_mass(mechanism, tips)):
        return "mass: too little of it, a force on the tip would accelerate it without bound (tip_kg and links)"
    return ""


def _why_no_tip(mechanism: Mechanism, certain: bool) -> str:
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
        f"geometry: no tip position in y > 0 at which both arms close within {within}"
        f"{'' if certain else f' and the tip has {1e6 * FINEST_M:g} um of room'} (bases {apart:g} m apart, {lengths})"
    )
