"""A simulated operator at the handle of the emulated board: goes to and fro on a path, or as it is ordered."""

import math

import numpy as np

from core.files import InputError
from core.kernels import kernel
from core.path import Path, build_path, path_from
from core.simulator.hand import new_hand
from core.tick_log import APPROACH, END, MOVE, TICK_S
from experiments.trial.operator import (
    Moment,
    Person,
    begin_approach,
    new_operator,
    on_path,
    operate,
    take_handle,
)
from experiments.trial.population import load_population
from experiments.trial.tick import arrived
from experiments.trial.trial import NOISE_DRAWS

START_RADIUS_M, HOLD_S = 0.003, 1.0  # longer at the start than a trial asks for: no signal tells this person to go
END_RADIUS_M, REST_S, LONGEST_S = 0.005, 1.0, 30.0


@kernel
def act(operators, grips, path, moment, tip, noise):
    """`operate` on plain arrays."""
    operate(operators[0], grips[0], path, moment, tip, noise)


def drawn_operator(path: Path, seed: int) -> "EmulatedOperator":
    """A person drawn from a seed, at the start of a path."""
    generator = np.random.default_rng([seed, 3])
    return EmulatedOperator(load_population().draw(generator), path, (path.x0, path.y0), generator)


class EmulatedOperator:
    """Moves the handle from start to end, rests, and returns to the start."""

    def __init__(self, person: Person, path: Path, tip: tuple[float, float], generator: np.random.Generator) -> None:
        """tip: of the handle, m. generator: of reaction, noise and tremor, drawn in the order of a trial's."""
        self._person, self._path, self._tip, self._random = person, path, tip, generator
        self.hand = new_hand()
        self._grips = self.hand.grips.view(np.ndarray)  # calls from Python take longer with a record array
        self._waits = self._go = False
        self._tick = 0
        self._set_out()
        self.hand.grips["target"][0, :2] = tip
        self._noise = generator.standard_normal((NOISE_DRAWS, 2))

    def tick(self, x: float, y: float) -> None:
        """Act on the handle for one tick, with the tip where it is seen (m)."""
        self._tip = (x, y)
        self.update_phase(x, y)
        moment = Moment(self.phase, self._tick, self._phase_tick)
        act(self._records, self._grips, self._path, moment, self._tip, self._noise)
        self._tick += 1
        self._phase_tick += 1

    def obey(self, order: dict) -> None:
        """Follow an order; InputError if it makes no sense.

        {"path": {..}}: follow this path from now on; {"wait": true}: wait at the start until {"go": true}; {"away":
        true}: let go of the handle until {"away": false}.
        """
        if unknown := set(order) - {"path", "wait", "go", "away"}:
            raise InputError(f"the operator does not know the order {min(unknown)!r}")
        if "path" in order:
            self._path = build_path(path_from(order["path"], "path"), "path")
            self._set_out()
        self._waits = bool(order.get("wait", self._waits))
        self._go = bool(order.get("go", self._go))
        if "away" in order:
            self.hand.grips["spring"][0] = 0 if order["away"] else 1
            if not order["away"]:
                self._set_out()

    def _set_out(self) -> None:
        person = on_path(self._person, self._path)
        take_handle(person, self._path, self.hand.grips)
        records = new_operator(person, self._random)
        begin_approach(records[0], *self._tip, self._path)
        self._records = records.view(np.ndarray)
        self.enter(APPROACH)

    def enter(self, phase: int) -> None:
        """Begin a phase, of `core.tick_log`."""
        self.phase, self._phase_tick, self._ticks_arrived = phase, 0, 0

    def update_phase(self, x: float, y: float) -> None:
        """Enter the next phase once the handle has been at the start, or at the end, for long enough."""
        path = self._path
        if self.phase == APPROACH:
            at_start = math.hypot(x - path.x0, y - path.y0) <= START_RADIUS_M
            self._ticks_arrived = self._ticks_arrived + 1 if at_start else 0
            if self._ticks_arrived * TICK_S >= HOLD_S and (self._go or not self._waits):
                self._go = False
                self.enter(MOVE)
        elif self.phase == MOVE:
            at_end = arrived(path, int(self._records["piece"][0]), END_RADIUS_M, x, y)
            self._ticks_arrived = self._ticks_arrived + 1 if at_end else 0
            if self._ticks_arrived * TICK_S >= REST_S or self._phase_tick * TICK_S >= LONGEST_S:
                self.enter(END)
        elif self._phase_tick * TICK_S >= REST_S:
            self._set_out()
