"""The launchers `phd` and `phd.cmd`: set up once, redone when killed or outdated, nothing of their own on stdout.

They run here in a small tree. In place of venv and pip are modules that write their call into a log; programs of the
system are stand-ins on a PATH of their own.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from app import set_up

ROOT = Path(__file__).resolve().parents[2]
WINDOWS = sys.platform == "win32"
linux = pytest.mark.skipif(sys.platform != "linux", reason="of Debian")
shell = pytest.mark.skipif(WINDOWS, reason="its tools are shell scripts here, its kills are signals")

# Modules that `python -m` finds before its own, and those of the tree.
LOG = "import os, sys, time\nlog = open(os.environ['LOG'], 'a')\n"
VENV = """
print("venv", file=log)
sys.path.remove(os.environ["PYTHONPATH"])
import venv
venv.create(sys.argv[1], with_pip=False, symlinks=os.name == "posix")
"""
PIP = """
print("pip", *sys.argv[1:], file=log, flush=True)
print("pip talks")
left = 20_000  # an abandoned one ends by itself
while (gate := os.environ.get("PIP_WAITS_FOR")) and not os.path.exists(gate) and left:
    time.sleep(0.01)
    left -= 1
sys.exit(bool(os.environ.get("PIP_FAILS")))
"""
COMPILE = """
print("compile", *sys.argv[1:], file=log, flush=True)
time.sleep(float(os.environ.get("COMPILING_S", 0)))
sys.exit(bool(os.environ.get("COMPILING_FAILS")))
"""
COMMAND = """
import sys
def main():
    print("phd was given:", *sys.argv[1:], *["and compiles all anew"] * sys.dont_write_bytecode)
    return 7 if "fails" in sys.argv else 0
"""
LOGGING = '#!/bin/sh\necho "${0##*/} $*" >>"$LOG"\n'


class Tree:
    """A tree with the launcher in it, and what it finds on its PATH."""

    def __init__(self, folder: Path) -> None:
        self.root, self.path, self.modules = folder / "a tree", folder / "path", folder / "modules"
        self.log = folder / "log"
        self.log.touch()
        for one in (self.path, self.modules, self.root / "app"):
            one.mkdir(parents=True)
        for name in ("phd", "phd.cmd", "app/set_up.py", "pyproject.toml", "constraints.txt"):
            shutil.copy(ROOT / name, self.root / name)
        for name, code in {"venv": VENV, "pip": PIP}.items():
            (self.modules / f"{name}.py").write_text(LOG + code)
        (self.root / "app/cli.py").write_text(COMMAND)
        (self.root / "app/compile_kernels.py").write_text(LOG + COMPILE)
        self.environment = {**os.environ, "PATH": str(self.path), "LOG": str(self.log)}
        self.environment |= {"PYTHONPATH": str(self.modules), "PYTHONDONTWRITEBYTECODE": "1"}
        self.environment.pop("NUMBA_DISABLE_JIT", None)
        if WINDOWS:
            (self.path / "py.cmd").write_text(f'@"{sys.executable}" %2 %3 %4 %5 %6 %7\n')
            self.environment["PATH"] += f";{os.environ['SystemRoot']}/system32"
            return
        for tool in ("sh", "readlink", "env"):
            found = shutil.which(tool)
            assert found, f"{tool} is needed by the launcher and not on this system"
            (self.path / tool).symlink_to(found)
        self.stand_in("python3", f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
        for name in ("apt-get", "Xvfb", "xdotool", "cc"):
            self.stand_in(name, LOGGING)

    def stand_in(self, name: str, script: str) -> None:
        (self.path / name).write_text(script)
        (self.path / name).chmod(0o755)

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen:
        command: list[str] | str = [str(self.root / ("phd.cmd" if WINDOWS else "phd")), *arguments]
        if WINDOWS:  # its shell takes the first and the last of more than two quotes away
            command = f'cmd.exe /s /c "{subprocess.list2cmdline(command)}"'
        return subprocess.Popen(
            command, env=self.environment | environment, text=True, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def run(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess:
        process = self.start(*arguments, **environment)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(arguments, process.returncode, out, err)

    def calls(self, start: str) -> list[str]:
        return [line for line in self.log.read_text().splitlines() if line.startswith(start)]

    def wait_for_pip(self) -> None:
        deadline = time.perf_counter() + 120
        while not self.calls("pip"):
            assert time.perf_counter() < deadline, "pip was never called"
            time.sleep(0.01)


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path)


def change_pins(tree: Tree, name: str = "constraints.txt") -> None:
    (tree.root / name).write_text((tree.root / name).read_text() + "# changed\n")


def test_the_environment_is_set_up_once_updated_with_its_pins_and_made_anew_for_a_moved_tree(tree: Tree) -> None:
    done = tree.run("study", "two words", "--seed", "1")
    assert (done.returncode, done.stdout) == (0, "phd was given: study two words --seed 1\n"), done.stderr
    assert "first use" in done.stderr and "pip talks" in done.stderr
    first, second = tree.calls("pip")
    assert all("-c constraints.txt" in call for call in (first, second))
    assert " numba " in first and "-e ." not in first and second.endswith("-e .")
    assert tree.calls("compile") == ["compile --no-window"]
    before = tree.log.read_text()
    again = tree.run("doctor", "fails")
    assert (again.returncode, again.stdout, again.stderr) == (7, "phd was given: doctor fails\n", "")
    assert tree.log.read_text() == before
    for number, name in enumerate(("constraints.txt", "pyproject.toml"), start=2):
        change_pins(tree, name)
        done = tree.run("doctor")
        assert done.returncode == 0 and "bringing .venv up to date" in done.stderr
        assert (len(tree.calls("pip")), len(tree.calls("venv"))) == (2 * number, 1)
    tree.root = tree.root.rename(tree.root.with_name("moved"))
    assert tree.run("doctor").returncode == 0 and len(tree.calls("venv")) == 2
    settings = tree.root / ".venv/pyvenv.cfg"
    settings.write_text(re.sub("home = .*", lambda _: f"home = {tree.path}", settings.read_text()))
    assert tree.run("doctor").returncode == 0 and len(tree.calls("venv")) == 3


def test_the_set_up_stands_where_the_kernels_cannot_be_compiled_and_a_window_does_not_wait_for_them(tree: Tree) -> None:
    done = tree.run("doctor", COMPILING_FAILS="yes")
    assert done.returncode == 0 and "could not be compiled now" in done.stderr
    assert tree.run("doctor").stderr == ""
    shutil.rmtree(tree.root / ".venv")
    begun = time.perf_counter()
    done = tree.run("run", COMPILING_S="100")
    assert (done.returncode, done.stdout) == (0, "phd was given: run\n"), done.stderr
    assert time.perf_counter() - begun < 100 and "could not be compiled" not in done.stderr


@shell
def test_a_killed_set_up_or_update_is_redone_from_the_start(tree: Tree, tmp_path: Path) -> None:
    for _ in ("set-up", "update"):
        tree.log.write_text("")
        process = tree.start("doctor", PIP_WAITS_FOR=str(tmp_path / "never"))
        tree.wait_for_pip()
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        (tree.root / ".venv/half").touch()
        tree.log.write_text("")
        assert tree.run("doctor").stdout == "phd was given: doctor\n"
        assert len(tree.calls("venv")) == 1 and not (tree.root / ".venv/half").exists()
        change_pins(tree)


def test_a_failed_set_up_is_redone_and_a_failed_update_keeps_the_environment(tree: Tree) -> None:
    for made in (2, 2):  # environments so far
        failed = tree.run("doctor", PIP_FAILS="1")
        assert (failed.returncode, failed.stdout) == (1, "") and "pip could not install" in failed.stderr
        assert tree.run("doctor").returncode == 0
        assert len(tree.calls("venv")) == made
        change_pins(tree)


def test_two_first_uses_at_once_set_up_once_and_both_succeed(tree: Tree, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    first = tree.start("doctor", PIP_WAITS_FOR=str(gate))
    tree.wait_for_pip()
    second = tree.start("doctor")
    assert second.stderr is not None and "waiting" in second.stderr.readline()
    gate.touch()
    assert first.communicate(timeout=120)[0] == "phd was given: doctor\n"
    assert second.communicate(timeout=120)[0] == "phd was given: doctor\n"
    assert (len(tree.calls("venv")), len(tree.calls("pip"))) == (1, 2)


def test_without_python_the_launcher_says_what_to_type(tree: Tree) -> None:
    for name in ("python3", "py.cmd"):
        (tree.path / name).unlink(missing_ok=True)
    done = tree.run("doctor")
    assert (done.returncode, done.stdout) == (2, "")
    what = "winget install Python.Python.3.13" if WINDOWS else "apt-get install -y --no-install-recommends python3"
    assert what in done.stderr


def test_both_launchers_take_the_same_pythons() -> None:
    unix, windows = (ROOT / "phd").read_text("utf-8"), (ROOT / "phd.cmd").read_text("utf-8")
    assert tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["requires-python"] == ">=3.11,<3.14"
    assert all("(3, 11) <= sys.version_info < (3, 14)" in text for text in (unix, windows))
    versions = {"3.11", "3.12", "3.13"}
    assert set(re.findall(r"python(3\.\d+)", unix)) == set(re.findall(r'"py -(3\.\d+)"', windows)) == versions
    assert f'"%errorlevel%"=="{set_up.NOT_READY}"' in windows


class Debian:
    """What the set-up finds of the system, and what it runs there."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.user, self.libraries, self.code = 0, True, 0
        self.programs, self.ran = {"apt-get"}, []
        monkeypatch.setattr(os, "geteuid", lambda: self.user)
        monkeypatch.setattr(set_up, "is_installed", lambda library: self.libraries)
        monkeypatch.setattr(shutil, "which", lambda program: program if program in self.programs else None)
        monkeypatch.setattr(subprocess, "run", self.run)

    def run(self, command: list[str], **_: object) -> subprocess.CompletedProcess:
        self.ran.append(" ".join(command))
        return subprocess.CompletedProcess(command, self.code, "E: no network")


@pytest.fixture
def debian(monkeypatch: pytest.MonkeyPatch) -> Debian:
    return Debian(monkeypatch)


@linux
def test_libraries_of_qt_are_installed_for_root_and_others_get_the_command_to_type(debian: Debian, capsys) -> None:
    set_up.install_qt_libraries()
    assert debian.ran == []
    debian.libraries = False
    set_up.install_qt_libraries()
    assert debian.ran[-1].endswith("libxcb-shape0") and "install -y --no-install-recommends libegl1" in debian.ran[-1]
    debian.user = 1000
    with pytest.raises(SystemExit, match="2"):
        set_up.install_qt_libraries()
    assert "Type: sudo apt-get update && sudo apt-get install" in capsys.readouterr().err
    debian.programs.clear()
    with pytest.raises(SystemExit, match="2"):
        set_up.install_qt_libraries()
    assert "there is no apt-get. The Debian packages are: libegl1" in capsys.readouterr().err
    assert len(debian.ran) == 2


def test_a_verb_with_a_window_needs_the_libraries_and_no_other() -> None:
    for words in ("", "run", "run --device d.toml", "--device d.toml", "replay a", "test x"):
        assert set_up.opens_window(words.split()), words
    for words in ("study --out d", "replay a --out b", "replay a --json", "run --print-plan", "run --help", "--help"):
        assert not set_up.opens_window(words.split()), words


def pins() -> dict[str, str]:
    """Package -> version of constraints.txt, by canonical name."""
    text = (ROOT / "constraints.txt").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    found = [re.fullmatch(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.+]+)", line) for line in lines]
    assert all(found), f"not a plain pin: {[line for line, match in zip(lines, found, strict=True) if not match]}"
    return {canonicalize_name(match[1]): match[2] for match in found if match}


def test_the_pins_are_plain_names_and_versions_and_name_no_address() -> None:
    assert len(pins()) > 20
    address = re.compile(r"https?:|--(extra-)?index-url|find-links|--hash|trusted-host")
    for name in ("constraints.txt", "pyproject.toml", "phd", "phd.cmd", "app/set_up.py", ".ci/run"):
        assert not address.search((ROOT / name).read_text()), name


def test_everything_the_project_needs_is_pinned_and_installed_as_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    declared = project["project"]["dependencies"] + project["project"]["optional-dependencies"]["test"]
    declared += project["project"]["optional-dependencies"]["docs"]
    waiting, seen = [Requirement(text) for text in declared], set()
    while waiting:
        need = waiting.pop()
        name = canonicalize_name(need.name)
        if name in seen or (need.marker and not need.marker.evaluate({"extra": ""})):
            continue
        seen.add(name)
        assert name in pins(), f"{name} is not pinned"
        assert need.specifier.contains(pins()[name]), f"{need} is pinned to {pins()[name]}"
        assert metadata.version(name) == pins()[name]
        waiting += [Requirement(text) for text in metadata.requires(name) or []]
    assert len(seen) > 30
    extras = project["project"]["optional-dependencies"]
    for text in project["build-system"]["requires"] + extras["bench"] + extras["cluster"]:
        need = Requirement(text)
        assert need.specifier == f"=={pins()[canonicalize_name(need.name)]}"
    assert pins()["pyside6-essentials"] in ("6.8.3", "6.9.3"), "the two versions that keep their references"
