"""A Butterworth low-pass of fourth order, run forward and backward: it shifts nothing in time.

The same numbers, bit by bit, as SciPy's `butter` and `sosfiltfilt`, whose import takes as long as a hundred trials.
"""

import math
from functools import cache

import numpy as np

from core.kernels import kernel

ORDER = 4
PADDED = 15  # samples at each end, as `sosfiltfilt` takes for two sections


def low_pass(values: np.ndarray, cutoff_hz: float, rate_hz: float) -> np.ndarray:
    """Each row of values (m, n) without what is above the cut-off; n > PADDED.

    The ends are continued by their own mirror image, turned by half a turn.
    """
    sections, settled = _design(cutoff_hz, rate_hz)
    before = 2.0 * values[:, :1] - values[:, PADDED:0:-1]
    after = 2.0 * values[:, -1:] - values[:, -2 : -PADDED - 2 : -1]
    padded = np.concatenate((before, values, after), axis=1)
    for _ in "forward", "backward":
        for row in padded:
            _filter(sections, settled * row[0], row)
        padded = np.ascontiguousarray(padded[:, ::-1])
    return padded[:, PADDED:-PADDED]


@cache
def _design(cutoff_hz: float, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Sections (2, 6): b0, b1, b2, 1, a1, a2, the one of weaker damping last; and their state (2, 2) at rest at 1.

    Poles of the analog filter on a half circle whose radius is the cut-off, pre-warped, brought to the discrete one
    by the bilinear transform.
    """
    warped = 4.0 * math.tan(math.pi * (2.0 * cutoff_hz / rate_hz) / 2.0)
    analog = warped * -np.exp(1j * np.pi * np.arange(1.0 - ORDER, ORDER, 2.0) / (2.0 * ORDER))
    poles = (4.0 + analog) / (4.0 - analog)
    gain = warped**ORDER * np.real(1.0 / np.prod(4.0 - analog))
    sections: list[np.ndarray] = []
    settled, scale = [], 1.0
    for pole in sorted(poles[poles.imag > 0.0], key=abs):
        b = np.array([1.0, 2.0, 1.0]) * (gain if not sections else 1.0)
        a = np.poly([pole, pole.conjugate()]).real
        matrix = np.array([[1.0 + a[1], -1.0], [a[2], 1.0]])
        sections.append(np.concatenate((b, a)))
        settled.append(scale * np.linalg.solve(matrix, b[1:] - a[1:] * b[0]))
        scale *= np.sum(b) / np.sum(a)
    return np.array(sections), np.array(settled)


@kernel
def _filter(sections, state, values):
    """Run values (n,) through the sections, in place; state (sections, 2) is that before the first value."""
    for n in range(values.shape[0]):
        value = values[n]
        for s in range(sections.shape[0]):
            filtered = sections[s, 0] * value + state[s, 0]
            state[s, 0] = sections[s, 1] * value - sections[s, 4] * filtered + state[s, 1]
            state[s, 1] = sections[s, 2] * value - sections[s, 5] * filtered
            value = filtered
        values[n] = value
