"""Whether the ticks of a movement came in time, and whether its trial is usable if some did not."""

from typing import NamedTuple, Self

import numpy as np

from core import tick_log
from experiments.plan import counted, grouped

#: Our choice, also in docs/accuracy-and-timing.md: a trial is usable if at most this share of its movement's ticks was
#: missed and none came later than this.
MISSED_SHARE, LATEST_US = 0.01, 20e3


class Punctuality(NamedTuple):
    """How late the ticks of a movement came, from "go" to its end."""

    ticks: int = 0
    missed: int = 0
    latest_us: float = 0.0

    def plus(self, rows: np.ndarray) -> Self:
        """With more ticks (n, tick_log.WIDTH) of the trial."""
        late_us = rows[rows[:, tick_log.PHASE] == tick_log.MOVE, tick_log.LATENESS_US]
        missed = int(np.count_nonzero(late_us >= tick_log.MISSED_US))
        latest_us = float(late_us.max(initial=self.latest_us))
        return self._replace(ticks=self.ticks + len(late_us), missed=self.missed + missed, latest_us=latest_us)

    @property
    def usable(self) -> bool:
        return self.missed <= MISSED_SHARE * self.ticks and self.latest_us <= LATEST_US

    @property
    def words(self) -> str:
        """How many were missed, and whether the trial is usable; "": none was."""
        if not self.missed:
            return ""
        verdict = "usable" if self.usable else "look at its curves, or repeat it"
        of = f"{counted(self.missed, 'tick')} missed of {grouped(self.ticks)}"
        return f"{of}, up to {1e-3 * self.latest_us:.0f} ms late: {verdict}"
