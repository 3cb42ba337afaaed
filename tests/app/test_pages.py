"""The pages say what the program declares, lead only to files that exist, and stay short."""

import importlib.util
import re
from pathlib import Path

import msgspec
import pytest

from experiments.assumptions import Assumptions

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/**/*.md"))]
#: Where a text names a file of docs/, from the top of the source.
NAMED = re.compile(r"\bdocs/[\w./-]*\w")
LINK = re.compile(r"\]\(([^):#\s]+)(?:#[^)\s]*)?\)")


def text_files() -> list[Path]:
    """The sources and pages, but for the list of changes."""
    folders = [ROOT / name for name in ("app", "core", "docs", "experiments", "hardware", "tests")]
    files = [*ROOT.glob("*"), *(file for folder in folders for file in folder.rglob("*"))]
    kinds = {".py", ".md", ".toml", ".c", ".h", ".yml", ".cff"}
    return [file for file in files if file.suffix in kinds and file.name != "CHANGELOG.md"]


@pytest.fixture(scope="module")
def generate():
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs/generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_pages_have_from_the_program_is_as_the_program_has_it_now(generate) -> None:
    stale = [page.name for page in PAGES if generate.generated(text := page.read_text("utf-8")) != text]
    assert not stale, "write them anew: .venv/bin/python docs/generate.py"
    written = {part[0] for page in PAGES for part in generate.PART.findall(page.read_text("utf-8"))}
    assert written == set(generate.PARTS)


def test_the_page_of_assumptions_has_each_with_its_default() -> None:
    section = (ROOT / "docs/assumptions-and-equations.md").read_text("utf-8").partition("\n## Assumptions\n")[2]
    said = {}
    for line in section.partition("\n## ")[0].splitlines():
        if line.startswith("| `"):
            keys, values = (cell.strip() for cell in line.split("|")[1:3])
            said |= dict(zip(re.findall(r"`(\w+)`", keys), values.split(", "), strict=True))
    assert said.keys() == set(Assumptions.__struct_fields__)
    for name, value in msgspec.structs.asdict(Assumptions()).items():
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        assert value is None or said[name].strip('`"') == shown, name


def test_every_file_of_docs_that_the_source_names_exists() -> None:
    missing = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in text_files()
        for name in NAMED.findall(file.read_text("utf-8"))
        if not [*ROOT.glob(f"{name}*")]
    }
    assert not missing


def test_every_relative_link_leads_to_a_file() -> None:
    pages = [file for file in text_files() if file.suffix == ".md"]
    pages = [page for page in pages if page.name != "report_template.md"]  # its pictures are made beside it
    missing = {
        f"{page.relative_to(ROOT)}: {target}"
        for page in pages
        for target in LINK.findall(page.read_text("utf-8"))
        if not (page.parent / target).exists()
    }
    assert len(pages) > 10 and not missing


def test_the_paper_cites_what_its_bibliography_has() -> None:
    paper, listed = ((ROOT / name).read_text("utf-8") for name in ("paper.md", "paper.bib"))
    assert set(re.findall(r"@(\w+)\]", paper)) == set(re.findall(r"^@\w+\{(\w+),", listed, re.M))
