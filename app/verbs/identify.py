"""`phd identify`: a brake file from measured current steps."""

import argparse
import math
import sys
from pathlib import Path

from app.progress import Progress
from app.verbs.common import add_verb, print_summary


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "identify",
        identify_verb,
        "fit a brake to measured current steps",
        "STEPS.csv: columns t_s (0 where the current changes), current_from_A, current_to_A, speed_rpm, torque_N_m,\n"
        "step_index (tells repeats apart, which are averaged). Eq. (4) takes the current stepped to: falling steps\n"
        "that all end at one current do not tell its a_1, a_3 and a_5.",
        "phd identify steps.csv --out brake.toml --figures figures",
    )
    verb.add_argument("steps", type=Path, metavar="STEPS.csv", help="the measured steps")
    verb.add_argument("--out", type=Path, required=True, metavar="BRAKE.toml", help="a new brake file")
    verb.add_argument("--figures", type=Path, metavar="DIR", help="draw Figs. 6 to 8 there")
    verb.add_argument("--name", help="the brake's name (default: that of the file)")
    verb.add_argument(
        "--omega-0",
        type=_positive,
        metavar="RPM",
        help="speed from which the time constant is a_avg (default: the measured speed that fits best)",
    )
    verb.add_argument(
        "--backlash-deg",
        type=_backlash,
        metavar="DEG",
        help="goes into the file as it is: steps do not show it (default: 0.75, assumed)",
    )
    verb.add_argument("--json", action="store_true", help="print numbers, intervals and residuals as JSON")


def identify_verb(args: argparse.Namespace) -> int:
    from experiments.identify.identify import identify, summary

    with Progress("identifying") as progress:
        found, brake, figures = identify(
            args.steps, args.out, args.name, args.figures, args.omega_0, args.backlash_deg, progress
        )
    told = summary(found, args.backlash_deg)
    for warning in told["warnings"]:
        print(f"warning: {warning}", file=sys.stderr)
    if args.json:
        print_summary({"brake": brake.name, "out": str(args.out), "figures": [*map(str, figures)]} | told, True)
        return 0
    print(f"{args.out}: {brake.name}, {told['steps']} steps, averaged to {told['averaged_steps']}")
    print(f"{'':12}{'value':>12}{'95 % interval':>26}")
    for row in told["parameters"]:
        interval = f"{row['low']:#.4g} .. {row['high']:#.4g}"
        print(f"{row['name']:12}{row['value']:#12.4g}{interval:>26}  {row['unit']}")
    print(f"omega_0     {found.omega_0_rpm:12.5g}{'':26}  rpm, {told['omega_0_by']}")
    print(
        f"residuals (rms): steady torque {told['torque_residual_rms_N_m']:.3g} N m, "
        f"time constant {told['time_constant_residual_rms_s'] * 1e3:.3g} ms"
    )
    print("assumed: " + "; ".join(f"{key} ({why})" for key, why in told["assumed"].items()))
    if found.set_aside:
        print(f"without a clear transient, not used for Eq. (4): {', '.join(told['set_aside'])}")
    for path in figures:
        print(path)
    return 0


def _positive(text: str) -> float:
    return _number(text, 0.0, math.inf, "must be a number greater than 0")


def _backlash(text: str) -> float:
    return _number(text, -1e-300, 360.0, "must be at least 0 and less than 360 degrees")


def _number(text: str, above: float, below: float, reason: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not above < number < below:
        raise argparse.ArgumentTypeError(f"{reason}, not {text!r}")
    return number
