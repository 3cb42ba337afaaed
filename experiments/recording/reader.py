"""Reading recordings back: every whole batch of a stream, or a Parquet file, and the faults of the rest.

A stream that was cut anywhere gives back every batch before the cut, and lacks its end; damage inside costs the
batches that it touches, and names them.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fastcrc.crc32 import iso_hdlc as crc32

from core import tick_log
from core.files import InputError, refuse_no_file
from experiments.recording import PARQUET_SUFFIX, STREAM_SUFFIX
from experiments.recording.schema import FORM, SEAL, TEXT_COLUMNS, Recording, Sensors, footer_at, recording_columns

MARKER = b"\xff\xff\xff\xff"  # begins every message of an Arrow stream
STREAM_END = MARKER + bytes(4)  # Arrow's own end of a stream
_UNREADABLE = (pa.ArrowException, OSError, EOFError, StopIteration, KeyError, ValueError, TypeError, RecursionError)


def read_recording(path: str | Path) -> Recording:
    """Read a recording from its stream (.arrows) or its Parquet file; check `complete` and `damaged`.

    Damage is no error: every whole batch is returned. InputError if there is no such file or it is of another kind.
    """
    path = Path(path)
    read = {STREAM_SUFFIX: _read_stream, PARQUET_SUFFIX: read_parquet}.get(path.suffix)
    if read is None:
        raise InputError(f"{path}: a recording ends in {STREAM_SUFFIX} or {PARQUET_SUFFIX}")
    refuse_no_file(path)
    try:
        return read(path)
    except OSError as error:
        raise InputError(f"{path}: the recording cannot be read: {(error.strerror or str(error)).lower()}") from None


def read_parquet(path: Path) -> Recording:
    """Read a Parquet recording; a damaged one has no rows, or is marked."""
    data = path.read_bytes()
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        stored = file.metadata.metadata or {}
        table = file.read(use_threads=False)
        described = describe(table.schema.metadata)
        columns = as_arrays(table.to_batches(), table.schema, described["words"])
        outcome = _outcome(stored[b"outcome"])
    except _UNREADABLE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        return Recording(path, damaged=[f"file: damaged ({reason}), no row can be read"])
    sealed = is_sealed(data, stored.get(b"crc32"), footer_at(data))
    damaged = [] if sealed else ["file: does not match its checksum"]
    return Recording(path, **described, outcome=outcome, columns=columns, complete=sealed, damaged=damaged)


def _read_stream(path: Path) -> Recording:
    """Read every whole batch of a stream, and note the faults of the rest."""
    data = path.read_bytes()
    header = _whole_header(data)
    if not header:
        return Recording(path, damaged=["header: cut or damaged, no row can be trusted"])
    schema = pa.ipc.open_stream(header).schema
    try:
        described = describe(schema.metadata)
    except ValueError as error:
        return Recording(path, damaged=[f"header: {error}"])

    damaged: list[str] = []
    batches: list[pa.RecordBatch] = []
    outcome: dict[str, Any] = {}
    ended, sequence, next_row, at = False, 0, 0, len(header)
    while not ended and not STREAM_END.startswith(data[at : at + len(STREAM_END) + 1]):
        found = _next_whole_batch(header, data, at)
        if found is None:
            if not _is_cut(data, at):
                damaged.append(f"batch {sequence} (rows from {next_row}): damaged, nothing whole follows")
            break
        batch, about, at = found
        number, first = int(about[b"sequence"]), int(about[b"first_row"])
        if number != sequence:
            damaged.append(f"batch {_span(sequence, number)} (rows {_span(next_row, first)}): damaged")
        sequence, next_row = number + 1, first + batch.num_rows
        if b"end" in about:
            ended = True
            try:
                outcome = _outcome(about[b"outcome"])
            except (KeyError, ValueError, RecursionError):
                damaged.append("end record: its outcome cannot be read")
        else:
            batches.append(batch)
    if ended and not STREAM_END.startswith(data[at:]):
        damaged.append("end: the bytes after the end record are damaged")
    try:
        columns = as_arrays(batches, schema, described["words"])
    except ValueError as error:  # ArrowInvalid is one
        return Recording(path, damaged=[f"header: {error}, no row can be trusted"])
    complete = ended and data[at:] == STREAM_END
    return Recording(path, **described, outcome=outcome, columns=columns, complete=complete, damaged=damaged)


def _outcome(text: bytes) -> dict[str, Any]:
    """The outcome of a trial as the writer stored it. ValueError if it is no JSON object."""
    outcome = _json(text)
    if not isinstance(outcome, dict) or not _are_texts(outcome.get("warnings", [])):
        raise ValueError("the outcome is not as the writer stores it")
    return outcome


def _json(text: bytes) -> Any:
    """Read what `stream.as_json` writes. ValueError for numbers that are not finite."""

    def refuse(word: str) -> None:
        raise ValueError(f"{word} is no number")

    return json.loads(text, parse_constant=refuse)


def _are_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def _span(first: int, end: int) -> str:
    """ "3", or "3 to 5": the numbers from `first` to before `end`."""
    return str(first) if end == first + 1 else f"{first} to {end - 1}"


def _whole_header(data: bytes) -> bytes:
    """The first messages of a stream, as many as their checksum covers; b"" if they are cut or damaged."""
    source = pa.BufferReader(data)
    try:
        pa.ipc.read_message(source)
        digits = (pa.ipc.open_stream(data).schema.metadata or {}).get(b"crc32")
        for _ in TEXT_COLUMNS:  # each has its dictionary
            pa.ipc.read_message(source)
    except _UNREADABLE:
        return b""
    header = data[: source.tell()]
    return header if is_sealed(header, digits) else b""


#: A batch, its custom metadata, and the byte after it.
_Batch = tuple[pa.RecordBatch, dict[bytes, bytes], int]


def _next_whole_batch(header: bytes, data: bytes, at: int) -> _Batch | None:
    """The first whole batch whose message begins at byte `at` or later."""
    while at >= 0:
        if (found := _whole_batch(header, data, at)) is not None:
            return found
        at = data.find(MARKER, at + 1)
    return None


def _whole_batch(header: bytes, data: bytes, at: int) -> _Batch | None:
    """The batch whose message begins at byte `at`; None: it is not whole."""
    source = pa.BufferReader(memoryview(data)[at:])
    try:
        pa.ipc.read_message(source)
        message = data[at : at + source.tell()]
        batch, custom = pa.ipc.open_stream(header + message).read_next_batch_with_custom_metadata()
        about = dict(custom or {})
        if not is_sealed(message, about.get(b"crc32")) or batch.num_rows != int(about[b"rows"]):
            return None
        if min(int(about[b"sequence"]), int(about[b"first_row"])) < 0:
            return None
    except _UNREADABLE:
        return None
    return batch, about, at + len(message)


def _is_cut(data: bytes, at: int) -> bool:
    """Whether the message at byte `at` is cut off (longer than what is left), not damaged."""
    try:
        pa.ipc.read_message(pa.BufferReader(memoryview(data)[at:]))
    except _UNREADABLE:
        return True
    return False


def describe(schema_metadata: dict[bytes, bytes] | None) -> dict[str, Any]:
    """The description in the schema (the JSON under `phd`), as keyword arguments of `Recording`.

    ValueError if this is no recording or one of a later form.
    """
    try:
        about = _json((schema_metadata or {})[b"phd"])
        form, words = about["form"], about["text"]
        described = {
            "metadata": about["metadata"],
            "braked": about["braked"],
            "sensors": Sensors(**about["sensors"]) if "sensors" in about else None,
            "words": {name: tuple(words[name]) for name in TEXT_COLUMNS},
        }
        as_declared = isinstance(about["metadata"], dict) and isinstance(about["braked"], str)
        if not as_declared or not all(_are_texts(words[name]) for name in TEXT_COLUMNS):
            raise ValueError("not as the writer stores it")
        known = {"phase": tick_log.PHASES, "stuck": tick_log.STUCK_LETTERS}
        if any(not set(words[name]) <= set(known[name]) for name in known) or "move" not in words["phase"]:
            raise ValueError("words that there are not")
        recording_columns(about["braked"], described["sensors"])  # InputError for joints that there are not
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, InputError):
        raise ValueError("no description of a recording") from None
    if form != FORM:
        raise ValueError(f"form {form!r}, this program reads form {FORM}")
    return described


def as_arrays(batches: list[pa.RecordBatch], schema: pa.Schema, words: dict[str, tuple[str, ...]]) -> dict:
    """Column name -> (rows,) array of all batches; text columns as places in `words` (else ValueError)."""
    table = pa.Table.from_batches(batches, schema)
    table.validate(full=True)  # every code has a word
    columns: dict[str, np.ndarray] = {}
    if missing := [name for name in ("t_s", *TEXT_COLUMNS) if name not in schema.names]:
        raise ValueError(f"there is no column {missing[0]}")
    for name, column in zip(schema.names, table.unify_dictionaries().columns, strict=True):
        if column.null_count:
            raise ValueError(f"column {name} has gaps")
        coded = column.combine_chunks()
        if pa.types.is_dictionary(column.type) != (name in TEXT_COLUMNS):
            raise ValueError(f"column {name} is of another type")
        if name not in TEXT_COLUMNS:
            if column.type != pa.float64():
                raise ValueError(f"column {name} is not of numbers")
            columns[name] = np.from_dlpack(coded).copy()  # that can be written to
            continue
        words_there, place = coded.dictionary.to_pylist(), {word: code for code, word in enumerate(words[name])}
        if not place.keys() >= set(words_there):
            raise ValueError(f"column {name} has words that the description does not list")
        places = np.array([place[word] for word in words_there], TEXT_COLUMNS[name].to_pandas_dtype())
        columns[name] = places[np.from_dlpack(coded.indices)]
    return columns


def is_sealed(message: bytes, digits: bytes | None, start: int = 0) -> bool:
    """Whether `digits`, the checksum in the message (after byte `start`), is that of its bytes."""
    if digits is None or len(digits) != len(SEAL):
        return False
    at = message.find(digits, start)
    if at < 0:
        return False
    rest = memoryview(message)[at + len(SEAL) :]
    return digits == b"%08x" % crc32(rest, crc32(message[:at] + SEAL))
