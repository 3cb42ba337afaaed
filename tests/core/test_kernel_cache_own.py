"""What lies in the kernel cache is run: nothing is read that is not this user's own and as it was kept."""

import os
import pickle
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_kernel_cache import small_tree

from core.kernels import cache
from core.kernels.cache import Place, make_private, read_file, write_file

CALL = (
    "import sys\nfrom core.kernels import cache\n"
    "cache.tellers.append(lambda said: print(said, file=sys.stderr))\n"
    "cache.watchers.append(lambda number, of, name: print('compiles', name))\n"
    "from core.caller import outer\nprint(outer(1.0))\n"
)
COMPILED = "compiles outer\ncompiles inner\ncompiles linking\ncompiles \n11.0\n"


posix = pytest.mark.skipif(sys.platform == "win32", reason="owners, modes, pipes and limits of size are POSIX'")


class Planted:
    """What leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple:
        return os.mkdir, (str(self.mark),)


@pytest.fixture(autouse=True)
def untold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "problems", cache.Counter())


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "source_hash", lambda: "0123456789abcdef")
    yield tmp_path / "cache" / "phd" / "kernels"
    cache.cache_place.cache_clear()


def place() -> Place:
    """As a new process finds it."""
    cache.cache_place.cache_clear()
    return cache.cache_place()


def run(tree: Path, code: str = CALL, **more: str) -> tuple[str, str]:
    """What a new process prints on stdout and stderr; it must end well."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tree / "cache"), "PYTHONDONTWRITEBYTECODE": "1", **more}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run([sys.executable, "-c", code], cwd=tree, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


# ------------------------------------------------------------------------------------------------------------- folders


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
@pytest.mark.parametrize("what", ["another user's", "link", "dangling link", "file", "pipe"])
def test_what_is_not_this_users_own_folder_is_not_used_and_said(
    what: str, level: int, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted = [home.parent, home, home / cache.source_hash()][level]
    planted.parent.mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    if what == "another user's":
        planted.mkdir()
        own, mine = os.fstat, planted.stat().st_ino

        def fstat(opened: int) -> os.stat_result:
            about = own(opened)
            if about.st_ino != mine:
                return about
            return os.stat_result((*about[:4], about.st_uid + 1, *about[5:]))

        monkeypatch.setattr(cache.os, "fstat", fstat)
    elif "link" in what:
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


# --------------------------------------------------------------------------------------------------------------- files


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


# ------------------------------------------------------------------------------------------------- with real kernels


def test_what_was_planted_is_compiled_again_and_never_unpickled(tmp_path: Path) -> None:
    tree = small_tree(tmp_path / "tree")
    assert run(tree) == (COMPILED, "")
    files = sorted((tree / "cache").rglob("*.kernel"))
    assert len(files) == 3  # an entry and two parts
    for file in files:
        file.write_bytes(pickle.dumps(Planted(tmp_path / "mark")))
    answer, said = run(tree)
    assert answer == COMPILED and not (tmp_path / "mark").exists()
    assert said.count("\n") == 1 and "compiled again" in said and str(tree / "cache") in said
