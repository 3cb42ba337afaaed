"""Whether docs/what-it-shows.md is what the program gives: new samples against the shares on the page.

python -m tests.benchmarks.findings_check [N] [SEED]      300 new samples, seed 2: some ten minutes

The page's table has a row for each statement: | number | text | 15.8 % (15.1 to 16.6) | .. Its intervals are those of
its samples, the new samples have their own (Wilson): a statement differs where the two shares do by more than both
intervals allow at a level of 95 % for all eleven together. Exit code 1: one differs, the page is to be made again.
"""

import math
import re
import sys
import tempfile
from pathlib import Path

from experiments.analysis.findings import STATEMENTS
from experiments.sensitivity.ranges import load_ranges
from experiments.sensitivity.report import Judgement
from experiments.sensitivity.run import SensitivityRun, run_sensitivity

PAGE = Path(__file__).resolve().parents[2] / "docs" / "what-it-shows.md"
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
    run = SensitivityRun(load_ranges("paper"), int(n), int(seed))
    with tempfile.TemporaryDirectory() as folder:
        run_sensitivity(run, Path(folder) / "out")
        shares = run.ranges.shares(run.n, run.seed)
        found = Judgement(Path(folder) / "out" / "sensitivity.csv", run.ranges, shares, run.seed).share
    far = []
    for number, share in sorted(on_page.items()):
        again = tuple(found.loc[number])
        z = differs(share, again)
        print(
            f"{number:2}: on the page {share[0]:6.1%}, again {again[0]:6.1%} ({again[1]:.1%} to {again[2]:.1%}), "
            f"z {z:+.1f}"
        )
        far += [number] if abs(z) > Z_OF_ALL else []
    if far:
        sys.exit(f"differs: statements {', '.join(map(str, far))}")
    print(f"{run.n} new samples agree with the page")


if __name__ == "__main__":
    main(*sys.argv[1:])
