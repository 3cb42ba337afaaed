"""The shape of the tree: who may import whom, and where each of the paper's equations is.

An equation is named in a docstring as "Eq. (2)", several as "Eqs. (9) and (10)", "Eqs. (9), (10)", "Eqs. (9, 10)"
or "Eqs. (7)-(11)". docs/assumptions-and-equations.md has one row for each, such as
`| (2) | ... | core/brake.py torque_gain |` (several places: by commas or semicolons; a method as `Class.method`).
"""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
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


@cache
def docstrings(file: Path) -> dict[str, str]:
    """Name -> docstring of the module (""), its classes, functions and methods ("Class.method")."""
    found: dict[str, str] = {}

    def visit(node: ast.AST, name: str) -> None:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            found[name] = ast.get_docstring(node) or ""
            for child in node.body:
                if isinstance(child, ast.ClassDef | ast.FunctionDef):
                    visit(child, f"{name}.{child.name}".lstrip("."))

    visit(ast.parse(file.read_text(), file), "")
    return found


def rows_of_equations() -> dict[int, str]:
    """Equation number -> last cell of its row in docs/assumptions-and-equations.md."""
    rows = ROW.findall((ROOT / "docs/assumptions-and-equations.md").read_text())
    assert len(rows) == len({number for number, _ in rows}), "an equation has two rows"
    return {int(number): cell for number, cell in rows}


@pytest.mark.parametrize("number", EQUATIONS)
def test_the_page_of_equations_leads_from_each_of_the_papers_to_code_whose_docstring_names_it(number: int) -> None:
    cell = rows_of_equations().get(number)
    assert cell is not None, f"no row for ({number})"
    places = PLACE.findall(cell)
    assert places, f"row ({number}) names no place such as `core/brake.py torque_gain`: {cell.strip()}"
    for file, function in places:
        assert (ROOT / file).is_file(), f"row ({number}): there is no {file}"
        texts = docstrings(ROOT / file)
        assert function in texts, f"row ({number}): there is no {function} in {file}"
        assert number in equations_named(texts[function]), f"{file} {function} does not name Eq. ({number})"


def lint(folder: Path, **modules: str) -> str:
    """What lint-imports says of a small tree under the project's own contracts; core="import app" fills it."""
    shutil.copy(ROOT / "pyproject.toml", folder)
    processes = ("app/ipc", "app/loop", "app/session_server", "app/window")
    control = ("core/control", *(f"core/control/{name}" for name in ("algorithm", "proportional", "sdof")))
    rooms = [f"app/window/{room}" for room in ("run", "analyse", "canvas", "widgets")]
    within = (*processes, *rooms, *control, "core/simulator", "experiments/trial")
    for package in ("core", "hardware", "experiments", "app", *within):
        (folder / package).mkdir()
        (folder / package / "__init__.py").touch()
        (folder / package / "code.py").write_text(modules.get(package.removeprefix("app/").replace("/", "."), ""))
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=200)
    assert done.returncode == (0 if "0 broken" in done.stdout else 1), done.stdout + done.stderr
    return done.stdout


def test_the_layers_as_designed_keep_the_contracts(tmp_path: Path) -> None:
    allowed = {
        "core": "import numpy, numba, msgspec",
        "hardware": "import core.code, serial, hidraw",
        "experiments": "import core.code, scipy, pyarrow, matplotlib",
        "app": "import core.code, hardware.code, experiments.code, PySide6",
        **dict.fromkeys(("loop", "session_server", "window"), "import app.ipc.code"),
        "window.run": "import app.window.canvas.code",
    }
    assert "0 broken" in lint(tmp_path, **allowed)


#: whose code -> what it must not import
FORBIDDEN = {
    "core": ("experiments", "scipy"),
    "hardware": ("experiments", "shiboken6"),
    "experiments": ("hardware", "app", "PySide6"),
    "loop": ("app.session_server",),
    "session_server": ("app.window",),
    "window": ("app.loop", "core.control.sdof", "core.simulator", "experiments.trial"),
    "ipc": ("app.session_server",),
    "window.run": ("app.window.analyse",),
    "window.widgets": ("app.window.canvas",),
}


def test_an_import_against_the_layers_breaks_a_contract(tmp_path: Path) -> None:
    outside = ("scipy", "shiboken6", "PySide6")
    wrong = {
        package: "\n".join(f"import {name}" if name in outside else f"import {name}.code" for name in names)
        for package, names in FORBIDDEN.items()
    }
    said = lint(tmp_path, **wrong)
    for package, names in FORBIDDEN.items():
        own = package if package in ("core", "hardware", "experiments") else f"app.{package}"
        for name in names:
            there = name if name in outside else f"{name}.code"
            assert f"{own}.code -> {there} (l." in said, (package, name)


def test_the_citation_names_this_version_and_the_paper_as_the_readme_does() -> None:
    cited = (ROOT / "CITATION.cff").read_text()
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    title = re.search(r'the paper "([^"]+)"', " ".join((ROOT / "README.md").read_text().split()))[1]
    assert re.search(r"(?m)^version: (.*)$", cited)[1] == project["version"]
    assert f"title: {title}\n" in cited
    assert re.search(r"(?m)^license: (.*)$", cited)[1] == project["license"] == "BSD-3-Clause"
    assert (ROOT / "LICENSE").read_text().startswith("BSD 3-Clause License")
