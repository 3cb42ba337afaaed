"""How often the indices of `phd worlds` and their intervals are right, on worlds made up so that the truth is known.

python -m tests.benchmarks.index_coverage [RUNS]

Each run draws worlds of 20 assumptions, tried by one triple of people or by ten. In a study a statement holds with a
probability that hangs on the first two assumptions, or on none. Printed: how often any index of a statement that hangs
on none is above chance (wanted: 5 % at most of the runs), how often the index of the assumption that matters is; how
often the 95 % interval of a share of the variance holds the true one; and how many of the standard deviations that the
share really has its half-width is long (wanted: 1.96).
"""

import sys

import numpy as np

from experiments.worlds.indices import Split, find_indices
from experiments.worlds.ranges import AssumptionRange

ASSUMPTIONS = 20
SIZES = ((1000, 1), (100, 10))  # worlds, triples
A, B = np.meshgrid((0, 1), (0, 1), indexing="ij")  # whether an assumption lies in the upper half of its range
STATEMENTS = {
    "none, 3 %": 0.03 + 0.0 * A,
    "none, 10 %": 0.1 + 0.0 * A,
    "none, 50 %": 0.5 + 0.0 * A,
    "the first, rare": 0.02 + 0.1 * A,
    "the first, often": 0.2 + 0.6 * A,
    "both": 0.1 + 0.3 * A + 0.2 * B + 0.3 * A * B,
    "interplay alone": 0.2 + 0.6 * (A != B),
}


def truth(p: np.ndarray) -> dict[str, float]:
    """Shares of the verdict's variance; p: at the lower and upper half of the first two assumptions."""
    variance = p.mean() * (1.0 - p.mean())
    first, second = (p.mean(axis=axis).var() / variance for axis in (1, 0))
    people = float((p * (1.0 - p)).mean() / variance)
    alone = first + second
    return {"first": first, "alone": alone, "rest": 1.0 - alone, "people": people, "interplay": 1.0 - alone - people}


def shares_of(split: Split) -> dict[str, np.ndarray]:
    """(statements,) of each; `first`: of the first assumption."""
    return split._asdict() | {"first": split.first[:, 0]}


def main(runs: str = "200") -> None:
    generator = np.random.default_rng(1)
    ranges = {f"{number}": AssumptionRange(source="made up", low=0.0, high=1.0) for number in range(ASSUMPTIONS)}
    for n, triples in SIZES:
        found = []
        for _ in range(int(runs)):
            shares = generator.random((n, ASSUMPTIONS))
            upper = (shares[:, :2] > 0.5).astype(int)
            p = np.array([of[upper[:, 0], upper[:, 1]] for of in STATEMENTS.values()])
            holds = generator.random((n, triples, len(p))) < p.T[:, np.newaxis]
            found.append(find_indices(ranges, shares, holds))
        print(f"{n} worlds, {triples} triple{'s' if triples > 1 else ''} each, {runs} runs")
        above = np.array([one.clear for one in found])  # (runs, statements, assumptions)
        nothing = [name.startswith("none") for name in STATEMENTS]
        size = above[:, nothing].any(axis=(1, 2)).mean()
        print(f"  any index of the statements that hang on none is above chance in {size:.1%} of the runs")
        for i, (name, p) in enumerate(STATEMENTS.items()):
            texts = [f"first above chance {above[:, i, 0].mean():.0%}"]
            for part, true in truth(p).items():
                value = np.array([shares_of(one.split)[part][i] for one in found])
                half = np.array([shares_of(one.half_width)[part][i] for one in found])
                if np.isfinite(value).all():
                    covered = np.mean(np.abs(value - true) <= half)
                    sd = value.std()
                    texts.append(f"{part} {true:.2f}: covered {covered:.0%}, {half.mean() / sd:.1f} sd" if sd else part)
            print(f"  {name}: {'; '.join(texts)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
