"""How many of the 95 % intervals of `phd identify` hold the true number, on steps made from known brakes.

python -m tests.benchmarks.fit_coverage [N]     N benches of each kind
"""

import sys

import numpy as np

from core.device_file import SHIPPED_FOLDER, parse_brake
from experiments.identify.identification import identify_steps
from tests.support.synthetic_steps import BENCH, synthetic_steps

BENCHES = {
    "clean": BENCH,
    "dead time of 5 ms": BENCH._replace(dead_time_s=0.005),
    "drift of -10 % an hour": BENCH._replace(drift_per_h=-0.1),
    "sensor's zero 0.3 N m, one way": BENCH._replace(offset_N_m=0.3),
    "the same, a third turned back": BENCH._replace(offset_N_m=0.3, turns_back=True),
}


def main() -> None:
    """A line for each kind of bench: intervals that hold the brake's number, of all; and of each number."""
    n = int(sys.argv[1]) if sys.argv[1:] else 20
    brake = parse_brake((SHIPPED_FOLDER / "mrb-2107-3.toml").read_text(), "brake")
    true = np.array([*brake.k, brake.rise.a_avg_s, *brake.rise.a, brake.fall.a_avg_s, *brake.fall.a])
    for kind, bench in BENCHES.items():
        inside, warned = np.zeros(len(true), int), 0
        for seed in range(n):
            found = identify_steps(synthetic_steps(brake, seed, bench), "steps.csv")
            intervals = [row.interval or (np.nan, np.nan) for row in found.parameters()]
            inside += [low <= one <= high for one, (low, high) in zip(true, intervals, strict=True)]
            warned += bool(found.warnings)
        share = inside.sum() / len(true) / n
        print(f"{kind:32} inside {share:6.1%}, warned {warned} of {n}; by number {inside}", flush=True)


if __name__ == "__main__":
    main()
