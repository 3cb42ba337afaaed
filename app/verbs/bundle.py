"""`phd bundle`: a folder with the program, its Python and its libraries, started with a double click.

Everything is copied from what this phd runs with, so the bundle holds what was tested. Nothing in it knows where it
stands: `sitecustomize.py`, which its Python reads first, puts the folders beside it on the path of every process.
"""

import argparse
import contextlib
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from app.progress import ProgressBar
from app.verbs.common import add_verb
from core.files import InputError
from experiments.progress import Progress
from experiments.recording.atomic_files import new_folders

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ("app", "core", "hardware", "experiments", "docs", "pyproject.toml", "README.md", "CHANGELOG.md")
#: Parts of libraries and of Python that no run of the program opens.
LEFT_OUT = frozenset(
    "__pycache__ tests test idlelib turtledemo ensurepip lib2to3 tkinter site-packages dist-packages include qml"
    " typesystems glue doc metatypes".split()
)
#: What every Linux has, and what must be its own: the C library and the loader.
GLIBC = re.compile(r"(ld-linux|lib(c|m|dl|rt|pthread|util|resolv|nsl|anl|mvec)\.so)")

SITECUSTOMIZE = '''\
"""Only what is in this folder: no other Python of this computer, no library of the user."""

import os
import sys

_here = os.path.dirname(os.path.abspath(__file__))
while not os.path.isdir(os.path.join(_here, "libraries")):
    _here = os.path.dirname(_here)
sys.path[:] = [path for path in sys.path if not path or os.path.abspath(path).startswith(_here)]
sys.path += [os.path.join(_here, "program"), os.path.join(_here, "libraries")]
'''


def add(verbs: argparse._SubParsersAction) -> None:
    verb = add_verb(
        verbs, "bundle", bundle_verb, "put the program, its Python and its libraries into a folder to carry away\n"
        "For computers of this system that have no Python and no network: copy the folder, double-click phd in it.\n"
        "On Linux it runs where the C library is at least as new as here. The first start compiles for the computer.",
        "phd bundle phd-bundle",
    )  # fmt: skip
    verb.add_argument("folder", type=Path, metavar="DIR", help="a new or empty folder")


def bundle_verb(args: argparse.Namespace) -> None:
    if missing := [name for name in PROGRAM if not (ROOT / name).exists()]:
        raise InputError(
            f"{ROOT}: has no {missing[0]}, as where pip installs; run ./phd bundle in the program's source folder"
        )
    place = args.folder.resolve()
    inside = [name for name in PROGRAM if ROOT / name in place.parents]
    if inside:
        raise InputError(f"{args.folder}: lies in {inside[0]}, which goes into the bundle; name a folder elsewhere")
    with contextlib.closing(ProgressBar("copying")) as bar, new_folders([args.folder], "a bundle") as (folder,):
        bundle(folder, bar)
    size = sum(file.stat().st_size for file in place.rglob("*") if file.is_file())
    print(f"{args.folder}: {size / 1e6:.0f} MB; start phd in it")


def bundle(folder: Path, progress: Progress) -> None:
    """Copy program, Python and libraries into a folder."""
    (folder / "program").mkdir(parents=True)
    for name in PROGRAM:
        source = ROOT / name
        (copy_tree if source.is_dir() else shutil.copy2)(source, folder / "program" / name)
    copy_python(folder / "python")
    names = libraries()
    for number, name in enumerate(names):
        copy_library(name, folder / "libraries")
        progress((number + 1) / len(names))
    if os.name == "nt":
        start = Path(__file__).with_name("bundle_phd.cmd").read_text(encoding="utf-8")
        (folder / "phd.cmd").write_text(start, encoding="utf-8", newline="\r\n")
        return
    shutil.copy2(Path(__file__).with_name("bundle_phd.sh"), folder / "phd")
    (folder / "phd").chmod(0o755)
    copy_system_libraries(folder)


def copy_tree(source: Path, target: Path) -> None:
    """Copy a folder without `LEFT_OUT`."""
    shutil.copytree(source, target, ignore=lambda _, names: LEFT_OUT.intersection(names), dirs_exist_ok=True)


def copy_python(folder: Path) -> None:
    """Copy the Python below the .venv: its program and its standard library."""
    program = Path(sys._base_executable).resolve()  # type: ignore[attr-defined]
    library = Path(sysconfig.get_path("stdlib"))
    if os.name == "nt":
        target = folder / library.name
        folder.mkdir(parents=True)
        for file in program.parent.glob("*"):
            if file.suffix in (".exe", ".dll"):
                shutil.copy2(file, folder)
        if (program.parent / "DLLs").is_dir():
            copy_tree(program.parent / "DLLs", folder / "DLLs")
    else:
        target = folder / "lib" / library.name
        (folder / "bin").mkdir(parents=True)
        shutil.copy2(program, folder / "bin" / "python3")
    copy_tree(library, target)
    (target / "sitecustomize.py").write_text(SITECUSTOMIZE, encoding="utf-8")


def libraries() -> list[str]:
    """Names of the installed distributions that the program needs, directly or not."""
    from packaging.requirements import Requirement

    from app.doctor import wanted_libraries

    found: dict[str, None] = {}
    waiting = wanted_libraries()
    while waiting:
        need = waiting.pop(0)
        name = need.name.lower().replace("_", "-")
        if name not in found and (not need.marker or need.marker.evaluate({"extra": ""})):
            found[name] = None
            waiting += map(Requirement, importlib.metadata.requires(name) or [])
    return list(found)


def copy_library(name: str, folder: Path) -> None:
    """Copy an installed distribution without what lies outside its folder."""
    distribution = importlib.metadata.distribution(name)
    for file in distribution.files or ():
        if ".." in file.parts or LEFT_OUT.intersection(file.parts) or file.suffix in (".pyc", ".pyi"):
            continue
        target = folder / file
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(str(distribution.locate_file(file)), target)


def copy_system_libraries(folder: Path) -> None:
    """Copy what Python and Qt load from this system into folder/system, for systems that lack some of it."""
    (folder / "system").mkdir()
    programs = [folder / "python" / "bin" / "python3", *folder.glob("python/lib/*/lib-dynload/*.so")]
    programs += [*folder.glob("libraries/PySide6/*.so"), *folder.glob("libraries/PySide6/Qt/plugins/platforms/*.so")]
    listed = subprocess.run(["ldd", *map(str, programs)], capture_output=True, text=True, check=True).stdout
    for place in sorted(set(re.findall(r"=> (/\S+)", listed))):
        library = Path(place)
        if folder.resolve() not in library.resolve().parents and not GLIBC.match(library.name):
            shutil.copy2(library, folder / "system" / library.name)
