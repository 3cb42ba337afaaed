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
LEAST_WORLDS = 100  # fewer give no index worth the name


class Indices(NamedTuple):
    """Of every statement (rows) and assumption (columns); nan where all worlds agree or they are too few."""

    first: np.ndarray
    half_width: np.ndarray  # of the 95 % interval


def indices(ranges: Mapping[str, Range], shares: np.ndarray, holds: np.ndarray) -> Indices:
    """shares (n, assumptions): where the worlds lie in the ranges; holds (n, statements): whether each holds."""
    first = np.full((holds.shape[1], shares.shape[1]), np.nan)
    half_width = first.copy()
    if len(holds) < LEAST_WORLDS:
        return Indices(first, half_width)
    from SALib.analyze import rbd_fast  # here: it takes seconds

    for row, verdicts in enumerate(holds.T.astype(float)):
        if 0.0 < verdicts.mean() < 1.0:
            found = rbd_fast.analyze(problem(ranges), shares, verdicts, seed=SEED)
            first[row], half_width[row] = np.maximum(found["S1"], 0.0), found["S1_conf"]
    return Indices(first, half_width)


def settled(found: Indices, holds: np.ndarray) -> np.ndarray:
    """How much of all doubt each assumption would settle (0 .. 1).

    Doubt: the variance of a verdict, p (1 - p), summed over the statements.
    """
    p = holds.mean(axis=0)
    doubt = p * (1.0 - p)
    return (
        np.nansum(found.first * doubt[:, np.newaxis], axis=0) / doubt.sum()
        if doubt.any()
        else np.zeros(found.first.shape[1])
    )
