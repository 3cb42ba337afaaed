"""Tables of finite numbers in CSV files: a header, then a row a line. A refusal names file, line and column."""

import io
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.files import InputError, StrangeInput, read_text
from core.ranges import Range


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
            raise InputError(f"{self.path}: line {self.line(0)}: the first time must be 0 or earlier, not {t[0]:g} s")
        bad = np.flatnonzero(np.diff(t) <= 0.0)
        if len(bad):
            row = int(bad[0]) + 1
            raise InputError(
                f"{self.path}: line {self.line(row)}: time must rise, but {t[row]:g} s follows {t[row - 1]:g} s"
            )

    def check_range(self, column: int, quantity: Range) -> None:
        """Refuse a column that leaves the range of its quantity; warn where its largest number is strange."""
        row = int(np.abs(self.values[:, column]).argmax())
        value = float(self.values[row, column])
        place = f"{self.path}: line {self.line(row)}: {self.columns[column]}"
        if reason := quantity.refusal(value):
            raise InputError(f"{place} {reason}")
        if doubt := quantity.doubt(value):
            warnings.warn(StrangeInput(f"{place} = {doubt}"), stacklevel=1)


def read_number_table(path: Path, asked_by: str, needed: Sequence[str] = ()) -> NumberTable:
    """The table in a CSV file; `asked_by` is the file and key that name it, for a file that cannot be read.

    needed: columns that it must have.
    """
    try:
        text = read_text(path)
    except InputError as error:
        raise InputError(f"{asked_by}: {error}") from None
    header, _, body = text.partition("\n")
    columns = tuple(name.strip().strip('"') for name in header.split(","))
    if missing := [name for name in needed if name not in columns]:
        raise InputError(f"{path}: line 1: the header lacks {', '.join(missing)}")
    if len(set(columns)) < len(columns):
        raise InputError(f"{path}: line 1: a column stands twice in the header ({header.strip()})")
    if not body.strip():
        raise InputError(f"{path}: has no rows")
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        values = np.empty((0, 0))  # the line at fault is found below
    if values.shape[1] != len(columns) or not np.isfinite(values).all():
        raise InputError(f"{path}: {_first_fault(body, columns)}")
    return NumberTable(path, columns, values, text)


def _first_fault(body: str, columns: tuple[str, ...]) -> str:
    """Line and reason of the first row that is not one finite number a column."""
    for number, line in enumerate(body.split("\n"), 2):
        if not line.strip():
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
