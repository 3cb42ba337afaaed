"""Ticks for tests of what is drawn: quiet ones to change by hand, and a whole made-up trial."""

import numpy as np

from core import tick_log
from core.device import Device
from core.path import Segment, build_path
from experiments.session.playback import fill_field
from tests.benchmarks.synthetic_bench import synthetic_trial

ALONG = Segment((-0.10, 0.40), (0.10, 0.40))
ACROSS = Segment((-0.08, 0.26), (0.08, 0.42))
TIP = (0.02, 0.39)


def quiet(n: int = 16, phase: int = tick_log.MOVE, start_s: float = 0.0, **columns: float) -> np.ndarray:
    """n ticks at TIP beside ALONG; columns by their names in core.tick_log, as TIP_X=0.1 or CURRENT_B=0.4."""
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = start_s + 1e-3 * np.arange(n)
    rows[:, tick_log.PHASE] = phase
    rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y] = TIP
    for name, value in columns.items():
        base, _, joint = name.rpartition("_")
        at = getattr(tick_log, base) + "AEBC".index(joint) if base in ("CURRENT", "TORQUE") else getattr(tick_log, name)
        rows[:, at] = value
    fill_field(build_path(ALONG, "path"), rows)
    return rows


def trial(device: Device, path: Segment = ALONG, seconds: float = 4.0) -> np.ndarray:
    """A made-up trial from approach to end."""
    return synthetic_trial(device, path, seconds)
