"""`phd run`, or `phd` alone: the app."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from app.verbs.common import add_devices, add_verb, devices_of, label
from core.errors import InputError

#: On Linux one of these says where a window can be; without any, Qt would end the process with a core dump.
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "run",
        run,
        "open the app and run trials (the same as phd alone)",
        "The simulated device is moved with the mouse: the pointer pulls the handle on a spring.",
        "phd run --device three-brake --participant 01 --data-dir data",
    )
    add_devices(verb)
    verb.add_argument(
        "--participant",
        type=label,
        metavar="01",
        help="who moves the handle (default: the first number without a session)",
    )
    verb.add_argument(
        "--data-dir",
        type=Path,
        default=Path("data"),
        metavar="DIR",
        help="where sessions are kept (default: data)",
    )


def run(args: argparse.Namespace) -> int:
    from experiments.session import check_reach, free_participant, refuse_existing

    args.devices = devices_of(args)
    check_reach(args.devices)
    check_writable(args.data_dir)
    if args.participant is None:
        args.participant = free_participant(args.data_dir)
    refuse_existing(args.data_dir, args.participant)
    if sys.platform == "linux" and not any(map(os.environ.get, SCREENS)):
        raise InputError("there is no screen to open a window on: none of DISPLAY, WAYLAND_DISPLAY is set")
    try:
        from app import window
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
    check_screen()
    return window.run(args)


def check_screen() -> None:
    """InputError unless Qt can open a screen: tried in a process of its own, for Qt ends the process if it cannot."""
    code = "from PySide6.QtGui import QGuiApplication; QGuiApplication([])"
    tried = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    if tried.returncode != 0:
        named = ", ".join(f"{name}={os.environ[name]}" for name in (*SCREENS, "QT_QPA_PLATFORM") if name in os.environ)
        raise InputError(f"the window cannot be opened: Qt finds no usable screen ({named})")


def check_writable(folder: Path) -> None:
    """InputError unless files can be made in a folder that need not exist yet; nothing is left there."""
    place = folder
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(f"{folder}: cannot be written to ({(error.strerror or str(error)).lower()})") from None
