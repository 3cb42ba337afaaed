"""`phd study`: the whole study with simulated operators."""

import argparse
from pathlib import Path

from app.progress import Progress, announce_first_use
from app.verbs.common import add_devices, add_verb, devices_of, print_summary, whole_number_of

#: What a study is that says nothing else; one that is resumed is what it was.
DEFAULTS = {"operators": 3, "seed": 1, "rules": "settled", "low_gain": 5.0}


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "study",
        study,
        "run the paper's whole study with simulated operators",
        "Per operator: 2 segments x 2 devices x 5 controllers x 3 trials. Leaves recordings, trials.csv,\n"
        "box plots and statistics. The same seed gives the same trials.csv. An interrupted study goes on with\n"
        "--resume: the trial that was cut off is kept as recovered and run again. That operator's further trials\n"
        "start from devices just switched on: not the ones, bit by bit, of a study that was not interrupted.",
        "phd study --operators 3 --seed 1 --out study-1",
    )
    verb.add_argument(
        "--operators", type=whole_number_of(1), metavar="N", help=f"how many (default: {DEFAULTS['operators']})"
    )
    verb.add_argument(
        "--seed",
        type=whole_number_of(0),
        metavar="N",
        help=f"of everything random (default: {DEFAULTS['seed']})",
    )
    add_devices(verb)
    verb.add_argument(
        "--rules", choices=("settled", "literal"), help="rule set of the controllers (default: settled)"
    )
    verb.add_argument(
        "--low-gain",
        type=low_gain,
        metavar="5|500",
        help="N s/m of controller 5: 5 as the paper's Table I prints it, or 500 (default: 5)",
    )
    verb.add_argument(
        "--resume",
        action="store_true",
        help="go on with the interrupted study in DIR, by the arguments that it was begun with",
    )
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new or empty folder")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def low_gain(text: str) -> float:
    if text not in ("5", "500"):
        raise argparse.ArgumentTypeError(f"invalid choice: {text!r} (choose from 5, 500)")
    return float(text)


def study(args: argparse.Namespace) -> int:
    asked = {name: getattr(args, name) for name in DEFAULTS if getattr(args, name) is not None}
    if args.device or not args.resume:
        asked["devices"] = devices_of(args)
    from experiments.study import resume_study, run_study

    announce_first_use()
    with Progress("study") as progress:
        if args.resume:
            summary = resume_study(args.out, asked, progress)
        else:
            summary = run_study(args.out, **{**DEFAULTS, **asked}, progress=progress)
    print_summary(summary, args.json)
    return 0
