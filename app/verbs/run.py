"""`phd run`, or `phd` alone: the app."""

import argparse
from pathlib import Path

from app.verbs.common import add_devices, add_verb, devices_of, label
from core.errors import InputError


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
    verb.add_argument("--participant", type=label, default="01", metavar="01", help="who moves the handle")
    verb.add_argument(
        "--data-dir",
        type=Path,
        default=Path("data"),
        metavar="DIR",
        help="where sessions are kept (default: data)",
    )


def run(args: argparse.Namespace) -> int:
    args.devices = devices_of(args)
    try:
        from app import window
    except ImportError as error:
        if ".so" not in str(error):
            raise
        raise InputError(f"the window cannot be opened, a system library is missing: {error}") from None
    return window.run(args) or 0
