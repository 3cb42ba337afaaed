"""What can be laid over the workspace: the velocity field, the SDOF directions, the forces that can be reached.

All of it from a tick's row, the path and the geometry of the device, in numpy: no kernel of control is compiled here.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from PySide6.QtCore import QRectF

from core import tick_log
from core.control.velocity_field import Field, field_around
from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.path import Path, PathFile, outline
from core.workspace import arm_pose, brake_rows, tip_is_free

Point = tuple[float, float]  # m

MARGIN_M = 0.03  # around everything that must be seen
SPACING_M = 0.002  # of the points of a drawn path: straight between them


def joints_at(mechanism: Mechanism, tip: Point) -> dict[str, Point]:
    """Where the joints A, E, B, C and D are (m) for a tip; none where the arms do not reach it."""
    joints: dict[str, Point] = {}
    for arm, base, elbow in ((mechanism.arm_1, "A", "E"), (mechanism.arm_2, "B", "C")):
        (x, y), _, _ = arm_pose(arm, *np.asarray(tip, dtype=float))
        joints |= {base: (arm.base_x, arm.base_y), elbow: (arm.base_x + float(x), arm.base_y + float(y))}
    reached = all(map(math.isfinite, (*joints["E"], *joints["C"])))
    return {**joints, "D": tip} if reached else {}


def extent_of_paths(paths: Iterable[PathFile], margin: float = MARGIN_M) -> QRectF:
    """The rectangle (m) around all of these paths."""
    return _around(np.concatenate([outline(path, SPACING_M) for path in paths]), margin)


def extent_of_linkages(devices: Sequence[Device], paths: Iterable[PathFile]) -> QRectF:
    """The rectangle (m) in which every device's linkage stays while its tip is on these paths."""
    places: list[Point] = []
    for path in paths:
        points = np.asarray(outline(path, SPACING_M))
        every = max(1, len(points) // 24)
        for tip in (*points[::every].tolist(), points[-1].tolist()):
            places += [place for device in devices for place in joints_at(device.mechanism, (tip[0], tip[1])).values()]
    return _around(np.array(places), MARGIN_M)


def _around(points: np.ndarray, margin: float) -> QRectF:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return QRectF(low[0], low[1], high[0] - low[0], high[1] - low[1])


MOVES_M_S = 0.002  # slower than this there is no present motion to act against
AT_REST_RAD_S = 1e-9  # a joint that turns more slowly is stuck
ROUNDING = 1e-9  # of a unit vector


class Direction(NamedTuple):
    """The way that one locked brake leaves the tip: a unit vector and its valid sense (0: neither)."""

    joint: int  # in the order A, E, B, C
    p_x: float
    p_y: float
    sense: float
    chosen: bool  # the valid one nearest to the desired direction


class Wedge(NamedTuple):
    """Directions of the forces that the brakes can exert against the present motion, rad counter-clockwise from +x."""

    first: float
    last: float  # > first, at most pi more
    spokes: tuple[float, ...]  # each brake by itself


def field_of(row: np.ndarray) -> Field | None:
    """The velocity field at the handle as the controller had it in a tick; None where it did not decide."""
    distance, _, t_x, t_y, beta_x, beta_y = row[tick_log.PATH_DISTANCE : tick_log.DESIRED_Y + 1].tolist()
    turned = t_y * beta_x - t_x * beta_y  # beta lies between t and n; on the path both are one
    side = math.copysign(1.0, turned if abs(turned) > 1e-9 else distance)
    return Field(abs(distance), t_x, t_y, side * t_y, -side * t_x, beta_x, beta_y) if math.isfinite(t_x) else None


def field_at_rest(path: Path, tip: Point, sense: float) -> Field:
    """The velocity field at a tip (m) where nothing is decided, with this travel sense."""
    return Field(*np.array(field_around(path, np.array([tip]), sense))[:, 0].tolist())


def needles(path: Path, sense: float, device: Device, low: Point, high: Point, step: float) -> np.ndarray:
    """The field on a grid (m) between two corners, wherever the tip can be: rows x, y, beta_x, beta_y (n, 4)."""
    x, y = (step * np.arange(math.ceil(a / step), math.floor(b / step) + 1) for a, b in zip(low, high, strict=True))
    x, y = np.meshgrid(x, y)
    free = tip_is_free(device.mechanism, x, y)
    places = np.column_stack((x[free], y[free]))
    field = field_around(path, places, sense)
    return np.column_stack((places, field.beta_x, field.beta_y))


def directions(device: Device, g: np.ndarray, field: Field) -> list[Direction]:
    """The SDOF direction of every brake (Eq. 12) at the tip, and whether it lies between t and n (Section IV-B)."""
    found: list[Direction] = []
    chosen, nearest = -1, -2.0  # cosine of the angle to beta
    for i in map(JOINTS.index, device.braked):
        p_x, p_y = (np.array((-g[i, 1], g[i, 0])) / math.hypot(*g[i])).tolist()
        along, inward = p_x * field.t_x + p_y * field.t_y, p_x * field.n_x + p_y * field.n_y
        sense = 1.0 if min(along, inward) >= -ROUNDING else -1.0 if max(along, inward) <= ROUNDING else 0.0
        cosine = sense * (p_x * field.beta_x + p_y * field.beta_y)
        if sense != 0.0 and cosine > nearest:
            chosen, nearest = len(found), cosine
        found.append(Direction(i, p_x, p_y, sense, False))
    return [direction._replace(chosen=place == chosen) for place, direction in enumerate(found)]


def wedge(device: Device, g: np.ndarray, vx: float, vy: float, stuck: int) -> Wedge | None:
    """The forces available against the motion (vx, vy), m/s, as in Fig. 1; None at rest.

    A slipping brake pushes one way only, against its own rate; a stuck one (bit of `stuck`) pushes either way. All of
    these have no component along the motion, so they lie within half a turn.
    """
    if math.hypot(vx, vy) < MOVES_M_S:
        return None
    against = math.atan2(-vy, -vx)
    spokes = []
    for i in range(4):
        if not device.brakes.present[i]:
            continue
        g_x, g_y = float(g[i, 0]), float(g[i, 1])
        rate = g_x * vx + g_y * vy
        held = stuck >> i & 1 or abs(rate) < AT_REST_RAD_S
        for sign in (-1.0, 1.0) if held else (-math.copysign(1.0, rate),):
            along, across = -sign * (g_x * vx + g_y * vy), sign * (g_y * -vx - g_x * -vy)
            turn = math.atan2(across, max(along, 0.0))
            spokes.append(against + turn)
    return Wedge(min(spokes), max(spokes), tuple(spokes)) if spokes else None


OFF, SLIPPING, STUCK = "off", "slips", "stuck"


class Doing(NamedTuple):
    """What a brake does: off (without current), slipping or stuck; its torque, N m, >= 0."""

    state: str = OFF
    torque: float = 0.0


def doing(device: Device, rows: np.ndarray) -> dict[str, Doing]:
    """What each brake does in the last of some ticks (n, WIDTH): joint -> off where it has no current then, else what
    it did during most of those with current, and its mean torque.
    """
    found = {}
    for joint in device.braked:
        i = JOINTS.index(joint)
        on = rows[:, tick_log.CURRENT + i] > 0.0
        if not on[-1]:
            found[joint] = Doing()
            continue
        stuck = (rows[on, tick_log.STUCK].astype(int) >> i & 1).mean() > 0.5
        found[joint] = Doing(STUCK if stuck else SLIPPING, float(np.abs(rows[on, tick_log.TORQUE + i]).mean()))
    return found


@dataclass(frozen=True)
class Instant:
    """A device with its tip at a place (m), at rest; or what a tick says of it."""

    device: Device
    tip: Point
    running: bool = False
    velocity: Point = (0.0, 0.0)  # m/s
    hand: Point = (0.0, 0.0)  # N, its force on the tip
    torques: tuple[float, ...] = ()  # N m, of the brakes, in the order A, E, B, C
    stuck: int = 0  # a bit for each brake
    wanted: Point | None = None  # m, where the hand wants the tip to be
    field: Field | None = None  # as the controller had it; none where it did not decide

    @classmethod
    def of_tick(cls, device: Device, tick: np.ndarray) -> Self:
        """As a tick (tick_log.WIDTH,) has it."""
        now, t = tick.tolist(), tick_log
        tip, wanted = (now[t.TIP_X], now[t.TIP_Y]), (now[t.TARGET_X], now[t.TARGET_Y])
        return cls(
            device, tip, True, (now[t.TIP_VX], now[t.TIP_VY]), (now[t.HAND_FX], now[t.HAND_FY]),
            tuple(now[t.TORQUE : t.TORQUE + 4]), int(now[t.STUCK]),
            wanted if 1e-3 < math.dist(wanted, tip) < 1.0 else None, field_of(tick),
        )  # fmt: skip

    @cached_property
    def joints(self) -> dict[str, Point]:
        """Where they are, m; empty out of reach."""
        return joints_at(self.device.mechanism, self.tip)

    @cached_property
    def g(self) -> np.ndarray:
        """How the joints' rates follow from the tip's velocity (4, 2), rad/m."""
        return brake_rows(self.device.mechanism, *self.tip)

    @cached_property
    def brakes(self) -> Point:
        """The force that the brakes exert on the tip, N."""
        x, y = (self.g.T @ self.torques).tolist() if any(self.torques) else (0.0, 0.0)
        return x, y

    def reachable(self) -> Wedge | None:
        """The forces that the brakes can exert against the present motion; None at rest."""
        return wedge(self.device, self.g, *self.velocity, self.stuck) if self.running else None
