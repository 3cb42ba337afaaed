"""The first time inside a step at which a value falls below zero, from its values and slopes at the step's ends."""

import math

from core.kernels import kernel
from core.simulator.solver_numbers import ROUNDING


@kernel
def hermite_zero(v0, d0, v1, d1, h):
    """First time in (0, h] at which the cubic through (v0, slope d0) and (v1, slope d1) falls below zero; -1: never.

    v0 >= 0 up to rounding. Found by the sign at the end or at the interior minimum, then by bracketed Newton steps.
    """
    a = 2.0 * (v0 - v1) + h * (d0 + d1)
    b = 3.0 * (v1 - v0) - h * (2.0 * d0 + d1)
    c = h * d0
    low, high = 0.0, 1.0
    if v1 >= -ROUNDING:
        square = b * b - 3.0 * a * c
        if square <= 0.0:
            return -1.0
        root = math.sqrt(square)
        high = (root - b) / (3.0 * a) if b <= 0.0 and a != 0.0 else -c / (b + root)  # where the cubic is convex
        if not (0.0 < high < 1.0) or ((a * high + b) * high + c) * high + v0 >= -ROUNDING:
            return -1.0
    s = 0.5 * (low + high)
    if v0 > 0.0 and v1 < 0.0:
        s = v0 / (v0 - v1)
    for _ in range(12):
        value = ((a * s + b) * s + c) * s + v0
        if value > 0.0 or (value == 0.0 and s < 0.5 * high):
            low = s
        else:
            high = s
        slope = (3.0 * a * s + 2.0 * b) * s + c
        step = value / slope if slope != 0.0 else 2.0
        if abs(step) < 1e-12:
            break
        s = s - step
        if not (low < s < high):
            s = 0.5 * (low + high)
    return s * h


@kernel
def parabola_zero(v0, vm, v1, h):
    """First time in (0, h] at which the parabola through v0, vm (middle), v1 falls below zero; -1: never. v0 >= 0."""
    a = 2.0 * (v0 + v1 - 2.0 * vm)
    b = v1 - v0 - a
    if not (math.isfinite(a) and math.isfinite(b)):
        return -1.0  # a stop holds without end
    if v1 >= -ROUNDING:
        if a <= 0.0 or b >= 0.0 or -b >= 2.0 * a or v0 - 0.25 * b * b / a >= -ROUNDING:
            return -1.0
    root = math.sqrt(max(b * b - 4.0 * a * v0, 0.0))
    s = 2.0 * v0 / (root - b) if root - b > 0.0 else 0.5
    return min(max(s, 0.0), 1.0) * h
