"""`phd verify`: is everything that was recorded whole?"""

import argparse
import sys
from pathlib import Path

from app.progress import Progress
from app.verbs.common import add_verb, print_summary


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "verify",
        verify_verb,
        "check that every recording of a folder is whole, or marked as recovered",
        "Writes nothing. Exit 0: it is so (an unfinished plan is no fault). Exit 1: each damaged batch, missing\n"
        "recording, trial that was cut off, and table that disagrees is named.",
        "phd verify study-1",
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="a folder that phd study or phd run has written")
    verb.add_argument("--json", action="store_true", help="print what was found as JSON")


def verify_verb(args: argparse.Namespace) -> int:
    from experiments.session.verify import verify

    with Progress("verifying") as progress:
        found = verify(args.dir, progress)
    for doubt in found["warnings"]:
        print(f"warning: {doubt['file']}: {doubt['warning']}", file=sys.stderr)
    counts = {**found, "faults": len(found["faults"]), "in_doubt": len(found["warnings"]), "warnings": []}
    print_summary(found if args.json else counts, args.json)
    if not args.json:
        for fault in found["faults"]:
            print(f"{fault['file']}: {fault['fault']}")
    return 1 if found["faults"] else 0
