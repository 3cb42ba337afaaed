"""What the launchers `phd` and `phd.cmd` run: sets the tree up on first use, then runs the command `phd`.

The system's Python, which needs no library, sets up and then starts the Python of the .venv, which runs the command. A
stamp in the .venv, written last, says what was installed where. No stamp: a set-up was killed or never ran, and starts
again from nothing. Another stamp: pyproject.toml or constraints.txt has changed, and pip updates the .venv. Messages go
to stderr.
"""

import contextlib
import ctypes
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
WINDOWS = sys.platform == "win32"
PYTHON = VENV / ("Scripts/python.exe" if WINDOWS else "bin/python")
PINS = ("pyproject.toml", "constraints.txt")
DONE, FAILED, TO_INSTALL = 0, 1, 2
NOT_READY = 75  # to phd.cmd: the system's Python must set up, while no Python of the .venv runs

#: What compiling the kernels imports: installed first, the rest while they are compiled.
KERNEL_PACKAGES = "numpy numba msgspec scipy pyarrow fastcrc corncobs pyserial filelock".split()

#: Shared library and Debian package: what Qt loads for any window, then what it loads on X.
QT_LIBRARIES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libglib-2.0.so.0": "libglib2.0-0",
    "libfontconfig.so.1": "libfontconfig1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libdbus-1.so.3": "libdbus-1-3",
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-shape.so.0": "libxcb-shape0",
}
TEST_PROGRAMS = (
    (("Xvfb", "xdotool"), ("xvfb", "xdotool"), "a screen", "tests that need a screen"),
    (("cc",), ("gcc", "libc6-dev"), "a C compiler", "tests of the board in C"),
)
APT_GET = "apt-get install -y --no-install-recommends"


def main() -> int:
    """Set up, then run the command; the exit code."""
    arguments = sys.argv[1:]
    tests = arguments[:1] == ["test"]
    kind = "test" if tests else "run"
    if sys.platform == "linux" and opens_window(arguments):
        install_qt_libraries()
    if Path(sys.prefix).resolve() != VENV.resolve():  # .venv may be a link to another disk
        set_up(kind, not tests and opens_window(arguments))
        return DONE if WINDOWS else exec_python(PYTHON, __file__, *arguments)
    if not is_ready(kind):
        return NOT_READY if WINDOWS else exec_python(sys._base_executable, __file__, *arguments)  # type: ignore[attr-defined]
    keep_bytecode()
    if tests:
        if sys.platform == "linux":
            install_test_programs()
        os.chdir(ROOT)
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
        os.environ["PYTHONUTF8"] = "1"
        return exec_python(PYTHON, *(["-m", "pytest", *arguments[1:]] if arguments[1:] else ["tests/suite.py"]))
    sys.path[0] = str(ROOT)
    from app.cli import main as command

    return command()


def keep_bytecode() -> None:
    """Store compiled Python in the .venv if the environment forbids it beside the sources, as many containers do.

    Without it every process compiles all that it imports: 2.5 s of a processor.
    """
    if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
        os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = str(VENV / "bytecode")
        sys.dont_write_bytecode = False


def exec_python(python: str | Path, *arguments: str) -> int:
    """Continue as another Python (on Windows as its parent); the exit code."""
    command = [str(python), *arguments]
    if WINDOWS:
        return subprocess.call(command)
    os.execv(command[0], command)


# ----------------------------------------------------------------------------------------------------------- the .venv


def is_ready(kind: str) -> bool:
    """Whether the .venv is up to date; kind: "run" or "test"."""
    stamp = VENV / f"stamp-{kind}"
    return PYTHON.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == stamp_now()


def stamp_now() -> str:
    """The stamp of a finished set-up: the place (a .venv cannot be moved), then checksums of the pins."""
    sums = [hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in PINS]
    return "\n".join([place(), *sums]) + "\n"


def place() -> str:
    """Where the tree and the Python below its .venv are; "" if that is gone."""
    with contextlib.suppress(OSError):
        settings = dict(line.split(" = ", 1) for line in (VENV / "pyvenv.cfg").read_text(encoding="utf-8").splitlines())
        if Path(settings["home"]).exists():
            return f"{ROOT} {settings['home']} {PYTHON.resolve()}"
    return ""


def set_up(kind: str, window: bool) -> None:
    """Make the .venv or update it, one process at a time; window: for a command that opens one."""
    try:
        _set_up(kind, window)
    except OSError as error:
        where, why = error.filename or ROOT, (error.strerror or str(error)).lower()
        state = "is not set up yet"
        if VENV.exists():
            state = "was set up for another version, or with a Python that you may not run"
        stop(
            f"{where}: {why}, and this tree {state}: run it once as a user who may write to {ROOT}, "
            "or copy the tree to a folder of your own.",
            TO_INSTALL,
        )


def _set_up(kind: str, window: bool) -> None:
    """As `set_up`. OSError: the disk or the rights do not allow it."""
    with one_at_a_time():
        if is_ready(kind):
            return
        stamp = VENV / "stamp-run"
        known = stamp.read_text(encoding="utf-8").splitlines()[0] if stamp.exists() else ""
        update = bool(known) and known == place() and PYTHON.exists()
        say("bringing .venv up to date" if update else "first use: setting up, about a minute")
        for old in VENV.glob("stamp-*"):
            old.unlink()
        if not update:
            make_venv()
        if not fill(kind, window):
            if update:
                stamp.write_text(f"{known}\n", encoding="utf-8")  # not killed: next time update again
            stop("the set-up failed: pip could not install what constraints.txt pins (see above). Run it again.")
        for done in dict.fromkeys((kind, "run")):
            (VENV / f"stamp-{done}").write_text(stamp_now(), encoding="utf-8")
        say("set-up done")


def make_venv() -> None:
    if importlib.util.find_spec("ensurepip") is None:
        install("venv for Python", [f"python3.{sys.version_info.minor}-venv"])
    if VENV.exists():
        try:
            shutil.rmtree(VENV)
        except OSError as error:
            stop(f"{VENV} cannot be removed ({error.strerror}): close every window of phd and run it again.")
    if subprocess.call([sys.executable, "-m", "venv", VENV], stdout=sys.stderr) != 0:
        stop("no .venv: python -m venv failed (see above)")


def fill(kind: str, window: bool) -> bool:
    """Install the pinned packages and compile the kernels meanwhile; whether pip succeeded.

    A window is not kept waiting: it opens, and says that it compiles the rest. Tests need the control loop too.
    """
    keep_bytecode()
    extras = "[test,docs]" if kind == "test" else ""
    if not pip_install(*KERNEL_PACKAGES):
        return False
    needed = [] if kind == "test" else ["--no-window"]
    compiling = subprocess.Popen([PYTHON, "-m", "app.compile_kernels", *needed], cwd=ROOT, **QUIET)
    installed = pip_install("-e", f".{extras}")
    if window:
        compiling.terminate()
    if compiling.wait() != 0 and not window:
        say("the kernels could not be compiled now: each verb compiles its own on first use")
    return installed


#: Of a process of the set-up: nothing to read, its messages to stderr, and the lock held while it lives.
QUIET: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": sys.stderr, "close_fds": False}


def pip_install(*packages: str) -> bool:
    """Install as pinned; whether that succeeded. Python compiles what it imports later, a third of it all."""
    options = "--quiet --disable-pip-version-check --progress-bar off --no-compile -c constraints.txt".split()
    return subprocess.call([PYTHON, "-m", "pip", "install", *options, *packages], cwd=ROOT, **QUIET) == 0


@contextlib.contextmanager
def one_at_a_time() -> Iterator[None]:
    """Wait for another process that sets up, or for its pip if it was killed."""
    with open(ROOT / ".venv.lock", "w", encoding="utf-8") as lock:
        os.set_inheritable(lock.fileno(), not WINDOWS)
        waiting = False
        while not is_locked(lock.fileno()):
            if not waiting:
                say("another set-up is running, waiting for it")
            waiting = True
            time.sleep(0.2)
        yield  # the lock goes with the file


def is_locked(lock: int) -> bool:
    """Try to lock this open file; whether that succeeded."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(lock, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


# ---------------------------------------------------------------------------------------------------- system packages


def install_qt_libraries() -> None:
    """Install what a window needs of the system."""
    if missing := [package for library, package in QT_LIBRARIES.items() if not is_installed(library)]:
        install("system libraries for the window", missing)


def install_test_programs() -> None:
    """Install a screen and a compiler; without them the tests that need them are skipped."""
    for programs, packages, purpose, skipped in TEST_PROGRAMS:
        if not all(map(shutil.which, programs)):
            try:
                install(f"{purpose} for the tests", packages)
            except SystemExit:
                say(f"going on: {skipped} are skipped")


def opens_window(arguments: Sequence[str]) -> bool:
    """Whether the command opens a window, so that Qt's system libraries are needed."""
    if {"-h", "--help", "--version", "--print-plan"} & set(arguments):
        return False
    verb = arguments[0] if arguments else ""
    if verb == "replay":  # any option: no window
        return not any(word.startswith("--") for word in arguments)
    return verb in ("", "run", "test") or verb.startswith("-")


def is_installed(library: str) -> bool:
    """Whether the system finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install(purpose: str, packages: Sequence[str]) -> None:
    """Install Debian packages, or end with the exact command to type."""
    names = " ".join(packages)
    if shutil.which("apt-get") is None:
        stop(f"{purpose}: missing here, and there is no apt-get. The Debian packages are: {names}", TO_INSTALL)
    sudo: list[str] = []
    if os.geteuid() != 0:
        sudo = ["sudo", "-n"]
        if shutil.which("sudo") is None or subprocess.call(["sudo", "-n", "true"], stderr=subprocess.DEVNULL) != 0:
            stop(f"{purpose}: missing on this system. Type: sudo apt-get update && sudo {APT_GET} {names}", TO_INSTALL)
    say(f"{purpose}: installing {names}")
    apt_get = [*sudo, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq"]
    apt_get += ["-o", "DPkg::Lock::Timeout=300", "-o", "Dpkg::Use-Pty=0"]
    for step in (["update"], ["install", "-y", "--no-install-recommends", *packages]):
        done = subprocess.run(
            [*apt_get, *step], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        if done.returncode != 0:
            print(done.stdout, file=sys.stderr)
            stop(f"{purpose}: apt-get failed (see above). Type: {APT_GET} {names}", TO_INSTALL)


def say(sentence: str) -> None:
    print("phd:", sentence, file=sys.stderr, flush=True)


def stop(sentence: str, code: int = FAILED) -> NoReturn:
    """End with a sentence on stderr and an exit code."""
    say(sentence)
    sys.exit(code)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:  # while the command is imported; once it runs it catches Ctrl-C itself
        stop("interrupted", 130)
