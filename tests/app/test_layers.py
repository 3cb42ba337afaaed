"""Where each of the paper's equations is, and what is cited.

An equation is named in a docstring as "Eq. (2)", several as "Eqs. (9) and (10)", "Eqs. (9), (10)", "Eqs. (9, 10)"
or "Eqs. (7)-(11)". docs/assumptions-and-equations.md has one row for each, such as
`| (2) | ... | core/brake.py torque_gain |` (several places: by commas or semicolons; a method as `Class.method`).
"""

import re
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EQUATIONS = range(1, 16)

_GROUP = r"\(\d+(?:\s*[-,]\s*\d+)*\)"
NAMED = re.compile(rf"\bEqs?\.\s+({_GROUP}(?:\s*(?:-|,|and|or|to|,\s*and)\s*{_GROUP})*)")
ROW = re.compile(r"^\|\s*\((\d+)\)\s*\|.*\|([^|]*)\|\s*$", re.MULTILINE)
PLACE = re.compile(r"\b((?:core|experiments)/[\w/]+\.py)`?\s+`?([A-Za-z_][\w.]*)")


def equations_named(text: str) -> set[int]:
    """The numbers of all equations that a text names."""
    numbers: set[int] = set()
    for match in NAMED.finditer(text):
        plain = re.sub(r"\)\s*(?:-|to)\s*\(", "-", match[1])
        for first, last in re.findall(r"(\d+)(?:\s*-\s*(\d+))?", plain):
            numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def rows_of_equations() -> dict[int, str]:
    """Equation number -> last cell of its row in docs/assumptions-and-equations.md."""
    rows = ROW.findall((ROOT / "docs/assumptions-and-equations.md").read_text())
    assert len(rows) == len({number for number, _ in rows}), "an equation has two rows"
    return {int(number): cell for number, cell in rows}


@pytest.mark.parametrize("number", EQUATIONS)
def test_the_page_of_equations_leads_from_each_of_the_papers_to_code_whose_docstring_names_it(number: int) -> None:
    cell = rows_of_equations()[number]
    places = PLACE.findall(cell)
    assert places, f"row ({number}) names no place such as `core/brake.py torque_gain`: {cell.strip()}"
    for file, function in places:
        found = attrgetter(function)(import_module(file.removesuffix(".py").replace("/", ".")))
        assert number in equations_named(found.__doc__ or ""), f"{file} {function} does not name Eq. ({number})"
