"""CSV files of numbers with one header line (brake schedules, forces): read at once, refused by line.

A million rows of three columns take half a second; only a file that is wrong is looked at line by line.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from core.errors import InputError
from core.files import read_text


@dataclass(frozen=True)
class NumberTable:
    """A file of finite numbers."""

    path: Path
    columns: tuple[str, ...]
    values: np.ndarray  # (rows, columns), at least one row
    text: str

    def line(self, row: int) -> int:
        """The line of the file (from 1) on which a row stands."""
        numbers = (i for i, line in enumerate(self.text.split("\n"), 1) if i > 1 and line.strip())
        return next(number for k, number in enumerate(numbers) if k == row)

    def check_times(self) -> None:
        """Refuse a first column that does not rise strictly, or starts after 0."""
        t = self.values[:, 0]
        if t[0] > 0.0:
            raise InputError(
                f"{self.path}: line {self.line(0)}: the first time must be 0 or earlier, not {t[0]:g} s"
            )
        bad = np.flatnonzero(np.diff(t) <= 0.0)
        if len(bad):
            row = int(bad[0]) + 1
            raise InputError(
                f"{self.path}: line {self.line(row)}: time must rise, but {t[row]:g} s follows {t[row - 1]:g} s"
            )


def read_number_table(path: Path, asked_by: str) -> NumberTable:
    """The table in a CSV file; `asked_by` is the file and key that name it, for a file that cannot be read."""
    try:
        text = read_text(path)
    except InputError as error:
        raise InputError(f"{asked_by}: {error}") from None
    header, _, body = text.partition("\n")
    columns = tuple(name.strip() for name in header.split(","))
    if len(set(columns)) < len(columns):
        raise InputError(f"{path}: line 1: a column stands twice in the header ({header.strip()})")
    if not body.strip():
        raise InputError(f"{path}: has no rows")
    try:
        values = _numbers(body, columns)
    except pa.ArrowInvalid:
        values = np.full((1, len(columns)), np.nan)  # the line at fault is found below
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path}: {_first_fault(body, columns)}")
    return NumberTable(path, columns, values, text)


def _numbers(body: str, columns: tuple[str, ...]) -> np.ndarray:
    """The rows (n, columns) of a CSV body; ArrowInvalid unless every cell is a number (nan and inf pass)."""
    table = pa_csv.read_csv(
        pa.py_buffer(body.encode()),
        pa_csv.ReadOptions(column_names=list(columns)),
        pa_csv.ParseOptions(quote_char=False),
        pa_csv.ConvertOptions(column_types={column: pa.float64() for column in columns}, null_values=[]),
    )
    return np.column_stack([column.to_numpy() for column in table.columns])


def _first_fault(body: str, columns: tuple[str, ...]) -> str:
    """Line and reason of the first row that is not one finite number a column."""
    for number, line in enumerate(body.split("\n"), 2):
        if not line:
            continue
        cells = line.split(",")
        if len(cells) != len(columns):
            return f"line {number}: has {len(cells)} values, the header names {len(columns)}"
        for cell, column in zip(cells, columns, strict=True):
            try:
                finite = math.isfinite(float(cell.replace("_", "?")))  # Python alone takes 1_000 for a number
            except ValueError:
                return f"line {number}: {column} must be a number, not {cell.strip()!r}"
            if not finite:
                return f"line {number}: {column} must be finite, not {cell.strip()}"
    return "cannot be read as numbers"
