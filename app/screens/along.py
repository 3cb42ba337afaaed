"""What drawing works out of ticks, in one call for all of a frame: a call from Python costs more than what it does."""

import numpy as np

from core.control import BLEND_WIDTH
from core.jit import kernel
from core.mechanism import Brakes
from core.path import Path, nearest
from core.row import HAND_FX, HAND_FY, MOVE, PHASE, TIP_VX, TIP_VY, TIP_X, TIP_Y
from core.rules import Rules
from core.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.velocity_field import Field, field_at


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
def brake_directions(brakes: Brakes, g: np.ndarray, field: Field, rules: Rules, found: np.ndarray) -> int:
    """Into `found` (4, 3): the SDOF direction of each brake and its valid sense; the chosen brake, or -1."""
    for i in range(4):
        p_x, p_y = sdof_direction(g[i, 0], g[i, 1])
        found[i, 0], found[i, 1] = p_x, p_y
        found[i, 2] = valid_sense(p_x, p_y, field, rules.span_rounding)
    return nearest_valid_brake(brakes, g, field, rules)
