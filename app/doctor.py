"""`phd doctor`: is this machine fit to run trials, and what to do about each thing that is not."""

import importlib.metadata
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

GOOD, CAUTION, BAD = "good", "caution", "bad"
LEAST_FREE_BYTES = 2 * 10**9  # a session of 60 trials takes about 0.2 GB
SLOW_SYNC_S = 0.1
#: Text is laid out for these; a smaller screen would clip it.
LEAST_SCREEN = (1280, 720)
UDEV_RULE = 'KERNEL=="hidraw*", ATTRS{idVendor}=="046d|256f", MODE="0660", TAG+="uaccess"'
SCREENS_CODE = """
import json
from PySide6.QtGui import QGuiApplication
application = QGuiApplication([])
print(json.dumps([[s.name(), s.size().width(), s.size().height(), s.devicePixelRatio(), s.refreshRate()]
                  for s in application.screens()]))
"""
SCHEDULING_CODE = "from app.ipc.scheduling import take_scheduling; print(take_scheduling()[0])"


class Line(NamedTuple):
    """One thing that was looked at."""

    name: str
    state: str  # GOOD, CAUTION, BAD
    found: str
    advice: str = ""  # what to do, one sentence; "" where there is nothing to do


def examine(data_dir: Path, attached: Callable[[], list[Line]]) -> list[Line]:
    """Everything, in the order of the report; `attached` looks at ports and hands."""
    return [
        libraries(), *screens(), scheduling(), cores(), disk(data_dir), kernels(), *attached()
    ]  # fmt: skip


def libraries() -> Line:
    """Whether what is installed is what the project asks for."""
    wrong = []
    for text in importlib.metadata.requires("phd") or []:
        need = Requirement(text)
        if need.marker and not need.marker.evaluate({"extra": ""}):
            continue
        try:
            version = importlib.metadata.version(need.name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{need.name} is missing")
            continue
        if not need.specifier.contains(version, prereleases=True):
            wrong.append(f"{need.name} is {version}, not {need.specifier}")
    if wrong:
        return Line("libraries", BAD, ", ".join(wrong), "Remove the folder .venv and run ./phd again.")
    return Line("libraries", GOOD, f"all there, Python {sys.version.split()[0]}")


def screens() -> list[Line]:
    """What Qt can open windows on: tried in a process of its own, for Qt ends the process where it cannot."""
    tried = subprocess.run([sys.executable, "-c", SCREENS_CODE], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        where = ", ".join(f"{name}={os.environ[name]}" for name in ("DISPLAY", "WAYLAND_DISPLAY") if name in os.environ)
        return [
            Line("screens", BAD, f"Qt finds none ({where or 'DISPLAY and WAYLAND_DISPLAY are not set'})",
                 "Log in at the machine's own desktop; every verb but run and replay works without.")
        ]  # fmt: skip
    lines = []
    for name, width, height, scale, refresh in json.loads(tried.stdout.splitlines()[-1]):
        found = f"{name or 'screen'}: {width} x {height} points, scale {scale:g}, {refresh:.0f} Hz"
        small = width < LEAST_SCREEN[0] or height < LEAST_SCREEN[1]
        less = "Lower the scale" if scale > 1.0 else "Choose a higher resolution or a larger screen"
        advice = f"{less}: windows are laid out for {LEAST_SCREEN[0]} x {LEAST_SCREEN[1]} points."
        lines.append(Line("screen", CAUTION if small else GOOD, found, advice if small else ""))
    if len(lines) == 1:
        lines.append(Line("screens", CAUTION, "only one: participant and experimenter share it",
                          "Plug in a second screen for the participant's view."))  # fmt: skip
    return lines


def scheduling() -> Line:
    """The best scheduling that the control loop gets here; tried in a process of its own."""
    from app.ipc.scheduling import ADVICE

    tried = subprocess.run([sys.executable, "-c", SCHEDULING_CODE], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        last = (tried.stderr.strip().splitlines() or ["no reason given"])[-1]
        return Line("scheduling", BAD, f"could not be tried: {last}", "Reinstall: remove .venv and run ./phd again.")
    got = tried.stdout.strip()
    if got.startswith("real-time") and "not locked" not in got:
        return Line("scheduling", GOOD, got)
    return Line("scheduling", CAUTION, got, ADVICE if sys.platform == "linux" else "")


def cores() -> Line:
    """Processor cores that we may use: the loop wants one of its own."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if count < 2:
        return Line("cores", CAUTION, "1: loop and window share it", "Give the machine a second core.")
    return Line("cores", GOOD, f"{count}")


def disk(data_dir: Path) -> Line:
    """Room and speed where recordings go."""
    place = data_dir
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        free = shutil.disk_usage(place).free
        waits = []
        with tempfile.TemporaryFile(dir=place) as file:
            for _ in range(5):
                file.write(b"\0" * 65536)
                file.flush()
                began = time.perf_counter()
                os.fsync(file.fileno())
                waits.append(time.perf_counter() - began)
    except OSError as error:
        return Line("disk", BAD, f"{data_dir} cannot be written to: {(error.strerror or str(error)).lower()}",
                    "Choose another folder with --data-dir.")  # fmt: skip
    wait = statistics.median(waits)
    found = f"{data_dir}: {free / 1e9:.1f} GB free, {1e3 * wait:.1f} ms to bring a write to the disk"
    if free < LEAST_FREE_BYTES:
        return Line("disk", BAD, found, f"Free at least {LEAST_FREE_BYTES / 1e9:g} GB, or choose another --data-dir.")
    if wait > SLOW_SYNC_S:
        return Line("disk", CAUTION, found, "Record on a local disk, not on a network drive or a memory stick.")
    return Line("disk", GOOD, found)


def kernels() -> Line:
    """Whether the compiled kernels are at hand."""
    from core.kernel import CACHE_FOLDER, first_use

    if first_use():
        return Line("kernels", CAUTION, f"not compiled yet ({CACHE_FOLDER})",
                    "The first trial or study compiles them, about half a minute; nothing to do.")  # fmt: skip
    return Line("kernels", GOOD, f"compiled, in {CACHE_FOLDER}")
