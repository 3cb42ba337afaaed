"""What phd.cmd runs: sets the tree up on first use, then becomes the command `phd`, as the script `phd` does on Linux.

The .venv's Python starts the command, or ends with NOT_READY. The system's Python then sets up and needs nothing but
itself. A stamp inside .venv, written last, says what was installed where. No stamp: a set-up was killed or never ran,
it is redone from the start. Another stamp: pyproject.toml or constraints.txt changed, pip updates the .venv.
"""

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
PINS = ("pyproject.toml", "constraints.txt")
NOT_READY = 75
FAILED = 1


def main() -> int:
    """The exit code."""
    arguments = sys.argv[1:]
    tests = arguments[:1] == ["test"]
    kind = "test" if tests else "run"
    if Path(sys.prefix).resolve() != VENV:
        set_up(kind)
        return 0
    if not is_ready(kind):
        return NOT_READY
    if not tests:
        sys.path[0] = str(ROOT)
        from app.cli import main as command

        return command()
    what = ["-m", "pytest", *arguments[1:]] if arguments[1:] else ["tests/suite.py"]
    return subprocess.call([PYTHON, *what], cwd=ROOT, env=os.environ | {"PYTHONUTF8": "1"})


def is_ready(kind: str) -> bool:
    """Whether the .venv is what the files ask for now; kind: "run" or "test"."""
    stamp = VENV / f"stamp-{kind}"
    return PYTHON.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == stamp_now()


def stamp_now() -> str:
    """What a finished set-up writes into its stamp: the place (a .venv cannot be moved), then checksums of the pins."""
    sums = [hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in PINS]
    return "\n".join([place(), *sums]) + "\n"


def place() -> str:
    """Where the tree is, and the Python below its .venv; "" where that is gone."""
    with contextlib.suppress(OSError):
        settings = dict(line.split(" = ", 1) for line in (VENV / "pyvenv.cfg").read_text(encoding="utf-8").splitlines())
        if Path(settings["home"]).exists():
            return f"{ROOT} {settings['home']}"
    return ""


def set_up(kind: str) -> None:
    """Make the .venv or bring it up to date, one process at a time; stamp last."""
    with one_at_a_time():
        if is_ready(kind):
            return
        stamp = VENV / "stamp-run"
        known = stamp.read_text(encoding="utf-8").splitlines()[0] if stamp.exists() else ""
        update = bool(known) and known == place() and PYTHON.exists()
        say("bringing .venv up to date" if update else "first use: setting up, a minute or two")
        for old in VENV.glob("stamp-*"):
            old.unlink()
        if not update:
            make_venv()
        extras = "[test]" if kind == "test" else ""
        pip = "-m pip install --quiet --disable-pip-version-check --progress-bar off -c constraints.txt -e".split()
        if run(*pip, f".{extras}") != 0:
            if update:
                stamp.write_text(f"{known}\n", encoding="utf-8")  # not killed: next time update again
            stop("the set-up failed: pip could not install what constraints.txt pins (see above). Run it again.")
        for done in dict.fromkeys((kind, "run")):
            (VENV / f"stamp-{done}").write_text(stamp_now(), encoding="utf-8")
        if run("-m", "app.compile_kernels") != 0:
            say("the kernels could not be compiled now: each verb compiles its own on first use")
        say("set-up done")


def make_venv() -> None:
    """A new .venv in place of the one there is."""
    if VENV.exists():
        try:
            shutil.rmtree(VENV)
        except OSError as error:
            stop(f"{VENV} cannot be removed ({error.strerror}): close every window of phd and run it again.")
    if subprocess.call([sys.executable, "-m", "venv", VENV], stdout=sys.stderr) != 0:
        stop("no .venv: python -m venv failed (see above)")


def run(*arguments: str) -> int:
    """The exit code of the .venv's Python."""
    return subprocess.call([PYTHON, *arguments], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=sys.stderr)


@contextlib.contextmanager
def one_at_a_time() -> Iterator[None]:
    """A process that comes second waits, and finds the set-up done."""
    import msvcrt

    with open(ROOT / ".venv.lock", "w", encoding="utf-8") as lock:
        waiting = False
        while True:
            try:
                msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
                break
            except OSError:
                if not waiting:
                    say("another set-up is running, waiting for it")
                waiting = True
                time.sleep(0.2)
        yield  # the lock goes with the file


def say(sentence: str) -> None:
    """To stderr."""
    print("phd:", sentence, file=sys.stderr, flush=True)


def stop(sentence: str) -> NoReturn:
    """End with a sentence."""
    say(sentence)
    sys.exit(FAILED)


if __name__ == "__main__":
    sys.exit(main())
