"""A simulated scene with the guard of obstacles, which locks the brakes in place of the schedule.

The guard decides every millisecond of simulated time, from the true motion; in between its decision holds. Each step is
one of `simulation.run_rows`, which knows nothing of a guard.
"""

from typing import NamedTuple

import numpy as np

from core.control.algorithm import LOCK_TOO_LATE, NONE, Tick
from core.control.guard import AROUND, Around, keep_out, make_around
from core.control.velocity_field import new_memory, seen_in
from core.kernels import kernel
from core.records import new_record
from core.simulator.simulation import ROW_WIDTH, Grid, Schedule, Simulation, run_rows
from core.simulator.solver_numbers import EDGE_S
from core.tick_log import TICK_S

CHECKSUMS = 2**31 - 1
GUARDED_WIDTH = ROW_WIDTH + 1  # of a row: at its end the decision that holds from its time on

LOOKS = np.dtype(
    [
        ("around", AROUND),
        ("memory", "f8", new_memory().shape),
        ("decision", "i8"),  # of the last look
        ("ticks", "i8"),  # looks so far
        ("locked", "i8"),  # of them, those that locked the brakes
        ("too_late", "i8"),  # and of these, those that could not promise that the tip stops
        ("course", "i8"),  # a checksum of all decisions
    ]
)


class Guarding(NamedTuple):
    """The guard, and what the brakes get in place of their schedule where it locks them."""

    looks: np.ndarray  # one LOOKS record
    lock: Schedule  # full current
    per_look: int  # steps from one look to the next
    spare: np.ndarray  # (1, GUARDED_WIDTH), work space: what the steps between two rows write


class Guarded:
    """A simulation whose brakes the guard of its obstacles locks where it must."""

    def __init__(self, simulation: Simulation, obstacles: Around) -> None:
        self.simulation = simulation
        self.looks = new_record(LOOKS, around=make_around(obstacles, simulation.device)[0], memory=new_memory())
        brakes = simulation.brakes
        self.lock = Schedule(np.zeros(1), np.where(brakes["present"] > 0.0, brakes["current_max"], 0.0))

    def rows(self, n: int, schedule: Schedule, grid: Grid) -> np.ndarray:
        """n output rows (n, GUARDED_WIDTH); call again to go on. The step: a millisecond over a whole number."""
        simulation, out = self.simulation, np.zeros((n, GUARDED_WIDTH))
        guarding = Guarding(self.looks, self.lock, round(TICK_S / grid.step), np.zeros((1, GUARDED_WIDTH)))
        run_guarded_rows(simulation.model, simulation.data, guarding, schedule, grid, out)
        return out


@kernel
def run_guarded_rows(model, data, guarding, schedule, grid, rows):
    """Fill rows (n, GUARDED_WIDTH) of a grid, a step of `run_rows` at a time."""
    looks, lock, cursor = guarding.looks[0], guarding.lock, 0
    for r in range(rows.shape[0]):
        row = grid.first_row + r
        last = row * grid.per_row if row == grid.last_row else -1
        for s in range(grid.per_row):
            k = row * grid.per_row + s
            if k % guarding.per_look == 0:
                ask_guard(looks, model.brakes[0], data.body[0], lock.values[0])
            while cursor + 1 < schedule.times.shape[0] and schedule.times[cursor + 1] <= k * grid.step + EDGE_S:
                cursor += 1
            commands = Schedule(schedule.times[cursor:], schedule.values[cursor:])
            if looks.decision != NONE:
                commands = lock
            out = rows[r : r + 1] if s == 0 else guarding.spare
            run_rows(model, data, commands, Grid(k, last, 1, grid.step), out)
            if s == 0:
                rows[r, ROW_WIDTH] = looks.decision
            if k == last:
                return


@kernel
def ask_guard(looks, brakes, body, full):
    """Let the guard decide; full (4,), A: the currents of a lock."""
    seen = seen_in(body.tip, body.hand_force)
    looks.decision = keep_out(looks.around, Tick(seen, body.g, body.mass, brakes, looks.memory, full))
    looks.ticks += 1
    looks.course = (31 * looks.course + looks.decision) % CHECKSUMS
    if looks.decision != NONE:
        looks.locked += 1
    if looks.decision == LOCK_TOO_LATE:
        looks.too_late += 1
