"""`phd export`: recordings for other programs."""

import argparse
from pathlib import Path

from app.progress import Progress
from app.verbs.common import add_verb, print_summary
from core.files import InputError

FORMS = ("bids", "csv")


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "export",
        export_verb,
        "write a study's recordings as BIDS-Motion or as CSV",
        "Each into a new folder, whole or not at all; both may be asked for at once. A recording that is damaged or\n"
        "was cut off is left out and named. While a session is blind, controllers keep their codes and what the\n"
        "brakes did is not exported. Answers to the questionnaire go into both, the experimenter's notes into CSV.",
        "phd export study-1 --bids study-1-bids",
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="a folder that phd study or phd run has written")
    verb.add_argument("--bids", type=Path, metavar="OUT", help="a new or empty folder for a BIDS-Motion data set")
    verb.add_argument(
        "--csv", type=Path, metavar="OUT", help="a new or empty folder for CSV: a file a recording, and trials.csv"
    )
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def export_verb(args: argparse.Namespace) -> int:
    outs = {form: getattr(args, form) for form in FORMS if getattr(args, form) is not None}
    if not outs:
        raise InputError("export: nothing to write, --bids OUT or --csv OUT says what (see phd export --help)")
    from experiments.export.export import export

    with Progress("exporting") as progress:
        summary = export(args.dir, outs, progress)
    if args.json:
        print_summary(summary, True)
        return 0
    lists = {name: summary.pop(name) for name in ("left_out", "blind")}
    print_summary({**summary, **{name: len(entries) for name, entries in lists.items()}}, False)
    for name, entries in lists.items():
        for entry in entries:
            print(f"{name.replace('_', ' ')}: {entry}")
    return 0
