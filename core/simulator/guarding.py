"""A simulated scene with the guard of obstacles, which locks the brakes in place of the schedule.

The guard sees the motion as it is, every millisecond of simulated time; between two looks its decision holds. What
simulates is `simulation.run_rows`, a step at a time: scenes without a guard know nothing of it.
"""

from typing import NamedTuple

import numpy as np

from core.control.algorithm import LOCK_TOO_LATE, NONE
from core.control.guard import AROUND, Around, Seen, keep_out, make_around
from core.control.stopping import TICK_S
from core.control.velocity_field import new_memory
from core.kernels import kernel
from core.simulator.simulation import ROW_WIDTH, Simulation, run_rows
from core.simulator.solver_numbers import EDGE_S
from core.simulator.state import new_record

CHECKSUMS = 2**31 - 1
GUARDED_WIDTH = ROW_WIDTH + 1  # of a row: at its end the decision that holds from its time on

GUARDING = np.dtype(
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


class Schedule(NamedTuple):
    """What the brakes are commanded."""

    times: np.ndarray  # (n,) s, rising, the first <= 0; each row holds from its time on
    values: np.ndarray  # (n, 4) A


class Lock(NamedTuple):
    """What the brakes get in place of it where the guard locks them."""

    times: np.ndarray  # (1,)
    values: np.ndarray  # (1, 4) A, full current
    spare: np.ndarray  # (1, GUARDED_WIDTH), work space: what the steps between two rows write


class Grid(NamedTuple):
    """Which rows are wanted, and how steps make them; as `run_rows` has them."""

    first_row: int
    last_row: int
    per_row: int
    per_tick: int  # steps from one look of the guard to the next
    step: float  # s
    fidelity: int
    integrator: int


class Guarded:
    """A simulation whose brakes the guard of its obstacles locks where it must."""

    def __init__(self, simulation: Simulation, how: Around) -> None:
        self.simulation = simulation
        self.guarding = new_record(GUARDING, around=make_around(how, simulation.device)[0], memory=new_memory())
        brakes = simulation.brakes
        full = np.where(brakes["present"] > 0.0, brakes["current_max"], 0.0)
        self.lock = Lock(np.zeros(1), full, np.zeros((1, GUARDED_WIDTH)))

    def rows(self, n: int, step: float, per_row: int, schedule: Schedule,
             first_row: int = 0, last_row: int = -1) -> np.ndarray:  # fmt: skip
        """n output rows (n, GUARDED_WIDTH); call again to go on. step (s): a millisecond over a whole number."""
        simulation, out = self.simulation, np.zeros((n, GUARDED_WIDTH))
        per_tick = round(TICK_S / step)
        grid = Grid(first_row, last_row, per_row, per_tick, step, simulation.fidelity, simulation.integrator)
        run_guarded_rows(simulation.arguments(), self.guarding, schedule, self.lock, grid, out)
        return out


@kernel
def run_guarded_rows(device, guardings, schedule, lock, grid, rows):
    """Fill rows (n, GUARDED_WIDTH) from row `first_row` on, advancing `per_row` steps after each but `last_row`.

    device: as of `Simulation.arguments`; per_tick steps go from one look of the guard to the next.
    """
    mechanisms, brake_records, hand, states, scratches = device
    guarding, step, cursor = guardings[0], grid.step, 0
    for r in range(rows.shape[0]):
        row = grid.first_row + r
        last = row * grid.per_row if row == grid.last_row else -1
        for s in range(grid.per_row):
            k = row * grid.per_row + s
            if k % grid.per_tick == 0:
                look(guarding, brake_records[0], states[0], lock.values[0])
            while cursor + 1 < schedule.times.shape[0] and schedule.times[cursor + 1] <= k * step + EDGE_S:
                cursor += 1
            times, values = schedule.times[cursor:], schedule.values[cursor:]
            if guarding.decision != NONE:
                times, values = lock.times, lock.values
            run_rows(
                mechanisms, brake_records, hand, states, scratches, times, values,
                k, last, 1, step, grid.fidelity, grid.integrator, rows[r : r + 1] if s == 0 else lock.spare,
            )  # fmt: skip
            if s == 0:
                rows[r, ROW_WIDTH] = guarding.decision
            if k == last:
                return


@kernel
def look(guarding, brakes, state, full):
    """A look of the guard at the state; full (4,), A: what a lock gives."""
    tip, force = state.tip, state.hand_force
    seen = Seen(tip[0], tip[1], tip[2], tip[3], force[0], force[1], state.g, state.mass)
    guarding.decision = keep_out(guarding.around, brakes, guarding.memory, seen, full)
    guarding.ticks += 1
    guarding.course = (31 * guarding.course + guarding.decision) % CHECKSUMS
    if guarding.decision != NONE:
        guarding.locked += 1
    if guarding.decision == LOCK_TOO_LATE:
        guarding.too_late += 1
