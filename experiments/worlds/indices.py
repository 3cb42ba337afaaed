"""Which assumption decides a statement: first-order indices from the worlds at hand (RBD-FAST, by SALib).

The index of an assumption is the share of a verdict's variance (it holds or not, over all worlds) that goes when the
assumption is known: Var(E[verdict | assumption]) / Var(verdict). What no assumption alone explains is their interplay,
and the chance of which three people took part.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from experiments.worlds.ranges import Range, problem

SEED = 1  # of the bootstrap behind the intervals
LEAST_EITHER = 30  # worlds in which it holds, and in which it does not: fewer give no index worth the name


class Indices(NamedTuple):
    """Of every statement (rows) and assumption (columns); nan where nearly all worlds agree."""

    first: np.ndarray
    half_width: np.ndarray  # of the 95 % interval

    @property
    def clear(self) -> np.ndarray:
        """Those that are above chance: beyond their own half-width."""
        return np.nan_to_num(self.first) > np.nan_to_num(self.half_width, nan=np.inf)


def indices(ranges: Mapping[str, Range], shares: np.ndarray, holds: np.ndarray) -> Indices:
    """shares (n, assumptions): where the worlds lie in the ranges; holds (n, statements): whether each holds."""
    from SALib.analyze import rbd_fast  # here: it takes seconds

    first = np.full((holds.shape[1], shares.shape[1]), np.nan)
    half_width = first.copy()
    for row, verdicts in enumerate(holds.T.astype(float)):
        if shares.shape[1] and LEAST_EITHER <= verdicts.sum() <= len(verdicts) - LEAST_EITHER:
            found = rbd_fast.analyze(problem(ranges), shares, verdicts, seed=SEED)
            first[row], half_width[row] = np.maximum(found["S1"], 0.0), found["S1_conf"]
    return Indices(first, half_width)


def settled(found: Indices, holds: np.ndarray) -> np.ndarray:
    """How much of all doubt each assumption would settle (0 .. 1), by the indices that are above chance.

    Doubt: the variance of a verdict, p (1 - p), summed over the statements.
    """
    p = holds.mean(axis=0)
    doubt = p * (1.0 - p)
    of_each = np.where(found.clear, found.first, 0.0) * doubt[:, np.newaxis]
    return of_each.sum(axis=0) / max(float(doubt.sum()), 1e-12)
