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
TWO = ["-n", "2", "--dist", "loadfile"]
NO_TEST = 5  # pytest's exit code where no test is marked


def main() -> int:
    """The exit code."""
    live = sorted(str(file.relative_to(ROOT)) for file in ROOT.glob("tests/app/test_live_*.py"))
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        results = [f"--junitxml={folder}/{number}.xml" for number in (1, 2, 3)]
        parts = {
            "ruff": [BIN / "ruff", "check", "."],
            "mypy": [BIN / "mypy"],
            "lint-imports": [BIN / "lint-imports", "--no-logo"],
            "pytest": [*PYTEST, *TWO, results[0], "--ignore-glob=*/test_live_*.py"],
            # real processes that keep time: nothing but each other beside them
            "pytest of real processes": [*PYTEST, *live, *TWO, results[1]],
            "pytest without the jit": [*PYTEST, *TWO, "-m", "nojit", results[2]],
        }
        for name, command in parts.items():
            print(f"\n== {name}", flush=True)
            without_jit = name == "pytest without the jit"
            more = {"NUMBA_DISABLE_JIT": "1"} if without_jit else {}
            code = subprocess.call(command, cwd=ROOT, env=os.environ | more)
            if code != 0 and not (without_jit and code == NO_TEST):
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
