"""What a verb shows: a progress bar and a word on the first compilation on stderr, and whether a window can be opened.

The screen is asked for before Qt is, which ends the process where there is none.
"""

import os
import subprocess
import sys
import time
from importlib import import_module
from types import ModuleType

from core.files import InputError

#: On Linux one of these says where a window can be.
PLACES = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
#: An environment variable: with it a bar is lines "PHD_PROGRESS 0.25" on stderr, for the program that asked for a verb.
PROGRESS = "PHD_PROGRESS"
LEAST_ROOM = (1240, 690)  # px, for the console with its frame
_CODE = (
    "from PySide6.QtGui import QGuiApplication as A; a = A([]); room = a.primaryScreen().availableGeometry();"
    "print(room.width(), room.height())"
)


def announce_first_use() -> bool:
    """Say so if kernels will be compiled now, and show how far that is; whether they will."""
    from core.kernel import first_use

    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False
    show_compiling()
    first = first_use()
    if first:
        print("compiling kernels (first use, about a quarter of a minute)", file=sys.stderr, flush=True)
    return first


def show_compiling() -> None:
    """From here on a bar says which of how many kernels is being compiled."""
    from core.kernel_compiler import watchers

    bar = Progress("compiling kernels")

    def watch(number: int, of: int, name: str) -> None:
        if name:
            bar(number / max(of, 1), f"{number} of {of}")
        else:
            bar.clear()

    watchers[:] = [watch]


class Progress:
    """A progress bar on stderr, on a terminal only, for what takes over a second; called with the share done."""

    CELLS = 30

    def __init__(self, says: str) -> None:
        self.says, self.start, self.shown = says, time.monotonic(), ""

    def __call__(self, share: float, where: str = "") -> None:
        """where: stands for the percentage."""
        if PROGRESS in os.environ:
            print(PROGRESS, f"{share:.3f}", file=sys.stderr, flush=True)
            return
        if not sys.stderr.isatty() or time.monotonic() - self.start < 1.0:
            return
        full = round(share * self.CELLS)
        line = f"\r{self.says} [{'#' * full}{'.' * (self.CELLS - full)}] {where or f'{share:4.0%}'}"
        if line != self.shown:
            print(line, end="", file=sys.stderr, flush=True)
            self.shown = line

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def clear(self) -> None:
        """Take it off the terminal."""
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self.shown = ""


class Display:
    """Tried in a process of its own, beside whatever else has to be prepared."""

    def __init__(self, purpose: str, without: str = "") -> None:
        """purpose: ends "there is no screen to ..."; without: what can be done all the same.

        InputError if nothing says where a screen could be.
        """
        if sys.platform == "linux" and not any(map(os.environ.get, PLACES)):
            more = f" ({without})" if without else ""
            raise InputError(f"there is no screen to {purpose}: none of DISPLAY, WAYLAND_DISPLAY is set{more}")
        null, pipe = subprocess.DEVNULL, subprocess.PIPE
        self._tried = subprocess.Popen(
            [sys.executable, "-c", _CODE], stdin=null, stdout=pipe, stderr=null, text=True
        )  # fmt: skip

    def check(self) -> None:
        """Wait for the answer. InputError if there is no screen.

        On one with little room (a small one at 200 %) all is drawn smaller, so that nothing is cut; before a window is
        made, for Qt reads the scale once.
        """
        said, _ = self._tried.communicate()
        if self._tried.returncode != 0:
            named = ", ".join(f"{name}={os.environ[name]}" for name in PLACES if name in os.environ)
            raise InputError(f"the window cannot be opened: Qt finds no usable screen ({named})")
        width, height = map(int, said.split())
        share = min(width / LEAST_ROOM[0], height / LEAST_ROOM[1])
        if share < 1.0:
            os.environ["QT_SCALE_FACTOR"] = f"{share * float(os.environ.get('QT_SCALE_FACTOR', 1.0)):.4f}"


def import_screen(name: str) -> ModuleType:
    """A module of app.window. InputError if a system library is missing."""
    try:
        return import_module(f"app.window.{name}")
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
