"""The form of a recording: its columns, their names, its header, and the checksum that covers every byte.

A recording in progress is an Arrow IPC stream that any Arrow library reads: the schema, the dictionaries of the
text columns (all words known in advance, so none is added later), batches of ticks, and an end record. Parquet,
once closed, holds the same columns and the same metadata.

Checksum, one rule for all: the header of a stream (everything before its first batch), each batch, the end record,
and a Parquet file as a whole carry in their metadata `crc32`, the CRC-32 (as in zip; 8 lower-case hex digits) of
all their own bytes, with those 8 digits themselves taken as `SEAL`. The bytes of a batch are its Arrow message,
from the continuation marker to the end of the body. So a changed bit is noticed wherever it is, and each part can
be judged alone.

Metadata of a batch: crc32, sequence (0, 1, ..), first_row, rows; of the end record besides: end, outcome (JSON).
Metadata of the schema: crc32, phd (JSON: form, braked, text (the words of each text column), metadata, and of a device
on the bench sensors).
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from fastcrc.crc32 import iso_hdlc as crc32

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from core.mechanism import JOINTS

FORM = 1  # rises when a reader of today could no longer read the file
SEAL = b"\x18" * 8  # stands for the digits of a checksum while it is computed

MARKER = b"\xff\xff\xff\xff"  # begins every message of an Arrow stream
STREAM_END = MARKER + bytes(4)  # Arrow's own end of a stream

#: Text columns -> the integer that stores a word's place.
TEXT_COLUMNS = {"phase": pa.int8(), "stuck": pa.int8(), "decision": pa.int16()}


class Sensors(NamedTuple):
    """What a device on the bench has, whose raw signals are recorded beside everything else."""

    encoders: str  # letters of their joints, "AB"
    force_channels: int


@cache
def recording_columns(braked: str, sensors: Sensors | None = None) -> tuple[tuple[str, int], ...]:
    """(name, column of the tick log) of every column; `braked`: letters of the braked joints, as "AEB".

    sensors: of a device on the bench; None: it is simulated, and there are no raw signals.
    """
    if "".join(joint for joint in JOINTS if joint in braked) != braked:
        raise InputError(f"recording: braked joints {braked!r} must be letters out of {JOINTS}, in that order")
    here = (tick_log.BOTH, tick_log.BENCH if sensors else tick_log.SIMULATED)
    found: list[tick_log.Column] = []
    for column in tick_log.COLUMNS:
        if column.of in here:
            joints = sensors.encoders if sensors and column.place == tick_log.COUNT else braked
            found += column.spread(joints, range(1, 1 + sensors.force_channels) if sensors else ())
    return tuple((column.name, column.place) for column in found)


def column_words(decisions: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Text column -> its words; a column of the tick log holds a word's place here."""
    return {"phase": tick_log.PHASES, "stuck": tick_log.STUCK_LETTERS, "decision": tuple(decisions)}


def make_schema(
    braked: str, metadata: dict[str, Any], decisions: tuple[str, ...], sensors: Sensors | None = None,
    columns: Iterable[str] | None = None,
) -> pa.Schema:  # fmt: skip
    """The Arrow schema of a recording, without a checksum. InputError for metadata that JSON cannot hold.

    columns: of a recording that an earlier version wrote, with fewer; None: all that there are now.
    """
    about = {"form": FORM, "braked": braked, "text": column_words(decisions), "metadata": metadata}
    if sensors:
        about["sensors"] = sensors._asdict()
    names = [name for name, _ in recording_columns(braked, sensors)] if columns is None else columns
    kinds = {name: pa.dictionary(code, pa.string()) for name, code in TEXT_COLUMNS.items()}
    fields = [pa.field(name, kinds.get(name, pa.float64()), nullable=False) for name in names]
    return pa.schema(fields, metadata={"phd": as_json(about, "metadata")})


def as_json(about: dict[str, Any], what: str) -> str:
    """JSON text for a recording. InputError, which names `what`, for what JSON cannot hold."""
    try:
        return json.dumps(about, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"recording: the {what} cannot be stored as JSON: {error}") from None


def seal(message: bytes, start: int = 0) -> bytes:
    """The message with its checksum in place of the first `SEAL` from byte `start` on."""
    at = message.index(SEAL, start)
    return b"".join((memoryview(message)[:at], b"%08x" % crc32(message), memoryview(message)[at + len(SEAL) :]))


def is_sealed(message: bytes, digits: bytes | None, start: int = 0) -> bool:
    """Whether `digits`, the checksum that the message carries (after byte `start`), is that of its bytes."""
    if digits is None or len(digits) != len(SEAL):
        return False
    at = message.find(digits, start)
    if at < 0:
        return False
    rest = memoryview(message)[at + len(SEAL) :]
    return digits == b"%08x" % crc32(rest, crc32(message[:at] + SEAL))


def footer_at(parquet: bytes) -> int:
    """The byte of a Parquet file at which its footer begins, which holds its metadata."""
    return max(len(parquet) - 8 - int.from_bytes(parquet[-8:-4], "little"), 0)


@dataclass(frozen=True)
class Recording:
    """One trial as recorded. Text columns hold codes: `words[name][code]` is the text."""

    path: Path
    metadata: dict[str, Any] = field(default_factory=dict)  # as given to the writer
    outcome: dict[str, Any] = field(default_factory=dict)  # as given to its `close`
    braked: str = ""
    sensors: Sensors | None = None  # of a device on the bench
    columns: dict[str, np.ndarray] = field(default_factory=dict)  # each (rows,)
    words: dict[str, tuple[str, ...]] = field(default_factory=dict)
    complete: bool = False  # the end is there: nothing was cut off
    damaged: list[str] = field(default_factory=list)  # fails its checksum or is missing; its rows are left out

    @property
    def rows(self) -> int:
        """Number of ticks that were read."""
        return len(self.columns["t_s"]) if self.columns else 0

    @property
    def whole(self) -> bool:
        """Whether every tick that was recorded is here, unchanged."""
        return self.complete and not self.damaged

    def column(self, name: str) -> np.ndarray:
        """One column (rows,). InputError if the recording has none of that name."""
        if name not in self.columns:
            raise InputError(f"{self.path}: there is no column {name} to read")
        return self.columns[name]

    def text(self, name: str) -> np.ndarray:
        """A text column as words (rows,), dtype object."""
        return np.array(self.words[name], dtype=object)[self.column(name)]

    def in_phase(self, phase: str) -> np.ndarray:
        """True at the ticks of one phase (rows,): approach, hold, move or end."""
        return self.column("phase") == self.words["phase"].index(phase)


def recording_of(rows: np.ndarray, braked: str, path: Path = Path()) -> Recording:
    """Ticks (n, tick_log.WIDTH) of a simulated device as a recording that was never on a disk."""
    columns = {
        name: rows[:, place].astype(TEXT_COLUMNS[name].to_pandas_dtype()) if name in TEXT_COLUMNS else rows[:, place]
        for name, place in recording_columns(braked)
    }
    return Recording(path, braked=braked, columns=columns, words=column_words(DECISIONS), complete=True)


def same_content(a: Recording, b: Recording) -> bool:
    """Whether two recordings hold the same, bit by bit (a NaN equals itself, -0 is not 0), wherever they lie."""

    def content(r: Recording) -> tuple:
        bits = [(name, x.dtype, x.shape, x.tobytes()) for name, x in r.columns.items()]
        return r.metadata, r.outcome, r.braked, r.sensors, r.words, bits

    return content(a) == content(b)


def arrow_array(values: np.ndarray) -> pa.Array:
    """Numbers without gaps, as they lie in memory.

    `pa.array` imports pandas where it is installed, to ask whether the numbers are a part of its.
    """
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])


def arrow_words(words: Sequence[str]) -> pa.Array:
    """Texts, as `arrow_array` makes numbers."""
    encoded = [word.encode() for word in words]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))


def describe(schema_metadata: dict[bytes, bytes] | None) -> dict[str, Any]:
    """The description in the schema (the JSON under `phd`), as keyword arguments of `Recording`.

    ValueError if this is no recording or one of a later form.
    """
    try:
        about = json.loads((schema_metadata or {})[b"phd"])
        form, words = about["form"], about["text"]
        described = {
            "metadata": about["metadata"],
            "braked": about["braked"],
            "sensors": Sensors(**about["sensors"]) if "sensors" in about else None,
            "words": {name: tuple(words[name]) for name in TEXT_COLUMNS},
        }
    except (KeyError, TypeError, ValueError):
        raise ValueError("no description of a recording") from None
    if form != FORM:
        raise ValueError(f"form {form!r}, this program reads form {FORM}")
    return described


def as_arrays(batches: list[pa.RecordBatch], schema: pa.Schema, words: dict[str, tuple[str, ...]]) -> dict:
    """Column name -> (rows,) array of all batches; text columns as places in `words` (else ValueError)."""
    table = pa.Table.from_batches(batches, schema)
    table.validate(full=True)  # every code has a word
    columns: dict[str, np.ndarray] = {}
    for name, column in zip(schema.names, table.unify_dictionaries().columns, strict=True):
        if column.null_count:
            raise ValueError(f"column {name} has gaps")
        coded = column.combine_chunks()
        if name not in TEXT_COLUMNS:
            columns[name] = np.from_dlpack(coded).copy()  # that can be written to
            continue
        there, place = coded.dictionary.to_pylist(), {word: code for code, word in enumerate(words[name])}
        if not place.keys() >= set(there):
            raise ValueError(f"column {name} has words that the description does not list")
        places = np.array([place[word] for word in there], TEXT_COLUMNS[name].to_pandas_dtype())
        columns[name] = places[np.from_dlpack(coded.indices)]
    return columns
