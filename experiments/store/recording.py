"""A trial's recording on the disk: its ticks go into the session's database while it runs, become a Parquet file when
it has ended, and are read back from either.

In this order: the file under another name, compared with the database, on the disk, named; then in one commit its
SHA-256, the trial's row and the line of the journal, and the ticks leave the database. A crash at any point leaves
ticks and outcome in the database, and closing begins again.
"""

import contextlib
import hashlib
import json
import os
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.analysis.trials_table import TrialRow
from experiments.atomic_files import make_folders, new_beside, reason_of, retry_while_locked, sync_file, sync_folder
from experiments.recording import TEXT_COLUMNS, Recording, Sensors, column_words, recording_columns
from experiments.store.database import Database, Stored, StoredTrial, reading, trials_in

FORM = 2  # rises when a reader of today could no longer read the file
PIECE_ROWS = 60_000  # of a row group: a minute, 25 MB
LONG_ROWS = 10 * PIECE_ROWS  # a longer recording is not held in memory as a whole
UNREADABLE = (pa.ArrowException, OSError, EOFError, KeyError, ValueError, TypeError, RecursionError)
BATCH_ROWS = 1000  # most ticks in a row of the database: what a damaged byte can cost
COMMIT_S = 0.2  # ticks wait at most this long, and for the next call: what a kill or a power cut can cost
RETRY_S = 1.0  # between two attempts, while the disk takes no more
MOST_IN_MEMORY = 400_000_000  # bytes that the disk refused: half an hour and more. Our choice: a desktop has the room
_codec = pa.Codec("zstd", compression_level=1)


# -------------------------------------------------------------------------------------------------------- what it is of


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


# ------------------------------------------------------------------------------------------------- while the trial runs


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
        self.recording: Recording | None = None  # once the trial is closed
        self.row: TrialRow | None = None  # once it is measured
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

    def close(self, outcome: Mapping[str, Any] | None = None) -> StoredTrial:
        """Add the rest and the trial's outcome (status, reason, ..) for the next commit: anything JSON holds."""
        text = as_json(outcome or {}, "outcome")
        self._add_waiting()
        trial = StoredTrial(self.trial, *self.place, self._about, text, self.rows, 0, "")
        self.database.put("trial", *trial)
        return trial

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


# ---------------------------------------------------------------------------------------------------- once it has ended


def close_trial(database: Database, trial: StoredTrial, sync: bool = True) -> Recording:
    """Make the file of a trial that has ended, and let its ticks leave the database with the next commit.

    OSError: the disk takes no more, and nothing has changed.
    """
    path = database.path.parent / trial.name
    with reading(database.path.parent) as stored:
        if trial.ticks:
            make_folders(path.parent, sync)
            with new_beside(path) as partial:
                _write_checked(partial, stored, trial)
                if sync:
                    sync_file(partial)
                trial = trial._replace(bytes=partial.stat().st_size, sha256=digest_of(partial))
                retry_while_locked(os.replace, partial, path)
            if sync:
                sync_folder(path.parent)
            database.put("trial", *trial)
            database.drop_ticks(trial.number)
        return read_trial(stored, trial, True, path)


def _write_checked(file: Path, stored: Stored, trial: StoredTrial) -> None:
    """OSError unless the file holds what the database does."""
    written, ticks = list[int](), 0

    def summed() -> Iterator[np.ndarray]:
        nonlocal ticks
        for piece in pieces(stored, trial):
            written.append(zlib.crc32(piece.tobytes()))
            ticks += piece.shape[1]
            yield piece

    write_parquet(file, trial.about, trial.outcome, summed())
    if ticks != trial.ticks:
        raise OSError(f"{file}: {ticks} of {trial.ticks} ticks are in the database")
    about = described(trial.about)
    names = column_names(about)
    for found, right in zip(pieces_of(file, about["words"]), written, strict=True):
        if zlib.crc32(np.array([found[name] for name in names], np.float64).tobytes()) != right:
            raise OSError(f"{file}: what was read back differs from what was written")


def write_parquet(path: Path, text: str, outcome: str, pieces: Iterable[np.ndarray]) -> None:
    """Write the ticks of a trial: pieces (columns, n) of at most `PIECE_ROWS`. text: its `description`.

    OSError if the disk takes no more.
    """
    about = described(text)
    names = column_names(about)
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


# ------------------------------------------------------------------------------------------------------------ read back


def read_recording(path: str | Path) -> Recording:
    """The recording of a trial, SESSION/trials/run-001.parquet; check `complete` and `damaged`.

    Damage is no error. InputError: the session has no such trial, or cannot be read.
    """
    path = Path(path)
    try:
        with reading(path.absolute().parent.parent) as stored:
            for trial, whole in trials_in(stored):
                if trial.name == f"{path.absolute().parent.name}/{path.name}":
                    return read_trial(stored, trial, whole, path)
    except OSError as error:
        raise InputError(f"{path}: the recording cannot be read: {reason_of(error)}") from None
    raise InputError(f"{path}: there is no such recording in the database of its session")


def read_trial(stored: Stored, trial: StoredTrial, whole: bool, path: Path) -> Recording:
    """A trial's recording. path: of its file."""
    if not whole:
        return Recording(path, damaged=["description: does not match its checksum, no tick can be trusted"])
    try:
        about: dict[str, Any] = described(trial.about)
        outcome = json.loads(trial.outcome) if trial.outcome else {}
    except ValueError as error:
        return Recording(path, damaged=[f"description: {error}"])
    about |= {"outcome": outcome, "complete": bool(trial.outcome)}
    if trial.sha256:
        return _from_file(trial, path, about)
    damaged, parts = [], []
    for part, fault in batches(stored, trial):
        parts.append(part)
        damaged += [fault] if fault else []
    names = column_names(about)
    table = np.concatenate(parts, axis=1) if parts else np.empty((len(names), 0))
    kinds = {name: kind.to_pandas_dtype() for name, kind in TEXT_COLUMNS.items()}
    columns = {name: values.astype(kinds.get(name, np.float64)) for name, values in zip(names, table, strict=True)}
    return Recording(path, **about, columns=columns, damaged=damaged)


def fault_of_file(trial: StoredTrial, path: Path) -> str:
    """What is wrong with the file of a trial that is closed; "": nothing."""
    try:
        if digest_of(path) != trial.sha256:
            return "file: does not match its checksum, it was changed or cut"
    except FileNotFoundError:
        return "file: missing"
    except OSError as error:
        return f"file: cannot be read ({reason_of(error)})"
    return ""


def _from_file(trial: StoredTrial, path: Path, about: dict[str, Any]) -> Recording:
    if fault := fault_of_file(trial, path):
        return Recording(path, **about, damaged=[fault])
    if trial.ticks > LONG_ROWS:
        return Recording(path, **about, columns=LongColumns(path, column_names(about), about["words"]))
    try:
        return Recording(path, **about, columns=read_columns(path, about["words"]))
    except UNREADABLE as error:
        return Recording(path, **about, damaged=[f"file: damaged ({error})"])


def column_names(about: dict[str, Any]) -> list[str]:
    """The columns of a recording of this description."""
    return [name for name, _ in recording_columns(about["braked"], about["sensors"])]


def batches(stored: Stored, trial: StoredTrial) -> Iterator[tuple[np.ndarray, str]]:
    """The ticks of a trial that are in the database, (columns, n) each, and what is wrong there; a fault has none."""
    columns, next_tick = len(column_names(described(trial.about))), 0
    nothing = np.empty((columns, 0))
    for (_, _, first, count, data), whole in stored.rows("ticks", "trial = ?", trial.number):
        if first != next_tick and whole:
            yield nothing, f"ticks {next_tick} to {first - 1}: missing"
        if whole:
            next_tick = first + count
            yield unpacked(data, count, columns), ""
        else:
            yield nothing, f"ticks from {next_tick} on: some do not match their checksum"
    if trial.outcome and next_tick != trial.ticks:
        yield nothing, f"ticks {next_tick} to {trial.ticks - 1}: missing"


def pieces(stored: Stored, trial: StoredTrial) -> Iterator[np.ndarray]:
    """The same, whole batches alone, in pieces of `PIECE_ROWS`."""
    waiting: list[np.ndarray] = []
    rows = 0
    for part, _ in batches(stored, trial):
        waiting.append(part)
        rows += part.shape[1]
        if rows >= PIECE_ROWS:
            yield np.concatenate(waiting, axis=1)
            waiting, rows = [], 0
    if rows:
        yield np.concatenate(waiting, axis=1)
