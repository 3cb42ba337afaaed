"""Writes the ticks of a trial into its session's database while the trial runs."""

import contextlib
import time
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
import pyarrow as pa

from core import tick_log
from core.control.controllers import DECISIONS
from experiments.recording import TEXT_COLUMNS, Sensors, column_words, recording_columns
from experiments.store.database import Database
from experiments.store.parquet import as_json, description

BATCH_ROWS = 1000  # most ticks in a row of the database: what a damaged byte can cost
COMMIT_S = 0.2  # ticks wait at most this long, and for the next call: what a kill or a power cut can cost
RETRY_S = 1.0  # between two attempts, while the disk takes no more
MOST_IN_MEMORY = 400_000_000  # bytes that the disk refused: half an hour and more. Our choice: a desktop has the room
_codec = pa.Codec("zstd", compression_level=1)


class Written(NamedTuple):
    """What is committed of a recording."""

    ticks: int
    bytes: int


class RecordingWriter:
    """Records one trial; after an exception, or a kill, what it has stays, without an outcome.

    OSError, from any call but `close`, if the disk takes no more: the ticks stay in the database's memory and go with a
    later commit. Not for the control loop itself: a call can wait for the disk.
    """

    def __init__(
        self,
        database: Database,
        place: tuple[str, int],
        braked: str,
        metadata: Mapping[str, Any],
        sensors: Sensors | None = None,
        decisions: tuple[str, ...] = DECISIONS,
    ) -> None:
        """Begin a trial, with the next commit. place: folder of its file and run. sensors: of a device on the bench."""
        self.database, self.place, self.rows = database, place, 0
        database.longest_sync_s = 0.0  # of this trial
        self._width = tick_log.BENCH_WIDTH if sensors else tick_log.WIDTH
        self._columns = recording_columns(braked, sensors)
        self._words = column_words(decisions)
        self._about = description(braked, metadata, sensors, decisions)
        self.trial = database.add("trial", *place, self._about, "", 0, 0, "")
        self._waiting: list[np.ndarray] = []
        self._in_database = self._bytes = 0
        self._last_commit = time.perf_counter()

    def write(self, rows: np.ndarray) -> None:
        """Add ticks: float64 (n, tick_log.WIDTH), with sensors (n, tick_log.BENCH_WIDTH); they are copied."""
        rows = np.array(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != self._width:
            raise ValueError(f"ticks of shape {rows.shape}, not (n, {self._width})")
        if len(rows):
            self._waiting.append(rows)
            self.rows += len(rows)
        waited_s = time.perf_counter() - self._last_commit
        if waited_s >= (COMMIT_S if self.database.trouble is None else RETRY_S):
            self.flush()
        elif self.rows - self._in_database >= BATCH_ROWS:
            self._add_waiting()

    def flush(self) -> None:
        """Commit every tick."""
        self._last_commit = time.perf_counter()
        self._add_waiting()
        self.database.commit()

    @property
    def name(self) -> str:
        """Of the recording."""
        return f"run-{self.place[1]:03d}"

    @property
    def written(self) -> Written:
        """What a kill cannot take any more."""
        return Written(self._in_database - self.database.pending_ticks, self._bytes - self.database.pending_bytes)

    @property
    def is_full(self) -> bool:
        """Whether neither the disk nor memory has room for more."""
        return self.database.pending_bytes > MOST_IN_MEMORY

    def _add_waiting(self) -> None:
        """Move the ticks into the database's memory. ValueError: one has a code without a word."""
        if not self._waiting:
            return
        rows, self._waiting = np.concatenate(self._waiting), []
        for name, place in self._columns:
            if name in TEXT_COLUMNS:
                codes = rows[:, place]
                if np.any((codes % 1 != 0) | (codes < 0) | (codes >= len(self._words[name]))):
                    self.rows -= len(rows)
                    raise ValueError(f"a tick has a {name} code without a word")
        for at in range(0, len(rows), BATCH_ROWS):
            part = rows[at : at + BATCH_ROWS]
            columns = packed(part.T[[place for _, place in self._columns]])
            self.database.add("ticks", self.trial, self._in_database, len(part), columns)
            self._in_database += len(part)
            self._bytes += len(columns)

    def close(self, outcome: Mapping[str, Any] | None = None) -> None:
        """Add the rest and the trial's outcome (status, reason, ..) for the next commit: anything JSON holds."""
        text = as_json(outcome or {}, "outcome")
        self._add_waiting()
        self.database.put("trial", self.trial, *self.place, self._about, text, self.rows, 0, "")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with contextlib.suppress(OSError, ValueError) if kind else contextlib.nullcontext():
            self.flush()


def packed(columns: np.ndarray) -> bytes:
    """Ticks (columns, n) as bytes: equal bytes of the doubles beside each other, which compress better."""
    shuffled = np.ascontiguousarray(columns).view(np.uint8).reshape(len(columns), -1, 8).transpose(0, 2, 1)
    return bytes(_codec.compress(shuffled.tobytes(), asbytes=True))


def unpacked(data: bytes, count: int, columns: int) -> np.ndarray:
    """Ticks (columns, n) from their bytes."""
    raw = _codec.decompress(data, 8 * count * columns, asbytes=True)
    shuffled = np.frombuffer(raw, np.uint8).reshape(columns, 8, count).transpose(0, 2, 1)
    return np.ascontiguousarray(shuffled).view(np.float64)[..., 0]
