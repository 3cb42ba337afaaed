"""A measured torque curve in place of Eq. (2): a monotone curve through the points of a table, without corners.

Our choice: quadratics (Schumaker 1983) with the slopes of a monotone cubic (Fritsch & Butland 1984): the torque rises
between the points as it does from point to point, its slope has no jumps, and its inverse is a square root.
"""

import math
from collections.abc import Sequence

import numpy as np

from core.files import Pair

MOST_POINTS = 24
#: Columns of a curve: where the piece begins (A), torque there (N m), slope there (N m/A), quadratic term (N m/A2).
FROM, TORQUE, SLOPE, SQUARE = range(4)
PIECES = 2 * (MOST_POINTS - 1)
NO_KNEE = -1.0  # A, of a brake with a table
NO_CURVE = np.full((4, PIECES, 4), math.inf)  # of the four brakes: each has Eq. (2)


def why_no_table(table: Sequence[Pair], current_max: float) -> str:
    """Why a table (A, N m) is no torque curve up to this current; "": it is one."""
    if not 2 <= len(table) <= MOST_POINTS:
        return f"torque_table has {len(table)} points, 2 to {MOST_POINTS} are needed"
    currents, torques = zip(*table, strict=True)
    if currents[0] != 0.0:
        return f"torque_table must begin at 0 A, not at {currents[0]:g}"
    if currents[-1] < current_max:
        return f"torque_table ends at {currents[-1]:g} A, below current_max_A = {current_max:g}"
    if torques[0] < 0.0:
        return f"torque_table gives a negative torque at zero current ({torques[0]:g} N m)"
    for what, values in (("currents", currents), ("torques", torques)):
        for before, after in zip(values, values[1:], strict=False):
            if not after > before:
                return f"torque_table: the {what} must rise from point to point, but {after:g} follows {before:g}"
    return ""


def torque_curve(table: Sequence[Pair]) -> np.ndarray:
    """The curve (PIECES, 4) through the points of a table (A, N m); rows that are not used are infinite."""
    x, y = np.array(table).T
    width, rise = np.diff(x), np.diff(y) / np.diff(x)
    inner = 2.0 * rise[:-1] * rise[1:] / (rise[:-1] + rise[1:])  # harmonic means: no more than twice either
    slope = np.concatenate([rise[:1], inner, rise[-1:]])
    middle = 2.0 * rise - 0.5 * (slope[:-1] + slope[1:])
    half = y[:-1] + 0.25 * width * (slope[:-1] + middle)
    curve = np.full((PIECES, 4), math.inf)
    pieces = 2 * len(width)
    curve[0:pieces:2] = np.column_stack([x[:-1], y[:-1], slope[:-1], (middle - slope[:-1]) / width])
    curve[1:pieces:2] = np.column_stack([x[:-1] + 0.5 * width, half, middle, (slope[1:] - middle) / width])
    return curve
