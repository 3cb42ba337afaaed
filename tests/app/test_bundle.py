"""A bundle holds what the program runs with, and its Python looks nowhere else."""

import os
import subprocess
import sys

import pytest

from app.cli import main
from app.verbs import bundle


def test_every_library_of_the_program_and_what_they_need_is_in_it_and_no_tool_of_developers() -> None:
    names = bundle.libraries()
    assert {"pyside6-essentials", "pyqtgraph", "numpy", "scipy", "numba", "hidapi", "pyserial"} <= set(names)
    assert {"llvmlite", "shiboken6", "pillow"} <= set(names)  # asked for by those
    assert not {"pytest", "ruff", "mypy", "hypothesis"} & set(names)


def test_a_library_is_copied_whole_and_without_what_no_run_opens(tmp_path) -> None:
    bundle.copy_library("pyserial", tmp_path)
    bundle.copy_library("msgspec", tmp_path)
    names = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
    assert {"serial/__init__.py", "serial/urlhandler/protocol_socket.py", "msgspec/__init__.py"} <= names
    assert any(name.endswith((".so", ".pyd")) for name in names)
    assert not [name for name in names if "__pycache__" in name or ".." in name or name.endswith(".pyi")]


def test_its_python_sees_only_its_folder_wherever_that_stands(tmp_path) -> None:
    made = tmp_path / "made"
    (made / "libraries").mkdir(parents=True)
    (made / "program").mkdir()
    (made / "program" / "ours.py").write_text("NUMBER = 4\n")
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "foreign.py").touch()
    bundle.copy_python(made / "python")
    moved = made.rename(tmp_path / "carried away")
    program = moved / "python" / ("python.exe" if os.name == "nt" else "bin/python3")
    code = "import sys, ssl, ctypes, ours; print(ours.NUMBER, *sys.path, sep='\\n')"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "foreign")}
    environment["LD_LIBRARY_PATH"] = str(os.path.join(sys.base_prefix, "lib"))  # where Python is a shared library
    done = subprocess.run([program, "-c", code], cwd=moved, env=environment, capture_output=True, text=True, timeout=99)
    assert done.returncode == 0, done.stderr
    number, *paths = done.stdout.splitlines()
    assert number == "4" and str(moved / "libraries") in paths
    assert not [path for path in paths if path and not path.startswith(str(moved))]


def test_a_folder_that_holds_something_or_lies_in_what_is_copied_is_refused_and_left_as_it_is(tmp_path, capsys) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["bundle", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]
    folder = bundle.ROOT / "docs" / "bundle"
    assert main(["bundle", str(folder)]) == 2
    assert "lies in docs" in capsys.readouterr().err and not folder.exists()


def test_where_pip_installed_the_program_a_bundle_is_refused_and_nothing_made(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(bundle, "ROOT", tmp_path / "site-packages")
    assert main(["bundle", str(tmp_path / "out")]) == 2
    assert "run ./phd bundle in the program's source folder" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("there", [False, True])
def test_a_bundle_that_fails_leaves_nothing_half_done(tmp_path, monkeypatch, there) -> None:
    def fail(folder) -> None:
        folder.mkdir()
        raise OSError(28, "No space left on device", str(folder))

    monkeypatch.setattr(bundle, "copy_python", fail)
    folder = tmp_path / "made"
    if there:
        folder.mkdir()
    assert main(["bundle", str(folder)]) == 1
    assert folder.exists() == there and not list(folder.glob("*"))
