"""Tables of numbers in CSV files: a header, then a row a line; commas between columns, points in numbers.

A refusal names file, line and column, and where it can the habit behind the fault: decimal commas, semicolons, tabs.
"""

import csv
import io
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.files import InputError, StrangeInput, read_text
from core.ranges import Range

#: What a number may look like: Python alone also takes 1_000, and digits of other scripts.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(inf(inity)?|nan)", re.IGNORECASE | re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_SHORTER_TIMES = (("ms", 1e-3), ("us", 1e-6))


@dataclass(frozen=True)
class NumberTable:
    """Finite numbers, in the columns that were asked for."""

    where: str  # begins every refusal
    columns: tuple[str, ...]
    values: np.ndarray  # (rows, columns), at least one row
    text: str

    def line(self, row: int) -> int:
        """The line of the file (from 1) on which a row stands."""
        numbers = (i for i, line in enumerate(self.text.split("\n"), 1) if i > 1 and line.strip())
        return next(number for k, number in enumerate(numbers) if k == row)

    def check_times(self, duration_s: float, longer: float) -> None:
        """Refuse a first column that does not rise strictly, or starts after 0.

        Warns where it goes on for more than `longer` times the scene's duration: it is hardly in seconds.
        """
        t = self.values[:, 0]
        if t[0] > 0.0:
            raise InputError(f"{self.where}: line {self.line(0)}: the first time must be 0 or earlier, not {t[0]:g} s")
        bad = np.flatnonzero(np.diff(t) <= 0.0)
        if len(bad):
            row = int(bad[0]) + 1
            raise InputError(
                f"{self.where}: line {self.line(row)}: time must rise, but {t[row]:g} s follows {t[row - 1]:g} s"
            )
        if t[-1] > longer * duration_s:
            unit, _ = min(_SHORTER_TIMES, key=lambda unit: abs(math.log(t[-1] * unit[1] / duration_s)))
            warnings.warn(
                StrangeInput(
                    f"{self.where}: {self.columns[0]} ends at {t[-1]:g} s, the scene at {duration_s:g} s; "
                    f"if {t[-1]:g} {unit} is meant, write seconds"
                ),
                stacklevel=2,
            )

    def check_range(self, name: str, quantity: Range) -> None:
        """Refuse a column that leaves the range of its quantity; warn where its largest number is strange."""
        column = self.values[:, self.columns.index(name)]
        row = int(np.abs(column).argmax())
        value = float(column[row])
        place = f"{self.where}: line {self.line(row)}: {name}"
        if reason := quantity.refusal(value):
            raise InputError(f"{place} {reason}")
        if doubt := quantity.doubt(value):
            warnings.warn(StrangeInput(f"{place} = {doubt}"), stacklevel=2)


def number(cell: str) -> float:
    """The number in a cell, perhaps one that is not finite; ValueError: it is none."""
    if not _NUMBER.fullmatch(cell.strip()):
        raise ValueError
    return float(cell)


def read_number_file(
    path: Path, asked_by: str, needed: Sequence[str], optional: Sequence[str] | None = ()
) -> NumberTable:
    """As `number_table`, of a file; `asked_by` names it (a file and its key) in case that it cannot be read."""
    try:
        text = read_text(path)
    except InputError as error:
        raise InputError(f"{asked_by}: {error}") from None
    return number_table(text, str(path), needed, optional)


def number_table(text: str, where: str, needed: Sequence[str], optional: Sequence[str] | None = ()) -> NumberTable:
    """The needed columns of a table, then those of the optional ones that it has.

    optional: other columns that it may have; None: any others, which are not read.
    """
    if not text.strip():
        raise InputError(f"{where}: is empty: it has no rows")
    header, _, body = text.partition("\n")
    names = tuple(name.strip() for name in _cells(header, f"{where}: line 1"))
    _check_header(header, names, where, needed, optional)
    columns = (*needed, *(name for name in names if name in (optional or ())))
    if not body.strip():
        raise InputError(f"{where}: has no rows")
    places = [names.index(name) for name in columns]
    try:
        if not re.fullmatch(r"[-+.,eE\d\s]*", body, re.ASCII):
            raise ValueError  # np.loadtxt takes more than `number` does
        values = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2)
        if values.shape[1] != len(names):
            raise ValueError
        values = values[:, places]
    except ValueError:
        values = np.array(_rows(body, where, names, places))
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        line = NumberTable(where, columns, values, text).line(row)
        raise InputError(f"{where}: line {line}: {columns[column]} must be finite, not {values[row, column]:g}")
    return NumberTable(where, columns, values, text)


def _check_header(
    header: str, names: Sequence[str], where: str, needed: Sequence[str], optional: Sequence[str] | None
) -> None:
    """InputError unless the names of the columns are those that a table must and may have."""
    where = f"{where}: line 1"
    for separator, words in _SEPARATORS.items():
        if separator in header:
            raise InputError(f"{where}: has {words} between the columns: save with commas, and with points in numbers")
    if missing := [name for name in needed if name not in names]:
        named = f"; it names {', '.join(filter(None, names))}" if any(names) else ""
        raise InputError(f"{where}: the header lacks {', '.join(missing)}{named}")
    if twice := [name for i, name in enumerate(names) if name in names[:i]]:
        raise InputError(f"{where}: the header names {twice[0] or 'an empty column'} twice")
    if "" in names:
        raise InputError(f"{where}: column {names.index('') + 1} has no name")
    if optional is not None and (unknown := [name for name in names if name not in (*needed, *optional)]):
        may = ", ".join((*needed, *optional))
        raise InputError(f"{where}: the header names {', '.join(unknown)}, but may name {may} only")


def _rows(body: str, where: str, names: Sequence[str], places: Sequence[int]) -> list[list[float]]:
    """The numbers at the given places of each line; InputError: a line has none there, or too many or few cells."""
    rows = []
    for count, line in enumerate(body.split("\n"), 2):
        if not line.strip():
            continue
        at = f"{where}: line {count}"
        cells = _cells(line, at)
        if len(cells) != len(names):
            raise InputError(
                f"{at}: has {len(cells)} values, the header names {len(names)}{_habit(line, cells, names)}"
            )
        row = []
        for place in places:
            try:
                row.append(number(cells[place]))
            except ValueError:
                comma = _DECIMAL_COMMA.fullmatch(cells[place].strip())
                hint = " (decimal commas: save with points)" if comma else ""
                raise InputError(f"{at}: {names[place]} must be a number, not {cells[place].strip()!r}{hint}") from None
        rows.append(row)
    return rows


def _cells(line: str, at: str) -> list[str]:
    try:
        return next(csv.reader([line], strict=True), [])
    except csv.Error as error:
        raise InputError(f"{at}: is no line of a CSV file ({error})") from None


def _habit(line: str, cells: Sequence[str], names: Sequence[str]) -> str:
    """What explains a wrong number of cells, as words to add; "" where nothing does."""
    for separator, words in _SEPARATORS.items():
        if separator in line:
            return f" ({words} between the columns: save with commas, and with points in numbers)"
    are_parts = all(re.fullmatch(r"\s*[+-]?\d+(e[+-]?\d+)?\s*", cell, re.IGNORECASE | re.ASCII) for cell in cells)
    if are_parts and len(names) < len(cells) <= 2 * len(names):
        return " (decimal commas: save with points)"
    return ""
