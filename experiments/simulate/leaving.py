"""Where a simulated tip goes that no scene may begin at: behind the bases, or beyond the hard stops."""

import math

import numpy as np

from core.mechanism import Mechanism
from core.workspace import tip_is_free

LOOK_EVERY_S = 5e-3  # of a scene whose rows are further apart
#: A tip at rest at a hard stop is not beyond it: so much of the margin, and of an angle (rad), is allowed. Our choice.
MARGIN_WITHIN, ANGLE_WITHIN = 0.02, 0.01


class Leaving:
    """Finds when and how the tip first leaves the workspace."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism._replace(
            margin=(1.0 - MARGIN_WITHIN) * mechanism.margin,
            theta_low=mechanism.theta_low - ANGLE_WITHIN,
            theta_high=mechanism.theta_high + ANGLE_WITHIN,
        )
        self.warning = ""

    def look(self, times: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """Take the next times (s) and tips (m) of the motion."""
        out = np.flatnonzero(~tip_is_free(self.mechanism, x, y))
        if self.warning or not len(out):
            return
        first = out[0]
        where = "passes behind the bases" if y[first] <= 0.0 else "is beyond a hard stop"
        self.warning = (
            f"the tip leaves the workspace at t = {times[first]:.4g} s: it {where}, "
            f"at ({x[first]:.3f}, {y[first]:.3f}) m"
        )


def looks_per_row(steps: int, step_s: float) -> int:
    """Into how many equal parts the steps of a row are divided, so that none is longer than `LOOK_EVERY_S`."""
    most = max(1, math.floor(LOOK_EVERY_S / step_s * (1.0 + 1e-9)))
    return steps // next(part for part in range(min(most, steps), 0, -1) if steps % part == 0)
