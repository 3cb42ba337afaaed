"""`phd worlds`: which sets of assumptions produce the paper's findings."""

import argparse
from pathlib import Path

from app.verbs.common import add_verb, answer, as_text, whole_number_of, with_progress


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "worlds", worlds, "draw sets of assumptions from ranges and ask which produce the paper's findings",
        "Each world is a study of three simulated people by the paper's protocol, without recordings, under\n"
        "assumptions drawn from the ranges, and is judged by boxes as the paper judges. Leaves DIR/worlds.csv, a row\n"
        "a world, and DIR/report: the share of worlds in which each statement holds, which assumption decides it, the\n"
        "nearest world to the paper, and what to measure first. Killed, it goes on with --resume to the same table;\n"
        "neither the number of cores nor the order of work changes a digit. The ranges of the paper ship as paper.",
        "phd worlds paper --n 10000 --out worlds-1", prints="the summary",
    ).add_argument  # fmt: skip
    option("ranges", metavar="RANGES.toml", help="a ranges file, or a shipped one's name (paper)")
    option("--n", type=whole_number_of(1), default=10_000, metavar="N", help="how many worlds (default: 10000)")
    option("--seed", type=whole_number_of(0), default=1, metavar="N", help="of everything random (default: 1)")
    option("--resume", action="store_true", help="go on with the interrupted run in DIR, begun with the same arguments")
    option("--cluster", metavar="ADDRESS", help="run it on this Dask scheduler (tcp://HOST:8786)")
    option("--out", type=Path, required=True, metavar="DIR", help="a new or empty folder")


def worlds(args: argparse.Namespace) -> None:
    from experiments.worlds.ranges import load_ranges
    from experiments.worlds.worlds import run_worlds

    ranges = load_ranges(args.ranges)
    summary = with_progress(
        "worlds", run_worlds, ranges, args.out, args.n, args.seed, args.resume, args.cluster, compiles=True
    )
    answer(args, summary, as_text(summary))
