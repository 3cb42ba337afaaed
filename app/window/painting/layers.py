"""What can be laid over the workspace: the velocity field, the SDOF directions, the forces that can be reached."""

import math
from typing import NamedTuple

import numpy as np

from app.window.painting.along import brake_directions, by_bin, elbows, errors, field_on, follow_ticks
from core import tick_log
from core.control.controllers import BLEND_WIDTH
from core.control.rule_sets import SETTLED, Rules
from core.control.velocity_field import TRAVEL, Field, field_at, new_memory
from core.device import Device
from core.linkage import tip_force_map
from core.path import Path, line, nearest
from core.workspace import tip_is_free

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
    ones = np.zeros((1, 1))
    by_bin(ticks[0], ones, 0, 1, 1.0, ones[0], ones, ones, np.zeros((1, 1), dtype=bool))
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
