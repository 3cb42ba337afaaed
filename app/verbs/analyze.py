"""`phd analyze`: every number and figure again, from the recordings alone."""

import argparse
import getpass
from pathlib import Path

from app.progress import Progress
from app.verbs.common import add_verb, print_summary


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "analyze",
        analyze_verb,
        "rebuild every number and figure of a study from its recordings alone",
        "Writes into a new folder; never touches the files of DIR. A recording that is damaged is left out and named,\n"
        "and what that changes in each box is said, compared with the trials.csv of DIR; it still exits 0, where phd\n"
        "verify exits 1. Which trials were skipped or done again later, the journals in DIR say.",
        "phd analyze study-1 --out study-1-again",
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="a folder that phd study or phd run has written")
    verb.add_argument("--out", type=Path, metavar="OUT", help="a new folder (default: DIR/analysis-N)")
    verb.add_argument(
        "--unblind",
        action="store_true",
        help="open the keys of blind sessions for this analysis; who did it, and when, is written into their journals",
    )
    verb.add_argument(
        "--beside",
        type=Path,
        nargs="+",
        default=[],
        metavar="DIR",
        help="further studies: the findings of all, from their trials.csv, side by side in OUT/side-by-side.md",
    )
    verb.add_argument(
        "--timeouts",
        action="store_true",
        help="put trials whose time was up into boxes and statistics, which leave them out otherwise",
    )
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def analyze_verb(args: argparse.Namespace) -> int:
    from experiments.study.analyze import analyze, read_studies, write_side_by_side

    studies = read_studies([args.dir, *args.beside]) if args.beside else {}
    with Progress("analyzing") as progress:
        summary = analyze(args.dir, args.out, progress, getpass.getuser() if args.unblind else "", args.timeouts)
    if studies:
        summary["side_by_side"] = str(write_side_by_side(studies, Path(summary["out"])))
    if args.json:
        print_summary(summary, True)
        return 0
    warnings = summary.pop("warnings")
    lists = {name: entries for name, entries in summary.items() if isinstance(entries, list)}
    print_summary({**summary, **{name: len(entries) for name, entries in lists.items()}}, False)
    for name, entries in lists.items():
        for entry in entries:
            print(f"{name.replace('_', ' ')}: {entry}")
    print_summary({"warnings": warnings}, False)
    return 0
