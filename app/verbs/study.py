"""`phd study`: the whole study with simulated operators."""

import argparse
from pathlib import Path

from app.progress import Progress, announce_first_use
from app.verbs.common import add_devices, add_verb, devices_of, print_summary, whole_number_of


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "study",
        study,
        "run the paper's whole study with simulated operators",
        "Per operator: 2 segments x 2 devices x 5 controllers x 3 trials. Leaves recordings, trials.csv,\n"
        "box plots and statistics. The same seed gives the same trials.csv.",
        "phd study --operators 3 --seed 1 --out study-1",
    )
    verb.add_argument("--operators", type=whole_number_of(1), default=3, metavar="N", help="how many (default: 3)")
    verb.add_argument(
        "--seed", type=whole_number_of(0), default=1, metavar="N", help="of everything random (default: 1)"
    )
    add_devices(verb)
    verb.add_argument(
        "--rules",
        choices=("settled", "literal"),
        default="settled",
        help="rule set of the controllers (default: settled)",
    )
    verb.add_argument(
        "--low-gain",
        choices=("5", "500"),
        default="5",
        help="N s/m of controller 5: 5 as the paper's Table I prints it, or 500 (default: 5)",
    )
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new or empty folder")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def study(args: argparse.Namespace) -> int:
    devices = devices_of(args)
    from experiments.study import run_study

    announce_first_use()
    with Progress("study") as progress:
        summary = run_study(
            args.out,
            operators=args.operators,
            seed=args.seed,
            devices=devices,
            rules=args.rules,
            low_gain=float(args.low_gain),
            progress=progress,
        )
    print_summary(summary, args.json)
    return 0
