"""The simulated device: commands in, motion out. One step is a short list of stages.

apply: the commands of this step become yield torques (fidelity: what of the brake model a scene needs), with their
ripple; resolve: which brakes stick, which slip, and the torques that follow; advance: the integrator carries the state
over the step.
"""

import math
from dataclasses import dataclass

import numpy as np

from core.brake import torque_gain
from core.device import Device
from core.kernels import kernel
from core.linkage import coupled_angle, joint_angles
from core.simulator.event import advance_event
from core.simulator.hand import Hand, new_hand, split_at_knots
from core.simulator.karnopp import advance_karnopp, resolve_in_band
from core.simulator.runge_kutta import STEP_SCRATCH, kinetic
from core.simulator.solver_numbers import ADDED_J, DELTA_OMEGA, EDGE_S, UNEXPLAINED, UNEXPLAINED_J
from core.simulator.state import new_record, new_state, pack_brakes, pack_mechanism
from core.simulator.stepping import advance_stepping
from core.simulator.stick_slip import STILL, same_line
from core.simulator.stick_slip_mode import hand_changed, look, resolve
from core.stops import distal_sine

FIDELITIES = ("ideal", "static", "mr")
IDEAL, STATIC, MR = range(3)
INTEGRATORS = ("event", "stepping", "karnopp")
EVENT, STEPPING, KARNOPP = range(3)

ROW_WIDTH = 10  # t, x, y, vx, vy, torque A, E, B, C, stuck bits


#: Torque ripple: periods a turn. Assumed; the paper tells its size alone.
RIPPLE_PERIODS = 36


@kernel
def apply(mechanism, brakes, state, commands, fidelity):
    """Stage: yields from the commands (4,): yield torques (ideal), currents (static); mr has its lag."""
    if fidelity == IDEAL:
        for i in range(4):
            state.torque_yield[i] = commands[i]
    elif fidelity == STATIC:
        for i in range(4):
            if brakes.present[i] > 0.0:
                state.torque_yield[i] = torque_gain(brakes, i, commands[i])
    if brakes.ripple > 0.0:
        swing(mechanism, brakes, state, fidelity)


@kernel
def swing(mechanism, brakes, state, fidelity):
    """Torque ripple: over a turn the torque of a brake swings about its mean, as the paper saw it do by about 1 N m.

    Assumed: a sine of the joint's angle, held over the step, whose height is at most what the field adds to the torque
    without current. So the yield stays positive, and at a constant current its mean is K.
    """
    joint_angles(mechanism, state.tip[0], state.tip[1], state.theta)
    for i in range(4):
        if mechanism.coupled >> i & 1 != 0:
            state.theta[i] = coupled_angle(mechanism, i, state.tip[0], state.tip[1])
        if brakes.present[i] > 0.0:
            mean = state.torque_yield[i] - (state.ripple[i] if fidelity == MR else 0.0)
            height = min(brakes.ripple, max(mean - brakes.k[i, 1], 0.0))
            state.ripple[i] = height * math.sin(RIPPLE_PERIODS * state.theta[i])
            state.torque_yield[i] = mean + state.ripple[i]


@kernel
def advance(mechanism, brakes, hand, state, scratch, commands, t, h, fidelity, integrator):
    """Stage: the integrator carries the resolved state from t to t + h, s."""
    lagged = 1 if fidelity == MR else 0
    if integrator == EVENT:
        advance_event(mechanism, brakes, hand, state, scratch, commands, t, h, lagged)
    elif integrator == STEPPING:
        state.steps += 1
        advance_stepping(mechanism, brakes, hand, state, scratch, commands, t, h, lagged)
    else:
        state.steps += 1
        advance_karnopp(mechanism, brakes, hand, state, scratch, commands, t, h, lagged)


@kernel
def stuck_bits(mechanism, brakes, state):
    """Which brakes are stuck (bit i for joint i): held, and able to hold anything."""
    bits = 0
    for i in range(4):
        if brakes.present[i] > 0.0 and state.torque_yield[i] > 0.0:
            if state.held == STILL or (state.held >= 0 and same_line(i, state.held, mechanism.lines)):
                bits |= 1 << i
    return bits


@kernel
def energy_residual(state):
    """What the ledger leaves unexplained (J): kinetic + heat + stops - work of the hand - kinetic at the start."""
    heat = state.heat[0] + state.heat[1] + state.heat[2] + state.heat[3]
    return kinetic(state) + heat + state.lost_at_stops - state.work_hand - state.kinetic_start


@kernel
def start(mechanisms, brake_records, states, fidelity):
    """A new state: rows and mass at its position, brakes off, the play in the middle of the backlash."""
    mechanism, brakes, state = mechanisms[0], brake_records[0], states[0]
    state.distal_side = 1.0 if distal_sine(mechanism, state.tip[0], state.tip[1]) > 0.0 else -1.0
    look(mechanism, state)
    state.kinetic_start = kinetic(state)
    for i in range(4):
        state.play[i] = 0.5 * brakes.play[i]
        state.edge[i] = 0.0
        if fidelity != IDEAL and brakes.present[i] > 0.0:
            state.torque_yield[i] = brakes.k[i, 1]


@kernel
def run_rows(
    mechanisms, brake_records, hand, states, scratches, times, values,
    first_row, last_row, per_row, step, fidelity, integrator, rows,
):  # fmt: skip
    """Fill rows (n, ROW_WIDTH) from row `first_row` on, advancing `per_row` steps after each but `last_row`.

    times (m,), values (m, 4): the command schedule; a row inside a step splits it, and so do the knots of a force
    table that the step would not see.
    """
    mechanism, brakes, state, scratch = mechanisms[0], brake_records[0], states[0], scratches[0]
    cursor = 0
    if state.settled != 0 and hand_changed(hand, state, first_row * per_row * step):
        state.settled = 0
    for r in range(rows.shape[0]):
        row = first_row + r
        for s in range(per_row):
            k = row * per_row + s
            t, end = k * step, (k + 1) * step
            while t < end:
                while cursor + 1 < times.shape[0] and times[cursor + 1] <= t + EDGE_S:
                    cursor += 1
                apply(mechanism, brakes, state, values[cursor], fidelity)
                if integrator == KARNOPP:
                    resolve_in_band(mechanism, brakes, hand, state, t)
                else:
                    resolve(mechanism, brakes, hand, state, t)
                if s == 0 and t == k * step:
                    rows[r, 0] = t
                    for i in range(4):
                        rows[r, 1 + i] = state.tip[i]
                        rows[r, 5 + i] = state.torque[i]
                    rows[r, 9] = stuck_bits(mechanism, brakes, state)
                    if row == last_row:
                        return
                until = end
                if cursor + 1 < times.shape[0] and times[cursor + 1] < end - EDGE_S:
                    until = times[cursor + 1]
                if hand.times.shape[0] > 1:
                    until = split_at_knots(hand, t, until)
                h = step if until == end and t == k * step else until - t
                advance(mechanism, brakes, hand, state, scratch, values[cursor], t, h, fidelity, integrator)
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
    signed: bool  # the lag acts on the signed torque, which is not passive

    def warnings(self) -> tuple[str, ...]:
        """Why the motion that the ledger belongs to may be wrong, a sentence each; none where it agrees."""
        found, added = [], self.added_by_brakes
        changed_hands = abs(self.work_hand) + sum(self.heat) + self.lost_at_stops + self.kinetic
        if not abs(self.residual) <= UNEXPLAINED * changed_hands + UNEXPLAINED_J:
            found.append(
                f"the energy ledger leaves {self.residual:.2g} J of {changed_hands:.2g} J unexplained: "
                "the motion may be wrong; choose a smaller step"
            )
        if self.signed and added > ADDED_J:
            found.append(
                f"a brake added {added:.2g} J within a step: with the lag on the signed torque (brake model signed) "
                "the device is not passive"
            )
        elif not added <= ADDED_J:
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
        backlash: bool = True,
        delta_omega: float = DELTA_OMEGA,
        tolerance: float = 1.0,
    ):
        self.device = device
        self.fidelity = FIDELITIES.index(fidelity)
        self.integrator = INTEGRATORS.index(integrator)
        self.mechanism = pack_mechanism(device.mechanism)
        self.brakes = pack_brakes(device.brakes, backlash=backlash and fidelity == "mr")
        self.hand = hand if hand is not None else new_hand()
        self.step_scratch = new_record(STEP_SCRATCH)
        self.state = new_state(*tip, *velocity)
        self.state["delta_omega"][0] = delta_omega
        self.state["tolerance"][0] = tolerance
        start(self.mechanism, self.brakes, self.state, self.fidelity)

    def arguments(self) -> tuple:
        """Mechanism, brakes, hand, state and scratch as kernels take them."""
        return self.mechanism, self.brakes, self.hand, self.state, self.step_scratch

    def rows(self, n: int, step: float, per_row: int, times: np.ndarray, values: np.ndarray,
             first_row: int = 0, last_row: int = -1) -> np.ndarray:  # fmt: skip
        """n output rows (n, ROW_WIDTH): t, x, y, vx, vy, torque A, E, B, C, stuck bits; call again to go on."""
        out = np.zeros((n, ROW_WIDTH))
        how = first_row, last_row, per_row, step, self.fidelity, self.integrator
        run_rows(*self.arguments(), times, values, *how, out)
        return out

    def run(self, duration: float, step: float, commands: np.ndarray) -> np.ndarray:
        """Run from t = 0 with constant commands; one row a step and the last one, (n + 1, ROW_WIDTH)."""
        n = round(duration / step)
        return self.rows(n + 1, step, 1, np.zeros(1), np.array([commands], dtype=float), 0, n)

    def ledger(self) -> Ledger:
        """The energy ledger and the counters now."""
        s = self.state
        return Ledger(
            float(s["work_hand"][0]), tuple(map(float, s["heat"][0])), float(s["lost_at_stops"][0]),
            float(kinetic(s[0])), float(energy_residual(s[0])), float(s["added_by_brakes"][0]),
            int(s["steps"][0]), int(s["events"][0]), int(s["fallbacks"][0]), bool(self.brakes["signed"][0]),
        )  # fmt: skip
