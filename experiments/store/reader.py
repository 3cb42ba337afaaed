"""Reads recordings back: of a trial that is closed from its Parquet file, of any other from the session's database."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from core.files import InputError
from experiments.atomic_files import reason_of
from experiments.recording import TEXT_COLUMNS, Recording, recording_columns
from experiments.store.database import Stored, reading
from experiments.store.files import StoredTrial, trials_in
from experiments.store.parquet import (
    LONG_ROWS,
    PIECE_ROWS,
    UNREADABLE,
    LongColumns,
    described,
    digest_of,
    read_columns,
)
from experiments.store.writer import unpacked


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
        if path.stat().st_size != trial.bytes or digest_of(path) != trial.sha256:
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
