"""Reading recordings back: every whole batch of a stream, or a Parquet file, and what is wrong with the rest.

A stream that was cut anywhere gives back every batch before the cut, and lacks its end; damage inside costs the
batches that it touches, and names them.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from core.files import InputError
from experiments.recording.schema import (
    MARKER,
    STREAM_END,
    TEXT_COLUMNS,
    Recording,
    as_arrays,
    describe,
    is_sealed,
)

STREAM_SUFFIX, PARQUET_SUFFIX = ".arrows", ".parquet"


def read_recording(path: str | Path) -> Recording:
    """A recording from its stream (.arrows) or its Parquet file; look at `complete` and `damaged`.

    Damage is no error: what is whole is returned. InputError if there is no such file or it is of another kind.
    """
    path = Path(path)
    try:
        if path.suffix == STREAM_SUFFIX:
            return read_stream(path)
        if path.suffix == PARQUET_SUFFIX:
            return read_parquet(path)
    except OSError as error:
        raise InputError(f"{path}: the recording cannot be read: {error.strerror}") from None
    raise InputError(f"{path}: a recording ends in {STREAM_SUFFIX} or {PARQUET_SUFFIX}")


def read_parquet(path: Path) -> Recording:
    """A Parquet recording; damage leaves it without rows or marked."""
    data = path.read_bytes()
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        stored = file.metadata.metadata or {}
        table = file.read(use_threads=False)
        described = describe(table.schema.metadata)
        columns = as_arrays(table.to_batches(), table.schema, described["words"])
        outcome = json.loads(stored[b"outcome"])
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        return Recording(path, damaged=[f"file: damaged ({_first_line(error)}), no row can be read"])
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    sealed = is_sealed(data, stored.get(b"crc32"), max(footer, 0))
    damaged = [] if sealed else ["file: does not match its checksum"]
    return Recording(path, **described, outcome=outcome, columns=columns, complete=sealed, damaged=damaged)


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def read_stream(path: Path) -> Recording:
    """Every whole batch of a stream, and what is wrong with the rest."""
    data = path.read_bytes()
    damaged: list[str] = []
    header = _whole_header(data)
    if not header:
        return Recording(path, damaged=["header: cut or damaged, no row can be trusted"])
    schema = pa.ipc.open_stream(header).schema
    try:
        described = describe(schema.metadata)
    except ValueError as error:
        return Recording(path, damaged=[f"header: {error}"])

    batches: list[pa.RecordBatch] = []
    outcome: dict[str, Any] = {}
    ended = False
    sequence, next_row = 0, 0
    at = len(header)
    cursor = _Cursor(header, data, at)
    while not STREAM_END.startswith(data[at : at + len(STREAM_END) + 1]):
        found = cursor.next_whole()
        if found is None:
            further = _next_whole_batch(header, data, at + len(MARKER))
            if further is None:
                if not _is_cut(data, at):
                    damaged.append(f"batch {sequence} (rows from {next_row}): damaged, nothing whole follows")
                break
            at = further
            cursor = _Cursor(header, data, at)
            continue
        batch, about, at = found
        number, first, rows = (int(about[key]) for key in (b"sequence", b"first_row", b"rows"))
        if number != sequence:
            damaged.append(f"batch {_span(sequence, number - 1)} (rows {_span(next_row, first - 1)}): damaged")
        sequence, next_row = number + 1, first + rows
        if b"end" in about:
            ended, outcome = True, json.loads(about[b"outcome"])
            break
        batches.append(batch)

    complete = ended and data[at:] == STREAM_END
    if ended and not STREAM_END.startswith(data[at:]):
        damaged.append("end: the bytes after the end record are damaged")
    columns = as_arrays(batches, schema, described["words"])
    return Recording(path, **described, outcome=outcome, columns=columns, complete=complete, damaged=damaged)


def _span(first: int, last: int) -> str:
    return str(first) if last == first else f"{first} to {last}"


def _whole_header(data: bytes) -> bytes:
    """The first messages of a stream, as many as their checksum covers; b"" if they are cut or damaged."""
    source = pa.BufferReader(data)
    try:
        pa.ipc.read_message(source)
        digits = (pa.ipc.open_stream(data).schema.metadata or {}).get(b"crc32")
        for _ in TEXT_COLUMNS:  # each has its dictionary
            pa.ipc.read_message(source)
    except (pa.ArrowException, OSError, EOFError, ValueError):
        return b""
    header = data[: source.tell()]
    return header if is_sealed(header, digits) else b""


class _Batch(NamedTuple):
    batch: pa.RecordBatch
    about: dict[bytes, bytes]  # its custom metadata
    end: int  # the byte after it


class _Cursor:
    """Reads one batch after the other, from a byte on where one begins."""

    def __init__(self, header: bytes, data: bytes, at: int) -> None:
        self._data = data
        self._shift = at - len(header)  # byte in data - byte in source
        self._source = pa.BufferReader(header + data[at:] if self._shift else data)
        self._stream = pa.ipc.open_stream(self._source)
        self._at = at

    def next_whole(self) -> _Batch | None:
        """The next batch; None unless it is whole."""
        try:
            batch, custom = self._stream.read_next_batch_with_custom_metadata()
            about = dict(custom or {})
            end = self._source.tell() + self._shift
            if not is_sealed(self._data[self._at : end], about.get(b"crc32")):
                return None
            if batch.num_rows != int(about[b"rows"]):
                return None
        except (pa.ArrowException, OSError, StopIteration, KeyError, ValueError):
            return None
        self._at = end
        return _Batch(batch, about, end)


def _next_whole_batch(header: bytes, data: bytes, at: int) -> int | None:
    """Where, from byte `at` on, the next whole batch begins."""
    while (at := data.find(MARKER, at)) >= 0:
        if _Cursor(header, data, at).next_whole() is not None:
            return at
        at += 1
    return None


def _is_cut(data: bytes, at: int) -> bool:
    """Whether the message at byte `at` is by its own length longer than what is left: cut off, rather than damaged."""
    try:
        pa.ipc.read_message(pa.BufferReader(data[at:]))
    except (pa.ArrowException, OSError, EOFError):
        return True
    return False
