"""Tables and drawings that are spoilt as people and programs spoil them: the structure holds, a value is wrong."""

import re
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


HIDDEN = (
    '<path d="M0 0L50 9" display="none"/>', '<g style="display:none"><path d="M0 0L50 9"/></g>',
    '<path d="M0 0L50 9" visibility="hidden"/>', '<defs><path d="M0 0L50 9"/></defs>',
    '<marker id="m9"><path d="M0 0L50 9"/></marker>',  '<symbol id="s9"><path d="M0 0L50 9"/></symbol>',
)  # fmt: skip
WRONG_TRANSFORMS = "rotate(", "rotate(9 9)", "move(3)", "translate(3;4)", "matrix(1 2 3)", "rotate(9deg)"


def transform(rng: np.random.Generator) -> str:
    """One to three random transforms that keep a drawing of 100 within -1000 to 1000."""
    a, b, c = rng.uniform(-1.0, 1.0, 3).round(3)
    kinds = (
        f"translate({50 * a} {50 * b})", f"translate({30 * a})", f"rotate({180 * a},50,{50 * b})",
        f"scale(-{1 + 0.5 * a},{1 - 0.5 * b})", f"skewX({40 * a:.1f})", f"skewY({40 * b:.1f})",
        f"matrix({1 + 0.3 * a},{0.3 * b},{0.4 * c},1,{20 * a},{10 * b})",
    )  # fmt: skip
    return rng.choice([" ", ",", ""]).join(rng.choice(kinds, rng.integers(1, 4)))


def _digit(inside: str, rng: np.random.Generator) -> str:
    """Another number in place of one in the data of a shape."""
    places = [found.span() for found in re.finditer(r"(?<=[\s,A-Za-z\"])\d+(?=[\s,A-Za-z\"])", inside)]
    start, end = places[rng.integers(len(places))]
    return f"{inside[:start]}{rng.integers(1, 99)}{inside[end:]}"


def _of_data(inside: str, change: Callable[[str], str]) -> str:
    """The drawing with the first data of a path, or the first points, changed."""
    return re.sub(r'(?<= d="|ts=")([^"]+)', lambda found: change(found[1]), inside, count=1)


def _command(inside: str, rng: np.random.Generator) -> str:
    def other(found: re.Match) -> str:
        return rng.choice([found[0], found[0].swapcase(), "L", "T"])

    return _of_data(inside, lambda data: re.sub("[A-Za-z]", other, data))


def _stray(inside: str, rng: np.random.Generator) -> str:
    """A character or two in the data in place of another, or of none."""

    def change(data: str) -> str:
        at, keeps = rng.integers(1, len(data)), rng.integers(2)
        return data[:at] + rng.choice(["", ",", ",,", ";", "-", ".", "e", " 5 ", "NaN", "1,5"]) + data[at + keeps :]

    return _of_data(inside, change)


#: What happens to a drawing -> how.
REDRAWN: dict[str, Callable[[str, np.random.Generator], str]] = {
    "in two groups": lambda inside, rng: (
        f'<g transform="{transform(rng)}"><g transform="{transform(rng)}">{inside}</g></g>'
    ),
    "used": lambda inside, rng: (
        f'<defs><g id="u9">{inside}</g></defs><use href="#u9" x="{rng.integers(40)}" transform="{transform(rng)}"/>'
    ),
    "with what is hidden": lambda inside, rng: inside + rng.choice(HIDDEN),
    "hidden by a class": lambda inside, rng: (
        f'<style>.n9{{display:none}}</style>{inside}<path class="n9" d="M0 0L50 9"/>'
    ),
    "another number": _digit,
    "another command": _command,
    "a stray character": _stray,
    "a wrong transform": lambda inside, rng: f'<g transform="{rng.choice(WRONG_TRANSFORMS)}">{inside}</g>',
    "a use of nothing": lambda inside, rng: f'{inside}<use href="#gone"/>',
    "a second line": lambda inside, rng: inside + '<path d="M5 5L9 70"/>',
    "broken off": lambda inside, rng: inside[: rng.integers(5, len(inside) - 1)],
}
