"""`phd run`, or `phd` alone: the app."""

import argparse
import os
import sys
from pathlib import Path

from app.progress import Display, announce_first_use, import_screen
from app.verbs.common import add_verb, label, whole_number_of
from core.files import InputError


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
    verb.add_argument(
        "--force", default="", metavar="netft:HOST",
        help="with --link serial:PORT: an ATI Net F/T on the network in place of the board's force channels",
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
    link = link_of(args)
    display = Display("open a window on")
    from app.ipc.client import Client
    from app.ipc.messages import OPERATOR, Setup
    from app.window.painting import palette

    setup = Setup(
        args.data_dir.absolute(), whole(args.protocol), tuple(map(whole, args.device)) if args.device else None,
        args.rules, args.low_gain, args.seed, args.input, args.participant or "", link,
    )  # fmt: skip
    if setup.hand == OPERATOR:
        say_what_is_missing(args, setup)
    client = Client(setup)
    try:  # all this takes its time, and so does the session server
        announce_first_use()
        palette.choose(args.theme)
        windows = import_screen("windows")
        display.check()
        windows.make_ready()
        if refused := client.refused():
            raise InputError(refused)
    except BaseException:
        client.stop("no window was opened")
        raise
    return windows.run(client)


def port_of(args: argparse.Namespace) -> str:
    """The serial port of --link; "" for the simulated device. InputError: there is no such port."""
    if args.link == "sim":
        return ""
    kind, _, port = args.link.partition(":")
    if kind != "serial" or not port:
        raise InputError(f"--link: must be sim or serial:PORT, not {args.link!r}")
    if args.input != "mouse":
        raise InputError(f"--input {args.input}: on the bench the force sensor says what the hand does")
    from hardware.serial_port import find_port

    found = find_port(port)
    if os.name == "posix" and not os.path.exists(found):
        raise InputError(f"--link serial:{found}: there is no such port (phd devices lists those there are)")
    return port  # "auto" is looked for again for each device


def link_of(args: argparse.Namespace) -> str:
    """As `Setup.link`. InputError: there is no such port, or no such sensor answers."""
    port = port_of(args)
    if not args.force:
        return port
    if not port:
        raise InputError("--force: goes with --link serial:PORT (the simulated device needs no force sensor)")
    from hardware.sensing.net_ft import check_force

    check_force(args.force)
    return f"{port} {args.force}"


def say_what_is_missing(args: argparse.Namespace, setup) -> None:
    """On the standard error: what a simulated operator's sessions have not, though the protocol asks for it."""
    from app.session_server.practice import done_without

    if without := done_without(setup, protocol_of(args)):
        print(f"phd: {without}", file=sys.stderr)


def protocol_of(args: argparse.Namespace):
    """The protocol with what the command line gives in place of what it says."""
    from experiments.protocol import load_protocol

    return load_protocol(args.protocol, devices=args.device, rules=args.rules, low_gain=args.low_gain, seed=args.seed)


def print_plan(args: argparse.Namespace) -> int:
    """Every trial of the participant, for the standard output."""
    from app.session_server.steps import planned_steps
    from experiments.plan import print_plan
    from experiments.session.files import free_participant

    protocol = protocol_of(args)
    participant = args.participant or free_participant(args.data_dir, protocol.participants)
    if args.input != "operator":
        protocol.refuse_stranger(participant)
    print(print_plan(protocol, participant, planned_steps), end="")
    return 0


def whole(name_or_path: str) -> str:
    """A file by its whole path, for another process; a shipped name as it is."""
    path = Path(name_or_path)
    return str(path.absolute()) if path.is_file() else name_or_path
