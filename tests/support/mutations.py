"""Tables that are spoilt as people and programs spoil them: the structure holds, a value is wrong."""

from collections.abc import Callable

import numpy as np

Rows = list[list[str]]
#: Names of columns -> largest sizes of what stands in them, which are as people write them.
TABLES = {
    "force": {"t_s": 1.0, "fx_N": 20.0, "fy_N": 8.0},
    "schedule": {"t_s": 1.0, "A": 5.0, "E": 2.0},
    "points": {"x_m": 0.1, "y_m": 0.4},
    "steps": {
        "t_s": 0.6,
        "current_from_A": 0.0,
        "current_to_A": 0.8,
        "speed_rpm": 10.0,
        "torque_N_m": 4.0,
        "step_index": 1.0,
    },
}


def table(kind: str, rng: np.random.Generator) -> Rows:
    """A right table of a kind: its header, then rows."""
    sizes, count = TABLES[kind], 30 if kind == "steps" else 6
    columns = [sizes[name] * (np.ones(count) if kind == "steps" else rng.uniform(0.5, 1.0, count)) for name in sizes]
    columns[0] = np.linspace(0.0, 1.0, count) * next(iter(sizes.values()))
    rows = [[f"{number:.4f}" for number in row] for row in zip(*columns, strict=True)]
    return [list(sizes), *(rows[:-1] if kind == "schedule" else rows)]


def as_text(rows: Rows, comma: str = ",") -> str:
    return "".join(comma.join(row) + "\n" for row in rows)


def _cell(change: Callable[[str], str]) -> Callable[[Rows, np.random.Generator], str]:
    """One cell is changed."""

    def spoil(rows: Rows, rng: np.random.Generator) -> str:
        row, column = rng.integers(1, len(rows)), rng.integers(len(rows[0]))
        rows[row][column] = change(rows[row][column])
        return as_text(rows)

    return spoil


def _scaled(rows: Rows, columns: range, factor: float) -> str:
    for row in rows[1:]:
        for column in columns:
            row[column] = f"{float(row[column]) * factor:.6g}"
    return as_text(rows)


def _row(rows: Rows, rng: np.random.Generator, change: Callable[[list[str]], object]) -> str:
    change(rows[rng.integers(1, len(rows))])
    return as_text(rows)


def _renamed(rows: Rows, rng: np.random.Generator) -> str:
    rows[0][rng.integers(len(rows[0]))] += rng.choice(["2", "_mm", " (N)", "S"])
    return as_text(rows)


#: What happens to a table -> how, and to which kinds (""; all) it can be told to have happened.
SPOILT: dict[str, tuple[Callable[[Rows, np.random.Generator], str], str]] = {
    "decimal commas": (lambda rows, rng: as_text(rows).replace(".", ","), ""),
    "semicolons and decimal commas": (lambda rows, rng: as_text(rows, ";").replace(".", ","), ""),
    "semicolons below the header": (lambda rows, rng: as_text(rows[:1]) + as_text(rows[1:], ";"), ""),
    "tabs": (lambda rows, rng: as_text(rows, "\t"), ""),
    "quoted decimal comma": (_cell(lambda cell: f'"{cell.replace(".", ",")}"'), ""),
    "extra cell in front": (lambda rows, rng: _row(rows, rng, lambda row: row.insert(0, "7")), ""),
    "missing cell": (lambda rows, rng: _row(rows, rng, lambda row: row.pop(rng.integers(len(row)))), ""),
    "empty cell": (_cell(lambda cell: ""), ""),
    "underscore": (_cell(lambda cell: f"{cell[0]}_{cell[2:]}"), ""),
    "thousands": (_cell(lambda cell: "1,000"), ""),
    "unit in a cell": (_cell(lambda cell: f"{cell} N"), ""),
    "digits of another script": (_cell(lambda cell: "\N{FULLWIDTH DIGIT ONE}"), ""),
    "not a number": (_cell(lambda cell: "nan"), ""),
    "row of units": (lambda rows, rng: as_text([rows[0], ["[s]"] * len(rows[0]), *rows[1:]]), ""),
    "no header": (lambda rows, rng: as_text(rows[1:]), ""),
    "renamed column": (_renamed, ""),
    "column twice": (lambda rows, rng: as_text([[*row, row[-1]] for row in rows]), ""),
    "milliseconds": (lambda rows, rng: _scaled(rows, range(1), 1e3), "force schedule"),
    "thousandths": (lambda rows, rng: _scaled(rows, range(rows[0][0] == "t_s", len(rows[0])), 1e3), "force points"),
    "rows swapped": (lambda rows, rng: as_text([*rows[:2], rows[3], rows[2], *rows[4:]]), "force schedule"),
    "row twice": (lambda rows, rng: as_text([*rows[:3], *rows[2:]]), "force schedule"),
    "last row lost": (lambda rows, rng: as_text(rows[:-1]), "force"),
    "order of columns": (lambda rows, rng: as_text([row[::-1] for row in rows]), ""),
    "empty lines": (lambda rows, rng: "\ufeff" + as_text(rows).replace("\n", "\r\n\r\n"), ""),
}  # fmt: skip


def spoilt_table(kind: str, what: str, rng: np.random.Generator) -> tuple[str, str]:
    """The text of a right table of a kind, and the same table spoilt."""
    rows = table(kind, rng)
    return as_text(rows), SPOILT[what][0]([list(row) for row in rows], rng)
