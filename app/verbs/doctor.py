"""`phd doctor`: check this machine."""

import argparse
import json
import os
import sys
from pathlib import Path

from app.verbs.common import add_verb

#: state -> mark, colour on a terminal
MARKS = {"good": ("ok", "32"), "caution": ("--", "33"), "bad": ("NO", "31")}


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "doctor",
        doctor,
        "check this machine: libraries, screens, scheduling, disk, ports and hands",
        "Says what to do about everything that is not as it should be. Changes nothing.\n"
        "Exit 0: trials can be run. Exit 1: something marked NO stands in the way.",
        "phd doctor --data-dir data",
    )
    verb.add_argument(
        "--data-dir", type=Path, default=Path("data"), metavar="DIR", help="where recordings would go (default: data)"
    )
    verb.add_argument(
        "--port", action="append", default=[], metavar="PORT", help="ask for a board there; may be given repeatedly"
    )
    verb.add_argument("--json", action="store_true", help="print the findings as JSON")


def doctor(args: argparse.Namespace) -> int:
    from app.doctor import examine
    from app.ipc.messages import BAD

    checks = examine(args.data_dir, args.port)
    if args.json:
        print(json.dumps([dict(zip(("name", "state", "found", "advice"), check, strict=True)) for check in checks]))
    else:
        coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
        width = max(len(check.name) for check in checks)
        for check in checks:
            mark, colour = MARKS[check.state]
            shown = f"\x1b[{colour}m{mark}\x1b[0m" if coloured else mark
            print(f"{shown}  {check.name:{width}}  {check.text}")
            if check.advice:
                print(f"{'':{width + 6}}{check.advice}")
    return 1 if any(check.state == BAD for check in checks) else 0
