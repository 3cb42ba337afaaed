"""The pace of the control loop: one absolute deadline a tick, and how late each tick was run."""

import time
from collections.abc import Callable

import numpy as np

from experiments.operator import TICK_S

#: Ticks run at once after a stall. Our choice: after a longer one (a machine that slept) the trial's time waits, so
#: that the handle does not race through seconds on a target that nobody aimed at; the lateness of the ticks says so.
MOST_AT_ONCE = 100


class Pace:
    """Deadlines 1 ms apart from now on."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._next = clock()  # s, deadline of the next tick

    def wait(self) -> np.ndarray:
        """Sleep until a tick is due; how late each of the ticks due now is, microseconds (n,), oldest first."""
        now = self._clock()
        while now < self._next:
            self._sleep(self._next - now)
            now = self._clock()
        due = int((now - self._next) / TICK_S) + 1
        n = min(due, MOST_AT_ONCE)
        late = now - self._next - TICK_S * np.arange(n)
        self._next = self._next + n * TICK_S if n == due else now + TICK_S
        return 1e6 * late
