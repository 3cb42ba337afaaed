"""Records: numpy arrays of one, with named fields, that kernels change in place."""

import functools
from typing import Any

import numpy as np


def new_record(dtype: np.dtype, **fields: Any) -> np.ndarray:
    """One record as an array of length one, zero but for these fields; kernels take `array[0]`.

    No recarray, whose fields take Python ten times as long; its one record still has them as attributes.
    """
    record = np.zeros(1, dtype=record_type(dtype))
    for name, value in fields.items():
        record[name][0] = value
    return record


@functools.cache
def record_type(dtype: np.dtype) -> np.dtype:
    """The one type of all records with these fields: numba compares two types of the same fields for a microsecond."""
    return np.dtype((np.record, dtype))
