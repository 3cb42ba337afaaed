"""Whether docs/findings.md is what the program gives: new worlds against the shares on the page.

python -m tests.benchmarks.findings_check [N] [SEED]      300 new worlds, seed 2: about eight minutes on two quiet cores

The page's table has a row for each statement: | number | text | 15.8 % (15.1 to 16.6) | .. Its intervals are those of
its worlds, the new worlds have their own (Wilson): a statement differs where the two shares do by more than both
intervals allow at a level of 95 % for all eleven together. Exit code 1: one differs, the page is to be made again.
"""

import math
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from experiments.analysis.findings import STATEMENTS
from experiments.worlds.pictures import wilson
from experiments.worlds.ranges import load_ranges
from experiments.worlds.report import Judgement
from experiments.worlds.worlds import WorldsRun, run_worlds

PAGE = Path(__file__).resolve().parents[2] / "docs" / "findings.md"
ROW = re.compile(r"^\| (\d+) \| [^|]+ \| ([\d.]+) % \(([\d.]+) to ([\d.]+)\) \|", re.MULTILINE)
Z, Z_OF_ALL = 1.96, 2.84  # of one interval; of eleven together (Bonferroni)


def shares_on(page: str) -> dict[int, tuple[float, float, float]]:
    """By statement: its share, and the ends of its interval."""
    return {int(row[0]): tuple(float(x) / 100.0 for x in row[1:]) for row in ROW.findall(page)}


def differs(share: tuple[float, float, float], again: tuple[float, float, float]) -> float:
    """How far apart two shares are, in standard errors of their difference, from the ends that face each other."""
    (p, low, high), (q, q_low, q_high) = share, again
    mine, other = (high - p, q - q_low) if q > p else (p - low, q_high - q)
    return (q - p) * Z / max(math.hypot(mine, other), 1e-9)


def main(n: str = "300", seed: str = "2") -> None:
    on_page = shares_on(PAGE.read_text(encoding="utf-8"))
    if sorted(on_page) != [statement.number for statement in STATEMENTS]:
        sys.exit(f"{PAGE}: has no share with interval of each of the eleven statements")
    run = WorldsRun(load_ranges("paper"), int(n), int(seed))
    with tempfile.TemporaryDirectory() as folder:
        run_worlds(run, Path(folder) / "worlds")
        lines = (Path(folder) / "worlds" / "worlds.csv").read_text(encoding="utf-8").splitlines()
    holds = Judgement(lines, run.ranges, run.ranges.drawn(run.n, run.seed)).studies.holds
    low, high = wilson(holds.sum(axis=0), len(holds))
    far = []
    for i, (number, share) in enumerate(sorted(on_page.items())):
        z = differs(share, (holds[:, i].mean(), low[i], high[i]))
        again = f"{holds[:, i].mean():6.1%} ({low[i]:.1%} to {high[i]:.1%})"
        print(f"{number:2}: on the page {share[0]:6.1%}, again {again}, z {z:+.1f}")
        far += [number] if abs(z) > Z_OF_ALL else []
    if far:
        sys.exit(f"differs: statements {', '.join(map(str, far))}")
    print(f"{np.size(holds, 0)} new worlds agree with the page")


if __name__ == "__main__":
    main(*sys.argv[1:])
