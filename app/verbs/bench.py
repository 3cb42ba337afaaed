"""`phd bench`: how accurate the simulator is at which speed."""

import argparse
import json
from pathlib import Path

from app.progress import Progress, announce_first_use
from app.verbs.common import add_verb
from core.errors import InputError


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "bench",
        bench,
        "measure the simulator's speed against its error",
        "Four scenes on two bench devices, steps of 5 to 0.1 ms, each integrator; MuJoCo beside them where it is\n"
        "installed (pip install '.[bench]'). The reference is checked against scipy DOP853 on Eq. (5) in the same\n"
        "run. Times are the least of several repeats: compare ratios, and let nothing else run beside it.",
        "phd bench --out bench-1",
    )
    verb.add_argument("--quick", action="store_true", help="one device, two steps, fewer repeats")
    verb.add_argument("--json", action="store_true", help="print the result as JSON instead of a table")
    verb.add_argument("--out", type=Path, metavar="DIR", help="a new folder for bench.json and the work-precision plot")


def bench(args: argparse.Namespace) -> int:
    if args.out is not None:
        if args.out.exists():
            raise InputError(f"--out: {args.out}: exists already and is never overwritten")
        if not args.out.parent.is_dir():
            raise InputError(f"--out: {args.out}: there is no folder {args.out.parent}")
    from experiments.bench import run_bench
    from experiments.bench_report import table, work_precision

    announce_first_use()
    with Progress("measuring") as progress:
        result = run_bench(args.quick, progress)
    text = json.dumps(result, allow_nan=False)
    print(text if args.json else table(result))
    if args.out is not None:
        pictures = work_precision(result)
        args.out.mkdir()
        (args.out / "bench.json").write_text(text + "\n", encoding="utf-8")
        for form, data in pictures.items():
            (args.out / f"work-precision.{form}").write_bytes(data)
    return 0
