"""Measures of one's own: how far off the last third of the path the handle is, and how long the hand pushes hard.

Name the file in a protocol beside it: measure = "my_measure.py"
"""

import numpy as np

from experiments.analysis.own_measures import Measure


def late_error(movement):
    """The largest distance from the path in its last third, mm."""
    late = movement.progress > 2.0 / 3.0 * movement.path.length
    return 1e3 * movement.deviation[late].max() if late.any() else None  # None: there is nothing to measure


def hard_push(movement):
    """Share of the movement in which the hand force is above 5 N."""
    force = np.hypot(movement.column("hand_fx_N"), movement.column("hand_fy_N"))  # also as movement.force
    return np.mean(force > 5.0)


MEASURES = (
    Measure("late_error_mm", "Late error", "mm", late_error, "largest distance from the path in its last third"),
    Measure("hard_push_share", "Hard push", "", hard_push, "share of the time with a hand force above 5 N"),
)
