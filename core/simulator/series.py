"""Exponentials and logarithms near their simplest point, by series: the processor's time of a lag would go there."""

import math

from core.kernels import inlined

#: Below it `exponentials` sums a series. Larger: its error; smaller: a call for every exponential.
SMALL = 0.06
OCTAVES = 1.0 / math.log(2.0)


@inlined
def exponentials(a, e, b, c):
    """exp(-a) .. exp(-c), all >= 0, side by side: so the processor does them at once; small ones to 1e-12."""
    if max(max(a, e), max(b, c)) < SMALL:
        return small_exponential(a), small_exponential(e), small_exponential(b), small_exponential(c)
    return math.exp(-a), math.exp(-e), math.exp(-b), math.exp(-c)


@inlined
def small_exponential(e):
    """exp(-e) of a small e."""
    return 1.0 - e * (1.0 - e * (1 / 2 - e * (1 / 6 - e * (1 / 24 - e * (1 / 120 - e * (1 / 720))))))


@inlined
def octaves_grown(growth):
    """log2(1 + growth): good to rounding within a fifth either way, to 1e-6 within a half."""
    z = growth / (2.0 + growth)
    zz = z * z
    return 2.0 * OCTAVES * z * (1.0 + zz * (1 / 3 + zz * (1 / 5 + zz * (1 / 7 + zz * (1 / 9)))))
