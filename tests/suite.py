"""What `phd test` runs without arguments: every check, part by part; the last line counts the tests.

Exit code 0: everything passed.
"""

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as tree
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = ROOT / ".venv" / ("Scripts" if sys.platform == "win32" else "bin")
PYTEST = [BIN / "python", "-m", "pytest"]
#: Two files of tests at a time, in the order of `conftest.LONG`.
TWO = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder"]
OF_THE_WHEEL = [str(ROOT / "tests/app/test_tutorial.py"), str(ROOT / "tests/experiments/test_from_python.py")]


def passes(name: str, command: list) -> bool:
    """Whether this part passes; it prints what it says."""
    print(f"\n== {name}", flush=True)
    return subprocess.call(command, cwd=ROOT) == 0


def said(command: list) -> tuple[str, bool]:
    """What a part says that runs beside another one, and whether it passes."""
    more = {"NO_MKDOCS_2_WARNING": "1"} | ({"NUMBA_DISABLE_JIT": "1"} if "nojit" in command else {})
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | more, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    return done.stdout.decode(errors="replace"), done.returncode == 0


def main() -> int:
    """The exit code."""
    files = sorted(ROOT.glob("tests/*/test_*.py"))
    live = [str(file.relative_to(ROOT)) for file in files if file.stem.startswith("test_live_")]
    marked = [str(file.relative_to(ROOT)) for file in files if "mark.nojit" in file.read_text(encoding="utf-8")]
    ignored = [f"--ignore={file}" for file in OF_THE_WHEEL]
    with tempfile.TemporaryDirectory() as folder:
        results = [f"--junitxml={folder}/{number}.xml" for number in (1, 2, 3, 4)]
        beside = {  # one after another, while tests of the main part wait for processes and disks
            "ruff": [BIN / "ruff", "check", "."],
            "ruff format": [BIN / "ruff", "format", "--check", "."],
            "lint-imports": [BIN / "lint-imports", "--no-logo"],
            "mkdocs": [BIN / "mkdocs", "build", "--strict", "--site-dir", f"{folder}/site"],
            "mypy": [BIN / "mypy"],
            "pytest without the jit": [*PYTEST, results[2], "-m", "nojit", *marked],
            "pytest of the wheel": [BIN / "python", "tests/wheel.py", results[3], *OF_THE_WHEEL],
        }
        failed = []
        with ThreadPoolExecutor(1) as second:
            waiting = {name: second.submit(said, command) for name, command in beside.items()}
            most = [*PYTEST, *TWO, results[0], "--ignore-glob=*/test_live_*.py", *ignored]
            failed += [] if passes("pytest", most) else ["pytest"]
            for name, done in waiting.items():
                output, passed = done.result()
                print(f"\n== {name}\n{output}", flush=True)
                failed += [] if passed else [name]
        # these keep time: nothing else beside them
        failed += [] if passes("pytest of real processes", [*PYTEST, *TWO, results[1], *live]) else ["real processes"]
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
