"""A simulation that its caller steps: currents and a force in, a state out.

A step is that of a scene (`simulated_device.move`), and a state is a scene's row, worked out on a copy: to look at it
changes nothing.
"""

import copy
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.device import Device, load_device
from core.files import InputError
from core.linkage import joint_angles
from core.mechanism import JOINTS
from core.ranges import FORCE, PLACE, SPEED, STEP, YIELD, Range
from core.records import new_record
from core.simulator import simulation as simulator
from core.simulator.runge_kutta import STEP_SCRATCH
from core.simulator.simulated_device import move
from core.simulator.simulation import ENERGIES, INTEGRATORS, ROW_WIDTH, STUCK, Grid, Schedule, run_rows
from core.simulator.state import FIDELITIES, Data
from core.tick_log import STUCK_LETTERS
from core.workspace import free_tips, tip_is_free

Two = Sequence[float] | np.ndarray
ONLY_NOW = Grid(first_row=0, last_row=0, per_row=1, step=1.0)  # a row, and nothing advances


class State(NamedTuple):
    """The state of a simulation. Arrays (4,) are of the joints A, E, B, C: 0 where there is no brake.

    Torques and `stuck` are those at the end of the last step.
    """

    time_s: float  # since the reset
    tip_m: np.ndarray  # (2,)
    velocity_m_s: np.ndarray  # (2,)
    angles_rad: np.ndarray  # (4,) A and B from +x, E and C from the link before them, counter-clockwise
    rates_rad_s: np.ndarray  # (4,) of the joints; of a coupling in the place of its brake
    torques_N_m: np.ndarray  # (4,) what each brake does, signed
    yields_N_m: np.ndarray  # (4,) what each brake can hold now
    stuck: str  # joints whose brakes stick, such as "AE"
    work_hand_J: float  # since the reset, as the next two
    heat_J: np.ndarray  # (4,) dissipated in each brake
    lost_at_stops_J: float  # absorbed by the hard stops
    kinetic_J: float  # now
    unexplained_J: float  # kinetic + heat + lost at stops - work - kinetic at the start: the integrator's error


class Simulation:
    """A device simulated step by step, as exactly as by `phd simulate`.

        simulation = phd.Simulation("three-brake", fidelity="mr")
        simulation.reset(tip_m=(0.0, 0.4))
        simulation.step([0.2, 0.0, 0.0], (1.0, 0.5), 1e-3)
        simulation.state.tip_m

    braked: the joints with a brake, such as "AEB". currents_max_A: array (n,), one per brake.
    """

    def __init__(self, device: str | Path | Device, fidelity: str = "mr", integrator: str = "event") -> None:
        """Starts at rest in the middle of the workspace, brakes off. device: shipped name, file, or `Device`.

        fidelity: "mr": lag and backlash; "static": torques follow at once; "ideal": commands are yield torques, N m.
        integrator: "event", "stepping" or "karnopp".
        """
        for name, word, known in (("fidelity", fidelity, FIDELITIES), ("integrator", integrator, INTEGRATORS)):
            if word not in known:
                raise InputError(f"{name} must be one of {', '.join(known)}, not {word!r}")
        self.device = device if isinstance(device, Device) else load_device(device)
        self.fidelity, self.integrator, self.braked = fidelity, integrator, self.device.braked
        places = [JOINTS.index(joint) for joint in self.braked]
        self.currents_max_A = self.device.brakes.current_max[places]
        most = np.full(len(places), YIELD.most) if fidelity == "ideal" else self.currents_max_A
        self._limits = list(zip(places, most.tolist(), strict=True))
        tips = free_tips(self.device.mechanism)
        x, y = tips[np.linalg.norm(tips - tips.mean(axis=0), axis=1).argmin()].tolist()
        self.reset((x, y))

    def reset(self, tip_m: Two, velocity_m_s: Two = (0.0, 0.0)) -> None:
        """Start again at a tip and velocity (x, y): brakes off, backlash centred, time and energies 0."""
        tip, velocity = _pair("tip_m", tip_m, PLACE), _pair("velocity_m_s", velocity_m_s, SPEED)
        if not tip_is_free(self.device.mechanism, *tip):
            raise InputError(f"tip_m: the tip of {self.device.name} cannot be at ({tip[0]:g}, {tip[1]:g}) m")
        self.time_s = 0.0
        self._fx = self._fy = 0.0
        self._commands, self._currents = np.zeros(4), [0.0] * len(self.braked)
        self._hold(simulator.Simulation(self.device, tip, velocity, self.fidelity, self.integrator))

    def _hold(self, device: simulator.Simulation) -> None:
        self._device = device
        self._model, self._data = device.model, device.data
        self._settled, self._hand, self._tip = device.body["settled"], device.hand.forces[0], device.body["tip"][0]

    def step(self, currents_A: Sequence[float] | np.ndarray, force_N: Two = (0.0, 0.0), step_s: float = 1e-3) -> None:
        """Advance by step_s with constant currents (one per brake, as in `braked`) and hand force (x, y).

        With "ideal": yield torques, N m, instead of currents. FloatingPointError: the motion diverges.
        """
        currents = currents_A.tolist() if isinstance(currents_A, np.ndarray) else list(currents_A)
        if currents != self._currents:
            self._set_currents(currents)
        try:
            fx, fy = force_N.tolist() if isinstance(force_N, np.ndarray) else force_N
        except ValueError:
            raise InputError(f"force_N must be two numbers, in N, not {force_N!r}") from None
        if fx != self._fx or fy != self._fy:
            if not (-FORCE.most <= fx <= FORCE.most and -FORCE.most <= fy <= FORCE.most):
                raise InputError(f"force_N {FORCE.refusal(fx) or FORCE.refusal(fy)}")
            self._hand[0], self._hand[1] = self._fx, self._fy = fx, fy
            self._settled[0] = 0
        if not STEP.least <= step_s <= STEP.most:
            raise InputError(f"step_s {STEP.refusal(step_s)}")
        move(self._model, self._data, self._commands, self.time_s, step_s)
        self.time_s += step_s
        if not isfinite(self._tip.item(0)):
            raise FloatingPointError(f"the motion diverges at {self.time_s:g} s; choose a smaller step")

    def _set_currents(self, currents: list[float]) -> None:
        if len(currents) != len(self._limits):
            raise InputError(f"currents_A must be {len(self._limits)} ({', '.join(self.braked)}), not {len(currents)}")
        commands = self._commands
        for current, (place, most) in zip(currents, self._limits, strict=False):
            if not 0.0 <= current <= most:
                raise InputError(f"currents_A: that of {JOINTS[place]} must be from 0 to {most:g}, not {current}")
            commands[place] = current
        self._currents = currents

    @property
    def state(self) -> State:
        """The present `State`, a copy."""
        device, rows = self._device, np.zeros((1, ROW_WIDTH))
        body, braking, ledger = device.body.copy(), device.braking.copy(), self._data.ledger.copy()
        data = Data(device.hand, body, braking, ledger, new_record(STEP_SCRATCH))
        run_rows(self._model, data, Schedule(np.zeros(1), self._commands[None]), ONLY_NOW, rows)
        row, angles = rows[0], np.zeros(4)
        joint_angles(device.mechanism[0], row[1], row[2], angles)
        work, heat, kinetic, at_stops = row[ENERGIES:].tolist()
        return State(
            time_s=self.time_s, tip_m=row[1:3], velocity_m_s=row[3:5], angles_rad=angles,
            rates_rad_s=body["rate"][0, :4], torques_N_m=row[5:9], yields_N_m=braking["torque_yield"][0],
            stuck=STUCK_LETTERS[int(row[STUCK])], kinetic_J=kinetic, work_hand_J=work, heat_J=ledger["heat"][0],
            lost_at_stops_J=at_stops,
            unexplained_J=kinetic + heat + at_stops - work - ledger["kinetic_start"].item(),
        )  # fmt: skip

    def copy(self) -> "Simulation":
        """An independent simulation in the same state."""
        other = copy.copy(self)
        other._commands = self._commands.copy()
        other._hold(copy.deepcopy(self._device, {id(self.device): self.device}))
        return other


def _pair(name: str, given: Two, allowed: Range) -> tuple[float, float]:
    """Two numbers of a range. InputError."""
    try:
        x, y = map(float, given)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be two numbers, in {allowed.unit}, not {given!r}") from None
    for value in (x, y):
        if reason := allowed.refusal(value):
            raise InputError(f"{name} {reason}")
    return x, y
