"""`phd recover`: rescue what a crash left."""

import argparse
from pathlib import Path

from app.progress import Progress
from app.verbs.common import add_verb, print_summary


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "recover",
        recover_verb,
        "rescue what a crash left: every whole batch of a trial that was cut off",
        "The trial gets a recording and a row marked as recovered; the file that the crash left is kept beside it.\n"
        "Exit 0: phd verify finds no fault any more. Exit 1: what is left is named. A folder that a running process\n"
        "uses is refused. phd study --resume does the same before it goes on.",
        "phd recover study-1",
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="a folder that phd study or phd run has written")
    verb.add_argument("--json", action="store_true", help="print what was done as JSON")


def recover_verb(args: argparse.Namespace) -> int:
    from experiments.session.recover import recover

    with Progress("recovering") as progress:
        done = recover(args.dir, progress)
    if args.json:
        print_summary(done, True)
    else:
        lists = {name: entries for name, entries in done.items() if isinstance(entries, list)}
        print_summary({**done, **{name: len(entries) for name, entries in lists.items()}}, False)
        for name, entries in lists.items():
            for entry in entries:
                said = f"{entry['file']}: {entry['fault']}" if name == "faults" else entry
                print(f"{name.replace('_', ' ')}: {said}")
    return 1 if done["faults"] or done["not_rescued"] else 0
