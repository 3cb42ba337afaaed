"""The light of the loop: whether ticks come in time now, by the newest ones.

Our choice: one tick that was missed in the last two seconds is amber. Of a board 20 are red: no trial starts until ten
seconds have passed without one.
"""

import time
from collections.abc import Callable

import numpy as np

from app.ipc.messages import BAD, CAUTION, GOOD, Check
from app.ipc.scheduling import ADVICE, Scheduling
from core import tick_log
from experiments.plan import counted

WINDOW_S, NEWEST = 2.0, 2000  # what is judged: so many seconds, which are so many ticks
MANY = 20  # missed ticks among them that a board's loop must not have
CALM_S = 10.0  # without a missed tick, before a trial of a board may start again
STEADY_S = 0.5  # that a text stands at least


class LoopLight:
    """Counts the ticks that were missed among the newest ones."""

    def __init__(self, board: bool, clock: Callable[[], float] = time.perf_counter) -> None:
        """board: the loop drives a real device, which loses its watchdog when ticks do not come."""
        self._board, self._clock = board, clock
        self._missed = np.zeros(0, bool)  # of the newest ticks, at most `NEWEST`
        self._last_s = -CALM_S  # when a missed tick was heard of last
        self._overrun = False  # `MANY` were missed, and `CALM_S` have not passed since
        self._check, self._said_s = Check("Loop", GOOD, "1 kHz"), -STEADY_S

    def take(self, lateness_us: np.ndarray) -> None:
        """More ticks of the loop, by how late each came (n,), us."""
        missed = lateness_us >= tick_log.MISSED_US
        self._missed = np.concatenate((self._missed, missed))[-NEWEST:]
        if missed.any():
            many = int(np.count_nonzero(self._missed)) >= MANY
            self._overrun = many or (self._overrun and self._since_s < CALM_S)
            self._last_s = self._clock()

    @property
    def _since_s(self) -> float:
        return self._clock() - self._last_s

    def check(self, scheduling: Scheduling) -> Check:
        """What the light says now."""
        missed = int(np.count_nonzero(self._missed)) if self._since_s < WINDOW_S else 0
        blocks = self._board and self._overrun and self._since_s < CALM_S
        state = BAD if blocks else CAUTION if missed else GOOD
        if state != self._check.state or self._clock() - self._said_s >= STEADY_S:
            self._check, self._said_s = Check("Loop", state, *self._words(missed, blocks, scheduling)), self._clock()
        return self._check

    def _words(self, missed: int, blocks: bool, scheduling: Scheduling) -> tuple[str, str]:
        """What was found, and what to do about it."""
        if not missed and not blocks:
            return "1 kHz", ""
        text = f"late: {counted(missed, 'tick')} missed in the last {WINDOW_S:g} s" if missed else "cannot keep up"
        again = f"The next trial can start after {CALM_S:g} s without a missed tick." if blocks else ""
        privilege = "" if scheduling.real_time else ADVICE
        return text, " ".join(filter(None, ("Ticks come late: close other programs.", again, privilege)))
