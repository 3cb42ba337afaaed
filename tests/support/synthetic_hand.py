"""A hand that drives the pointer through a trial: to the start, wait, to the end."""

import numpy as np
from protocols import PAPER

from core import tick_log

SPEED = 0.25  # m/s, of the pointer
PULL = 4.0  # 1/s, at which the pointer goes beyond the goal while the handle (which drags) is short of it
LONGEST_S = 0.03  # that a hand moves on before it looks again: one that sees four pictures a second is slow, not wild


class SyntheticHand:
    """Where the pointer goes next, from what a person sees: the handle and the phase of the trial."""

    def __init__(self, path: int, tip: tuple[float, float]) -> None:
        shape = PAPER.paths[path]
        self._start, self._end = np.array(shape.start_m), np.array(shape.end_m)
        self._at, self._beyond = np.array(tip), np.zeros(2)
        self._goal = self._start

    def __call__(self, tip: tuple[float, float], phase: int, dt: float) -> tuple[float, float]:
        dt = min(dt, LONGEST_S)
        goal = self._start if phase in (tick_log.APPROACH, tick_log.HOLD) else self._end
        if goal is not self._goal:
            self._goal, self._at, self._beyond = goal, self._at + self._beyond, np.zeros(2)
        way = goal - self._at
        far = float(np.hypot(*way))
        self._at = self._at + way * min(1.0, SPEED * dt / max(far, 1e-9))
        if far < 1e-6 and phase != tick_log.HOLD:
            self._beyond = self._beyond + PULL * dt * (goal - np.array(tip))
        x, y = self._at + self._beyond
        return float(x), float(y)
