"""Random scenes FIRST to LAST (without LAST) beside the independent reference, as a table; about 0.4 s a scene.

`--store` makes the suite's references anew, and says how far the reference is from the known scenes' tips.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import numpy as np  # noqa: E402
from random_scenes import STEPS, random_scene  # noqa: E402
from scene_outcomes import (  # noqa: E402
    SURE_M,
    THINNED,
    Outcome,
    known_scenes,
    outcomes,
    reference,
    store_references,
)

#: Seeds of the suite.
STORED_SEEDS = range(120)


def table(found: list[Outcome]) -> str:
    """One line a step: runs, off by more than a millimetre, warnings, false alarms, energy."""
    lines = ["   step s   runs  silent  warned  false alarms  ledger silent  largest silent m  brakes add J"]
    for step in (*STEPS, None):
        of = [one for one in found if step in (None, one.step_s)]
        silent, wrong = [one for one in of if one.silent], [one for one in of if one.off_m > 1e-3]
        lines.append(
            f"{step or 'all':>9} {len(of):6} {len(silent):7} {len(wrong) - len(silent):7} "
            f"{sum(one.false_alarm for one in of):13} {sum(one.unexplained and not one.warnings for one in of):14} "
            f"{max((one.off_m for one in of if not one.warnings), default=0.0):17.3g} "
            f"{max((one.added_by_brakes_J for one in of), default=0.0):13.3g}"
        )
    return "\n".join(lines)


def main() -> None:
    """Check a range of seeds, or store the suite's references."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=1000)
    parser.add_argument("last", type=int, nargs="?", default=2000)
    parser.add_argument("--store", action="store_true")
    asked = parser.parse_args()
    if asked.store:
        store_references(STORED_SEEDS)
        for name, (device, scene, tips) in known_scenes().items():
            apart = reference(device, scene).tips[::THINNED] - tips
            print(f"{name}: at most {np.hypot(*apart.T).max():.2g} m from the known tips")
        return
    found, unsure = [], 0
    for seed in range(asked.first, asked.last):
        solved = reference(*random_scene(seed))
        if not solved.error[-1] < SURE_M:
            unsure += 1
            continue
        for one in outcomes(f"seed {seed}", *random_scene(seed), solved.tips[::THINNED]):
            found.append(one)
            if one.silent or one.unexplained and not one.warnings:
                print(one, flush=True)
    print(table(found))
    print(f"the reference is not sure of {unsure} of {asked.last - asked.first} scenes: not judged")


if __name__ == "__main__":
    main()
