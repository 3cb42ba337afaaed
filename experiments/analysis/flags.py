"""What an experimenter should know of a trial before it is kept, as sentences."""

import numpy as np

from core import tick_log
from experiments.analysis.trials_table import TrialRow

LATE_US = 1000.0  # a tick so late has missed its millisecond
CLIPPED = 0.999  # of the largest force of the hand's spring


def trial_flags(row: TrialRow, ticks: np.ndarray | None) -> list[str]:
    """The flags of a trial, from its row and its ticks (n, tick_log.WIDTH), where they are known; none: all is well."""
    flags = []
    if row.status == "timeout":
        flags.append("Time ran out before the end was reached")
    if row.status == "aborted":
        flags.append("The trial was aborted")
    if ticks is None or not len(ticks):
        return flags
    move = ticks[ticks[:, tick_log.PHASE] == tick_log.MOVE]
    late = int(np.count_nonzero(ticks[:, tick_log.LATENESS_US] >= LATE_US))
    if late:
        flags.append(f"{late} tick{'s' if late > 1 else ''} came a millisecond or more too late")
    most = move[:, tick_log.ARM_FORCE_MAX]
    force = np.hypot(move[:, tick_log.HAND_FX], move[:, tick_log.HAND_FY])
    left = int(np.count_nonzero((most[:-1] > 0.0) & (most[1:] == 0.0)))
    if left:
        often = "once" if left == 1 else f"{left} times"
        flags.append(f"The pointer left the picture {often}, and the hand let the handle go")
    clipped = 1e-3 * np.count_nonzero((most > 0.0) & np.isfinite(most) & (force >= CLIPPED * most))
    if clipped:
        flags.append(f"The hand force was at its limit for {clipped:.2f} s")
    return flags
