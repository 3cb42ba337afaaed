"""`phd bench`: how accurate the simulator is at which speed; how punctual the control loop is."""

import argparse
import json
from pathlib import Path

from app.verbs.common import add_verb, print_result, whole_number_of, with_progress
from core.files import InputError


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "bench", bench, "measure the simulator's speed against its error\n"
        "Four scenes on two bench devices, steps of 5 to 0.1 ms, each integrator; MuJoCo beside them where it\n"
        "is installed (pip install -c constraints.txt '.[bench]'). The reference is checked against scipy\n"
        "DOP853 on Eq. (5) in the same run. Times are the least of several repeats: compare ratios, and let nothing\n"
        "else run beside it.\n"
        "--loop instead: how late the ticks of live trials of a simulated operator come on this machine, with and\n"
        "without the real-time privilege, alone or with a busy process for each processor core. Stolen:\n"
        "what the host of a virtual machine kept the loop's core from it; nothing here can help that.",
        "phd bench --out bench-1", prints="the result",
    ).add_argument  # fmt: skip
    option("--quick", action="store_true", help="one device, two step lengths, fewer repeats")
    loop = "measure the control loop's lateness instead, so long in each case (default: 15)"
    option("--loop", nargs="?", type=whole_number_of(1), const=15, metavar="SECONDS", help=loop)
    option("--out", type=Path, metavar="DIR", help="new folder for bench.json and the work-precision plot")


def bench(args: argparse.Namespace) -> None:
    if args.loop is not None:
        return bench_loop(args)
    out = args.out
    if out is not None and out.exists():
        raise InputError(f"--out: {out}: exists already and is never overwritten")
    if out is not None and not out.parent.is_dir():
        raise InputError(f"--out: {out}: there is no folder {out.parent}")
    from experiments.benchmark.bench import run_bench
    from experiments.benchmark.bench_tables import table, work_precision

    result = with_progress("measuring", run_bench, args.quick, compiles=True)
    print_result(args, result, table(result))
    if out is not None:
        pictures = work_precision(result)
        out.mkdir()
        (out / "bench.json").write_text(json.dumps(result, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
        for form, data in pictures.items():
            (out / f"work-precision.{form}").write_bytes(data)


def bench_loop(args: argparse.Namespace) -> None:
    """Measure how late the control loop's ticks are."""
    if args.out is not None or args.quick:
        raise InputError("--loop: takes neither --out nor --quick")
    from app.verbs.loop_lateness import measure_all, table

    measured = with_progress("measuring", measure_all, args.loop, compiles=True)
    print_result(args, measured, table(measured))
