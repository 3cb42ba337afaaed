"""Ticks for tests of what is drawn: quiet ones to change by hand, and a whole made-up trial."""

import numpy as np

from app.screens.synthetic_bench import synthetic_trial
from core import row
from core.device import Device
from core.path_file import Segment

ALONG = Segment((-0.10, 0.40), (0.10, 0.40))
ACROSS = Segment((-0.08, 0.26), (0.08, 0.42))
TIP = (0.02, 0.39)


def quiet(n: int = 16, phase: int = row.MOVE, start_s: float = 0.0, **columns: float) -> np.ndarray:
    """n ticks with the handle at TIP; columns by their names in core.row, as TIP_X=0.1 or CURRENT_B=0.4."""
    rows = np.zeros((n, row.WIDTH))
    rows[:, row.T] = start_s + 1e-3 * np.arange(n)
    rows[:, row.PHASE] = phase
    rows[:, row.TIP_X], rows[:, row.TIP_Y] = TIP
    for name, value in columns.items():
        base, _, joint = name.rpartition("_")
        place = getattr(row, base) + "AEBC".index(joint) if base in ("CURRENT", "TORQUE") else getattr(row, name)
        rows[:, place] = value
    return rows


def trial(device: Device, path: Segment = ALONG, seconds: float = 4.0) -> np.ndarray:
    """A made-up trial from approach to end."""
    return synthetic_trial(device, path, seconds)
