"""Compiled kernels on disk: kept between processes and never stale; only what is this user's own, as kept, is run.

PHD_PLAIN_NUMBA=1: without our compiler numba makes the same numbers, so that it can be dropped.
"""

import contextlib
import io
import os
import pickle
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from core.kernels import cache, kernel
from core.kernels.cache import Place, make_private, read_file, source_hash, write_file
from core.kernels.compiler import identity

ROOT = Path(__file__).resolve().parents[2]
CALLEE = """from core.kernels import kernel
from core.number import NUMBER


@kernel
def inner(x):
    return {} * x + NUMBER
"""
CALLER = """from core.callee import inner
from core.kernels import kernel


@kernel
def outer(x):
    return inner(x)


@kernel
def beside(x):
    return 3.0 * inner(x)
"""
TOLD = """import sys
from core.kernels import cache
cache.tellers.append(lambda said: print(said, file=sys.stderr))
cache.watchers.append(lambda number, of, name: print(number, of, name))
from core.caller import beside, outer
"""
posix = pytest.mark.skipif(sys.platform == "win32", reason="owners, modes, pipes and limits of size are POSIX'")


class Planted:
    """What leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A tree with kernels in two files, and a constant in a third that holds no kernel."""
    core = tmp_path / "tree" / "core"
    core.mkdir(parents=True)
    shutil.copytree(ROOT / "core" / "kernels", core / "kernels")
    (core / "__init__.py").touch()
    (core / "caller.py").write_text(CALLER)
    (core / "callee.py").write_text(CALLEE.format("1.0"))
    (core / "number.py").write_text("NUMBER = 10.0\n")
    (core / "elsewhere.py").write_text("OTHER = 1\n")
    return core.parent


def run(tree: Path, code: str) -> tuple[str, str]:
    """What a new process prints on stdout, watched, and on stderr; it must end well."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tree / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-c", TOLD + code], cwd=tree, env=environment, capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_a_process_runs_what_another_compiled_but_nothing_stale_or_planted_and_a_watcher_is_told(
    tree: Path, tmp_path: Path
) -> None:
    whole = "print(cache.is_compiled('outer'), outer(1.0), cache.is_compiled('outer'))\n"
    first, said = run(tree, whole + "print(outer(True))")
    compiled = "1 2 outer\n2 2 inner\n2 2 linking\n2 2 \nFalse 11.0 True\n"
    assert first == compiled + "1 1 outer\n2 2 inner\n2 2 linking\n2 2 \n11.0\n" and not said
    planted = [file for file in (tree / "cache").rglob("*.kernel") if "outer" in file.name]
    assert planted
    for file in planted:
        file.write_bytes(pickle.dumps(Planted(tmp_path / "mark")))
    second, said = run(tree, "print(beside(1.0), outer(1.0))")
    assert "beside" in second and "outer" in second and second.endswith("33.0 11.0\n")
    assert "inner" not in second, "its part is there"
    assert not (tmp_path / "mark").exists(), "unpickled"
    assert said.count("\n") == 1 and "compiled again" in said and str(tree / "cache") in said
    (tree / "core" / "number.py").write_text("NUMBER = 20.0\n")
    assert run(tree, whole) == (compiled.replace("11.0", "21.0"), "")


def test_sources_are_other_ones_where_a_file_that_a_kernel_depends_on_is_another(tree: Path) -> None:
    before = source_hash(tree)
    (tree / "core" / "elsewhere.py").write_text("OTHER = 2\n")
    assert source_hash(tree) == before
    (tree / "core" / "callee.py").write_text(CALLEE.format("2.0"))
    with_callee = source_hash(tree)
    (tree / "core" / "number.py").write_text("NUMBER = 20.0\n")
    assert len({before, with_callee, source_hash(tree)}) == 3


def test_a_kernel_is_another_one_where_what_it_calls_or_a_number_that_it_names_is_another():
    def told_by(inner: str, number: float = 10.0) -> str:
        text = f"@kernel\ndef inner(x):\n    return {inner}\n\n@kernel\ndef outer(x):\n    return inner(x) + NUMBER\n"
        names: dict = {"kernel": kernel, "NUMBER": number, "__name__": "one"}
        exec(compile(text, __file__, "exec"), names)  # of one file, as two versions of another that it calls are
        return identity(names["outer"].function)

    known = told_by("2.0 * x")
    assert told_by("2.0 * x") == known
    assert len({known, told_by("3.0 * x"), told_by("2.0 + x"), told_by("2.0 * x", 20.0)}) == 4


@pytest.fixture(autouse=True)
def untold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "problems", cache.Counter())


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield tmp_path / "cache" / "phd" / "kernels"
    cache.cache_place.cache_clear()


def place() -> Place:
    """As a new process finds it."""
    cache.cache_place.cache_clear()
    return cache.cache_place()


@posix
def test_the_cache_is_a_folder_of_this_user_alone_whatever_it_was_and_whatever_is_above_it(home: Path) -> None:
    home.mkdir(parents=True)
    for folder in (home.parent.parent, home.parent, home):
        folder.chmod(0o777)
    found = place()
    assert found.folder is not None and found.folder.parent == home and not found.wrong
    assert [folder.stat().st_mode & 0o777 for folder in (found.folder, home, home.parent)] == [0o700] * 3
    write_file(found.folder / "core" / "one.kernel", b"code")
    assert (found.folder / "core").stat().st_mode & 0o777 == 0o700
    assert (found.folder / "core" / "one.kernel").stat().st_mode & 0o777 == 0o600


@posix
@pytest.mark.parametrize("level", [0, 1, 2], ids=["phd", "kernels", "the sources' own"])
@pytest.mark.parametrize("what", ["link", "dangling link", "file", "pipe"])
def test_what_is_not_this_users_own_folder_is_not_used_and_said(
    what: str, level: int, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted = [home.parent, home, home / source_hash()][level]
    planted.parent.mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    if "link" in what:
        planted.symlink_to(tmp_path / ("elsewhere" if what == "link" else "nowhere"))
    elif what == "file":
        planted.touch()
    else:
        os.mkfifo(planted)
    said: list[str] = []
    monkeypatch.setattr(cache, "tellers", [said.append])
    found = place()
    assert found.folder is None and str(planted) in found.wrong
    assert said == [f"compiled kernels are not kept, each process compiles its own: {found.wrong}"]
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.fixture
def kept(home: Path) -> Iterator[Path]:
    folder = place().folder
    assert folder is not None
    file = folder / "core" / "one.kernel"
    write_file(file, random.Random(1).randbytes(5000))
    assert read_file(file) == random.Random(1).randbytes(5000) and not cache.problems
    yield file


def test_no_file_is_read_that_is_not_as_it_was_kept(kept: Path) -> None:
    sound, chance = kept.read_bytes(), random.Random(2)
    pieces = [sound[: chance.randrange(len(sound))] for _ in range(40)]
    flipped = []
    for bit in [*range(8 * 50), *(chance.randrange(8 * len(sound)) for _ in range(100))]:
        flipped.append(bytearray(sound))
        flipped[-1][bit // 8] ^= 1 << bit % 8
    others = [b"", sound + b"\0", sound * 2, b"\0" * len(sound), pickle.dumps(1), sound[:13] + pickle.dumps(1)]
    for wrong in (*pieces, *flipped, *others):
        kept.write_bytes(wrong)
        assert read_file(kept) is None
    assert cache.problems["file"] == len(pieces) + len(flipped) + len(others)
    write_file(kept, b"again")
    assert read_file(kept) == b"again"


@posix
def test_no_file_is_read_that_others_may_have_made(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beside = kept.with_name("two.kernel")
    for mode, is_read in ((0o600, True), (0o644, True), (0o620, False), (0o602, False), (0o666, False)):
        kept.chmod(mode)
        assert (read_file(kept) is not None) == is_read
    kept.chmod(0o600)
    beside.write_bytes(kept.read_bytes())  # sound, but another kernel's
    assert read_file(beside) is None
    for make in (lambda: beside.symlink_to(kept), lambda: os.mkfifo(beside), beside.mkdir):
        beside.unlink()
        make()
        assert read_file(beside) is None
    monkeypatch.setattr(cache.os, "geteuid", lambda: os.getuid() + 1)
    assert read_file(kept) is None and make_private(kept.parent) != ""


@posix
def test_a_disk_that_takes_no_more_keeps_nothing_half_and_is_told_once(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource")
    said: list[str] = []
    monkeypatch.setattr(cache, "tellers", [said.append])
    limit, after = kept.with_name("two.kernel"), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, after[1]))
    try:
        for _ in range(3):
            write_file(limit, bytes(5000))
        no_room = cache.why_no_room(kept.parent)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, after)
    assert said == [f"compiled kernels cannot be kept, each command compiles them again: {kept.parent}: File too large"]
    assert cache.problems["room"] == 3 and no_room == f"{kept.parent}: File too large"
    assert [file.name for file in kept.parent.iterdir()] == ["one.kernel"]
    assert cache.why_no_room(kept.parent) == ""


#: Equations of motion and the exact solver of stick and slip, at random states: what every step is made of.
NUMBERS = """
import numpy as np
from core.device import load_device
from core.simulator.state import new_body, pack_mechanism
from core.simulator.stick_slip import Joints, solve_at_rest
from core.simulator.stick_slip_mode import update_kinematics

rng, mechanism = np.random.default_rng(1), pack_mechanism(load_device("four-brake").mechanism)[0]
body, sign = new_body(0.0, 0.4)[0], np.zeros(7)
for _ in range(2000):
    body.tip[:] = *rng.uniform((-0.1, 0.3), (0.1, 0.45)), *rng.normal(size=2)
    update_kinematics(mechanism, body)
    joints = Joints(body.g, np.ones(7, np.int64), *rng.uniform(0.0, 1.0, (2, 7)), 0)
    held, *acceleration = solve_at_rest(joints, tuple(body.mass), tuple(rng.normal(scale=8.0, size=2)), sign)
    print(held, *(float(x).hex() for x in (*body.rate, *body.bias, *body.bias_force, *acceleration)))
print(type(solve_at_rest.entry).__module__.split(".")[0])
"""


def test_plain_numba_makes_the_same_numbers_to_the_last_bit() -> None:
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(NUMBERS, {})
    done = subprocess.run(
        [sys.executable, "-c", NUMBERS],
        env={**os.environ, "PHD_PLAIN_NUMBA": "1"}, capture_output=True, text=True, timeout=850,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    ours, plain = said.getvalue().splitlines(), done.stdout.splitlines()
    assert (ours.pop(), plain.pop()) == ("core", "numba")
    assert ours == plain and len({line.split()[0] for line in ours}) > 1, "it sticks and slips"
