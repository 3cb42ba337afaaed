"""The verbs on simulated operators: `phd study`, or a sweep of many, and `phd sensitivity`."""

import argparse
from pathlib import Path

from app.verbs.common import (
    DEVICES,
    FIGURES,
    RULES,
    RUN_OWN_CODE,
    add_verb,
    ask_own_code,
    low_gain,
    number_between,
    print_result,
    summary_text,
    whole_number_of,
    with_progress,
)
from core.files import InputError
from core.own_consent import OPTION
from experiments.assumptions import SENSINGS
from experiments.protocol import load_protocol
from experiments.trial.population import SHIPPED_FOLDER, USUAL, load_population

#: The sweep that ships; its protocol has the same name.
ARENA = "arena"
#: Of a study that is new; one that is resumed has as many as it had.
OPERATORS = 3
SIMULATED_PEOPLE, LEAST_SIMULATED = 100, 30  # of `phd power`
#: What may be asked for in place of what the protocol has.
OVERRIDES = ("seed", "rules", "low_gain", "sensing")
#: What the file of a sweep decides.
IN_SWEEP_FILE = ("protocol", "operators", "population", "device", *OVERRIDES)


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "study", study, "run the paper's whole study, or another protocol's, with simulated operators\n"
        "Per operator, by the paper's protocol: 2 paths x 2 devices x 5 controllers x 3 trials. Leaves recordings,\n"
        "trials.csv, box plots and statistics. The same seed gives the same trials.csv. An interrupted study goes on\n"
        "with --resume: the trial that was cut off is kept as recovered and run again. That operator's further trials\n"
        "start from devices just switched on: not the ones, bit by bit, of a study that was not interrupted.",
        "phd study --operators 3 --seed 1 --out study-1", prints="the summary",
    ).add_argument  # fmt: skip
    option(
        "protocol", nargs="?", metavar="PROTOCOL.toml",
        help="protocol file or shipped name (default: paper); arena: the shipped sweep, which ranks controllers",
    )  # fmt: skip
    option("--operators", type=whole_number_of(1), metavar="N", help=f"simulated operators (default: {OPERATORS})")
    option("--seed", type=whole_number_of(0), metavar="N", help="of everything random (default: the protocol's)")
    option("--device", **{**DEVICES, "help": "shipped names or device files (default: the protocol's)"})
    option("--rules", choices=RULES, help="rule set (default: the protocol's)")
    option(
        "--low-gain", type=low_gain, metavar="NUMBER|'no vibration'",
        help="N s/m of the lowest-gain proportional controller, or the paper's rule (default: the protocol's)",
    )  # fmt: skip
    option(
        "--sensing", choices=SENSINGS,
        help="whether controllers see the true motion or encoder counts (default: the protocol's)",
    )  # fmt: skip
    option("--population", metavar="NAME|PATH", help=f"shipped name or population file (default: {USUAL})")
    option("--figures", **FIGURES)
    option("--resume", action="store_true", help="continue the interrupted study in DIR")
    option(OPTION, **RUN_OWN_CODE)
    option(
        "--sweep", metavar="FILE.toml",
        help="run every combination of a sweep file's values instead, without recordings, into DIR/sweep.csv",
    )  # fmt: skip
    option("--cluster", metavar="ADDRESS", help="run the sweep on this Dask scheduler (tcp://HOST:8786)")
    option("--out", type=Path, required=True, metavar="DIR", help="new or empty folder")
    option = add_verb(
        verbs, "sensitivity", sensitivity, "vary what the paper does not give: find which of its statements hold\n"
        "Each sample is a study of three simulated people by the paper's protocol, without recordings, with values\n"
        "drawn from ranges, and is judged by boxes as the paper judges. Leaves DIR/sensitivity.csv, a row a trial,\n"
        "and DIR/report: in which share of the samples each statement holds, what decides it, which statements\n"
        "contradict each other, and what to measure first. Killed, it goes on with --resume to the same table;\n"
        "neither the number of cores nor the order of work changes a digit. The ranges of the paper ship as paper.",
        "phd sensitivity paper --n 3000 --out sensitivity-1", prints="the summary",
    ).add_argument  # fmt: skip
    option("ranges", metavar="RANGES.toml", help="ranges file or shipped name (paper)")
    option("--n", type=whole_number_of(1), default=3000, metavar="N", help="number of samples (default: 3000)")
    option("--seed", type=whole_number_of(0), default=1, metavar="N", help="of everything random (default: 1)")
    option("--resume", action="store_true", help="continue the interrupted run in DIR, with the same arguments")
    option("--cluster", metavar="ADDRESS", help="run it on this Dask scheduler (tcp://HOST:8786)")
    option("--out", type=Path, required=True, metavar="DIR", help="new or empty folder")
    option = add_verb(
        verbs, "power", power_verb, "find how many people an experiment needs to tell two controllers apart\n"
        "By the test that phd analyze will use: signed-rank on each person's mean, Holm over all pairs.\n"
        "From simulated people of several populations. The number has an interval, that of hanging on the people it\n"
        "was found from. Leaves DIR/power.csv and DIR/power.png.",
        "phd power paper --between 1 3 --measure path_error_m --out power-1", prints="the summary",
    ).add_argument  # fmt: skip
    option("protocol", metavar="PROTOCOL.toml", help="protocol file or shipped name")
    option("--between", nargs=2, required=True, metavar="CONTROLLER", help="two controllers, by name or number")
    option("--measure", default="path_error_m", metavar="NAME", help="column of trials.csv (default: path_error_m)")
    option("--power", type=number_between(0.0, 1.0, "a share between 0 and 1"), default=0.8, metavar="SHARE",
           help="share of studies that find the difference (default: 0.8)")  # fmt: skip
    option("--population", nargs="+", metavar="NAME|PATH", help="shipped names or files (default: all shipped)")
    option("--people", type=whole_number_of(LEAST_SIMULATED, 10_000), metavar="N",
           default=SIMULATED_PEOPLE,
           help=f"number simulated of each population (default: {SIMULATED_PEOPLE})")  # fmt: skip
    option("--out", type=Path, required=True, metavar="DIR", help="new or empty folder")


def power_verb(args: argparse.Namespace) -> None:
    from experiments.study.power import power, question_of

    protocol = load_protocol(args.protocol)
    question = question_of(protocol, args.between, args.measure, args.power)
    names = args.population or sorted(path.stem for path in SHIPPED_FOLDER.glob("*.toml"))
    populations = {found.name: found for found in map(load_population, names)}
    summary = with_progress("power", power, protocol, question, populations, args.people, args.out, compiles=True)
    print_result(args, summary, summary_text(summary))


def study(args: argparse.Namespace) -> None:
    if args.protocol == ARENA and args.sweep is None:
        args.sweep, args.protocol = ARENA, None
    if args.sweep is not None:
        return sweep(args)
    if args.cluster:
        raise InputError("--cluster: is for --sweep alone, a study runs on this machine")
    from experiments.analysis.chart_figures import SCREEN
    from experiments.study.study import resume_study, run_study

    overrides = {name: getattr(args, name) for name in OVERRIDES if getattr(args, name) is not None}
    named = "paper" if args.protocol is None else args.protocol  # an empty name is refused, as a shell gives it
    protocol = load_protocol(named, devices=args.device, **overrides)
    population = load_population(USUAL if args.population is None else args.population)
    if args.resume:
        ask_own_code(args.out, args.run_own_code)
        given = {"operators": args.operators, "devices": args.device and protocol.devices}
        given |= {"protocol": args.protocol and protocol, "population": args.population and population}
        asked = overrides | {name: value for name, value in given.items() if value}
        summary = with_progress("study", resume_study, args.out, asked, args.figures or SCREEN, compiles=True)
    else:
        operators = args.operators or OPERATORS
        summary = with_progress(
            "study", run_study, args.out, operators, protocol, population, args.figures or SCREEN, compiles=True
        )
    doubt = (
        f"{args.out}: the energy ledger contradicts the motion of {summary['in_doubt']} trials, which may be wrong; "
        "phd verify names them"
    )
    print_result(args, summary, summary_text(summary), [doubt] if summary["in_doubt"] else [])


def sweep(args: argparse.Namespace) -> None:
    from experiments.study.sweep import load_sweep, run_sweep

    if args.figures:
        raise InputError("--figures: a sweep draws its figure in one way")
    for name in IN_SWEEP_FILE:
        if getattr(args, name) is not None:
            option = "PROTOCOL.toml" if name == "protocol" else f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: stands in the file of a sweep, {args.sweep}")
    found = load_sweep(args.sweep)
    summary = with_progress("sweep", run_sweep, found, args.out, args.resume, args.cluster, compiles=True)
    print_result(args, summary, summary_text(summary))


def sensitivity(args: argparse.Namespace) -> None:
    from experiments.sensitivity.ranges import load_ranges
    from experiments.sensitivity.run import SensitivityRun, run_sensitivity

    run = SensitivityRun(load_ranges(args.ranges), args.n, args.seed)
    summary = with_progress("sensitivity", run_sensitivity, run, args.out, args.resume, args.cluster, compiles=True)
    print_result(args, summary, summary_text(summary))
