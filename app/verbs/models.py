"""The verbs on models: `phd simulate` a scene, `phd identify` a brake, draw the paper's figures."""

import argparse
import math
import sys
from contextlib import AbstractContextManager, nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

from app.progress import watch_compiling
from app.verbs.common import DEVICES, add_verb, devices_of, number_between, print_result, with_progress
from experiments.simulate.scene import read_scene, scene_file

KARNOPP = "karnopp, Eq. (6), is for comparison: its band can create energy and diverge; `event` cannot"
#: Displays with two brakes, three, four, and four on the central axis.
MAPPED = ["er-two-brake", "three-brake", "four-brake", "pter"]


def add(verbs: argparse._SubParsersAction) -> None:
    option = add_verb(
        verbs, "simulate", simulate_verb, "simulate one scene without an operator\n"
        "A scene file names a device, a brake schedule and a hand force, or a cobot and a hand force; the motion\n"
        "goes to a CSV file.",
        "phd simulate scene.toml --out motion.csv", prints="the summary",
    ).add_argument  # fmt: skip
    option("scene", metavar="SCENE.toml", help="scene file or shipped name")
    option("--out", required=True, metavar="FILE.csv", help="new file; -: standard output")
    option = add_verb(
        verbs, "identify", identify_verb, "fit a brake to measured current steps\n"
        "STEPS.csv: columns t_s (0 where the current changes), current_from_A, current_to_A, speed_rpm, torque_N_m,\n"
        "step_index (tells repeats apart, which are averaged), in the order in which they were measured. Steps at one\n"
        "speed give Eq. (2) and a constant time constant. With some\n"
        "steps turned the other way (speed and torque below 0) the torque sensor's zero is found. Eq. (4) takes the\n"
        "current stepped to: falling steps that all end at one current do not give its a_1, a_3 and a_5.",
        "phd identify steps.csv --out brake.toml --figures figures", prints="numbers, intervals and residuals",
    ).add_argument  # fmt: skip
    option("steps", type=Path, metavar="STEPS.csv", help="measured steps")
    option("--out", type=Path, metavar="BRAKE.toml", help="new brake file (default: only print the numbers)")
    option("--figures", type=Path, metavar="DIR", help="folder for Figs. 6 to 8")
    option("--name", metavar="NAME", help="of the brake (default: that of the file)")
    option(
        "--omega-0", type=number_between(0.0, math.inf, "a number greater than 0"), metavar="RPM",
        help="speed from which the time constant is a_avg (default: best fit)",
    )  # fmt: skip
    option(
        "--knee", type=number_between(0.0, math.inf, "a number greater than 0"), default=0.2, metavar="A",
        help="current below which Eq. (2) is linear (default: 0.2)",
    )  # fmt: skip
    option(
        "--backlash-deg", type=number_between(-1e-300, 360.0, "at least 0 and less than 360 degrees"),
        metavar="DEG", help="backlash, which steps do not show (default: 0.75, assumed)",
    )  # fmt: skip
    option = add_verb(
        verbs, "figures", figures_verb, "draw the paper's Figs. 1 and 4 to 14 from our models\n"
        "Besides: the shipped displays compared, the guard's stopping distance, a passive master and the Scooter.\n"
        "Each as PNG and PDF. No data of the paper are drawn; what rests on assumed parameters is marked so.\n"
        "Files that exist are never overwritten. Prints the files.",
        "phd figures --out figures", prints="names, contents and files",
    ).add_argument  # fmt: skip
    option("--device", **DEVICES)
    option(
        "--map", choices=("force", "steerability"),
        help="only this map: the force, or the acceleration, that brakes can show across the motion "
        f"(default devices: {' '.join(MAPPED)})",
    )  # fmt: skip
    option("--out", type=Path, required=True, metavar="DIR", help="folder for the figures")


def simulate_verb(args: argparse.Namespace) -> None:
    from experiments.simulate.cobot_scene import is_cobot_scene
    from experiments.simulate.simulate import simulate

    args.scene = scene_file(args.scene)
    if is_cobot_scene(args.scene):
        return simulate_cobot_verb(args)
    scene = read_scene(args.scene)
    if scene.integrator == "karnopp":
        print(f"note: {args.scene}: {KARNOPP}", file=sys.stderr)
    compiling = watch_compiling()
    device = scene.device
    done = with_progress("simulating", simulate, scene, args.out)
    summary = {"device": device.name, "assumed": device.assumed, "fidelity": scene.fidelity}
    summary |= {"integrator": scene.integrator} | done | {"compiling_s": compiling.seconds}
    compiled = f" (and {compiling.seconds:.3g} s of compiling, on first use)" if compiling.seconds else ""
    text = (
        f"{args.out}: {done['rows']} rows, device {device.name}{' (assumed)' if device.assumed else ''}, "
        f"{done['simulated_s']:g} s simulated in {done['wall_s']:.3g} s{compiled}: {done['steps']} steps, "
        f"{done['events']} events, {done['fallbacks']} fallbacks{_beside_obstacles(done)}"
    )
    with summary_to(args.out):
        print_result(args, summary, text, (f"{args.scene}: {warning}" for warning in done["warnings"]))


def summary_to(out: str) -> AbstractContextManager[Any]:
    """Where a scene's summary is printed: on stderr where the motion goes to standard output."""
    return redirect_stdout(sys.stderr) if out == "-" else nullcontext()


def _beside_obstacles(done: dict[str, Any]) -> str:
    """Obstacles in a summary, as the end of a sentence; "": there were none."""
    if "least_obstacle_m" not in done:
        return ""
    words = f"; {1e3 * done['least_obstacle_m']:.3g} mm from an obstacle at least"
    if "guard_ticks" not in done:
        return words
    late = done["guard_too_late_ticks"]
    return f"{words}, locked by the guard in {done['guard_locked_ticks']} of {done['guard_ticks']} ticks" + (
        f" (in {late} too late to be sure)" if late else ""
    )


def simulate_cobot_verb(args: argparse.Namespace) -> None:
    from experiments.simulate.cobot_scene import read_cobot_scene, simulate_cobot

    done = with_progress("simulating", simulate_cobot, read_cobot_scene(args.scene), args.out, compiles=True)
    wall = done["least_distance_from_wall_m"]
    text = (
        f"{args.out}: {done['rows']} rows, cobot {done['cobot']}{' (assumed)' if done['assumed'] else ''}; a servo at "
        f"its limit in {done['rows_with_a_servo_at_its_limit']}, {done['side_force_max_N']:.3g} N sideways at most"
        + ("" if wall is None else f", {1e3 * wall:.3g} mm from the wall at least")
    )
    with summary_to(args.out):
        print_result(args, done, text, (f"{args.scene}: {warning}" for warning in done["warnings"]))


def identify_verb(args: argparse.Namespace) -> None:
    from experiments.identify.identification import ByHand
    from experiments.identify.identify import identify, summary_of_fit, with_zero

    by_hand = ByHand(args.omega_0, args.backlash_deg, args.knee)
    found, brake, figures = with_progress(
        "identifying", identify, args.steps, args.out, args.name, args.figures, by_hand
    )
    fit = summary_of_fit(found)
    lines = [f"{args.out or args.steps}: {brake.name}, {fit['steps']} steps, averaged to {fit['averaged_steps']}"]
    lines += table_of(fit["parameters"], 12)
    lines += [
        f"omega_0     {found.omega_0_rpm:12.5g}{'':26}  rpm, {fit['omega_0_by']}",
        f"k_2 is the drag without current{with_zero(found)}",
        found.transients.reach,
        f"residuals (rms): steady torque {fit['torque_residual_rms_N_m']:.3g} N m, "
        f"time constant {fit['time_constant_residual_rms_s'] * 1e3:.3g} ms",
        "assumed: " + "; ".join(f"{key} ({why})" for key, why in fit["assumed"].items()),
    ]
    if found.set_aside:
        lines.append(f"without a clear transient, not used for Eq. (4): {', '.join(fit['set_aside'])}")
    files = [str(path) for path in figures]
    result = {"brake": brake.name, "out": args.out and str(args.out), "figures": files} | fit
    print_result(args, result, "\n".join([*lines, *files]), fit["warnings"])


def table_of(numbers: list[dict[str, Any]], width: int) -> list[str]:
    """Names (of this width), values and 95 % intervals, as lines."""
    lines = [f"{'':{width}}{'value':>12}{'95 % interval':>26}"]
    for row in numbers:
        interval = "withheld" if row["low"] is None else f"{row['low']:#.4g} .. {row['high']:#.4g}"
        lines.append(f"{row['name']:{width}}{row['value']:#12.4g}{interval:>26}  {row['unit']}")
    return lines


def figures_verb(args: argparse.Namespace) -> None:
    from experiments.paper_figures import draw_all

    if args.map and not args.device:
        args.device = MAPPED
    drawn = with_progress("drawing", draw_all, devices_of(args), args.out, args.map, compiles=True)
    found = [figure._asdict() | {"files": [str(file) for file in figure.files]} for figure in drawn]
    print_result(args, found, "\n".join(f"{file}: {figure['shows']}" for figure in found for file in figure["files"]))
