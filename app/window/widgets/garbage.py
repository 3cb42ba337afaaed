"""Python's garbage collector in a process with windows: it runs in their thread, between Qt's events, and only then.

A collection that starts by itself may start inside a call of Qt, or in another thread. The QObjects that it destroys
there can need a lock that the interrupted call holds, for instance in `QObject::disconnect`: the window stands still
for ever.
"""

import gc
import time

from PySide6.QtCore import QCoreApplication, QTimer

LOOK_MS = 100  # between two looks whether something is to be collected
#: A collection of all generations waits until it has taken less than this share of the time since the one before.
MAX_SHARE = 0.01


class Collector(QTimer):
    """Collects what is due by Python's own thresholds, the youngest generations most often."""

    def __init__(self, application: QCoreApplication) -> None:
        super().__init__(application, interval=LOOK_MS)
        gc.disable()
        gc.freeze()  # looking through all that was imported would hold a frame for 50 ms now and then
        self._whole_at_s = 0.0  # when all generations may be collected again
        self.timeout.connect(self.look)
        self.start()

    def look(self) -> None:
        """Collect the oldest generation that is due, and with it all younger ones."""
        due = [count > threshold > 0 for count, threshold in zip(gc.get_count(), gc.get_threshold(), strict=True)]
        began_s = time.perf_counter()
        if due[2] and began_s >= self._whole_at_s:
            gc.collect()
            ended_s = time.perf_counter()
            self._whole_at_s = ended_s + (ended_s - began_s) / MAX_SHARE
        elif due[1]:
            gc.collect(1)
        elif due[0]:
            gc.collect(0)
