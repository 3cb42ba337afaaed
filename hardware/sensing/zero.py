"""What sensor and amplifiers read with nobody at the handle and no current, from samples taken so."""

import math
from collections.abc import Sequence

import numpy as np

from core.device_interface import DeviceError, DeviceSample, ZeroRecord

ZERO_SAMPLES = 500
STILL_M = 1e-3  # a handle that moved further was touched


def zero_of(taken: Sequence[DeviceSample], before: ZeroRecord) -> ZeroRecord:
    """The zero in samples; before: the one that was taken off their currents. DeviceError: the handle moved."""
    moved = float(np.max(np.ptp(np.array([sample.tip for sample in taken]), axis=0)))
    if not math.isfinite(moved):
        raise DeviceError("zero: nobody can tell whether the handle is still; home the encoders first")
    if moved > STILL_M:
        raise DeviceError("zero: the handle moved; nobody may touch it meanwhile")
    counts = np.array([sample.force_counts for sample in taken], dtype=float)
    a, e, b, c = (np.array([sample.current for sample in taken]).mean(axis=0) + before.current).tolist()
    mean, spread = counts.mean(axis=0).tolist(), counts.std(axis=0).tolist()
    return ZeroRecord(len(taken), tuple(mean), tuple(spread), (a, e, b, c))
