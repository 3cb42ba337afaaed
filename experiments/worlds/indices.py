"""What a verdict hangs on: assumptions one by one, their interplay, or which people took part.

A verdict is 1 where a statement holds in a study and 0 where not. Its variance over all studies, p (1 - p), is split:

- first: Var(E[verdict | assumption]), the first-order index of Sobol', from the means in the parts of the assumption's
  range (Plischke, Borgonovo and Smith 2013) less what chance puts between them; alone: their sum over the assumptions
- people: the mean variance among triples of people who tried the same world; needs several triples a world
- interplay: what is left, which several assumptions make together

An index is above chance where it exceeds its statement's limit: where verdicts are dealt to the worlds at random, no
index of any statement exceeds its limit in 95 % of the cases. Half-widths are of 95 % intervals, by a jackknife that
leaves out a fifth of the worlds, drawn anew each time: 1.96 times twice the root mean square of what that changes (the
variance of such a change is a quarter of the number's own). Where an index is near 0 that is too wide by half. How
often either is right, by simulation: `python -m tests.benchmarks.index_coverage`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.worlds.ranges import AssumptionRange

PARTS = 8  # of a range without choices
LEAST_EITHER = 10  # studies (as `effective_counts`) in which it holds, and does not: fewer give no index worth the name
SEED = 1  # of what is drawn here
DEALS, DRAWS = 200, 200
LEFT_OUT = 5  # a fifth of the worlds
LEVEL, Z = 0.95, 1.96


class Split(NamedTuple):
    """Shares of the variance of each statement's verdict; nan where nearly all studies agree."""

    first: np.ndarray  # (statements, assumptions)
    alone: np.ndarray  # (statements,)
    rest: np.ndarray  # (statements,) what no assumption explains alone: people and interplay
    people: np.ndarray  # (statements,); with one triple a world nan, as is interplay
    interplay: np.ndarray  # (statements,)


class Indices(NamedTuple):
    """The split of the verdicts' variance, with its uncertainty."""

    split: Split
    half_width: Split  # of the 95 % intervals
    limit: np.ndarray  # (statements,) what an index must exceed to be above chance

    @property
    def any(self) -> bool:
        """Whether any statement has indices."""
        return bool(np.isfinite(self.split.first).any())

    @property
    def clear(self) -> np.ndarray:
        """(statements, assumptions): above chance."""
        return np.nan_to_num(self.split.first) > np.nan_to_num(self.limit, nan=np.inf)[:, np.newaxis]

    def settled(self, holds: np.ndarray) -> np.ndarray:
        """(assumptions,) How much of all doubt each would settle, by its indices above chance.

        Doubt: the variance of a verdict, p (1 - p), summed over the statements. holds: as in `find_indices`.
        """
        p = holds.mean(axis=(0, 1))
        doubt = p * (1.0 - p)
        of_each = np.where(self.clear, self.split.first, 0.0) * doubt[:, np.newaxis]
        return of_each.sum(axis=0) / max(float(doubt.sum()), 1e-12)


def parts_of(assumption: AssumptionRange) -> int:
    """Into how many parts a range is cut: its choices, or equal ones."""
    return PARTS if assumption.choices is None else len(assumption.choices)


def part_at(shares: np.ndarray, parts: int) -> np.ndarray:
    """The part (n,) in which each world lies, by its share (n,) of the range."""
    return np.minimum((shares * parts).astype(int), parts - 1)


def effective_counts(holds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """In how many studies (statements,) each holds, and of how many; holds (worlds, triples, statements).

    Studies of one world resemble each other, so they count as fewer: as many studies of different worlds would give a
    share as certain.
    """
    of_world = holds.mean(axis=1)
    p, n = of_world.mean(axis=0), len(of_world)
    of_mean = of_world.var(axis=0) / n
    worth = np.where(of_mean > 0.0, p * (1.0 - p) / np.maximum(of_mean, 1e-12), n)
    return p * worth, worth


def find_indices(ranges: Mapping[str, AssumptionRange], shares: np.ndarray, holds: np.ndarray) -> Indices:
    """The indices of all statements and assumptions.

    shares (worlds, assumptions): where worlds lie in the ranges; holds (worlds, triples, statements).
    """
    n, generator = len(shares), np.random.default_rng(SEED)
    sizes = [parts_of(assumption) for assumption in ranges.values()]
    often, studies = effective_counts(holds)
    judged = (often >= LEAST_EITHER) & (studies - often >= LEAST_EITHER)
    if not sizes or not judged.any():
        nothing = np.full(len(judged), np.nan)
        none = Split(np.full((len(judged), len(sizes)), np.nan), *[nothing] * 4)
        return Indices(none, none, nothing)
    member = np.hstack([np.eye(size)[part_at(shares[:, j], size)] for j, size in enumerate(sizes)])
    whole = _split(member, sizes, holds, judged)
    dealt = np.array([_split(member, sizes, holds[generator.permutation(n)], judged).first for _ in range(DEALS)])
    scale = np.sqrt(np.mean(dealt**2, axis=(0, 2)))  # (statements,) of an index by chance
    largest = np.nanmax(dealt / scale[:, np.newaxis], axis=(1, 2))
    some = [generator.permutation(n)[n // LEFT_OUT :] for _ in range(DRAWS)]
    without = [_split(member[drawn], sizes, holds[drawn], judged) for drawn in some]
    changes = [
        np.mean((np.array(parts) - of_whole) ** 2, axis=0) for *parts, of_whole in zip(*without, whole, strict=True)
    ]
    half_width = Split(*(Z * np.sqrt((LEFT_OUT - 1) * change) for change in changes))
    return Indices(whole, half_width, scale * np.quantile(largest, LEVEL))


def _split(member: np.ndarray, sizes: Sequence[int], holds: np.ndarray, judged: np.ndarray) -> Split:
    """The split of the verdicts, nan where not judged (statements,).

    member (worlds, parts of all ranges): 1 where a world lies in the part.
    """
    n, triples = holds.shape[:2]
    mean = holds.mean(axis=1)  # of each world
    p = mean.mean(axis=0)
    variance = np.where(judged, np.maximum(p * (1.0 - p), 1e-12), np.nan)
    count = member.sum(axis=0)
    of_parts = member.T @ mean / np.maximum(count, 1.0)[:, np.newaxis]
    starts = np.cumsum([0, *sizes[:-1]])
    between = np.add.reduceat(count[:, np.newaxis] * (of_parts - p) ** 2, starts, axis=0)
    inside = n * mean.var(axis=0) - between
    parts = np.array(sizes)[:, np.newaxis]
    first = ((between - (parts - 1) * inside / (n - parts)) / (n * variance)).T
    people = np.full(len(p), np.nan)
    if triples > 1:
        people = triples / (triples - 1) * (mean * (1.0 - mean)).mean(axis=0) / variance
    alone = first.sum(axis=1)
    return Split(first, alone, 1.0 - alone, people, 1.0 - alone - people)
