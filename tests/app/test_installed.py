"""What `pip install .` installs, without installing it: every file of the packages, the command, what they import."""

import ast
import importlib.metadata
import re
import sys
import tomllib
from pathlib import Path

import pytest
from setuptools import Distribution

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("core", "hardware", "experiments", "app")
STUBS = Path("phd-stubs/__init__.pyi")
#: The firmware is built from the source tree alone.
SOURCES = {
    file.relative_to(ROOT)
    for package in PACKAGES for file in (ROOT / package).rglob("*")
    if file.is_file() and "__pycache__" not in file.parts and "firmware" not in file.parts
}  # fmt: skip
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

IMPORT = re.compile(r"(?m)^ *(?:from|import) (\w+)")
INSTALLED = {distribution.name.lower() for distribution in importlib.metadata.distributions()}


def named(requirement: str) -> str:
    """The distribution that a requirement is of."""
    return re.split(r"[^\w-]", requirement)[0].lower().replace("_", "-")


@pytest.fixture
def distribution(monkeypatch: pytest.MonkeyPatch) -> Distribution:
    monkeypatch.chdir(ROOT)
    made = Distribution({"script_name": "setup.py"})
    made.parse_config_files()
    return made


def test_every_file_of_the_packages_is_installed_and_the_command_is_the_one_of_the_source(distribution):
    build = distribution.get_command_obj("build_py")
    build.ensure_finalized()
    installed = {Path(file) for _, _, file in build.find_all_modules()}
    installed |= {Path(folder, name) for _, folder, _, names in build.data_files for name in names}
    assert sorted(SOURCES - {Path(file) for file in installed}) == []
    assert {Path("phd.py"), STUBS} <= installed and PROJECT["scripts"] == {"phd": "app.cli:main"}


def test_type_checkers_read_the_names_of_the_door_and_each_package_is_typed():
    door, stubs = (ast.parse((ROOT / file).read_text(encoding="utf-8")).body for file in ("phd.py", STUBS))
    assert set(map(ast.dump, stubs)) < set(map(ast.dump, door)) and ast.dump(door[-2]) == ast.dump(stubs[-1])
    assert all(Path(package, "py.typed") in SOURCES for package in PACKAGES)


def test_every_library_that_the_program_imports_is_one_that_it_asks_for():
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    asked = {named(line) for group in groups for line in group}
    asked |= {named(line) for name in asked & INSTALLED for line in importlib.metadata.requires(name) or ()}
    known = importlib.metadata.packages_distributions()
    imported: dict[str, Path] = {}
    for file in (*SOURCES, Path("phd.py")):
        if file.suffix == ".py":
            imported |= dict.fromkeys(IMPORT.findall((ROOT / file).read_text(encoding="utf-8")), file)
    others = imported.keys() - sys.stdlib_module_names - {*PACKAGES, "phd"}
    missing = {name: imported[name] for name in others if name in known and asked.isdisjoint(map(named, known[name]))}
    assert missing == {} and {"numpy", "numba", "PySide6"} <= others
