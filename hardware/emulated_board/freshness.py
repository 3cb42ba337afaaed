"""Which commands a board may still obey: newer than the last one, and not held up on their way."""

from enum import Enum

LATE_US = 50_000  # us; a command that took this much longer than the quickest of late is not obeyed
LATE_FORGET = 1000  # us per s at which "the quickest of late" is forgotten: more than two clocks drift apart
WRAP = 1 << 32


class Age(Enum):
    """What a command is, by its sequence number and its host time."""

    FRESH = 0
    OLD = 1  # it came before, or after a newer one
    LATE = 2


class Freshness:
    """Judges the commands of one connection. The two clocks need not agree: only differences count."""

    def __init__(self) -> None:
        self.last = 0  # sequence number of the last command that was taken in
        self._any = False
        self._quickest: tuple[int, int] | None = None  # us: when it came, and board time less host time then

    def judge(self, sequence: int, host_us: int, now_us: int) -> Age:
        """What this command is; changes nothing but the memory of how long commands take."""
        if self._any and not 0 < (sequence - self.last) % WRAP < WRAP // 2:
            return Age.OLD
        took = now_us - host_us
        quickest = took
        if self._quickest is not None:
            then, least = self._quickest
            quickest = least + (now_us - then) * LATE_FORGET // 1_000_000
        if took <= quickest:
            self._quickest = now_us, took
        return Age.LATE if took - quickest > LATE_US else Age.FRESH

    def take(self, sequence: int) -> None:
        """This command was taken in."""
        self.last, self._any = sequence, True
