"""The noise of simulated operators: drawn once for all trials that have the same."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np


class Normals:
    """Standard normal draws of a generator, kept: trials with the same noise draw it once.

    In place of a `numpy.random.Generator`, for a trial that draws nothing else from it.
    """

    def __init__(self, seed: Sequence[int]) -> None:
        self._generator = np.random.default_rng(np.random.SeedSequence(seed))
        self._drawn: list[np.ndarray] = []
        self._next = 0

    def from_the_first(self) -> "Normals":
        """The same draws again."""
        self._next = 0
        return self

    def standard_normal(self, size: int | tuple[int, ...]) -> np.ndarray:
        """The next draws, as the generator would give them; not to be changed.

        Not marked as such: for arrays that are read only numba would compile every kernel once more.
        """
        if self._next == len(self._drawn):
            self._drawn.append(self._generator.standard_normal(size))
        drawn = self._drawn[self._next]
        assert drawn.shape == (size if isinstance(size, tuple) else (size,))
        self._next += 1
        return drawn


def normals(*seed: int) -> Normals:
    """The draws of a trial: the same for every controller and device."""
    return _kept(seed).from_the_first()


@lru_cache(maxsize=12)  # each holds a megabyte; an operator of the paper's study has six
def _kept(seed: tuple[int, ...]) -> Normals:
    return Normals(seed)
