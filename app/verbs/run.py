"""`phd run`, or `phd` alone: the app."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from app.verbs.common import add_verb, label, whole_number_of
from core.errors import InputError

#: On Linux one of these says where a window can be; without any, Qt would end the process with a core dump.
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "run",
        run,
        "open the app and run trials (the same as phd alone)",
        "Two windows: the console, and the participant's view on the second screen (on one screen: F11).\n"
        "The simulated device is moved with the mouse: the pointer pulls the handle on a spring.\n"
        "An interrupted session is offered to be resumed.",
        "phd run --participant 01 --data-dir data\n  phd run my.toml --print-plan",
    )
    verb.add_argument(
        "protocol", nargs="?", default="paper", metavar="PROTOCOL.toml",
        help="a protocol file, or a shipped one by its name (default: paper)",
    )  # fmt: skip
    verb.add_argument(
        "--device", nargs="+", action="extend", metavar="NAME|PATH",
        help="devices in place of the protocol's: shipped ones by name, or device files by path",
    )  # fmt: skip
    verb.add_argument(
        "--input", choices=("mouse", "operator"), default="mouse",
        help="where the hand force comes from: the mouse (default), or a simulated operator",
    )  # fmt: skip
    verb.add_argument("--rules", choices=("settled", "literal"), help="in place of the protocol's")
    verb.add_argument(
        "--low-gain", type=float, metavar="5|500",
        help="N s/m, of the proportional controller of least gain, in place of the protocol's",
    )  # fmt: skip
    verb.add_argument(
        "--seed", type=whole_number_of(0), metavar="1", help="of the order of trials, in place of the protocol's"
    )
    verb.add_argument(
        "--participant", type=label, metavar="01",
        help="who moves the handle (default: the first without a session)",
    )  # fmt: skip
    verb.add_argument(
        "--data-dir", type=Path, default=Path("data"), metavar="DIR", help="where sessions are kept (default: data)"
    )
    verb.add_argument(
        "--print-plan", action="store_true", help="print every trial of the participant, in order, and end: no window"
    )


def run(args: argparse.Namespace) -> int:
    from experiments.protocol import load_protocol

    protocol = load_protocol(
        args.protocol, devices=args.device, rules=args.rules, low_gain=args.low_gain, seed=args.seed
    )
    participant = args.participant or next_participant(args.data_dir, protocol.participants)
    if args.print_plan:
        from experiments.plan_text import print_plan

        print(print_plan(protocol, participant), end="")
        return 0
    check_writable(args.data_dir)
    check_participant(args.data_dir, participant)
    if sys.platform == "linux" and not any(map(os.environ.get, SCREENS)):
        raise InputError("there is no screen to open a window on: none of DISPLAY, WAYLAND_DISPLAY is set")
    try:
        from app.live.setup import Setup
        from app.screens import windows
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
    check_screen()
    setup = Setup(
        args.data_dir.absolute(), whole(args.protocol), tuple(map(whole, args.device)) if args.device else None,
        args.rules, args.low_gain, args.seed, args.input,
    )  # fmt: skip
    return windows.run(setup, participant)


def next_participant(data_dir: Path, participants: tuple[str, ...]) -> str:
    """Whom to offer: the first without a session, else one whose session was interrupted. InputError if all are done."""
    from experiments.session_files import free_participant, unfinished_sessions

    try:
        return free_participant(data_dir, participants)
    except InputError:
        if unfinished := unfinished_sessions(data_dir):
            return unfinished[0]
        raise


def check_participant(data_dir: Path, participant: str) -> None:
    """InputError unless the participant's session is still to begin or can be gone on with."""
    from experiments.session_files import STORED, read_stored, refuse_existing, session_folder, unfinished_sessions

    if participant in unfinished_sessions(data_dir):
        return
    folder = session_folder(data_dir, participant)
    if (folder / STORED).exists():
        read_stored(folder)  # one that is damaged is said to be
    refuse_existing(data_dir, participant)


def whole(name_or_path: str) -> str:
    """A file by its whole path, for another process; a shipped name as it is."""
    path = Path(name_or_path)
    return str(path.absolute()) if path.is_file() else name_or_path


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
