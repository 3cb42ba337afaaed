"""What decides a statement: the share of its verdict's variance that each range explains alone, by SALib.

A verdict is 1 where a statement holds in a sample and 0 where not; its variance over all samples is p (1 - p). The
first-order index of Sobol' is Var(E[verdict | range]) / p (1 - p), found from the samples as they are (Plischke,
Borgonovo and Smith 2013), with a 95 % interval by bootstrap. An index counts where the whole interval lies above the
index of every dummy range, which nothing reads.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from SALib.analyze import delta
from scipy.stats import fisher_exact

from experiments.sensitivity.ranges import AssumptionRange, problem

LEAST_EITHER = 10  # samples in which it holds, and does not: fewer give no index worth the name
DUMMIES = 10
RESAMPLES, SEED = 100, 1
LEVEL = 0.05  # of all pairs of statements together


class Indices(NamedTuple):
    """First-order indices; a row a statement, a column a range; NaN where nearly all samples agree."""

    first: pd.DataFrame
    half_width: pd.DataFrame  # of the 95 % intervals
    dummy: pd.Series  # the largest index of a dummy range, by statement

    @property
    def counts(self) -> pd.DataFrame:
        """Whether an index stands out from the dummies'."""
        return (self.first - self.half_width).gt(self.dummy, axis=0)

    def settled(self, holds: pd.DataFrame) -> pd.Series:
        """By range: how much of all doubt, the sum of p (1 - p), it would settle alone, by the indices that count."""
        doubt = holds.mean() * (1.0 - holds.mean())
        of_each = self.first.where(self.counts, 0.0).mul(doubt, axis=0).sum()
        return (of_each / max(float(doubt.sum()), 1e-12)).sort_values(ascending=False, kind="stable")


def find_indices(ranges: Mapping[str, AssumptionRange], shares: np.ndarray, holds: pd.DataFrame) -> Indices:
    """shares (samples, ranges): where the samples lie in the ranges; holds: a column a statement."""
    names = list(ranges)
    dummies = np.random.default_rng(SEED).random((len(shares), DUMMIES))
    described = problem(dict.fromkeys([*names, *(f"dummy {k}" for k in range(DUMMIES))]))  # type: ignore[arg-type]
    first = pd.DataFrame(np.nan, index=holds.columns, columns=names)
    half_width, dummy = first.copy(), pd.Series(np.nan, index=holds.columns)
    for number, verdicts in holds.items():
        if min(verdicts.sum(), (~verdicts).sum()) >= LEAST_EITHER:
            found = delta.analyze(
                described, np.hstack([shares, dummies]), verdicts.to_numpy(dtype=float), RESAMPLES, seed=SEED,
                method="sobol",
            )  # fmt: skip
            first.loc[number], half_width.loc[number] = found["S1"][: len(names)], found["S1_conf"][: len(names)]
            dummy[number] = max(found["S1"][len(names) :])
    return Indices(first, half_width, dummy)


class Pair(NamedTuple):
    """Two statements that hold together less often, or more, than if they had nothing to do with each other."""

    first: int
    second: int
    together: int  # samples
    expected: float  # samples, if they were independent


def dependent_pairs(holds: pd.DataFrame) -> list[Pair]:
    """The pairs that Fisher's exact test tells from independent ones (Bonferroni); the least together first."""
    numbers, n = list(holds.columns), len(holds)
    tried = [(a, b) for place, a in enumerate(numbers) for b in numbers[place + 1 :]]
    found = []
    for a, b in tried:
        both = int((holds[a] & holds[b]).sum())
        only_a, only_b = int(holds[a].sum()) - both, int(holds[b].sum()) - both
        if fisher_exact([[both, only_a], [only_b, n - both - only_a - only_b]]).pvalue < LEVEL / len(tried):
            found.append(Pair(a, b, both, float(holds[a].mean() * holds[b].mean() * n)))
    return sorted(found, key=lambda pair: pair.together / max(pair.expected, 1e-12))
