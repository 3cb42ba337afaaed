"""`phd run`, or `phd` alone: the app."""

import argparse
import math
import sys
from pathlib import Path

from app.ipc.client import Client
from app.ipc.messages import Setup
from app.progress import ScreenCheck, import_window_module, watch_compiling
from app.session_server.lsl import load_pylsl
from app.session_server.preflight import ignored_features
from app.verbs.common import DATA_DIR, DEVICES, RULES, add_verb, number_between, whole_number_of
from app.window.widgets import palette
from core.files import InputError
from experiments.inputs import CHOICES, INPUTS, MOUSE, is_person
from experiments.plan import participant_label, print_plan
from experiments.protocol import Protocol, load_protocol
from hardware.own_driver import DRIVER, load_driver

GAIN = number_between(0.0, math.inf, "a number greater than 0, in N s/m")
#: for --help: mouse (pulls the handle by a spring)
HANDS = [f"{name} ({INPUTS[name].does})" for name in CHOICES]


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "run", run, "open the app and run trials (the same as phd alone)\n"
        "One window (Home, Try, Run, Analyse), and the participant's view on the second screen (on one screen: F11).\n"
        "The simulated device is moved with the mouse: the pointer pulls the handle on a spring.\n"
        "An interrupted session is offered to be resumed.",
        "phd run --participant 01 --data-dir data\n  phd run my.toml --print-plan",
    ).add_argument  # fmt: skip
    protocol = "protocol file or shipped name (default: paper)"
    option("protocol", nargs="?", default="paper", metavar="PROTOCOL.toml", help=protocol)
    option("--device", **{**DEVICES, "help": "shipped names or device files in place of the protocol's"})
    option(
        "--input", choices=CHOICES, default=MOUSE,
        help=f"what moves the simulated device: {'; '.join(HANDS)} (default: {MOUSE})",
    )  # fmt: skip
    option(
        "--link", default="sim", metavar="sim|serial:PORT|driver:FILE.py",
        help="the simulated device (default), a board at a serial port (auto: the only one on USB) or at "
        "socket://HOST:NUMBER, or hardware with a driver of your own",
    )  # fmt: skip
    option(
        "--force", default="", metavar="netft:HOST",
        help="ATI Net F/T on the network, in place of the board's force channels",
    )  # fmt: skip
    option("--lsl", action="store_true", help="stream ticks and markers to the Lab Streaming Layer")
    option("--rules", choices=RULES, help="rule set in place of the protocol's")
    least_gain = "N s/m of the lowest-gain proportional controller, in place of the protocol's"
    option("--low-gain", type=GAIN, metavar="NUMBER", help=least_gain)
    option("--seed", type=whole_number_of(0), metavar="N", help="of the trial order, in place of the protocol's")
    participant = "label of the participant (default: the first without a session)"
    option("--participant", type=label_of_participant, metavar="01", help=participant)
    folder = "folder of the sessions (default: that of the settings, else phd-data in your home folder)"
    option("--data-dir", **{**DATA_DIR, "default": None, "help": folder})
    option("--theme", choices=("dark", "light"), help="of the windows (default: that of the settings)")
    option("--print-plan", action="store_true", help="print the participant's trials in order and open no window")


def label_of_participant(text: str) -> str:
    """The type of an argument: letters and digits."""
    try:
        return participant_label(text)
    except InputError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def run(args: argparse.Namespace) -> int | None:
    port = port_of(args)
    if args.print_plan:
        plan_verb(args)
        return None
    link = checked_link(port, args.force)
    if args.lsl:
        load_pylsl()  # InputError: before any window
    display = ScreenCheck("open a window on")
    devices = tuple(map(absolute_or_name, args.device)) if args.device else None
    setup = Setup(
        data_dir_of(args).absolute(), absolute_or_name(args.protocol), devices, args.rules, args.low_gain, args.seed,
        args.input, args.participant or "", link, lsl=args.lsl,
    )  # fmt: skip
    if not is_person(setup.hand):
        if without := ignored_features(setup, protocol_of(args)):
            print(f"phd: {without}", file=sys.stderr)
    client = Client(setup)
    try:  # while the session server starts
        watch_compiling()
        memory = import_window_module("widgets.memory")
        memory.begin()
        palette.choose(args.theme or memory.remembered(memory.DARK_OR_LIGHT))
        program = import_window_module("program")
        display.check(memory.scale())
        program.make_ready()
        if not program.compile_kernels():
            client.stop("the set-up was closed")
            return 0
    except BaseException:
        client.stop("no window was opened")
        raise
    return program.run(client)


def data_dir_of(args: argparse.Namespace) -> Path:
    """The data folder of the command line, else of the settings."""
    if args.data_dir is not None:
        return args.data_dir
    memory = import_window_module("widgets.memory")
    memory.begin()
    return Path(memory.remembered(memory.DATA_FOLDER))


def port_of(args: argparse.Namespace) -> str:
    """The port of --link, which need not exist; "": simulated. InputError: wrong, or not with --input or --force."""
    if args.link == "sim":
        if args.force:
            raise InputError("--force: goes with --link serial:PORT (the simulated device needs no force sensor)")
        return ""
    from hardware.serial_port import is_address

    if args.link.startswith(DRIVER):
        if args.force:
            raise InputError("--force: goes with --link serial:PORT (a driver of your own reads its own sensor)")
        return f"{DRIVER}{Path(args.link.removeprefix(DRIVER)).absolute()}"
    port = args.link if is_address(args.link) else args.link.removeprefix("serial:")
    if not port or (port == args.link and not is_address(port)):
        raise InputError(f"--link: must be sim, serial:PORT, socket://HOST:NUMBER or driver:FILE.py, not {args.link!r}")
    if "://" in port and not is_address(port):
        raise InputError(f"--link: an address must be socket://HOST:NUMBER, not {port!r}")
    if args.input != MOUSE:
        raise InputError(f"--input {args.input}: on the bench the force sensor measures what the hand does")
    return port


def checked_link(port: str, force: str) -> str:
    """The port and force sensor as in `Setup.link`. InputError: there is no such port, or the sensor is silent."""
    if not port:
        return ""
    from hardware.serial_port import find_port, is_missing

    if port.startswith(DRIVER):
        load_driver(port)
        return port
    found = find_port(port)  # "auto" is looked for again for each device
    if is_missing(found):
        raise InputError(f"--link serial:{found}: there is no such port (phd doctor lists those there are)")
    if not force:
        return port
    from hardware.sensing.net_ft import check_force

    check_force(force)
    return f"{port} {force}"


def protocol_of(args: argparse.Namespace) -> Protocol:
    """The protocol with the options of the command line."""
    protocol = load_protocol(
        args.protocol, devices=args.device, rules=args.rules, low_gain=args.low_gain, seed=args.seed
    )
    protocol.refuse_unknown_low_gain()
    return protocol


def plan_verb(args: argparse.Namespace) -> None:
    from experiments.analysis.own_measures import own_metrics
    from experiments.store.files import free_participant

    protocol = protocol_of(args)
    own_metrics(protocol)  # InputError: its own measures cannot be used
    participant = args.participant or free_participant(data_dir_of(args), protocol.participants)
    if is_person(args.input):
        protocol.refuse_stranger(participant)
    print(print_plan(protocol, participant), end="")


def absolute_or_name(name_or_path: str) -> str:
    """The absolute path of a file; a shipped name as it is."""
    path = Path(name_or_path)
    return str(path.absolute()) if path.is_file() else name_or_path
