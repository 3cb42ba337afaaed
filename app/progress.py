"""What a verb shows while it works, on stderr; and whether a window can be opened.

The screen is tried before Qt is loaded, for Qt ends the process where there is none.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from importlib import import_module
from types import ModuleType

from core.files import InputError
from core.kernels.cache import LINKING, watchers
from experiments.numbers import percent

#: On Linux one of these names where a window can be.
PLACES = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
#: An environment variable: with it a bar is lines "PHD_PROGRESS 0.25" on stderr, for the program that asked for a verb.
PROGRESS = "PHD_PROGRESS"
LEAST_ROOM = (1024, 630)  # px, for the main window with its frame
#: Prints each screen, the primary one first: name, size in points, scale, Hz, and the room for windows on it.
SCREENS_CODE = """
import json
from PySide6.QtGui import QGuiApplication
application = QGuiApplication([])
print(json.dumps([[s.name(), s.size().width(), s.size().height(), s.devicePixelRatio(), s.refreshRate(),
                   s.availableGeometry().width(), s.availableGeometry().height()] for s in application.screens()]))
"""


def redraws(stream: object) -> bool:
    """Whether a line that is written anew replaces the one before: on a terminal, and in a notebook's cell."""
    return stream is not None and (stream.isatty() or type(stream).__module__.startswith("ipykernel"))  # type: ignore[attr-defined]


class ProgressBar:
    """A bar for work of more than a second, called with the share done; lines where stderr is no terminal."""

    CELLS = 30
    LINE_S = 10.0  # between two lines

    def __init__(self, doing: str) -> None:
        self.doing, self.start, self.shown = doing, time.perf_counter(), ""
        self.first: tuple[float, float] | None = None  # when it was first called, and with which share
        self.place = "0 %"
        self._ended = threading.Event()
        self._lines: threading.Thread | None = None

    def __call__(self, share: float, where: str = "") -> None:
        """where: stands for the percentage."""
        if PROGRESS in os.environ:
            print(PROGRESS, f"{share:.3f}", file=sys.stderr, flush=True)
            return
        self.place = where or f"{percent(share)}{self._left(share)}"
        if not redraws(sys.stderr):
            if self._lines is None:  # not before: a study forks its processes before it has anything to show
                self._lines = threading.Thread(target=self._write_lines, name="lines of progress", daemon=True)
                self._lines.start()
            return
        if time.perf_counter() - self.start < 1.0:
            return
        full = round(share * self.CELLS)
        line = f"\r{self.doing} [{'#' * full}{'.' * (self.CELLS - full)}] {self.place}"
        if line != self.shown:
            print(line, "\033[K", sep="", end="", file=sys.stderr, flush=True)
            self.shown = line

    def _write_lines(self) -> None:
        """Print a line every `LINE_S` until `close`."""
        while not self._ended.wait(self.LINE_S):
            with contextlib.suppress(OSError, ValueError):  # no reader is left: the work goes on
                print(f"{self.doing}: {self.place}", file=sys.stderr, flush=True)

    def _left(self, share: float) -> str:
        """The time left at the pace so far, if it is a minute or more."""
        self.first = self.first or (time.perf_counter(), share)
        begun, at_first = self.first
        if share <= at_first:
            return ""
        minutes = round((1.0 - share) / (share - at_first) * (time.perf_counter() - begun) / 60.0)
        hours = f"{minutes // 60} h " if minutes >= 60 else ""
        return f", {hours}{minutes % 60} min left" if minutes >= 1 else ""

    def close(self) -> None:
        """Remove the bar from the terminal and stop the lines."""
        self._ended.set()
        if self._lines is not None:
            self._lines.join()
        self._lines, self._ended = None, threading.Event()  # a bar of kernels comes again with the next entry
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self.shown = ""


class CompileProgress:
    """Shows which kernel of how many is being compiled or linked, and adds up the time (s)."""

    FEW = 20  # kernels, of which the bar shows no share: it would run to and fro before the many of a trial

    def __init__(self) -> None:
        self.seconds, self._bar = 0.0, ProgressBar("compiling kernels")
        self._share = 0.0
        self._began: float | None = None

    def __call__(self, number: int, of: int, name: str) -> None:
        """As `watchers` of the cache are called. The first half of the bar: compiling; the other: linking."""
        if self._began is None:
            self._began = time.perf_counter()
        if name:
            if of > self.FEW:
                self._share = 0.5 * number / of
            self._bar(self._share, "linking" if name == LINKING else f"{number} of {of}")
            return
        self._bar.close()
        self.seconds, self._began = self.seconds + time.perf_counter() - self._began, None


def watch_compiling() -> CompileProgress:
    """Show a bar for each compilation of kernels from now on."""
    compiling = CompileProgress()
    watchers[:] = [compiling]
    return compiling


class ScreenCheck:
    """Checks in another process whether there is a screen, while other things are prepared."""

    def __init__(self, purpose: str, without: str = "") -> None:
        """purpose: ends "there is no screen to ..."; without: what can be done all the same.

        InputError if no variable names a place for a window.
        """
        if sys.platform == "linux" and not any(map(os.environ.get, PLACES)):
            more = f" ({without})" if without else ""
            raise InputError(f"there is no screen to {purpose}: none of DISPLAY, WAYLAND_DISPLAY is set{more}")
        self._tried = subprocess.Popen(
            [sys.executable, "-c", SCREENS_CODE],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip

    def check(self, wanted: float = 1.0) -> None:
        """Wait for the result. InputError: there is no screen.

        wanted: scale of everything; on a small screen (or one at 200 %) it is smaller, to fit. Before a window is made,
        for Qt reads the scale once.
        """
        answer, _ = self._tried.communicate()
        if self._tried.returncode != 0:
            named = ", ".join(f"{name}={os.environ[name]}" for name in PLACES if name in os.environ)
            raise InputError(f"the window cannot be opened: Qt finds no usable screen ({named})")
        *_, width, height = json.loads(answer.splitlines()[-1])[0]
        share = min(wanted, width / LEAST_ROOM[0], height / LEAST_ROOM[1])
        if share != 1.0:
            os.environ["QT_SCALE_FACTOR"] = f"{share * float(os.environ.get('QT_SCALE_FACTOR', 1.0)):.4f}"


def import_window_module(name: str) -> ModuleType:
    """A module of app.window. InputError if a system library is missing."""
    try:
        return import_module(f"app.window.{name}")
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
