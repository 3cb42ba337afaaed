"""Ticks as the messages of an Arrow stream, each with its checksum; the words and numbers of a recording in Arrow."""

import io
import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from fastcrc.crc32 import iso_hdlc as crc32

from core import tick_log
from core.files import InputError
from experiments.recording.schema import FORM, SEAL, TEXT_COLUMNS, Sensors, column_words, recording_columns


class TickStream:
    """The messages of one recording, one after another."""

    def __init__(
        self, braked: str, metadata: dict[str, Any], sensors: Sensors | None, decisions: tuple[str, ...]
    ) -> None:
        """As `RecordingWriter`."""
        self.width = tick_log.BENCH_WIDTH if sensors else tick_log.WIDTH
        self.rows = 0  # in the messages so far
        self._batches = 0
        self._columns = recording_columns(braked, sensors)
        self._words = {name: arrow_words(words) for name, words in column_words(decisions).items()}
        schema = make_schema(braked, metadata, decisions, sensors)
        self._schema = schema.with_metadata({**schema.metadata, "crc32": SEAL})
        self._sink = io.BytesIO()
        self._arrow = pa.ipc.new_stream(self._sink, self._schema)

    def header(self) -> bytes:
        """The schema and the dictionaries, which come first."""
        self._arrow.write_batch(self._batch(np.empty((0, self.width))))
        written = self._drain()
        source, end = pa.BufferReader(written), 0
        while pa.ipc.read_message(source).type != "record batch":
            end = source.tell()
        return seal(written[:end])

    def message(self, rows: np.ndarray, **more: str) -> bytes:
        """The next batch of ticks (n, width). ValueError: a tick has a code without a word."""
        about = {"crc32": SEAL.decode(), "sequence": str(self._batches), "first_row": str(self.rows)}
        self._arrow.write_batch(self._batch(rows), custom_metadata={**about, "rows": str(len(rows)), **more})
        self._batches += 1
        self.rows += len(rows)
        return seal(self._drain())

    def end(self, outcome_json: str) -> list[bytes]:
        """The end record, and Arrow's own end of a stream."""
        record = self.message(np.empty((0, self.width)), end="end", outcome=outcome_json)
        self._arrow.close()
        return [record, self._drain()]

    def _drain(self) -> bytes:
        """The bytes that Arrow has written since the last call."""
        written = self._sink.getvalue()
        self._sink.seek(0)
        self._sink.truncate()
        return written

    def _batch(self, rows: np.ndarray) -> pa.RecordBatch:
        columns = np.ascontiguousarray(rows.T)
        arrays = []
        for name, place in self._columns:
            if name not in TEXT_COLUMNS:
                arrays.append(arrow_array(columns[place]))
                continue
            with np.errstate(invalid="ignore"):
                codes = columns[place].astype(TEXT_COLUMNS[name].to_pandas_dtype())
            if np.any((codes != columns[place]) | (codes < 0) | (codes >= len(self._words[name]))):
                raise ValueError(f"a tick has a {name} code without a word")
            arrays.append(pa.DictionaryArray.from_arrays(arrow_array(codes), self._words[name]))
        return pa.RecordBatch.from_arrays(arrays, schema=self._schema)


def make_schema(
    braked: str, metadata: dict[str, Any], decisions: tuple[str, ...], sensors: Sensors | None,
    columns: Iterable[str] | None = None,
) -> pa.Schema:  # fmt: skip
    """The Arrow schema of a recording, without a checksum. InputError for metadata that JSON cannot hold.

    columns: of a recording by an earlier version, which has fewer; None: all.
    """
    about = {"form": FORM, "braked": braked, "text": column_words(decisions), "metadata": metadata}
    if sensors:
        about["sensors"] = sensors._asdict()
    names = [name for name, _ in recording_columns(braked, sensors)] if columns is None else columns
    kinds = {name: pa.dictionary(code, pa.string()) for name, code in TEXT_COLUMNS.items()}
    fields = [pa.field(name, kinds.get(name, pa.float64()), nullable=False) for name in names]
    return pa.schema(fields, metadata={"phd": as_json(about, "metadata")})


def as_json(about: dict[str, Any], part: str) -> str:
    """JSON text for a recording. InputError, which names `part`, for what JSON cannot hold."""
    try:
        return json.dumps(about, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"recording: the {part} cannot be stored as JSON: {error}") from None


def arrow_array(values: np.ndarray) -> pa.Array:
    """Numbers without gaps as an Arrow array on the same memory.

    `pa.array` would import pandas, where it is installed, to check their type.
    """
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])


def arrow_words(words: Sequence[str]) -> pa.Array:
    """Texts as an Arrow array; see `arrow_array`."""
    encoded = [word.encode() for word in words]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))


def seal(message: bytes, start: int = 0) -> bytes:
    """The message with its checksum in place of the first `SEAL` from byte `start` on."""
    at = message.index(SEAL, start)
    return b"".join((memoryview(message)[:at], b"%08x" % crc32(message), memoryview(message)[at + len(SEAL) :]))
