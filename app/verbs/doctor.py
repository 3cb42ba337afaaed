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
    from app.attached import attached_lines
    from app.doctor import BAD, examine

    lines = examine(args.data_dir, lambda: attached_lines(args.port))
    if args.json:
        print(json.dumps([line._asdict() for line in lines]))
    else:
        coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
        width = max(len(line.name) for line in lines)
        for line in lines:
            mark, colour = MARKS[line.state]
            shown = f"\x1b[{colour}m{mark}\x1b[0m" if coloured else mark
            print(f"{shown}  {line.name:{width}}  {line.found}")
            if line.advice:
                print(f"{'':{width + 6}}{line.advice}")
    return 1 if any(line.state == BAD for line in lines) else 0
