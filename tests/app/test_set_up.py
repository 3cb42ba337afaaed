"""phd.cmd and what it runs: set up once, redone when killed or outdated, every argument handed on.

The set-up runs here in a small tree; venv, pip and the compiler of kernels are stand-ins that write down their call.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[2]
windows = pytest.mark.skipif(sys.platform != "win32", reason="only Windows runs .cmd files")


class Tree:
    """A tree with the set-up in it. `run` is what phd.cmd does with its arguments."""

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root, self.calls, self.codes = root, [], {}
        self._home = root.with_name("python")
        self._home.mkdir()
        (root / "app").mkdir(parents=True)
        shutil.copy(ROOT / "app" / "set_up.py", root / "app")
        for name in ("pyproject.toml", "constraints.txt"):
            shutil.copy(ROOT / name, root)
        self._patch = monkeypatch
        monkeypatch.setattr(subprocess, "call", self._call)
        monkeypatch.setitem(
            sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=lambda *_: self.calls.append("lock"))
        )

    def load(self) -> ModuleType:
        spec = importlib.util.spec_from_file_location("set_up", self.root / "app" / "set_up.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def _call(self, command: list, **_: object) -> int:
        words = [str(word) for word in command]
        what = next(
            word for word in ("venv", "pip", "app.compile_kernels", "pytest", "tests/suite.py") if word in words
        )
        self.calls.append(what)
        self.last = words
        if what == "venv":
            python = self.load().PYTHON
            python.parent.mkdir(parents=True)
            python.touch()
            (self.root / ".venv" / "pyvenv.cfg").write_text(f"home = {self._home}\nversion = 3.11.3\n")
        code = self.codes.get(what, 0)
        if code is KeyboardInterrupt:
            raise KeyboardInterrupt
        return code

    def as_system(self, *arguments: str) -> int:
        """What the system's Python does."""
        self._patch.setattr(sys, "argv", ["set_up.py", *arguments])
        self._patch.setattr(sys, "prefix", str(self._home))
        return self.load().main()

    def as_venv(self, *arguments: str) -> int:
        """What the .venv's Python does."""
        self._patch.setattr(sys, "argv", ["set_up.py", *arguments])
        self._patch.setattr(sys, "prefix", str(self.root / ".venv"))
        self._patch.setattr(sys, "path", list(sys.path))
        self._patch.setattr("app.cli.main", lambda: 7)
        return self.load().main()

    def made(self) -> list[str]:
        """The calls since the last time, but for the lock."""
        made, self.calls = [call for call in self.calls if call != "lock"], []
        return made


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Tree:
    return Tree(tmp_path / "a tree", monkeypatch)


def test_first_use_sets_up_and_the_next_becomes_the_command(tree: Tree) -> None:
    assert tree.as_system("study", "two words") == 0
    assert tree.made() == ["venv", "pip", "app.compile_kernels"]
    assert tree.as_venv("study", "two words") == 7
    assert tree.made() == []


@pytest.mark.parametrize("name", ["constraints.txt", "pyproject.toml"])
def test_changed_pins_bring_the_environment_up_to_date(tree: Tree, name: str, capsys) -> None:
    tree.as_system("devices")
    (tree.root / name).write_text("# changed\n")
    tree.made()
    assert tree.as_venv("devices") == 75  # the system's Python is asked for
    assert tree.as_system("devices") == 0 and tree.made() == ["pip", "app.compile_kernels"]
    assert "bringing .venv up to date" in capsys.readouterr().err
    assert tree.as_venv("devices") == 7


@pytest.mark.parametrize("update", [False, True])
def test_a_killed_set_up_or_update_is_redone_from_the_start(tree: Tree, update: bool) -> None:
    if update:
        tree.as_system("devices")
        (tree.root / "constraints.txt").write_text("numpy==0.1\n")
    tree.codes["pip"] = KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        tree.as_system("devices")
    assert tree.as_venv("devices") == 75
    tree.codes.clear()
    tree.made()
    (tree.root / ".venv" / "half").touch()
    assert tree.as_system("devices") == 0 and tree.made()[0] == "venv"
    assert not (tree.root / ".venv" / "half").exists()


@pytest.mark.parametrize("update", [False, True])
def test_a_failed_set_up_is_redone_and_a_failed_update_keeps_the_environment(tree: Tree, update: bool, capsys) -> None:
    if update:
        tree.as_system("devices")
        (tree.root / "constraints.txt").write_text("numpy==0.1\n")
    tree.codes["pip"] = 1
    with pytest.raises(SystemExit) as ended:
        tree.as_system("devices")
    assert ended.value.code == 1 and "pip could not install" in capsys.readouterr().err
    tree.codes.clear()
    tree.made()
    assert tree.as_system("devices") == 0
    assert tree.made()[:1] == (["pip"] if update else ["venv"])


def test_a_moved_tree_or_another_python_is_set_up_anew(tree: Tree) -> None:
    tree.as_system("devices")
    tree.root = tree.root.rename(tree.root.with_name("moved"))
    tree.made()
    assert tree.as_venv("devices") == 75 and tree.as_system("devices") == 0 and tree.made()[0] == "venv"
    (tree.root / ".venv" / "pyvenv.cfg").write_text(f"home = {tree.root / 'gone'}\n")
    assert tree.as_venv("devices") == 75 and tree.as_system("devices") == 0 and tree.made()[0] == "venv"


def test_kernels_that_cannot_be_compiled_do_not_fail_the_set_up(tree: Tree, capsys) -> None:
    tree.codes["app.compile_kernels"] = 1
    assert tree.as_system("devices") == 0 and "could not be compiled now" in capsys.readouterr().err
    assert tree.as_venv("devices") == 7


def test_the_tests_have_an_extra_and_a_stamp_of_their_own(tree: Tree) -> None:
    tree.as_system("devices")
    assert tree.as_venv("test") == 75 and tree.as_system("test", "x") == 0
    assert tree.as_venv("test", "tests/test_x.py", "-k", "a b") == 0
    assert tree.last[1:] == ["-m", "pytest", "tests/test_x.py", "-k", "a b"]
    assert tree.as_venv("test") == 0 and tree.last[1:] == ["tests/suite.py"]
    assert tree.as_venv("devices") == 7


def test_both_launchers_ask_for_the_same() -> None:
    shell, batch = (ROOT / "phd").read_text("utf-8"), (ROOT / "phd.cmd").read_text("utf-8")
    set_up = (ROOT / "app" / "set_up.py").read_text("utf-8")
    bounds = "(3, 11) <= sys.version_info < (3, 14)"
    assert bounds in shell and bounds in batch
    assert tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["requires-python"] == ">=3.11,<3.14"
    versions = {"3.11", "3.12", "3.13"}
    assert set(re.findall(r"python(3\.\d+)", shell)) == set(re.findall(r'"py -(3\.\d+)"', batch)) == versions
    for text in (shell, set_up):
        for asked in (
            "--quiet --disable-pip-version-check --progress-bar off", "-c constraints.txt", "[test]", "stamp-", ".venv",
            "app.compile_kernels", "pyproject.toml", "constraints.txt", "tests/suite.py",
        ):  # fmt: skip
            assert asked in text
    assert "NOT_READY = 75" in set_up and '"%errorlevel%"=="75"' in batch


@windows
def test_without_python_the_launcher_says_what_to_type(tmp_path: Path) -> None:
    done = launched(tmp_path, {}, "devices")
    assert done.returncode == 2 and "winget install Python.Python.3.13" in done.stderr


@windows
def test_the_launcher_finds_python_by_py_and_hands_arguments_and_exit_codes_on(tmp_path: Path) -> None:
    lines = [
        "@echo off",
        'if not "%1"=="-3.12" exit /b 1',
        f'"{sys.executable}" %2 %3 %4 %5 %6',
        "exit /b %errorlevel%",
    ]
    py = "\r\n".join([*lines, ""])
    done = launched(tmp_path, {"py.cmd": py}, "study", "two words", "--seed")
    assert done.stdout.split("\n")[0].strip() == "study|two words|--seed" and done.returncode == 5, done.stderr


def launched(tmp_path: Path, programs: dict[str, str], *arguments: str) -> subprocess.CompletedProcess:
    """phd.cmd in a tree in which the set-up only prints its arguments, with these programs to be found."""
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "set_up.py").write_text("import sys\nprint('|'.join(sys.argv[1:]))\nsys.exit(5)\n")
    shutil.copy(ROOT / "phd.cmd", tmp_path)
    for name, text in programs.items():
        (tmp_path / name).write_bytes(text.encode())
    system = Path(os.environ["SystemRoot"]) / "system32"
    return subprocess.run(
        [system / "cmd.exe", "/c", tmp_path / "phd.cmd", *arguments],
        env={**os.environ, "PATH": f"{tmp_path};{system}"}, capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
