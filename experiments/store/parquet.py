"""A trial's ticks as a Parquet file, which pandas, polars, DuckDB and R read; in pieces of a minute."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.recording import TEXT_COLUMNS, Sensors, column_words, recording_columns

FORM = 1  # rises when a reader of today could no longer read the file
PIECE_ROWS = 60_000  # of a row group: a minute, 25 MB
LONG_ROWS = 10 * PIECE_ROWS  # a longer recording is not held in memory as a whole
UNREADABLE = (pa.ArrowException, OSError, EOFError, KeyError, ValueError, TypeError, RecursionError)


def as_json(about: Mapping[str, Any], part: str) -> str:
    """JSON text for a recording. InputError, which names `part`, for what JSON cannot hold."""
    try:
        return json.dumps(about, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"recording: the {part} cannot be stored as JSON: {error}") from None


def description(
    braked: str, metadata: Mapping[str, Any], sensors: Sensors | None = None, decisions: tuple[str, ...] = DECISIONS
) -> str:
    """What a recording is of, as JSON. InputError for metadata that JSON cannot hold."""
    about = {"form": FORM, "braked": braked, "text": column_words(decisions), "metadata": metadata}
    return as_json(about | ({"sensors": sensors._asdict()} if sensors else {}), "metadata")


def described(text: str) -> dict[str, Any]:
    """A `description` as keyword arguments of `Recording`. ValueError if it is none, or of a later form."""
    try:
        about = json.loads(text)
        words = {name: tuple(about["text"][name]) for name in TEXT_COLUMNS}
        sensors = Sensors(**about["sensors"]) if "sensors" in about else None
        found = {"metadata": dict(about["metadata"]), "braked": about["braked"], "sensors": sensors, "words": words}
        known = {"phase": tick_log.PHASES, "stuck": tick_log.STUCK_LETTERS}
        if any(not set(words[name]) <= set(known[name]) for name in known):
            raise ValueError("words that there are not")
        recording_columns(about["braked"], sensors)  # InputError for joints that there are not
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, InputError) as error:
        raise ValueError(f"no description of a recording ({error})") from None
    if about["form"] != FORM:
        raise ValueError(f"form {about['form']!r}, this program reads form {FORM}")
    return found


def write_parquet(path: Path, text: str, outcome: str, pieces: Iterable[np.ndarray]) -> None:
    """Write the ticks of a trial: pieces (columns, n) of at most `PIECE_ROWS`. text: its `description`.

    OSError if the disk takes no more.
    """
    about = described(text)
    names = [name for name, _ in recording_columns(about["braked"], about["sensors"])]
    kinds = {name: pa.dictionary(code, pa.string()) for name, code in TEXT_COLUMNS.items()}
    fields = [pa.field(name, kinds.get(name, pa.float64()), nullable=False) for name in names]
    schema = pa.schema(fields, metadata={"phd": text})
    words = {name: _words(of) for name, of in about["words"].items()}
    with pq.ParquetWriter(
        path,
        schema,
        compression="snappy",  # on noisy doubles zstd saves a tenth of the space for twice the time
        use_dictionary=list(TEXT_COLUMNS),
        use_byte_stream_split=[name for name in names if name not in TEXT_COLUMNS],  # a fifth smaller
        write_statistics=False,
    ) as writer:
        for piece in pieces:
            arrays = [
                pa.DictionaryArray.from_arrays(_array(column.astype(TEXT_COLUMNS[name].to_pandas_dtype())), words[name])
                if name in TEXT_COLUMNS
                else _array(column)
                for name, column in zip(names, piece, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
        writer.add_key_value_metadata({"outcome": outcome})


def _array(values: np.ndarray) -> pa.Array:
    """Numbers without gaps as an Arrow array on the same memory.

    `pa.array` would import pandas, where it is installed, to check their type.
    """
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])


def _words(words: Sequence[str]) -> pa.Array:
    """Texts as an Arrow array; see `_array`."""
    encoded = [word.encode() for word in words]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))


def pieces_of(path: Path, words: Mapping[str, tuple[str, ...]]) -> Iterator[dict[str, np.ndarray]]:
    """The columns of a Parquet file, piece by piece."""
    with pq.ParquetFile(path) as file:
        for number in range(file.num_row_groups):
            yield _columns(file.read_row_group(number, use_threads=False), words)


def read_columns(path: Path, words: Mapping[str, tuple[str, ...]], names: Sequence[str] | None = None) -> dict:
    """Columns (rows,) of a Parquet file, all or these; text columns as places in `words`."""
    return _columns(pq.read_table(path, columns=names, use_threads=False, partitioning=None), words)


def _columns(table: pa.Table, words: Mapping[str, tuple[str, ...]]) -> dict[str, np.ndarray]:
    columns: dict[str, np.ndarray] = {}
    for name, column in zip(table.schema.names, table.unify_dictionaries().columns, strict=True):
        if column.null_count or pa.types.is_dictionary(column.type) != (name in TEXT_COLUMNS):
            raise ValueError(f"column {name} is not as it was written")
        if name not in TEXT_COLUMNS:
            columns[name] = np.from_dlpack(column.combine_chunks()).copy()  # that can be written to
            continue
        coded = column.combine_chunks()
        coded = coded if isinstance(coded, pa.DictionaryArray) else coded.chunk(0)
        place = {word: code for code, word in enumerate(words[name])}
        places = np.array([place[word] for word in coded.dictionary.to_pylist()], TEXT_COLUMNS[name].to_pandas_dtype())
        columns[name] = places[np.from_dlpack(coded.indices)]
    return columns


class LongColumns(Mapping[str, np.ndarray]):
    """The columns of a recording that is too long to be held in memory: each is read when it is asked for."""

    def __init__(self, path: Path, names: Sequence[str], words: Mapping[str, tuple[str, ...]]) -> None:
        self._path, self._names, self._words = path, tuple(names), words

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise KeyError(name)
        return read_columns(self._path, self._words, [name])[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def digest_of(path: Path) -> str:
    """The SHA-256 (hex) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
