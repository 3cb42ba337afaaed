"""The launcher `phd`: set up once, redone when killed or outdated, nothing of its own on stdout.

It runs here in a small tree with stand-ins for python3, pip, apt-get and the rest on a PATH of their own; each
stand-in writes its call into a log.
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

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a shell script; on Windows phd.cmd has its place")
REAL_TOOLS = "sh env cat readlink cksum flock rm mv mkdir cp chmod mktemp sleep".split()

# The system's python3: -c answers what the launcher asks of it, -m venv makes a folder with a stand-in inside.
SYSTEM_PYTHON = """#!/bin/sh
case "$*" in
    *ensurepip*) [ -z "${NO_VENV-}" ]; exit ;;
    *ctypes*) exit 1 ;;
    "-m venv "*) echo "venv" >>"$LOG"; mkdir -p "$3/bin"; cp "$STAND_INS/venv-python" "$3/bin/python" ;;
esac
"""

# The .venv's python: pip makes the command, after a while where asked; pytest leaves results behind.
VENV_PYTHON = """#!/bin/sh
here=${0%/*}
case "$*" in
    "-m pip"*)
        echo "pip $*" >>"$LOG"
        echo "pip talks"
        left=3000 # an abandoned one ends by itself
        while [ -n "${PIP_WAITS_FOR-}" ] && [ ! -e "$PIP_WAITS_FOR" ] && [ $left -gt 0 ]; do
            sleep 0.01 || exit 1
            left=$((left - 1))
        done
        [ -z "${PIP_FAILS-}" ] || exit 1
        for tool in ruff mypy lint-imports; do
            printf '#!/bin/sh\\n[ "$FAILING_TOOL" != %s ]\\n' $tool >"$here/$tool"
        done
        printf '#!/bin/sh\\necho "phd was given:" "$@"\\n' >"$here/phd"
        chmod +x "$here"/* ;;
    "-m app.compile_kernels") echo "compile" >>"$LOG"; [ -z "${COMPILING_FAILS-}" ] ;;
    "-m pytest -n 2 --dist loadfile --no-loadscope-reorder --junitxml"*" -m nojit tests/app/test_marked.py")
        echo "pytest nojit $NUMBA_DISABLE_JIT" >>"$LOG"; exit "${NOJIT_CODE-0}" ;;
    "-m pytest -n 2 --dist loadfile --no-loadscope-reorder --junitxml"*" --ignore-glob=*/test_live_*.py")
        echo "pytest whole" >>"$LOG"
        echo '<a><testsuite tests="9" skipped="1" errors="1" failures="2"/></a>' >"${8#--junitxml=}"; exit 1 ;;
    "-m pytest -n 2 --dist loadfile --no-loadscope-reorder --junitxml"*" tests/app/test_live_one.py")
        echo "pytest live" >>"$LOG" ;;
    "-m pytest"*) echo "$*" >>"$LOG" ;;
    "tests/suite.py") exec "$REAL_PYTHON" "$@" ;;
esac
"""

LOGGING = '#!/bin/sh\necho "${0##*/} $*" >>"$LOG"\n'


class Tree:
    """A tree with the launcher in it, and what it finds on its PATH."""

    def __init__(self, folder: Path) -> None:
        self.root, self.path, self.log = folder / "tree", folder / "path", folder / "log"
        self.root.mkdir(parents=True)
        self.path.mkdir()
        self.log.touch()
        (self.root / "tests/app").mkdir(parents=True)
        (self.root / "tests/app/test_marked.py").write_text("@pytest.mark.nojit")
        (self.root / "tests/app/test_live_one.py").touch()
        (self.root / "tests/app/test_other.py").touch()
        for name in ("phd", "pyproject.toml", "constraints.txt", "tests/suite.py"):
            shutil.copy(ROOT / name, self.root / name)
        for tool in REAL_TOOLS:
            found = shutil.which(tool)
            assert found, f"{tool} is needed by the launcher and not on this system"
            (self.path / tool).symlink_to(found)
        self.stand_in("python3", SYSTEM_PYTHON)
        self.stand_in("venv-python", VENV_PYTHON)
        self.stand_in("apt-get", LOGGING)
        self.stand_in("sudo", "#!/bin/sh\nexit 1\n")
        self.stand_in("Xvfb", LOGGING)
        self.stand_in("xdotool", LOGGING)
        self.stand_in("cc", LOGGING)
        self.user(0)
        self.libraries("all")
        self.environment = {"PATH": str(self.path), "STAND_INS": str(self.path), "LOG": str(self.log)}
        self.environment |= {"REAL_PYTHON": sys.executable, "FAILING_TOOL": "none"}

    def stand_in(self, name: str, script: str) -> None:
        (self.path / name).write_text(script)
        (self.path / name).chmod(0o755)

    def user(self, number: int) -> None:
        self.stand_in("id", f"#!/bin/sh\necho {number}\n")

    def libraries(self, which: str) -> None:
        """Let the system have all of Qt's libraries or none."""
        words = (self.root / "phd").read_text().split("qt_libraries='")[1].split("'")[0].split()
        assert len(words) == 11
        lines = [f"\t{word.split('=')[0]} (libc6,x86-64) => /somewhere" for word in words if which == "all"]
        self.stand_in("ldconfig", "#!/bin/sh\ncat <<END\n" + "\n".join(lines) + "\nEND\n")

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen:
        return subprocess.Popen(
            [self.root / "phd", *arguments], env=self.environment | environment, text=True, start_new_session=True,
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


def test_first_use_sets_up_and_hands_every_argument_on(tree: Tree) -> None:
    done = tree.run("study", "two words", "--seed", "1")
    assert (done.returncode, done.stdout) == (0, "phd was given: study two words --seed 1\n")
    assert "first use" in done.stderr and "pip talks" in done.stderr
    first, second = tree.calls("pip")
    assert all("-c constraints.txt" in call for call in (first, second))
    assert " numba " in first and "-e ." not in first and second.endswith("-e .")


def test_the_set_up_compiles_the_kernels_once_and_stands_where_that_fails(tree: Tree) -> None:
    done = tree.run("devices", COMPILING_FAILS="yes")
    assert (done.returncode, tree.calls("compile")) == (0, ["compile"])
    assert "could not be compiled now" in done.stderr
    tree.run("devices")
    assert len(tree.calls("compile")) == 1


def test_later_uses_call_neither_python_nor_pip(tree: Tree) -> None:
    tree.run("devices")
    before = tree.log.read_text()
    tree.stand_in("python3", LOGGING)
    again = tree.run("devices")
    assert (again.stdout, again.stderr, tree.log.read_text()) == ("phd was given: devices\n", "", before)


@pytest.mark.parametrize("name", ["constraints.txt", "pyproject.toml"])
def test_changed_pins_bring_the_environment_up_to_date(tree: Tree, name: str) -> None:
    tree.run("devices")
    (tree.root / name).write_text((tree.root / name).read_text() + "# changed\n")
    assert tree.run("devices").returncode == 0
    assert (len(tree.calls("pip")), len(tree.calls("venv"))) == (4, 1)
    assert tree.run("devices").stderr == ""


@pytest.mark.parametrize("update", [False, True])
def test_a_killed_set_up_or_update_is_redone_from_the_start(tree: Tree, tmp_path: Path, update: bool) -> None:
    if update:
        tree.run("devices")
        (tree.root / "constraints.txt").write_text("numpy==0.1\n")
        tree.log.write_text("")
    process = tree.start("devices", PIP_WAITS_FOR=str(tmp_path / "never"))
    tree.wait_for_pip()
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    (tree.root / ".venv/half").touch()
    tree.log.write_text("")
    assert tree.run("devices").stdout == "phd was given: devices\n"
    assert len(tree.calls("venv")) == 1 and not (tree.root / ".venv/half").exists()


def test_two_first_uses_at_once_set_up_once_and_both_succeed(tree: Tree, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    first = tree.start("devices", PIP_WAITS_FOR=str(gate))
    tree.wait_for_pip()
    second = tree.start("doctor")
    assert second.stderr is not None and "waiting" in second.stderr.readline()
    gate.touch()
    assert first.communicate(timeout=120)[0] == "phd was given: devices\n"
    assert second.communicate(timeout=120)[0] == "phd was given: doctor\n"
    assert (len(tree.calls("venv")), len(tree.calls("pip"))) == (1, 2)


@pytest.mark.parametrize("update", [False, True])
def test_a_failed_set_up_is_redone_and_a_failed_update_keeps_the_environment(tree: Tree, update: bool) -> None:
    if update:
        tree.run("devices")
        (tree.root / "constraints.txt").write_text("numpy==0.1\n")
    failed = tree.run("devices", PIP_FAILS="1")
    assert (failed.returncode, failed.stdout) == (1, "") and "pip could not install" in failed.stderr
    assert tree.run("devices").returncode == 0
    assert len(tree.calls("venv")) == (1 if update else 2)


def test_a_moved_tree_is_set_up_anew(tree: Tree) -> None:
    tree.run("devices")
    tree.root = tree.root.rename(tree.root.with_name("moved"))
    assert tree.run("devices").returncode == 0
    assert len(tree.calls("venv")) == 2


def test_without_venv_root_gets_it_installed_and_others_the_command_to_type(tree: Tree) -> None:
    tree.user(1000)
    refused = tree.run("devices", NO_VENV="1")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "sudo apt-get install -y --no-install-recommends python3-venv" in refused.stderr
    assert not (tree.root / ".venv").exists()
    tree.user(0)
    assert tree.run("devices", NO_VENV="1").returncode == 0
    assert any(call.endswith("--no-install-recommends python3-venv") for call in tree.calls("apt-get"))


@pytest.mark.parametrize("verb", ["", "run", "run --device d.toml", "--device d.toml", "replay a", "test x"])
def test_a_verb_with_a_window_needs_the_system_libraries(tree: Tree, verb: str) -> None:
    tree.libraries("none")
    tree.user(1000)
    refused = tree.run(*verb.split())
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "Type: sudo apt-get update && sudo apt-get install" in refused.stderr and "libegl1" in refused.stderr
    tree.user(0)
    assert tree.run(*verb.split()).returncode == 0
    assert "libxcb-shape0" in tree.calls("apt-get")[-1]
    tree.libraries("all")
    tree.user(1000)
    assert tree.run(*verb.split()).returncode == 0


WITHOUT_WINDOW = [
    "study --out d", "replay a --out b", "replay a --json", "replay a --controller 2", "run --print-plan", "run --help",
    "--help",
]  # fmt: skip


@pytest.mark.parametrize("verb", WITHOUT_WINDOW)
def test_a_verb_without_a_window_needs_no_system_library(tree: Tree, verb: str) -> None:
    tree.libraries("none")
    tree.user(1000)
    assert tree.run(*verb.split()).returncode == 0


def test_test_with_arguments_is_pytest_with_these_arguments(tree: Tree) -> None:
    assert tree.run("test", "tests/test_x.py", "-k", "a b").returncode == 0
    assert tree.calls("-m") == ["-m pytest tests/test_x.py -k a b"]
    assert tree.calls("pip")[-1].endswith("-e .[test]")
    assert tree.run("devices").stderr == ""


@pytest.mark.parametrize("tool", ["none", "ruff", "mypy", "lint-imports"])
def test_the_suite_names_each_failed_part_and_ends_with_the_counts(tree: Tree, tool: str) -> None:
    done = tree.run("test", FAILING_TOOL=tool)
    assert done.returncode == 1
    failed = "pytest" if tool == "none" else f"{tool}, pytest"
    assert done.stdout.splitlines()[-2:] == [f"failed: {failed}", "5 passed, 3 failed"]
    assert tree.calls("pytest") == ["pytest whole", "pytest live", "pytest nojit 1"]


def test_a_failure_without_the_jit_fails_the_suite(tree: Tree) -> None:
    assert "failed: pytest, pytest without the jit\n" in tree.run("test", NOJIT_CODE="1").stdout


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
    for name in ("constraints.txt", "pyproject.toml", "phd", ".ci/run"):
        assert not address.search((ROOT / name).read_text()), name


def test_everything_the_project_needs_is_pinned_and_installed_as_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    declared = project["project"]["dependencies"] + project["project"]["optional-dependencies"]["test"]
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


def test_the_kernels_can_be_compiled_with_what_the_set_up_installs_first() -> None:
    """Everything else cannot be imported here."""
    first = re.search(r"^kernel_packages='(.+)'", (ROOT / "phd").read_text(), re.M)
    assert first
    waiting, there = first[1].split(), {"phd"}
    while waiting:
        name = canonicalize_name(waiting.pop())
        if name not in there:
            there.add(name)
            needs = [Requirement(text) for text in metadata.requires(name) or []]
            waiting += [need.name for need in needs if not need.marker or need.marker.evaluate({"extra": ""})]
    owners = metadata.packages_distributions()
    others = {module for module, of in owners.items() if not there & {canonicalize_name(one) for one in of}}
    assert {"matplotlib", "PySide6", "msgspec", "numba"} & others == {"matplotlib", "PySide6"}
    code = f"""
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {others!r}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing())
from app.compile_kernels import compile_scene_and_loop, compile_trials
compile_trials()
compile_scene_and_loop()
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, timeout=280)


def test_qt_is_one_of_the_two_versions_that_keep_their_references() -> None:
    assert pins()["pyside6-essentials"] in ("6.8.3", "6.9.3")
