"""Brings the ticks of a trial from the ring to its recording, on a thread that alone waits for the disk."""

import queue
import threading
import time
from collections.abc import Callable

import numpy as np

from app.live.messages import Proof, Timing
from app.live.ring import Ring
from core import row
from experiments.recording import RecordingWriter

DRAIN_S = 0.02
LATE_US = 1000.0  # a tick so late has missed its millisecond


class Recorder:
    """Takes every tick of one trial until `close`; the writer stays open for whoever knows the outcome."""

    def __init__(self, ring: Ring, writer: RecordingWriter | None) -> None:
        """writer: None for a trial that is not kept."""
        self.writer = writer
        self.error = ""  # why the recording takes no more
        self._ring = ring
        self._lateness: list[np.ndarray] = []
        self._bytes, self._last_write = 0, time.monotonic()
        self._beside: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder")
        self._thread.start()

    def beside(self, write: Callable[[], None]) -> None:
        """Do something else that waits for the disk (the journal) between two looks into the ring."""
        self._beside.put(write)

    def close(self) -> None:
        """Take what is left in the ring and end the thread."""
        self._end.set()
        self._thread.join()

    def proof(self) -> Proof | None:
        """What is in the file by now; None: nothing is kept."""
        writer, now = self.writer, time.monotonic()
        if writer is None:
            return None
        if writer.bytes_written != self._bytes:
            self._bytes, self._last_write = writer.bytes_written, now
        return Proof(writer.path.name, writer.rows_written, writer.bytes_written, now - self._last_write)

    @property
    def lateness_us(self) -> np.ndarray:
        """How late each tick so far was, (n,) us."""
        return np.concatenate([np.empty(0), *self._lateness])

    def timing(self, scheduling: str) -> Timing | None:
        """The lateness of all ticks so far; None: there are none."""
        lateness = self.lateness_us
        return timing_of(lateness, scheduling) if len(lateness) else None

    def _work(self) -> None:
        ending = False
        while not ending:
            ending = self._end.wait(DRAIN_S)
            rows = self._ring.take()
            try:
                if self.writer is not None and not self.error:  # after one: the trial is being ended for it
                    self.writer.write(rows)
                while not self._beside.empty():
                    self._beside.get()()
            except (OSError, ValueError) as error:
                self.error = f"the recording failed: {getattr(error, 'strerror', None) or error}"
            self._ring.taken(len(rows))
            if len(rows):
                self._lateness.append(rows[:, row.LATENESS_US].copy())


def timing_of(lateness_us: np.ndarray, scheduling: str) -> Timing:
    """The figures of a loop's lateness (n,), us."""
    p50, p99 = np.percentile(lateness_us, (50.0, 99.0))
    missed = int(np.count_nonzero(lateness_us >= LATE_US))
    return Timing(float(p50), float(p99), float(lateness_us.max()), missed, scheduling)
