"""What `phd test` runs without arguments: every check, part by part; the last line counts the tests.

Exit code 0: everything passed.
"""

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as tree
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = ROOT / ".venv" / ("Scripts" if sys.platform == "win32" else "bin")
PYTEST = [BIN / "python", "-m", "pytest"]
#: Two files of tests at a time, in the order of `conftest.LONG`.
TWO = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder"]
OF_THE_WHEEL = [str(ROOT / "tests/app/test_tutorial.py"), str(ROOT / "tests/experiments/test_from_python.py")]


def main() -> int:
    """The exit code."""
    files = sorted(ROOT.glob("tests/*/test_*.py"))
    live = [str(file.relative_to(ROOT)) for file in files if file.stem.startswith("test_live_")]
    marked = [str(file.relative_to(ROOT)) for file in files if "mark.nojit" in file.read_text(encoding="utf-8")]
    ignored = [f"--ignore={file}" for file in OF_THE_WHEEL]
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        results = [f"--junitxml={folder}/{number}.xml" for number in (1, 2, 3, 4)]
        parts = {
            "ruff": [BIN / "ruff", "check", "."],
            "ruff format": [BIN / "ruff", "format", "--check", "."],
            "mypy": [BIN / "mypy"],
            "lint-imports": [BIN / "lint-imports", "--no-logo"],
            "mkdocs": [BIN / "mkdocs", "build", "--strict", "--site-dir", f"{folder}/site"],
            "pytest": [*PYTEST, *TWO, results[0], "--ignore-glob=*/test_live_*.py", *ignored],
            "pytest of the wheel": [BIN / "python", "tests/wheel.py", *TWO, results[3], *OF_THE_WHEEL],
            "pytest of real processes": [*PYTEST, *TWO, results[1], *live],  # they keep time: nothing else beside them
            "pytest without the jit": [*PYTEST, *TWO, results[2], "-m", "nojit", *marked],
        }
        for name, command in parts.items():
            print(f"\n== {name}", flush=True)
            more = {"pytest without the jit": {"NUMBA_DISABLE_JIT": "1"}, "mkdocs": {"NO_MKDOCS_2_WARNING": "1"}}.get(
                name, {}
            )
            if subprocess.call(command, cwd=ROOT, env=os.environ | more) != 0:
                failed.append(name)
        suites = [suite for file in Path(folder).glob("*.xml") for suite in tree.parse(file).iter("testsuite")]
    tests, skipped, errors, failures = (
        sum(int(suite.get(key, 0)) for suite in suites) for key in ("tests", "skipped", "errors", "failures")
    )
    wrong = errors + failures
    print(f"\nfailed: {', '.join(failed)}" if failed else "")
    print(f"{tests - skipped - wrong} passed, {wrong} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
