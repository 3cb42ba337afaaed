"""Brings a trial's ticks to its recording beside the control loop, which never waits for the disk."""

import queue
import threading
import time

import numpy as np

from app.messages import Proof
from experiments.recording import RecordingWriter


class Recorder:
    """Owns the writer from now until `close`."""

    def __init__(self, writer: RecordingWriter) -> None:
        self.writer = writer
        self._blocks: queue.SimpleQueue[np.ndarray | None] = queue.SimpleQueue()
        self._bytes, self._last_write = writer.bytes_written, time.monotonic()
        self.error = ""  # why the recording takes no more
        self._thread = threading.Thread(target=self._work, name="recorder")
        self._thread.start()

    def take(self, rows: np.ndarray) -> None:
        """Record these ticks (n, row.WIDTH), which must not change any more."""
        self._blocks.put(rows)

    def proof(self) -> Proof:
        """What is in the file by now."""
        writer, now = self.writer, time.monotonic()
        if writer.bytes_written != self._bytes:
            self._bytes, self._last_write = writer.bytes_written, now
        return Proof(writer.path.name, writer.rows_written, writer.bytes_written, now - self._last_write)

    def close(self) -> None:
        """Hand over what waits and end the thread; the writer stays open for whoever knows the outcome."""
        self._blocks.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (block := self._blocks.get()) is not None:
            if self.error:
                continue  # the trial is being aborted for it
            try:
                self.writer.write(block)
            except (OSError, ValueError) as error:
                self.error = f"{self.writer.path}: {getattr(error, 'strerror', None) or error}"
