"""The noise of simulated operators: drawn once for all trials that have the same."""

from functools import lru_cache

import numpy as np

Size = int | tuple[int, ...]


class Normals:
    """Standard normal draws of a generator, kept by their size: trials with the same noise draw it once.

    In place of a `numpy.random.Generator`, for a trial, which draws each size once.
    """

    def __init__(self, *seed: int) -> None:
        self._generator = np.random.default_rng(np.random.SeedSequence(seed))
        self._drawn: dict[Size, np.ndarray] = {}

    def standard_normal(self, size: Size) -> np.ndarray:
        """The draws, as the generator gave them when they were first asked for; not to be changed.

        Not marked as such: for arrays that are read only numba would compile every kernel once more.
        """
        if size not in self._drawn:
            self._drawn[size] = self._generator.standard_normal(size)
        return self._drawn[size]


#: The draws of a trial, the same for every controller and device, by the numbers of their seed.
normals = lru_cache(maxsize=12)(Normals)  # each holds a megabyte; an operator of the paper's study has six
