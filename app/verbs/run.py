"""`phd run`, or `phd` alone: the app."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from app.progress import announce_first_use
from app.verbs.common import add_verb, label, whole_number_of
from core.errors import InputError

#: On Linux one of these says where a window can be; without any, Qt would end the process with a core dump.
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
LEAST_ROOM = (1240, 690)  # px, for the console with its frame


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
        "--input", choices=("mouse", "hid", "operator"), default="mouse",
        help="where the hand force comes from: the mouse (default), a six-axis device, or a simulated operator",
    )  # fmt: skip
    verb.add_argument(
        "--link", default="sim", metavar="sim|serial:PORT",
        help="the simulated device (default), or one whose board is at a serial port (auto: the only one on USB)",
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
    verb.add_argument("--theme", choices=("dark", "light"), default="dark", help="of the windows (default: dark)")
    verb.add_argument(
        "--print-plan", action="store_true", help="print every trial of the participant, in order, and end: no window"
    )


def run(args: argparse.Namespace) -> int:
    if args.print_plan:
        return print_plan(args)
    check_writable(args.data_dir)
    port_of(args)
    if sys.platform == "linux" and not any(map(os.environ.get, SCREENS)):
        raise InputError("there is no screen to open a window on: none of DISPLAY, WAYLAND_DISPLAY is set")
    screen = ScreenCheck()
    from app.live.bench import Bench
    from app.live.setup import Setup

    bench = Bench(
        Setup(
            args.data_dir.absolute(), whole(args.protocol), tuple(map(whole, args.device)) if args.device else None,
            args.rules, args.low_gain, args.seed, args.input, args.participant or "", port_of(args),
        )  # fmt: skip
    )
    try:  # all this takes its time, and so does the bench
        announce_first_use()
        windows = import_windows(args.theme)
        screen.check()
        windows.make_ready()
        if refused := bench.refused():
            raise InputError(refused)
    except BaseException:
        bench.stop("no window was opened")
        raise
    return windows.run(bench)


def port_of(args: argparse.Namespace) -> str:
    """The serial port of --link; "" for the simulated device. InputError: there is no such port."""
    if args.link == "sim":
        return ""
    kind, _, port = args.link.partition(":")
    if kind != "serial" or not port:
        raise InputError(f"--link: must be sim or serial:PORT, not {args.link!r}")
    if args.input != "mouse":
        raise InputError(f"--input {args.input}: on the bench the force sensor says what the hand does")
    from hardware.port import find_port

    port = find_port(port)
    if os.name == "posix" and not os.path.exists(port):
        raise InputError(f"--link serial:{port}: there is no such port (phd devices lists those there are)")
    return port


def print_plan(args: argparse.Namespace) -> int:
    """Every trial of the participant, for the standard output."""
    from experiments.plan_text import print_plan
    from experiments.protocol import load_protocol
    from experiments.session_files import free_participant

    protocol = load_protocol(
        args.protocol, devices=args.device, rules=args.rules, low_gain=args.low_gain, seed=args.seed
    )
    participant = args.participant or free_participant(args.data_dir, protocol.participants)
    print(print_plan(protocol, participant), end="")
    return 0


def import_windows(theme: str):
    """The windows, in this palette. InputError if a system library is missing."""
    from app.screens import palette

    palette.choose(theme)
    try:
        from app.screens import windows
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
    return windows


def whole(name_or_path: str) -> str:
    """A file by its whole path, for another process; a shipped name as it is."""
    path = Path(name_or_path)
    return str(path.absolute()) if path.is_file() else name_or_path


class ScreenCheck:
    """Whether Qt can open a screen: tried in a process of its own, for Qt ends the process if it cannot."""

    def __init__(self) -> None:
        code = (
            "from PySide6.QtGui import QGuiApplication as A; a = A([]); room = a.primaryScreen().availableGeometry();"
            "print(room.width(), room.height())"
        )
        null, pipe = subprocess.DEVNULL, subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, "-c", code], stdin=null, stdout=pipe, stderr=null, text=True
        )

    def check(self) -> None:
        """Wait for it. InputError if there is no screen. On one with little room (a small one at 200 %) all is drawn
        smaller, so that nothing is cut: before a window is made, for Qt reads the scale once.
        """
        said, _ = self._process.communicate()
        if self._process.returncode == 0:
            width, height = map(int, said.split())
            share = min(width / LEAST_ROOM[0], height / LEAST_ROOM[1])
            if share < 1.0:
                os.environ["QT_SCALE_FACTOR"] = f"{share * float(os.environ.get('QT_SCALE_FACTOR', 1.0)):.4f}"
        else:
            names = [name for name in (*SCREENS, "QT_QPA_PLATFORM") if name in os.environ]
            named = ", ".join(f"{name}={os.environ[name]}" for name in names)
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
