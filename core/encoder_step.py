"""How far the tip moves for one count of the encoders."""

import math
from collections.abc import Sequence

import numpy as np

from core.device import Device
from core.linkage import tip_force_map
from core.simulator.state import pack_mechanism


def encoder_step(device: Device, tip: tuple[float, float], counts_per_rev: Sequence[int]) -> float:
    """m at a tip (m), in the direction where it is coarsest; counts_per_rev (4,), joints A, E, B, C, 0 without one.

    Rows of Eqs. (7) and (8) are the joint rates for a velocity of the tip; infinite where a direction is not sensed.
    """
    rates = np.empty((4, 2))
    tip_force_map(pack_mechanism(device.mechanism)[0], tip[0], tip[1], rates)  # 1/m
    counts = rates * np.asarray(counts_per_rev, dtype=float)[:, None] / (2.0 * math.pi)
    least = float(np.linalg.svd(counts, compute_uv=False)[-1])
    return 1.0 / least if least > 0.0 else math.inf
