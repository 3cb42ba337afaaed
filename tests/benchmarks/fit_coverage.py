"""How many of the 95 % intervals of fits hold the true number, on data made from known numbers.

python -m tests.benchmarks.fit_coverage people [N] [SEED]     `phd fit-operator`, N people of each of two populations
python -m tests.benchmarks.fit_coverage brakes [N]            `phd identify`, N benches of each kind

People: as their population has them, but for the spread of their reactions, which is one of `SPREADS_S` in turn.
"""

import sys

import numpy as np

from core.device_file import SHIPPED_FOLDER, parse_brake
from core.files import InputError
from experiments.identify.identification import identify_steps
from experiments.operator_fit.fit import RESTS_ON, fit_person
from experiments.trial.population import load_population
from tests.support.people import bench_trials
from tests.support.synthetic_steps import BENCH, synthetic_steps

POPULATIONS = "average", "from-device"
SPREADS_S = 0.0, 0.015, 0.03, 0.06, 0.1
BENCHES = {
    "clean": BENCH,
    "dead time of 5 ms": BENCH._replace(dead_time_s=0.005),
    "drift of -10 % an hour": BENCH._replace(drift_per_h=-0.1),
    "sensor's zero 0.3 N m, one way": BENCH._replace(offset_N_m=0.3),
    "the same, a third turned back": BENCH._replace(offset_N_m=0.3, turns_back=True),
}


def people(n: int, first_seed: int) -> None:
    """A table for each population, a line a number."""
    for name in POPULATIONS:
        like = load_population(name)
        found: dict[str, list[tuple[float, ...]]] = {key: [] for key in RESTS_ON}
        for seed in range(first_seed, first_seed + n):
            spread = SPREADS_S[seed % len(SPREADS_S)]
            person = like.draw(np.random.default_rng(seed))._replace(reaction_spread_s=spread)
            try:
                fitted = fit_person(str(seed), bench_trials(person, seed, rounds=2), like)
            except InputError as error:
                print(f"{name}, {seed}: {error}")
                continue
            for one in fitted.numbers:
                found[one.name].append((getattr(person, one.name), one.value, one.low, one.high))
        print(f"\n{name}, {n} people from seed {first_seed}; in shares of the mean number")
        print(f"{'number':22}{'people':>7}{'inside':>7}{'bias':>9}{'error':>9}{'half-width':>11}")
        for key, rows in found.items():
            if rows:
                line(key, *np.array(rows).T)


def line(name: str, true: np.ndarray, value: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    """Coverage of one number of many people."""
    inside = np.sum((low <= true) & (true <= high))
    unit = true.mean() or np.nan
    bias, error, half = np.mean(value - true), np.mean(np.abs(value - true)), np.mean(high - low) / 2.0
    print(f"{name:22}{len(true):7}{inside:7}{bias / unit:9.1%}{error / unit:9.1%}{half / unit:11.1%}", flush=True)


def brakes(n: int) -> None:
    """A line for each kind of bench: intervals that hold the brake's number, of all; and of each number."""
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


def main() -> None:
    n, seed = (int(word) for word in (*sys.argv[2:], *("20", "1000")[len(sys.argv[2:]) :]))
    if sys.argv[1] == "people":
        people(n, seed)
    else:
        brakes(n)


if __name__ == "__main__":
    main()
