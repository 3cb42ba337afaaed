"""Velocity and acceleration of the tip from its measured positions.

A parabola by least squares through the last 15 ms of positions, at their times by the board's clock: its slope and
curvature in the middle of the window. Both are 7 ms old, exactly zero while no encoder moves, and lost samples do not
disturb them. With encoder steps of q at the tip the velocity's noise is 0.017 q per ms (0.35 mm/s for 20 um), so that 2
and 5 mm/s, the thresholds of the rules, are far above it; the acceleration's is 0.0089 q per ms2 (0.18 m/s2).
"""

import numpy as np

WINDOW = 15  # samples
TICK_S = 1e-3
GAP_S = 0.05  # after a longer one the filter begins anew
_MIDDLE = WINDOW // 2

_GRID = TICK_S * (np.arange(WINDOW) - _MIDDLE)
_EVEN = np.linalg.pinv(np.vander(_GRID, 3, increasing=True))[1:]  # slope, half the curvature


class MotionFilter:
    """Positions in, velocity and acceleration out."""

    def __init__(self) -> None:
        self._t = np.zeros(WINDOW)  # s, oldest first
        self._p = np.zeros((WINDOW, 2))  # m
        self._n = 0

    def add(self, t_s: float, x: float, y: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """A position (m) at a time (s, rising): velocity (m/s) and acceleration (m/s2); zero for the first 15 ms."""
        if self._n and not 0.0 < t_s - self._t[-1] <= GAP_S:
            self._n = 0
        self._t[:-1], self._p[:-1] = self._t[1:], self._p[1:]
        self._t[-1], self._p[-1] = t_s, (x, y)
        self._n = min(self._n + 1, WINDOW)
        if self._n < WINDOW:
            return (0.0, 0.0), (0.0, 0.0)
        from_last = self._p - self._p[-1]  # exact zeros while nothing moves
        even = abs(self._t[-1] - self._t[0] - (WINDOW - 1) * TICK_S) < 0.02 * TICK_S
        slope, half = (_EVEN if even else self._uneven()) @ from_last
        return (float(slope[0]), float(slope[1])), (2.0 * float(half[0]), 2.0 * float(half[1]))

    def _uneven(self) -> np.ndarray:
        """The weights where samples are missing: of the middle of the time that the window spans."""
        middle = 0.5 * (self._t[0] + self._t[-1])
        return np.linalg.pinv(np.vander(self._t - middle, 3, increasing=True))[1:]
