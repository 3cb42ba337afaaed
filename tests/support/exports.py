"""Exports for tests: their tables, and the official BIDS validator."""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def table(path: Path, delimiter: str = "\t") -> list[list[str]]:
    """The lines of a table, the header first."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file, delimiter=delimiter))


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file by the names in its header."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def validate(folder: Path) -> set[tuple[str, str, str]]:
    """What the official validator finds: (severity, code, what) of each issue. It needs no network."""
    pytest.importorskip("bids_validator_deno")
    program = shutil.which("bids-validator-deno", path=str(Path(sys.executable).parent))
    done = subprocess.run(
        [program, str(folder), "--format", "json", "--max-rows", "-1"], capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("{"), done.stderr
    issues = json.loads(done.stdout)["issues"]["issues"]
    return {(issue["severity"], issue["code"], issue.get("subCode", "")) for issue in issues}


def errors(folder: Path) -> list[tuple[str, str, str]]:
    """The errors among them."""
    return [issue for issue in validate(folder) if issue[0] == "error"]
