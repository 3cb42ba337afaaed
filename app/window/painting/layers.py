"""What can be laid over the workspace: the velocity field, the SDOF directions, the forces that can be reached."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QRectF

from core import tick_log
from core.control.rule_sets import SETTLED, Rules
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import BLEND_WIDTH, PIECE, SIDE, TRAVEL, Field, field_at, new_memory
from core.device import Device
from core.kernel import kernel
from core.linkage import links, tip_force_map
from core.mechanism import JOINTS, Brakes, Mechanism
from core.path import Path, PathFile, line, nearest, outline
from core.tick_log import HAND_FX, HAND_FY, MOVE, PHASE, TIP_VX, TIP_VY, TIP_X, TIP_Y
from core.workspace import tip_is_free


@kernel
def follow_ticks(path: Path, memory: np.ndarray, rows: np.ndarray, rules: Rules) -> Field:
    """The field after ticks (n, row.WIDTH), n > 0, as the controller has it in the move; before: at the tip at rest."""
    last = rows[len(rows) - 1]
    x, y, vx, vy, fx, fy = last[TIP_X], last[TIP_Y], 0.0, 0.0, 0.0, 0.0
    moves = False
    for i in range(len(rows)):
        now = rows[i]
        if now[PHASE] == MOVE:
            if moves:
                field_at(path, memory, x, y, vx, vy, fx, fy, BLEND_WIDTH, rules)
            x, y, vx, vy, fx, fy = now[TIP_X], now[TIP_Y], now[TIP_VX], now[TIP_VY], now[HAND_FX], now[HAND_FY]
            moves = True
    return field_at(path, memory, x, y, vx, vy, fx, fy, BLEND_WIDTH, rules)


@kernel
def errors(path: Path, rows: np.ndarray, error: np.ndarray) -> None:
    """Into `error` (n,), m: the tip's distance from the path in the ticks (n, row.WIDTH) of the move, else NaN."""
    for i in range(len(rows)):
        error[i] = abs(nearest(path, rows[i, TIP_X], rows[i, TIP_Y])[1]) if rows[i, PHASE] == MOVE else np.nan


@kernel
def field_on(path: Path, memory: np.ndarray, places: np.ndarray, rules: Rules, beta: np.ndarray) -> None:
    """Into `beta` (n, 2): the desired directions at places (n, 2), m, each as if it were the first; uses up memory."""
    piece, travel = memory[PIECE], memory[TRAVEL]
    for i in range(len(places)):
        memory[PIECE], memory[TRAVEL], memory[SIDE] = piece, travel, 0.0
        field = field_at(path, memory, places[i, 0], places[i, 1], 0.0, 0.0, 0.0, 0.0, BLEND_WIDTH, rules)
        beta[i, 0], beta[i, 1] = field.beta_x, field.beta_y


@kernel
def elbows(mechanism: Mechanism, x: float, y: float) -> tuple[float, float, float, float]:
    """Where the elbows E and C are (x, y, x, y; m) for a tip (m); NaN where an arm does not reach it."""
    first, second = mechanism.arm_1, mechanism.arm_2
    a_x, a_y, _, _, s_1 = links(first, x, y)
    b_x, b_y, _, _, s_2 = links(second, x, y)
    if s_1 == 0.0 or s_2 == 0.0:
        return np.nan, np.nan, np.nan, np.nan
    return first.base_x + a_x, first.base_y + a_y, second.base_x + b_x, second.base_y + b_y


@kernel
def brake_directions(brakes: Brakes, g: np.ndarray, field: Field, rules: Rules, found: np.ndarray) -> int:
    """Into `found` (4, 3): the SDOF direction of each brake and its valid sense; the chosen brake, or -1."""
    for i in range(4):
        p_x, p_y = sdof_direction(g[i, 0], g[i, 1])
        found[i, 0], found[i, 1] = p_x, p_y
        found[i, 2] = valid_sense(p_x, p_y, field, rules.span_rounding)
    return nearest_valid_brake(brakes, g, field, rules)


Point = tuple[float, float]  # m

MARGIN_M = 0.03  # around everything that must be seen
SPACING_M = 0.002  # of the points of a drawn path: straight between them


def joints_at(mechanism: Mechanism, tip: Point) -> dict[str, Point]:
    """Where the joints A, E, B, C and D are (m) for a tip; none where the arms do not reach it."""
    first, second = mechanism.arm_1, mechanism.arm_2
    e_x, e_y, c_x, c_y = elbows(mechanism, *tip)
    if math.isnan(e_x):
        return {}
    return {
        "A": (first.base_x, first.base_y), "E": (e_x, e_y), "B": (second.base_x, second.base_y), "C": (c_x, c_y),
        "D": tip,
    }  # fmt: skip


def extent_of_paths(paths: Iterable[PathFile], margin: float = MARGIN_M) -> QRectF:
    """The rectangle (m) around all of these paths."""
    return _around(np.concatenate([outline(path, SPACING_M) for path in paths]), margin)


def extent_of_linkages(devices: Sequence[Device], paths: Iterable[PathFile], margin: float = MARGIN_M) -> QRectF:
    """The rectangle (m) in which every device's linkage stays while its tip is on these paths."""
    places: list[Point] = []
    for path in paths:
        points = np.asarray(outline(path, SPACING_M))
        every = max(1, len(points) // 24)
        for tip in (*points[::every].tolist(), points[-1].tolist()):
            places += [place for device in devices for place in joints_at(device.mechanism, (tip[0], tip[1])).values()]
    return _around(np.array(places), margin)


def _around(points: np.ndarray, margin: float) -> QRectF:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return QRectF(low[0], low[1], high[0] - low[0], high[1] - low[1])


MOVES_M_S = 0.002  # slower than this there is no present motion to act against
AT_REST_RAD_S = 1e-9  # a joint that turns more slowly is stuck


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


class Follower:
    """The velocity field of one path as the controller sees it, with the travel sense that the hand has chosen."""

    def __init__(self, path: Path, rules: Rules) -> None:
        self.path, self.rules = path, rules
        self._memory = new_memory()

    @property
    def sense(self) -> float:
        """+1: forward is towards the end of the path; -1: towards its start."""
        return float(self._memory[TRAVEL])

    def follow(self, x: float, y: float, vx: float, vy: float, fx: float, fy: float) -> Field:
        """The field at the tip (m, m/s, N) in the next tick of `move`."""
        return field_at(self.path, self._memory, x, y, vx, vy, fx, fy, BLEND_WIDTH, self.rules)

    def follow_ticks(self, rows: np.ndarray) -> Field:
        """The field after ticks (n, tick_log.WIDTH), n > 0, all of which have been felt in the move."""
        return follow_ticks(self.path, self._memory, np.ascontiguousarray(rows), self.rules)

    def error(self, x: float, y: float) -> float:
        """Distance of the tip from the path, m."""
        return abs(nearest(self.path, x, y)[1])

    def needles(self, device: Device, low: tuple[float, float], high: tuple[float, float], step: float) -> np.ndarray:
        """The field on a grid (m) between two corners, wherever the tip can be: rows x, y, beta_x, beta_y (n, 4)."""
        x, y = (step * np.arange(math.ceil(a / step), math.floor(b / step) + 1) for a, b in zip(low, high, strict=True))
        x, y = np.meshgrid(x, y)
        free = tip_is_free(device.mechanism, x, y)
        places = np.column_stack((x[free], y[free]))
        beta = np.empty_like(places)
        field_on(self.path, self._memory.copy(), places, self.rules, beta)
        return np.hstack((places, beta))


def compile_kernels(device: Device) -> None:
    """Have every kernel compiled and kept on disk that drawing calls: seconds, on the first use only."""
    follower = Follower(line((-0.1, 0.4), (0.1, 0.4)), SETTLED)
    field = follower.follow(0.0, 0.4, 0.0, 0.0, 0.0, 0.0)
    follower.error(0.0, 0.4)
    ticks = np.zeros((1, tick_log.WIDTH))
    follower.follow_ticks(ticks)
    errors(follower.path, ticks, np.empty(1))
    follower.needles(device, (-0.05, 0.35), (0.05, 0.4), 0.02)
    elbows(device.mechanism, 0.0, 0.4)
    directions(device, force_map(device, 0.0, 0.4), field, SETTLED)


def force_map(device: Device, x: float, y: float) -> np.ndarray:
    """Rows g (4, 2) at a tip (m): force of a brake on the tip = g torque, rate of its joint = g . v."""
    g = np.zeros((4, 2))
    tip_force_map(device.mechanism, x, y, g)
    return g


def directions(device: Device, g: np.ndarray, field: Field, rules: Rules) -> list[Direction]:
    """The SDOF direction of every brake (Eq. 12) at the tip."""
    found = np.empty((4, 3))
    chosen = brake_directions(device.brakes, g, field, rules, found)
    return [
        Direction(i, p_x, p_y, sense, i == chosen)
        for i, (p_x, p_y, sense) in enumerate(found.tolist())
        if device.brakes.present[i]
    ]


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


OFF, SLIPPING, STUCK = "off", "slipping", "stuck"


class Doing(NamedTuple):
    """What a brake does: off (without current), slipping or stuck; its torque, N m, >= 0."""

    state: str = OFF
    torque: float = 0.0


def doing(device: Device, rows: np.ndarray) -> dict[str, Doing]:
    """What each brake did during most of some ticks (n, WIDTH): joint -> state and mean torque. None: all off."""
    found = {}
    for joint in device.braked:
        i = JOINTS.index(joint)
        on = rows[:, tick_log.CURRENT + i] > 0.0
        if 2 * np.count_nonzero(on) <= len(rows):
            found[joint] = Doing()
            continue
        stuck = (rows[on, tick_log.STUCK].astype(int) >> i & 1).mean() > 0.5
        found[joint] = Doing(STUCK if stuck else SLIPPING, float(np.abs(rows[on, tick_log.TORQUE + i]).mean()))
    return found


class Instant:
    """A device with its tip at a place (m); with a tick (tick_log.WIDTH,) also velocity and forces.

    blind: nothing that would tell the controllers apart; the brakes then seem to do nothing.
    """

    def __init__(self, device: Device, tip: Point, tick: np.ndarray | None = None, blind: bool = False) -> None:
        self.device, self.tip, self.blind = device, tip, blind
        self.running = tick is not None
        self.joints = joints_at(device.mechanism, tip)  # m; empty out of reach
        self.g = force_map(device, *tip)
        now = np.zeros(tick_log.WIDTH).tolist() if tick is None else tick.tolist()
        self.velocity: Point = (now[tick_log.TIP_VX], now[tick_log.TIP_VY])  # m/s
        self.hand: Point = (now[tick_log.HAND_FX], now[tick_log.HAND_FY])  # N
        self.brakes: Point = (0.0, 0.0)  # N, what they exert on the tip
        self.wanted: Point | None = None  # m, where the hand wants the tip to be
        self._stuck = int(now[tick_log.STUCK])
        if tick is None:
            return
        wanted = (now[tick_log.TARGET_X], now[tick_log.TARGET_Y])
        self.wanted = wanted if 1e-3 < math.dist(wanted, tip) < 1.0 else None
        if not blind:
            x, y = (self.g.T @ now[tick_log.TORQUE : tick_log.TORQUE + 4]).tolist()
            self.brakes = (x, y)

    def reachable(self) -> Wedge | None:
        """The forces that the brakes can exert against the present motion; None at rest, and while blind: with the
        stuck ones it would tell the controllers apart, without them it would be wrong."""
        return wedge(self.device, self.g, *self.velocity, self._stuck) if self.running and not self.blind else None
