"""Velocity and acceleration of the tip from its measured positions.

A parabola by least squares through the last 15 ms of positions, at their times by the board's clock: its slope and
curvature in the middle of the window. Both are 7 ms old, exactly zero while no encoder moves, and lost samples do not
disturb them. With encoder steps of q at the tip the velocity's noise is 0.017 q per ms (0.35 mm/s for 20 um), so that 2
and 5 mm/s, the thresholds of the rules, are far above it; the acceleration's is 0.0089 q per ms2 (0.18 m/s2).
"""

import numpy as np

from core.device_interface import VELOCITY_WINDOW

Vector = tuple[float, float]

TICK_S = 1e-3
GAP_S = 0.05  # after a longer one the filter begins anew


class MotionFilter:
    """Positions in, velocity and acceleration out."""

    def __init__(self, window: int = VELOCITY_WINDOW) -> None:
        """window: samples that the parabola goes through, at least 3."""
        self._t = np.zeros(window)  # s, oldest first
        self._p = np.zeros((window, 2))  # m
        self._n = 0
        self._even = slope_and_half(TICK_S * (np.arange(window) - window // 2))
        self._spans = (window - 1) * TICK_S

    def add(self, t_s: float, x: float, y: float) -> tuple[Vector, Vector]:
        """A position (m) at a time (s, rising): velocity (m/s), acceleration (m/s2); zero until the window is full."""
        if self._n and not 0.0 < t_s - self._t[-1] <= GAP_S:
            self._n = 0
        self._t[:-1], self._p[:-1] = self._t[1:], self._p[1:]
        self._t[-1], self._p[-1] = t_s, (x, y)
        self._n = min(self._n + 1, len(self._t))
        if self._n < len(self._t):
            return (0.0, 0.0), (0.0, 0.0)
        from_last = self._p - self._p[-1]  # exact zeros while nothing moves
        even = abs(self._t[-1] - self._t[0] - self._spans) < 0.02 * TICK_S
        middle = 0.5 * (self._t[0] + self._t[-1])
        slope, half = (self._even if even else slope_and_half(self._t - middle)) @ from_last
        return (float(slope[0]), float(slope[1])), (2.0 * float(half[0]), 2.0 * float(half[1]))


def slope_and_half(times: np.ndarray) -> np.ndarray:
    """Weights (2, n) of positions at times (n,), s, for the parabola's slope and half its curvature at time 0."""
    return np.linalg.pinv(np.vander(times, 3, increasing=True))[1:]
