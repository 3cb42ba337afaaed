"""A simulated operator at the handle of the emulated board: goes to and fro on a path, or as it is told."""

import math

import numpy as np

from core.files import InputError
from core.kernel import kernel
from core.path import Path, build_path, path_from
from core.simulator.hand import new_hand
from core.tick_log import APPROACH, END, MOVE
from experiments.trial.operator import TICK_S, Person, begin_approach, new_operator, operate, take_handle
from experiments.trial.trial import NOISE_DRAWS

START_RADIUS_M, HOLD_S = 0.003, 1.0  # longer at the start than a trial asks for: nobody tells this person to go
END_RADIUS_M, REST_S, LONGEST_S = 0.005, 1.0, 30.0


@kernel
def act(operators, grips, path, phase, tick, phase_tick, x, y, noise):
    """`operate` on plain arrays."""
    operate(operators[0], grips[0], path, phase, tick, phase_tick, x, y, noise)


class EmulatedOperator:
    """Who holds the handle. By itself it goes from start to end, rests, and comes back to the start."""

    def __init__(self, person: Person, path: Path, tip: tuple[float, float], generator: np.random.Generator) -> None:
        """tip: where the handle is, m. generator: of reaction, noise and tremor, drawn in the order of a trial's."""
        self._person, self._path, self._tip, self._random = person, path, tip, generator
        self.hand = new_hand()
        self._grip = self.hand.grips[0]
        # a plain array: calls from Python take longer with the other kind
        self._grips = self.hand.grips.view(np.ndarray)
        self._waits = self._go = self._told = False
        self._tick = 0
        self._set_out()
        self._grip.target[0], self._grip.target[1] = tip
        self._noise = generator.standard_normal((NOISE_DRAWS, 2))

    def tick(self, x: float, y: float) -> None:
        """Before each tick: what it sees of the handle (m), and what it then does."""
        self._tip = (x, y)
        if not self._told:
            self._go_on(x, y)
        act(
            self._records, self._grips, self._path, self._phase, self._tick, self._phase_tick, x, y, self._noise
        )  # fmt: skip
        self._tick += 1
        self._phase_tick += 1

    def tell(self, phase: int) -> None:
        """The phase of a trial, as a participant sees it on the screen; from now on it goes by these alone."""
        self._told = True
        if phase != self._phase:
            self._enter(phase)

    def obey(self, order: dict) -> None:
        """Orders; InputError where they make no sense.

        {"path": {..}}: from now on this one; {"wait": true}: at the start until {"go": true}; {"away": true}: it lets
        go of the handle until {"away": false}.
        """
        if unknown := set(order) - {"path", "wait", "go", "away"}:
            raise InputError(f"the operator does not know the order {min(unknown)!r}")
        if "path" in order:
            self._path = build_path(path_from(order["path"], "path"), "path")
            self._set_out()
        self._waits = bool(order.get("wait", self._waits))
        self._go = bool(order.get("go", self._go))
        if "away" in order:
            self._grip.spring = 0 if order["away"] else 1
            if not order["away"]:
                self._set_out()

    def _set_out(self) -> None:
        take_handle(self._person, self._path, self.hand.grips)
        records = new_operator(self._person, self._random)
        begin_approach(records[0], *self._tip, self._path)
        self._records = records.view(np.ndarray)
        self._enter(APPROACH)

    def _enter(self, phase: int) -> None:
        self._phase, self._phase_tick, self._there = phase, 0, 0

    def _go_on(self, x: float, y: float) -> None:
        path = self._path
        if self._phase == APPROACH:
            self._there = self._there + 1 if math.hypot(x - path.x0, y - path.y0) <= START_RADIUS_M else 0
            if self._there * TICK_S >= HOLD_S and (self._go or not self._waits):
                self._go = False
                self._enter(MOVE)
        elif self._phase == MOVE:
            self._there = self._there + 1 if math.hypot(x - path.x1, y - path.y1) <= END_RADIUS_M else 0
            if self._there * TICK_S >= REST_S or self._phase_tick * TICK_S >= LONGEST_S:
                self._enter(END)
        elif self._phase_tick * TICK_S >= REST_S:
            self._set_out()
