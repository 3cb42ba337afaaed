"""How many people a test needs to find a difference between two controllers, from the scores of many people.

The test is the one of `phd analyze`: each person's mean over their trials, the signed-rank test of the differences
between two controllers, Holm's correction over all pairs of controllers of that configuration. The people of a study
are drawn from those that are known, each as likely as any other.

Scores are (people, controllers), NaN where a person has none.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from experiments.analysis.statistics import LEAST_PEOPLE, LEVEL, holm, signed_rank_distribution

MOST_PEOPLE = 200
TIES_APART = 1e-9  # relative: a person drawn twice makes two equal differences, which the exact test has none of


class Draws(NamedTuple):
    """How many are drawn: more say it more exactly, and take longer."""

    studies: int = 1000  # for each number of people
    redrawn: int = 100  # of the interval: people drawn anew
    studies_redrawn: int = 200  # and studies drawn of each
    curve_studies: int = 400  # for each point of the figure


FULL = Draws()


class Needed(NamedTuple):
    """The least number of people whose study finds the difference with the power that is wanted."""

    people: int | None  # None: more than MOST_PEOPLE
    low: int | None  # 95 % interval: how far it hangs on the people it was found from
    high: int | None


def people_needed(known: np.ndarray, pair: tuple[int, int], power: float, seed: int, draws: Draws = FULL) -> Needed:
    """How many people find the difference between two controllers (their places in the scores) with this power."""
    generator = np.random.default_rng(seed)
    least = _least(known, pair, power, draws.studies, seed)
    others = [
        _least(_drawn(known, generator, len(known)), pair, power, draws.studies_redrawn, seed + 1 + again)
        for again in range(draws.redrawn)
    ]
    ends = np.quantile(others, (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)), method="closest_observation")
    return Needed(*(None if n > MOST_PEOPLE else int(n) for n in (least, min(ends[0], least), max(ends[1], least))))


def _drawn(known: np.ndarray, generator: np.random.Generator, shape: int | tuple[int, int]) -> np.ndarray:
    return known[generator.integers(0, len(known), shape)]


def _least(known: np.ndarray, pair: tuple[int, int], power: float, studies: int, seed: int) -> int:
    """By bisection: power rises with the number of people. MOST_PEOPLE + 1: even so many are too few."""
    low, high = LEAST_PEOPLE, MOST_PEOPLE + 1
    while low < high:
        middle = (low + high) // 2
        if share_found(known, pair, middle, studies, seed) >= power:
            high = middle
        else:
            low = middle + 1
    return low


def share_found(known: np.ndarray, pair: tuple[int, int], n: int, studies: int, seed: int) -> float:
    """The share of simulated studies of n people in which the corrected p of the pair is below 5 %."""
    scores = _drawn(known, np.random.default_rng([seed, n]), (studies, n))
    pairs = list(combinations(range(scores.shape[-1]), 2))
    jitter = 1.0 + TIES_APART * np.random.default_rng([seed, n, 1]).random((studies, n))
    found = [signed_rank_chances((scores[..., a] - scores[..., b]) * jitter) for a, b in pairs]
    corrected = holm(np.stack(found, axis=-1))[:, pairs.index((min(pair), max(pair)))]
    return float(np.mean(corrected < 1.0 - LEVEL))


def signed_rank_chances(differences: np.ndarray) -> np.ndarray:
    """Two-sided p (studies,) of the exact signed-rank test of each row (studies, people) of differences without ties.

    Zeros and NaN are left out, as `statistics.signed_rank_p` leaves them out.
    """
    sizes = np.nan_to_num(np.abs(differences))
    empty = np.count_nonzero(sizes == 0.0, axis=1)
    ranks = np.argsort(np.argsort(sizes, axis=1), axis=1) + 1 - empty[:, None]  # those of zeros are not positive
    sums = np.sum(np.where((differences > 0.0) & (ranks > 0), ranks, 0), axis=1)
    chances = np.ones(len(differences))
    for zeros in np.unique(empty):
        alike, n = empty == zeros, differences.shape[1] - int(zeros)
        if n:
            below = _cumulative(n)
            from_both_ends = np.minimum(sums[alike], n * (n + 1) // 2 - sums[alike])
            chances[alike] = np.minimum(1.0, 2.0 * below[from_both_ends])
    return chances


@cache
def _cumulative(n: int) -> np.ndarray:
    return np.cumsum(signed_rank_distribution(n))


def scores_of(table: Mapping[int, Mapping[str, float]], controllers: Sequence[int]) -> np.ndarray:
    """Scores (people, controllers) of a table of one configuration; NaN where a person has none with a controller."""
    people = list(dict.fromkeys(person for of in table.values() for person in of))
    return np.array([[table.get(c, {}).get(person, np.nan) for c in controllers] for person in people])
