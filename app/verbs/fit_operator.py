"""`phd fit-operator`: a population file from the recorded trials of people."""

import argparse
from pathlib import Path

from app.verbs.common import FOLDER, add_verb, answer, with_progress


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "fit-operator", fit_operator_verb, "fit simulated operators to the recorded trials of people",
        "Reads the trials that reached the end of a straight path: motion and force of the handle, path and phases,\n"
        "nothing that a bench could not record. Prints each number with its 95 % interval and what it rests on, and\n"
        "the numbers that cannot be seen, which stay as in --like and are marked assumed. phd study --population FILE\n"
        "then simulates these people: one as fitted, several with mean and sd of people.",
        "phd fit-operator data --participant 01 --out people.toml", prints="numbers and intervals",
    ).add_argument  # fmt: skip
    option("folder", **FOLDER)
    option("--participant", metavar="LABEL", help="this one alone (default: everyone in the folder)")
    option("--like", default="average", metavar="NAME|PATH", help="population of the other numbers (default: average)")
    option("--out", type=Path, metavar="FILE.toml", help="a new population file")


def fit_operator_verb(args: argparse.Namespace) -> None:
    from experiments.trial.population import load_population

    like = load_population(args.like)
    from experiments.operator_fit.fit import fit_operator

    found = with_progress("fitting", fit_operator, args.folder, args.participant, args.out, like)
    lines = []
    for one in found:
        lines += [f"participant {one.participant}, {one.trials} trials", f"{'':22}{'value':>9}{'95 % interval':>20}"]
        for number in one.numbers:
            interval = f"{number.low:.3g} .. {number.high:.3g}"
            lines.append(f"{number.name:22}{number.value:9.4g}{interval:>20}  {number.rests_on}")
        lines.append(f"not seen, assumed as in {like.name}: {', '.join(one.unseen)}")
    people = [
        {"participant": one.participant, "trials": one.trials, "unseen": one.unseen}
        | {"numbers": [number._asdict() for number in one.numbers]}
        for one in found
    ]
    lines += [str(args.out)] if args.out else []
    answer(args, {"like": like.name, "out": args.out and str(args.out), "people": people}, "\n".join(lines))
