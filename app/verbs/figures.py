"""`phd figures`: the paper's figures again, from our models."""

import argparse
import json
from pathlib import Path

from app.progress import Progress, announce_first_use
from app.verbs.common import add_devices, add_verb, devices_of


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "figures",
        figures,
        "remake the paper's Figs. 1 and 4 to 14 from our models",
        "Each as PNG and PDF. No data of the paper are drawn; what rests on assumed parameters says so.\n"
        "Files that exist are never overwritten. Prints the files.",
        "phd figures --out figures",
    )
    add_devices(verb)
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="the folder for the figures")
    verb.add_argument("--json", action="store_true", help="print names, contents and files as JSON")


def figures(args: argparse.Namespace) -> int:
    devices = devices_of(args)
    from experiments.paper_figures import draw_all

    announce_first_use()
    with Progress("drawing") as progress:
        drawn = draw_all(devices, args.out, progress)
    if args.json:
        print(json.dumps([figure._asdict() | {"files": [str(file) for file in figure.files]} for figure in drawn]))
    else:
        for figure in drawn:
            for file in figure.files:
                print(f"{file}: {figure.shows}")
    return 0
