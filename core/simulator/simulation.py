"""The simulated device: commands in, motion out. One step is a short list of stages.

apply: the commands of this step become yield torques (fidelity: what of the brake model a scene needs);
resolve: which brakes stick, which slip, and the torques that follow; advance: the integrator carries the state over the
step.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.brake import torque_gain
from core.device import Device
from core.kernels import kernel
from core.mechanism import PLACES
from core.records import new_record
from core.simulator.event import advance_event
from core.simulator.hand import Hand, new_hand, split_at_knots
from core.simulator.karnopp import advance_karnopp, resolve_in_band
from core.simulator.runge_kutta import STEP_SCRATCH, kinetic
from core.simulator.solver_numbers import (
    ADDED_J,
    DELTA_OMEGA,
    EDGE_S,
    RATE_ROUNDING,
    UNEXPLAINED,
    UNEXPLAINED_J,
)
from core.simulator.state import (
    BRAKING,
    FIDELITIES,
    IDEAL,
    LEDGER,
    STATIC,
    Data,
    Model,
    new_body,
    pack_brakes,
    pack_mechanism,
)
from core.simulator.stepping import advance_stepping
from core.simulator.stick_slip import STILL, same_line
from core.simulator.stick_slip_mode import hand_changed, resolve, update_kinematics
from core.stops import distal_sine

INTEGRATORS = ("event", "stepping", "karnopp")
EVENT, STEPPING, KARNOPP = range(3)

#: Columns of a row: t, x, y, vx, vy, torques A, E, B, C, stuck bits; then what went in: hand force x, y (N), commands
#: A, E, B, C; then the energies (J): work of the hand, heat of the brakes, kinetic, lost at stops.
ROW_WIDTH = 20
STUCK, HAND, COMMANDS, ENERGIES = 9, 10, 12, 16


@kernel
def apply(model, braking, commands):
    """Stage: yields from the commands (4,): yield torques (ideal), currents (static); mr has its lag."""
    brakes = model.brakes
    if model.fidelity == IDEAL:
        for i in range(4):
            braking.torque_yield[i] = commands[i]
    elif model.fidelity == STATIC:
        for i in range(4):
            if brakes.present[i] > 0.0:
                braking.torque_yield[i] = torque_gain(brakes, i, commands[i])


@kernel
def advance(model, data, commands, t, h):
    """Stage: the integrator carries the resolved state from t to t + h, s."""
    if model.integrator == EVENT:
        advance_event(model, data, commands, t, h)
    elif model.integrator == STEPPING:
        data.ledger.steps += 1
        advance_stepping(model, data, commands, t, h)
    else:
        data.ledger.steps += 1
        advance_karnopp(model, data, commands, t, h)


@kernel
def stuck_bits(model, body, braking):
    """Which brakes are stuck (bit i for joint i): held, and able to hold anything."""
    bits = 0
    for i in range(4):
        if model.brakes.present[i] > 0.0 and braking.torque_yield[i] > 0.0:
            if body.held == STILL or (body.held >= 0 and same_line(i, body.held, model.mechanism.lines)):
                bits |= 1 << i
    return bits


@kernel
def energy_residual(body, ledger):
    """What the ledger leaves unexplained (J): kinetic + heat + stops - work of the hand - kinetic at the start."""
    heat = ledger.heat[0] + ledger.heat[1] + ledger.heat[2] + ledger.heat[3]
    return kinetic(body) + heat + ledger.lost_at_stops - ledger.work_hand - ledger.kinetic_start


@kernel
def start(model, data):
    """A new state: rows and mass at its position, each joint slips as it moves, brakes off, the play in the middle."""
    mechanism, brakes = model.mechanism[0], model.brakes[0]
    body, braking, ledger = data.body[0], data.braking[0], data.ledger[0]
    body.distal_side = 1.0 if distal_sine(mechanism, body.tip[0], body.tip[1]) > 0.0 else -1.0
    update_kinematics(mechanism, body)
    ledger.kinetic_start = kinetic(body)
    for j in range(PLACES):  # before `resolve` asks how a joint goes on that stands while these move
        if abs(body.rate[j]) > RATE_ROUNDING:
            body.sign[j] = 1.0 if body.rate[j] > 0.0 else -1.0
    for i in range(4):
        braking.play[i] = 0.5 * brakes.play[i]
        braking.edge[i] = 0.0
        if model.fidelity != IDEAL and brakes.present[i] > 0.0:
            braking.torque_yield[i] = brakes.k[i, 1]


class Schedule(NamedTuple):
    """The commands to the brakes over time."""

    times: np.ndarray  # (n,) s, rising, the first <= 0; each row holds from its time on
    values: np.ndarray  # (n, 4) N m or A, as the fidelity has it


class Grid(NamedTuple):
    """Which rows are wanted, and how many steps make them."""

    first_row: int
    last_row: int  # nothing advances after it; -1: none is the last
    per_row: int  # steps from one row to the next
    step: float  # s


@kernel
def run_rows(model, data, schedule, grid, rows):
    """Fill rows (n, ROW_WIDTH) of a grid.

    A row of the schedule inside a step splits it, and so do the knots of a force table that the step would not see.
    """
    model = Model(model.mechanism[0], model.brakes[0], model.fidelity, model.integrator)
    data = Data(data.hand, data.body[0], data.braking[0], data.ledger[0], data.scratch[0])
    hand, body, braking, ledger = data.hand, data.body, data.braking, data.ledger
    times, values = schedule.times, schedule.values
    per_row, step, cursor = grid.per_row, grid.step, 0
    if body.settled != 0 and hand_changed(hand, body, grid.first_row * per_row * step):
        body.settled = 0
    for r in range(rows.shape[0]):
        row = grid.first_row + r
        for s in range(per_row):
            k = row * per_row + s
            t, end = k * step, (k + 1) * step
            while t < end:
                while cursor + 1 < times.shape[0] and times[cursor + 1] <= t + EDGE_S:
                    cursor += 1
                apply(model, braking, values[cursor])
                if model.integrator == KARNOPP:
                    resolve_in_band(model, data, t)
                else:
                    resolve(model, data, t)
                if s == 0 and t == k * step:
                    rows[r, 0] = t
                    for i in range(4):
                        rows[r, 1 + i] = body.tip[i]
                        rows[r, 5 + i] = braking.torque[i]
                    rows[r, STUCK] = stuck_bits(model, body, braking)
                    rows[r, HAND], rows[r, HAND + 1] = body.hand_force[0], body.hand_force[1]
                    rows[r, ENERGIES], rows[r, ENERGIES + 1] = ledger.work_hand, 0.0
                    for i in range(4):
                        rows[r, COMMANDS + i] = values[cursor, i]
                        rows[r, ENERGIES + 1] += ledger.heat[i]
                    rows[r, ENERGIES + 2], rows[r, ENERGIES + 3] = kinetic(body), ledger.lost_at_stops
                    if row == grid.last_row:
                        return
                until = end
                if cursor + 1 < times.shape[0] and times[cursor + 1] < end - EDGE_S:
                    until = times[cursor + 1]
                if hand.times.shape[0] > 1:
                    until = split_at_knots(hand, t, until)
                h = step if until == end and t == k * step else until - t
                advance(model, data, values[cursor], t, h)
                t = until


@dataclass(frozen=True)
class Ledger:
    """Energies in J since the start, and what happened on the way."""

    work_hand: float
    heat: tuple[float, ...]
    lost_at_stops: float
    kinetic: float
    residual: float
    added_by_brakes: float
    steps: int
    events: int
    fallbacks: int

    def warnings(self) -> tuple[str, ...]:
        """Why the motion that the ledger belongs to may be wrong, a sentence each; none where it agrees."""
        found, added = [], self.added_by_brakes
        changed_hands = abs(self.work_hand) + sum(self.heat) + self.lost_at_stops + self.kinetic
        if not abs(self.residual) <= UNEXPLAINED * changed_hands + UNEXPLAINED_J:
            found.append(
                f"the energy ledger leaves {self.residual:.2g} J of {changed_hands:.2g} J unexplained: "
                "the motion may be wrong; choose a smaller step"
            )
        if not added <= ADDED_J:
            found.append(f"a brake added {added:.2g} J within a step, which no brake can; choose a smaller step")
        return tuple(found)


class Simulation:
    """One simulated device. Commands are yield torques (ideal, N m) or currents (static and mr, A), (4,) A, E, B, C."""

    def __init__(
        self,
        device: Device,
        tip: tuple[float, float],
        velocity: tuple[float, float] = (0.0, 0.0),
        fidelity: str = "ideal",
        integrator: str = "event",
        hand: Hand | None = None,
    ):
        """At a tip (m) with a velocity (m/s). Before a run, `tolerance` and `delta_omega` of its body may be set."""
        self.device = device
        self.fidelity = FIDELITIES.index(fidelity)
        self.integrator = INTEGRATORS.index(integrator)
        self.mechanism = pack_mechanism(device.mechanism)
        self.brakes = pack_brakes(device.brakes, backlash=fidelity == "mr")
        self.hand = hand if hand is not None else new_hand()
        self.step_scratch = new_record(STEP_SCRATCH)
        self.body, self.braking = new_body(*tip, *velocity), new_record(BRAKING)
        self._ledger = new_record(LEDGER)
        self.body["delta_omega"][0] = DELTA_OMEGA
        start(self.model, self.data)

    @property
    def model(self) -> Model:
        """The constant part, as kernels take it."""
        return Model(self.mechanism, self.brakes, self.fidelity, self.integrator)

    @property
    def data(self) -> Data:
        """The changing part, as kernels take it."""
        return Data(self.hand, self.body, self.braking, self._ledger, self.step_scratch)

    def rows(self, n: int, schedule: Schedule, grid: Grid) -> np.ndarray:
        """n output rows (n, ROW_WIDTH); call again to go on."""
        out = np.zeros((n, ROW_WIDTH))
        run_rows(self.model, self.data, schedule, grid, out)
        return out

    def run(self, duration: float, step: float, commands: np.ndarray) -> np.ndarray:
        """Run from t = 0 with constant commands; one row a step and the last one, (n + 1, ROW_WIDTH)."""
        n = round(duration / step)
        return self.rows(n + 1, Schedule(np.zeros(1), np.array([commands], dtype=float)), Grid(0, n, 1, step))

    def ledger(self) -> Ledger:
        """The energy ledger and the counters now."""
        s, body = self._ledger, self.body
        return Ledger(
            float(s["work_hand"][0]), tuple(map(float, s["heat"][0])), float(s["lost_at_stops"][0]),
            float(kinetic(body[0])), float(energy_residual(body[0], s[0])), float(s["added_by_brakes"][0]),
            int(s["steps"][0]), int(s["events"][0]), int(s["fallbacks"][0]),
        )  # fmt: skip
