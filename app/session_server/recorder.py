"""Writes the ticks of a trial from the ring to its recording, on a thread that alone waits for the disk.

Our choice: if the disk fails or the folder goes, the trial runs on to its end with its ticks in memory. To end it would
lose the movement for certain; memory loses it only if this program ends before the disk is back.
"""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.ipc.messages import Proof
from app.ipc.ring import Ring
from app.ipc.scheduling import LostTime, lost_time
from core import tick_log
from core.faults import cause
from experiments.store.recording import RecordingWriter

DRAIN_S = 0.02
OnTicks = Callable[[np.ndarray], None]
LIVE = 500  # readings of the ring, 10 s: the percentiles of a running trial are of these


class Timing(NamedTuple):
    """The lateness of ticks in the running (or last) trial, and its causes; None: the system does not count it."""

    p50_us: float
    p99_us: float
    max_us: float
    missed: int  # ticks a millisecond or more late
    scheduling: str  # "real-time: FIFO 50, core 0" | "default, short slice" ..
    stolen_ms: float | None = None  # time for which the host of a virtual machine kept the loop's core
    waited_ms: float | None = None  # time for which the loop was ready and another program ran
    switches: int | None = None  # how often the scheduler took the core from the loop
    tick_us: float | None = None  # mean time that a tick took
    tick_max_us: float | None = None  # longest time that a tick took


class Recorder:
    """Records every tick of one trial until `close`; the writer stays open until the outcome is known."""

    def __init__(self, ring: Ring, writer: RecordingWriter | None, on_ticks: OnTicks | None = None) -> None:
        """writer: None for a trial that is not kept. on_ticks: gets the ticks (n, width), too."""
        self.writer, self._on_ticks = writer, on_ticks
        self.error = ""  # why no more ticks can be recorded, so that the trial must end
        self._ring = ring
        self._lateness: list[np.ndarray] = []
        self._lost_before, self._max_us, self._missed = self._lost(), 0.0, 0
        self._bytes, self._last_write = 0, time.perf_counter()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def longest_sync_s(self) -> float:
        """The longest wait for the disk so far."""
        return self.writer.database.longest_sync_s if self.writer is not None else 0.0

    def close(self) -> None:
        """Record what is left in the ring and end the thread."""
        self._end.set()
        self._thread.join()

    def proof(self) -> Proof | None:
        """What is in the database now; None: the trial is not recorded."""
        writer, now = self.writer, time.perf_counter()
        if writer is None:
            return None
        written = writer.written
        if written.bytes != self._bytes:
            self._bytes, self._last_write = written.bytes, now
        return Proof(writer.name, written.ticks, written.bytes, now - self._last_write)

    @property
    def lateness_us(self) -> np.ndarray:
        """The lateness of each tick so far, (n,) us."""
        return np.concatenate([np.empty(0), *self._lateness])

    def timing(self, scheduling: str) -> Timing | None:
        """The lateness of all ticks (of a running trial: percentiles of its last 10 s); None: no ticks yet."""
        if not self._lateness:
            return None
        live = not self._end.is_set()
        newest = np.concatenate(self._lateness[-LIVE:]) if live else self.lateness_us
        timing = timing_of(newest, scheduling)._replace(max_us=self._max_us, missed=self._missed)
        timing = timing._replace(**self._lost().since(self._lost_before)._asdict())
        worked_us, most_us = 1e-3 * int(self._ring.control.worked), 1e-3 * int(self._ring.control.worked_most)
        if not worked_us:  # a real device's ticks wait for samples: their own time is not measured
            return timing
        return timing._replace(tick_us=worked_us / sum(map(len, self._lateness)), tick_max_us=most_us)

    def _lost(self) -> LostTime:
        return lost_time(int(self._ring.control.pid), int(self._ring.control.core))

    def _work(self) -> None:
        ending = False
        while not ending:
            ending = self._end.wait(DRAIN_S)
            rows = self._ring.unrecorded_ticks()
            if self.writer is not None:
                self._record(self.writer, rows)
            if self._on_ticks is not None and len(rows):
                self._on_ticks(rows)
            self._ring.mark_recorded(len(rows))
            if len(rows):
                lateness = rows[:, tick_log.LATENESS_US].copy()
                self._max_us = max(self._max_us, float(lateness.max()))
                self._missed += int(np.count_nonzero(lateness >= tick_log.MISSED_US))
                self._lateness.append(lateness)

    def _record(self, writer: RecordingWriter, rows: np.ndarray) -> None:
        """Ticks, and events that others have added meanwhile."""
        try:
            writer.write(rows)
            if writer.database.pending and writer.database.trouble is None:
                writer.flush()
        except OSError:
            pass  # they are in memory: `Database.trouble` says why
        except ValueError as error:
            self.error = cause("recording-failed", why=error)
        if writer.is_full:
            self.error = self.error or cause("recording-failed", why="neither disk nor memory has room")


def timing_of(lateness_us: np.ndarray, scheduling: str) -> Timing:
    """Percentiles and misses of the lateness (n,), us, of ticks."""
    p50, p99 = np.percentile(lateness_us, (50.0, 99.0))
    missed = int(np.count_nonzero(lateness_us >= tick_log.MISSED_US))
    return Timing(float(p50), float(p99), float(lateness_us.max()), missed, scheduling)
