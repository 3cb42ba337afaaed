"""Which assumption decides a statement: first-order indices from the worlds at hand (RBD-FAST).

The index of an assumption is the share of a verdict's variance (it holds or not, over all worlds) that goes when the
assumption is known: Var(E[verdict | assumption]) / Var(verdict). What no assumption alone explains is their interplay,
and the chance of which three people took part.

RBD-FAST: the verdicts, in the order of one assumption up every second world and down the others, are a wave of low
frequency if the assumption matters (Tarantola et al. 2006, as Plischke 2010 sorts; unbiased by Tissot and Prieur 2012).
The same numbers as SALib's `rbd_fast`, whose import brings pandas and takes seconds.
"""

from typing import NamedTuple

import numpy as np

HARMONICS = 10  # of the wave that count as due to the assumption
SEED, RESAMPLES = 1, 100  # of the bootstrap behind the intervals, over halves of the worlds
NORMAL_95 = 1.959963984540054  # standard deviations
LEAST_EITHER = 30  # worlds in which it holds, and in which it does not: fewer give no index worth the name


class Indices(NamedTuple):
    """Of every statement (rows) and assumption (columns); nan where nearly all worlds agree."""

    first: np.ndarray
    half_width: np.ndarray  # of the 95 % interval

    @property
    def clear(self) -> np.ndarray:
        """Those that are above chance: beyond their own half-width."""
        return np.nan_to_num(self.first) > np.nan_to_num(self.half_width, nan=np.inf)


def indices(shares: np.ndarray, holds: np.ndarray) -> Indices:
    """shares (n, assumptions): where the worlds lie in the ranges; holds (n, statements): whether each holds."""
    first = np.full((holds.shape[1], shares.shape[1]), np.nan)
    half_width = first.copy()
    for row, verdicts in enumerate(holds.T.astype(float)):
        if LEAST_EITHER <= verdicts.sum() <= len(verdicts) - LEAST_EITHER:
            generator = np.random.default_rng(SEED)
            for column, share in enumerate(shares.T):
                first[row, column] = max(_first_order(share, verdicts), 0.0)
                half_width[row, column] = _half_width(share, verdicts, generator)
    return Indices(first, half_width)


def _first_order(share: np.ndarray, verdicts: np.ndarray) -> float:
    order = np.argsort(share)
    wave = verdicts[np.concatenate((order[::2], order[1::2][::-1]))]
    power = np.abs(np.fft.rfft(wave - wave.mean())[1:]) ** 2
    if len(wave) % 2 == 0:
        power[-1] *= 0.5  # the highest frequency stands for itself, any other for its negative too
    index = float(np.sum(power[:HARMONICS]) / np.sum(power))
    by_chance = 2.0 * HARMONICS / len(wave)
    return index - by_chance / (1.0 - by_chance) * (1.0 - index)


def _half_width(share: np.ndarray, verdicts: np.ndarray, generator: np.random.Generator) -> float:
    found = []
    for _ in range(RESAMPLES):
        drawn = generator.choice(len(share), replace=True, size=len(share) // 2)
        found.append(_first_order(share[drawn], verdicts[drawn]))
    return NORMAL_95 * float(np.std(found, ddof=1))


def settled(found: Indices, holds: np.ndarray) -> np.ndarray:
    """How much of all doubt each assumption would settle (0 .. 1), by the indices that are above chance.

    Doubt: the variance of a verdict, p (1 - p), summed over the statements.
    """
    p = holds.mean(axis=0)
    doubt = p * (1.0 - p)
    of_each = np.where(found.clear, found.first, 0.0) * doubt[:, np.newaxis]
    return of_each.sum(axis=0) / max(float(doubt.sum()), 1e-12)
