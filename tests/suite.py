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
#: The last to get a processor.
LAST = [] if sys.platform == "win32" else ["nice", "-n", "19"]


def main() -> int:
    """The exit code."""
    files = sorted(ROOT.glob("tests/*/test_*.py"))
    live = [str(file.relative_to(ROOT)) for file in files if file.stem.startswith("test_live_")]
    marked = [str(file.relative_to(ROOT)) for file in files if "mark.nojit" in file.read_text(encoding="utf-8")]
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        results = [f"--junitxml={folder}/{number}.xml" for number in (1, 2, 3)]
        run("ruff", [BIN / "ruff", "check", "."], failed)
        run("ruff format", [BIN / "ruff", "format", "--check", "."], failed)
        run("pytest", [*PYTEST, *TWO, results[0], "--ignore-glob=*/test_live_*.py"], failed)
        beside = {  # the tests of real processes, which wait most of their time
            "mypy": [BIN / "mypy"],
            "lint-imports": [BIN / "lint-imports", "--no-logo"],
            "pytest without the jit": [*PYTEST, *TWO, results[2], "-m", "nojit", *marked],
        }
        with ThreadPoolExecutor(1) as one_at_a_time:
            waiting = {name: one_at_a_time.submit(output, command) for name, command in beside.items()}
            run("pytest of real processes", [*PYTEST, *TWO, results[1], *live], failed)
            for name, done in waiting.items():
                print(f"\n== {name}\n{done.result().stdout}", flush=True)
                failed += [name] if done.result().returncode else []
        suites = [suite for file in Path(folder).glob("*.xml") for suite in tree.parse(file).iter("testsuite")]
    tests, skipped, errors, failures = (
        sum(int(suite.get(key, 0)) for suite in suites) for key in ("tests", "skipped", "errors", "failures")
    )
    wrong = errors + failures
    print(f"\nfailed: {', '.join(failed)}" if failed else "")
    print(f"{tests - skipped - wrong} passed, {wrong} failed")
    return 1 if failed else 0


def run(name: str, command: list, failed: list[str]) -> None:
    """Run a part; what it prints is seen at once."""
    print(f"\n== {name}", flush=True)
    if subprocess.call(command, cwd=ROOT) != 0:
        failed.append(name)


def output(command: list) -> subprocess.CompletedProcess:
    """Run a part in what the others leave of the processor; pytest without the jit."""
    environment = os.environ | ({"NUMBA_DISABLE_JIT": "1"} if "nojit" in command else {})
    return subprocess.run(
        [*LAST, *command], cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


if __name__ == "__main__":
    sys.exit(main())
