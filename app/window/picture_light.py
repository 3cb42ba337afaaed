"""The light of the picture: whether what is seen of a trial is what happens now."""

import time
from collections.abc import Callable

from app.ipc import messages as m

#: Our choice: a frame so late makes the light amber, for so long
BEHIND_S, WINDOW_S = 0.5, 2.0


class PictureLight:
    """Remembers the latest frame of a trial."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._worst_s, self._last_s = 0.0, -WINDOW_S

    def take(self, late_s: float) -> bool:
        """A frame of a running trial came so late; whether the light is to be looked at."""
        if late_s < BEHIND_S:
            return False
        self._worst_s = max(late_s, self._worst_s if self.is_on else 0.0)
        self._last_s = self._clock()
        return True

    @property
    def is_on(self) -> bool:
        return self._clock() - self._last_s < WINDOW_S

    def over(self, snapshot: m.Snapshot) -> m.Snapshot:
        """The snapshot with the light's check, while it is on."""
        if not self.is_on:
            return snapshot
        text = f"{self._worst_s:.1f} s behind"
        check = m.Check("Picture", m.CAUTION, text, "The picture comes late: close other programs.")
        return snapshot._replace(checks=(*snapshot.checks, check))
