"""Writing recordings (their content: `schema`): a stream grows while the trial runs and becomes Parquet once closed."""

import contextlib
import errno
import io
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.atomic_files import (
    append_whole,
    give_new_name,
    refuse_existing_files,
    refusing,
    remove,
    replace_file,
    set_aside,
    sync_folder,
    written_beside,
)
from experiments.recording.reader import read_parquet, read_recording
from experiments.recording.schema import SEAL, TEXT_COLUMNS, Recording, Sensors, footer_at, same_content
from experiments.recording.stream import TickStream, arrow_array, arrow_words, as_json, make_schema, seal

BATCH_ROWS = 1000  # most rows in a batch: what a damaged byte can cost. Smaller: slower, larger files
WRITE_INTERVAL_S = 0.1  # rows wait at most this long (and for the next call): what a kill can cost
SYNC_INTERVAL_S = 0.25  # at most so often to the disk itself: what a power cut can cost
MOST_IN_MEMORY = 400_000_000  # bytes of a stream, a quarter of an hour and more. Our choice: a desktop has the room
OTHER = "other"  # how a file is marked that stood where a stream from memory belongs


class RecordingWriter:
    """Writes the ticks of one trial to a new file, batch by batch; `close` adds the end record.

    As a context manager it closes on a normal exit; after an exception it keeps what it has, without an end record. If
    the disk is full or unplugged, or the file is gone: OSError, once, from the call of `write` or `flush` that notices
    it, and from `close`. The file then ends with its last whole batch and gets no more. All ticks, earlier and later
    ones, stay in memory until `save` writes them to a disk that is well again. Not for the control loop itself: a call
    can wait for the disk.
    """

    def __init__(
        self,
        path: str | Path,
        braked: str,
        metadata: dict[str, Any],
        sync: bool = True,
        sensors: Sensors | None = None,
        decisions: tuple[str, ...] = DECISIONS,
    ) -> None:
        """Create `path`; InputError if it exists or cannot be there, OSError if the disk takes no more.

        braked: letters of the braked joints, "AEB". metadata: anything JSON holds. sync = False leaves it to the
        system when the data reach the disk: for simulated trials, whose Parquet file is synced before their stream is
        removed. sensors: of a device on the bench, whose ticks are tick_log.BENCH_WIDTH wide. decisions: words by code.
        """
        self.path = Path(path)
        self.rows = 0  # rows taken
        self.rows_written = self.bytes_written = 0  # in the file: what a kill cannot take any more
        self.trouble: OSError | None = None  # why the file gets no more; None: it has everything
        self.ended = False  # the stream has its end record
        self.longest_sync_s = 0.0  # that the disk made us wait
        self._stream = TickStream(braked, metadata, sensors, decisions)
        self._memory: io.BytesIO | None = io.BytesIO()  # the whole stream; None: beyond MOST_IN_MEMORY
        self._waiting: list[np.ndarray] = []
        self._sync = sync
        header = self._stream.header()
        refuse_existing_files([self.path])
        with refusing(self.path, "the recording cannot be created"):
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
        self._open = True
        self._last_write = self._last_sync = time.perf_counter()
        self._append(header)
        self._bring_to_disk()
        if self.trouble is not None:
            self._open = False
            self.path.unlink(missing_ok=True)
            raise self.trouble
        if sync:
            sync_folder(self.path.parent)

    def write(self, rows: np.ndarray) -> None:
        """Add ticks: float64 (n, tick_log.WIDTH), with sensors (n, tick_log.BENCH_WIDTH).

        They are copied; they reach the file within `WRITE_INTERVAL_S`.
        """
        self._need_open()
        rows = np.array(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != self._stream.width:
            raise ValueError(f"ticks of shape {rows.shape}, not (n, {self._stream.width})")
        self.rows += len(rows)
        if self.trouble is not None and (self._memory is None or self._memory.tell() > MOST_IN_MEMORY):
            return  # lost, and counted as such
        if len(rows):
            self._waiting.append(rows)
        now = time.perf_counter()
        with self._raising_new_trouble():
            self._write_batches(everything=now - self._last_write >= WRITE_INTERVAL_S)
            if self._sync and now - self._last_sync >= SYNC_INTERVAL_S:
                self.flush()

    def flush(self) -> None:
        """Write every row to the file and, unless `sync` is off, to the disk."""
        self._need_open()
        with self._raising_new_trouble():
            self._write_batches(everything=True)
            self._bring_to_disk()

    def close(self, outcome: dict[str, Any] | None = None) -> None:
        """Write the rest and the end record with the trial's outcome (status, reason, ..): anything JSON holds.

        A recording that lacks ticks gets no end record, so it reads as cut off. OSError: the file is not whole.
        """
        if self._open:
            outcome_json = as_json(outcome or {}, "outcome")
            try:
                self._write_batches(everything=True)
                if not self.lost:
                    for message in self._stream.end(outcome_json):
                        self._append(message)
                    self.ended = True
                self._bring_to_disk()
            finally:
                self._release()
        if self.trouble is not None:
            raise self.trouble

    def abandon(self) -> None:
        """Keep what there is, without an end record: the recording reads as cut off."""
        if not self._open:
            return
        try:
            self.flush()
        finally:
            self._release()

    @property
    def lost(self) -> int:
        """Rows that are neither in the file nor in memory."""
        kept = self._stream.rows + sum(map(len, self._waiting))
        if self.trouble is not None and self._memory is None:
            kept = self.rows_written
        return self.rows - kept

    @property
    def in_memory(self) -> bool:
        """Whether the whole stream is in memory."""
        return self._memory is not None

    def is_stored(self) -> bool:
        """Whether a closed recording is at its place, as a stream or as Parquet."""
        return self.trouble is None and any(map(os.path.exists, (self.path, self.path.with_suffix(PARQUET_SUFFIX))))

    def save(self, path: Path | None = None) -> None:
        """Write a closed or abandoned recording from memory to its place, whole, over the part that is there.

        path: its place from now on; None: the first one. A file with other content is set aside. InputError or OSError:
        it cannot be written, and nothing has changed.
        """
        path = path or self.path
        if self._memory is None:
            raise InputError(f"{path}: its ticks are not in memory")
        content = self._memory.getvalue()
        with refusing(path, "the recording cannot be written"):
            path.parent.mkdir(exist_ok=True)
            if path.exists() and not content.startswith(path.read_bytes()):
                set_aside(path, OTHER)
        replace_file(path, content, self._sync)
        self.path, self.trouble = path, None
        self.rows_written, self.bytes_written = self._stream.rows, len(content)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            with contextlib.suppress(OSError, ValueError):  # the exception that ends the trial is raised, not this one
                self.abandon()

    def _need_open(self) -> None:
        if not self._open:
            raise ValueError("the recording is closed")

    @contextlib.contextmanager
    def _raising_new_trouble(self) -> Iterator[None]:
        """OSError if the file has failed meanwhile, and not before."""
        before = self.trouble
        yield
        if self.trouble is not None and before is None:
            raise self.trouble

    def _release(self) -> None:
        self._open = False
        self._waiting.clear()
        if self.trouble is None:
            try:
                os.close(self._file)
            except OSError as error:  # as of a network drive, which writes only now
                self.trouble = error

    def _write_batches(self, everything: bool) -> None:
        """Write the waiting rows: all, or as many as fill whole batches."""
        waiting = sum(map(len, self._waiting))
        if not waiting or not (everything or waiting >= BATCH_ROWS):
            return
        rows = np.concatenate(self._waiting)
        end = waiting if everything else waiting - waiting % BATCH_ROWS
        self._waiting = [rows[end:]] if end < waiting else []
        for start in range(0, end, BATCH_ROWS):
            self._append(self._stream.message(rows[start : min(start + BATCH_ROWS, end)]))
        self._last_write = time.perf_counter()
        self._attempt(self._check_place)

    def _append(self, message: bytes) -> None:
        """Append a whole message to memory and, whole or not at all, to the file."""
        if self._memory is not None:
            self._memory.write(message)

        def append() -> None:
            append_whole(self._file, message, self.bytes_written)
            self.bytes_written += len(message)
            self.rows_written = self._stream.rows

        self._attempt(append)
        if self._memory is not None and self._memory.tell() > MOST_IN_MEMORY and self.trouble is None:
            self._memory = None

    def _bring_to_disk(self) -> None:
        began = time.perf_counter()
        if self._sync:
            self._attempt(lambda: os.fsync(self._file))
        self._attempt(self._check_place)
        self._last_sync = time.perf_counter()
        self.longest_sync_s = max(self.longest_sync_s, self._last_sync - began)

    def _check_place(self) -> None:
        """OSError if the file is gone from its place: its folder was deleted, or its disk removed."""
        found = os.stat(self.path)
        if os.name == "posix" and not os.path.samestat(found, os.fstat(self._file)):  # Windows keeps a file in use
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self.path))

    def _attempt(self, do: Callable[[], object]) -> None:
        """Do something with the file, unless it has failed before; note a failure."""
        if self.trouble is not None:
            return
        try:
            do()
        except OSError as error:
            self.trouble = error
            with contextlib.suppress(OSError):  # the first error is the one to tell
                os.close(self._file)


def convert_to_parquet(path: str | Path, sync: bool = True) -> Recording:
    """Turn a closed, undamaged stream into Parquet, compare the two and remove the stream; the new recording.

    Never overwrites: an existing Parquet file must hold the same (then only the stream is removed). InputError if the
    stream is cut or damaged, or the other file differs; the stream then stays.
    """
    path = Path(path)
    if path.suffix != STREAM_SUFFIX:
        raise InputError(f"{path}: only a {STREAM_SUFFIX} stream can be converted")
    stream = read_recording(path)
    if stream.damaged:
        raise InputError(f"{path}: damaged, not converted: {'; '.join(stream.damaged)}")
    if not stream.complete:
        raise InputError(f"{path}: has no end record, not converted")
    stored = save_as_parquet(stream, path.with_suffix(PARQUET_SUFFIX), sync)
    remove(path)
    return stored


def save_as_parquet(recording: Recording, target: Path, sync: bool) -> Recording:
    """Write a recording as Parquet, read it back and compare; the recording that was read back.

    An existing file must hold the same, else InputError (neither is touched). OSError if it cannot be written.
    """

    def is_the_same(other: Recording) -> bool:
        return other.whole and same_content(other, recording)

    if target.exists():
        if not is_the_same(stored := read_parquet(target)):
            raise InputError(f"{target}: exists already and differs from {recording.path.name}, neither was touched")
        return stored
    with written_beside(target, _parquet_bytes(recording), sync) as partial:
        if not is_the_same(stored := read_parquet(partial)):
            raise OSError(f"{partial}: what was read back differs from {recording.path.name}")
        give_new_name(partial, target)
    return replace(stored, path=target)


def _parquet_bytes(recording: Recording) -> bytes:
    columns, words = recording.columns, recording.words
    schema = make_schema(recording.braked, recording.metadata, words["decision"], recording.sensors, columns)
    arrays = [
        pa.DictionaryArray.from_arrays(arrow_array(values), arrow_words(words[name]))
        if name in TEXT_COLUMNS
        else arrow_array(values)
        for name, values in columns.items()
    ]
    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(
        sink,
        schema,
        compression="snappy",  # on noisy doubles zstd saves a tenth of the space for twice the time
        use_dictionary=list(TEXT_COLUMNS),
        use_byte_stream_split=[name for name in columns if name not in TEXT_COLUMNS],  # a fifth smaller
        write_statistics=False,
    ) as writer:
        writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
        writer.add_key_value_metadata({"outcome": as_json(recording.outcome, "outcome"), "crc32": SEAL.decode()})
    data = sink.getvalue().to_pybytes()
    return seal(data, footer_at(data))
