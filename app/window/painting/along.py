"""What drawing works out, in one call for all of a frame: a call from Python costs more than what it does."""

import math

import numpy as np

from core.control.controllers import BLEND_WIDTH
from core.control.rule_sets import Rules
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import PIECE, SIDE, TRAVEL, Field, field_at
from core.kernel import kernel
from core.linkage import links
from core.mechanism import Brakes, Mechanism
from core.path import Path, nearest
from core.tick_log import HAND_FX, HAND_FY, MOVE, PHASE, TIP_VX, TIP_VY, TIP_X, TIP_Y


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
def by_bin(
    t: np.ndarray, values: np.ndarray, begin: int, end: int, rate: float,
    bins: np.ndarray, low: np.ndarray, high: np.ndarray, falls: np.ndarray,
) -> int:
    """Ticks begin .. end - 1 of times t (s) and values (series, n) in bins, `rate` a second; how many bins there are.

    Into bins (m,) their numbers; into low, high and falls (series, m) the lowest and the highest tick of each, NaN
    where one is NaN, and whether its last tick is lower than its first.
    """  # fmt: skip
    count, start = 0, begin
    for k in range(begin, end):
        now = math.floor(t[k] * rate + 1e-9)
        new = count == 0 or now != bins[count - 1]
        if new:
            bins[count] = now
            count, start = count + 1, k
        at = count - 1
        for i in range(len(values)):
            value = values[i, k]
            if new or value < low[i, at] or value != value:
                low[i, at] = value
            if new or value > high[i, at] or value != value:
                high[i, at] = value
            falls[i, at] = value < values[i, start]
    return count


@kernel
def brake_directions(brakes: Brakes, g: np.ndarray, field: Field, rules: Rules, found: np.ndarray) -> int:
    """Into `found` (4, 3): the SDOF direction of each brake and its valid sense; the chosen brake, or -1."""
    for i in range(4):
        p_x, p_y = sdof_direction(g[i, 0], g[i, 1])
        found[i, 0], found[i, 1] = p_x, p_y
        found[i, 2] = valid_sense(p_x, p_y, field, rules.span_rounding)
    return nearest_valid_brake(brakes, g, field, rules)
