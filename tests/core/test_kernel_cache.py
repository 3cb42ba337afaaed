"""Compiled kernels on disk: kept between processes, and never stale when anything they depend on changes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from core.kernels import kernel
from core.kernels.cache import source_hash
from core.kernels.compiler import identity

ROOT = Path(__file__).resolve().parents[2]
CALLEE = (
    "from core.kernels import kernel\nfrom core.number import NUMBER\n\n\n"
    "@kernel\ndef inner(x):\n    return {} * x + NUMBER\n"
)
CALLER = (
    "from core.callee import inner\nfrom core.kernels import kernel\n\n\n@kernel\ndef outer(x):\n    return inner(x)\n"
)


def small_tree(folder: Path) -> Path:
    """A tree with two kernels in two files, and a constant in a third that holds no kernel."""
    core = folder / "core"
    core.mkdir(parents=True)
    shutil.copytree(ROOT / "core" / "kernels", core / "kernels")
    (core / "__init__.py").touch()
    (core / "caller.py").write_text(CALLER)
    (core / "callee.py").write_text(CALLEE.format("1.0"))
    (core / "number.py").write_text("NUMBER = 10.0\n")
    (core / "elsewhere.py").write_text("OTHER = 1\n")
    return folder


def answer(tree: Path) -> str:
    """In a new process: whether the caller's kernel is compiled, its value at 1.0, and whether it is now."""
    code = (
        "from core.kernels.cache import is_compiled\nbefore = is_compiled('outer')\n"
        "from core.caller import outer\nprint(before, outer(1.0), is_compiled('outer'))"
    )
    return run(tree, code).strip()


def run(tree: Path, code: str) -> str:
    """What a new process prints."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tree / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tree, env=environment, capture_output=True, text=True, timeout=200, check=True
    )
    return done.stdout


def test_a_changed_kernel_file_or_constant_never_serves_stale_code(tmp_path):
    tree = small_tree(tmp_path)
    assert answer(tree) == "False 11.0 True"
    before = source_hash(tree)
    (tree / "core" / "elsewhere.py").write_text("OTHER = 2\n")
    assert source_hash(tree) == before  # nothing that a kernel depends on
    (tree / "core" / "callee.py").write_text(CALLEE.format("2.0"))
    assert source_hash(tree) != before
    before = source_hash(tree)
    (tree / "core" / "number.py").write_text("NUMBER = 20.0\n")
    assert source_hash(tree) != before
    assert answer(tree) == "False 22.0 True"


def test_a_process_finds_the_parts_that_another_compiled_and_a_watcher_is_told_which_of_how_many_are_left(tmp_path):
    tree = small_tree(tmp_path)
    (tree / "core" / "caller.py").write_text(CALLER + "\n\n@kernel\ndef beside(x):\n    return 3.0 * inner(x)\n")
    watching = (
        "from core.kernels import cache\ncache.watchers.append(lambda number, of, name: print(number, of, name))\n"
    )
    outer = run(tree, watching + "from core.caller import outer\nprint(outer(1.0))\nprint(outer(True))")
    first, other_types = outer[: outer.index("11.0")], outer[outer.index("11.0") :]
    assert first == "1 2 outer\n2 2 inner\n2 2 linking\n2 2 \n"
    assert other_types == "11.0\n1 1 outer\n2 2 inner\n2 2 linking\n2 2 \n11.0\n"
    beside = run(tree, watching + "from core.caller import beside\nprint(beside(1.0))")
    assert beside.splitlines()[0].endswith("beside") and "inner" not in beside and beside.endswith("\n33.0\n")


def test_a_kernel_is_another_one_where_what_it_calls_or_a_number_that_it_names_is_another():
    def told_by(inner: str, number: float = 10.0) -> str:
        text = f"@kernel\ndef inner(x):\n    return {inner}\n\n@kernel\ndef outer(x):\n    return inner(x) + NUMBER\n"
        names: dict = {"kernel": kernel, "NUMBER": number, "__name__": "one"}
        exec(compile(text, __file__, "exec"), names)  # of one file, as two versions of another that it calls are
        return identity(names["outer"].function)

    known = told_by("2.0 * x")
    assert told_by("2.0 * x") == known
    assert len({known, told_by("3.0 * x"), told_by("2.0 + x"), told_by("2.0 * x", 20.0)}) == 4
