"""`phd simulate`: one scene, no operator."""

import argparse
import sys
import time
from dataclasses import asdict
from pathlib import Path

from app.progress import Progress, announce_first_use
from app.verbs.common import add_verb, print_summary

KARNOPP = "karnopp, Eq. (6), is for comparison: its band can create energy and diverge; `event` cannot"


def add(verbs) -> None:
    verb = add_verb(
        verbs,
        "simulate",
        simulate_verb,
        "simulate one scene without an operator",
        "A scene file names a device, a brake schedule and a hand force; the motion goes to a CSV file.",
        "phd simulate scene.toml --out motion.csv",
    )
    verb.add_argument("scene", type=Path, metavar="SCENE.toml", help="the scene file")
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.csv", help="a new file")
    verb.add_argument("--json", action="store_true", help="print the summary as JSON")


def simulate_verb(args: argparse.Namespace) -> int:
    from experiments.simulate.scene import read_scene

    scene = read_scene(args.scene)
    from experiments.simulate.simulate import SceneRun, simulate

    if scene.integrator == "karnopp":
        print(f"note: {args.scene}: {KARNOPP}", file=sys.stderr)
    compiling_s = 0.0

    def announced(scene):
        nonlocal compiling_s
        if announce_first_use():
            began = time.perf_counter()
            SceneRun(scene).run_chunk(1)  # compiles what the scene needs
            compiling_s = time.perf_counter() - began
        return SceneRun(scene)

    with Progress("simulating") as progress:
        summary = asdict(simulate(scene, args.out, announced, progress))
    summary["wall_s"] -= compiling_s
    for warning in summary["warnings"]:
        print(f"warning: {args.scene}: {warning}", file=sys.stderr)
    if args.json:
        told = {"device": scene.device.name, "assumed": scene.device.assumed, "fidelity": scene.fidelity}
        print_summary(told | {"integrator": scene.integrator} | summary | {"compiling_s": compiling_s}, True)
    else:
        assumed = " (assumed)" if scene.device.assumed else ""
        compiled = f" (and {compiling_s:.3g} s of compiling, on first use)" if compiling_s else ""
        print(
            f"{args.out}: {summary['rows']} rows, device {scene.device.name}{assumed}, "
            f"{summary['simulated_s']:g} s simulated in {summary['wall_s']:.3g} s{compiled}: {summary['steps']} steps, "
            f"{summary['events']} events, {summary['fallbacks']} fallbacks"
        )
    return 0
