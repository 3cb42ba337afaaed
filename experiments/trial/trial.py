"""One trial on a simulated device, tick by tick: the same for a simulated operator and for a hand at the mouse."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.control.controllers import Controller, Preset, make_controller, new_memory
from core.device import Device
from core.path import Path
from core.path_file import PathFile, build_path
from core.simulator.hand import Hand
from core.simulator.simulation import Ledger, Simulation
from core.simulator.state import CARRIED, STATE, new_record
from core.simulator.stick_slip import STILL
from core.simulator.stick_slip_mode import look
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules
from experiments.trial.operator import OPERATOR, Person, new_operator, take_handle
from experiments.trial.tick import REASONS, RUNNING, STATUSES, TICK_S, new_run, run_ticks

#: Draws of noise per axis for one trial; a longer trial goes round.
NOISE_DRAWS = 1 << 16


#: Our choice: a person's approach, which may take its time, ends a forgotten trial after 10 minutes.
PERSON_APPROACH_S = 600.0
#: What a protocol that says nothing else has.
DEFAULT_RULES = TrialRules()


class Arguments(NamedTuple):
    """What `run_ticks` takes before the rows, in its order: a trial as the control loop gets it."""

    path: Path
    controller: Controller
    mechanism: np.recarray
    brakes: np.recarray
    hand: Hand
    state: np.recarray
    trial: np.recarray
    run: np.recarray
    operator: np.recarray
    noise: np.ndarray
    memory: np.ndarray


class Trial:
    """One trial of the plan on a simulated device that stays as the last trial left it."""

    def __init__(
        self,
        simulation: Simulation,
        planned: PlannedTrial,
        path: PathFile,
        preset: Preset,
        rules: str,
        how: TrialRules = DEFAULT_RULES,
        person: Person | None = None,
        generator: np.random.Generator | None = None,
    ) -> None:
        """preset: its controller, whatever `planned` calls it. how: durations and radii of the protocol.

        person and generator: a simulated operator; None: the hand's target is set from outside (`aim`).
        """
        self.simulation, self.planned = simulation, planned
        self.path: Path = build_path(path, f"path {planned.segment}")
        self.controller: Controller = make_controller(preset, simulation.device.force_normalised_N, rules)
        self._memory = new_memory()
        self._run = new_run(simulation.fidelity, person is not None)
        for name, value in run_fields(how, person is not None).items():
            self._run[name][0] = value
        self._operator, self._noise = new_record(OPERATOR), np.zeros((1, 2))
        if person is not None and generator is not None:
            self._operator = new_operator(person, generator)
            self._noise = generator.standard_normal((NOISE_DRAWS, 2))
            take_handle(person, self.path, simulation.hand.grips)
        self._abort_reason = ""
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were
        come_to_rest(simulation)
        self.start = recorded_start(simulation)
        self._before = simulation.ledger()

    def aim(self, x: float, y: float) -> None:
        """Where the hand wants the handle to be (m), from now on; its velocity counts as zero."""
        self.simulation.hand.grips["target"][0] = (x, y, 0.0, 0.0)

    def run(self, rows: np.ndarray) -> int:
        """Run ticks into rows (n, tick_log.WIDTH) until they are full or the trial is finished; how many were run."""
        return int(run_ticks(*self.arguments(), rows))

    def arguments(self) -> Arguments:
        """The trial as the kernels see it; what they change is changed here."""
        s = self.simulation
        return Arguments(
            self.path, self.controller, s.mechanism, s.brakes, s.hand, s.state, s.trial,
            self._run, self._operator, self._noise, self._memory,
        )  # fmt: skip

    def abort(self, reason: str) -> None:
        """Stop at the next tick, brakes off; the trial ends as aborted with this reason."""
        self._abort_reason = reason
        self._run["stop"][0] = 1

    @property
    def finished(self) -> bool:
        """Whether the last tick has been run."""
        return bool(self._run["finished"][0])

    @property
    def phase(self) -> str:
        """The phase of the tick to come."""
        return tick_log.PHASES[int(self._run["phase"][0])]

    @property
    def device(self) -> Device:
        """The device behind it."""
        return self.simulation.device

    @property
    def tip(self) -> tuple[float, float]:
        """Where the handle is, m."""
        tip = self.simulation.state["tip"][0]
        return float(tip[0]), float(tip[1])

    @property
    def ticks(self) -> int:
        """Ticks run so far."""
        return int(self._run["tick"][0])

    def outcome(self) -> dict:
        """How the trial ended, for the end record: status, reason, and what the simulator counted."""
        status = int(self._run["status"][0])
        reason = REASONS[int(self._run["reason"][0])]
        now, before = self.simulation.ledger(), self._before
        return {
            "status": STATUSES[status] if status != RUNNING else "aborted",
            "reason": (self._abort_reason or reason) if STATUSES[status] == "aborted" else reason,
            "events": now.events - before.events,
            "fallbacks": now.fallbacks - before.fallbacks,
            "energy_residual_J": now.residual - before.residual,
            "energy_added_max_J": now.added_by_brakes,
            "warnings": ledger_warnings(before, now),
            **({"timing": self.timing} if self.timing else {}),
        }


def ledger_warnings(before: Ledger, after: Ledger) -> list[str]:
    """What the simulator's ledger says against its motion between two of its states; none where it agrees."""
    between = replace(
        after,
        work_hand=after.work_hand - before.work_hand,
        heat=(sum(after.heat) - sum(before.heat),),
        lost_at_stops=after.lost_at_stops - before.lost_at_stops,
        residual=after.residual - before.residual,
    )
    return list(between.warnings())


def run_fields(how: TrialRules, simulated_hand: bool) -> dict[str, float]:
    """The fields of `tick.RUN` that a protocol decides: lengths in m, durations in whole ticks."""
    fields = {
        "start_radius": how.start_radius_m,
        "end_radius": how.end_radius_m,
        "hold_ticks": round(how.hold_s / TICK_S),
        "move_ticks": round(how.time_out_s / TICK_S),
        "end_ticks": round(how.end_s / TICK_S),
    }
    approach_s = how.approach_time_out_s if simulated_hand else PERSON_APPROACH_S
    return {**fields, "approach_ticks": round(approach_s / TICK_S)}


def new_simulation(device: Device, tip: tuple[float, float], hand: Hand | None = None) -> Simulation:
    """The device as a session uses it: full brake model, at rest at `tip`, brakes off."""
    return Simulation(device, tip, fidelity="mr", integrator="event", hand=hand)


def come_to_rest(simulation: Simulation) -> None:
    """Our choice: between trials the handle comes to rest where it is; yields and backlash stay as they were."""
    state = simulation.state
    state["tip"][0, 2:] = 0.0
    state["carry"][0] = 0.0
    state["held"][0] = STILL
    state["added_by_brakes"][0] = 0.0
    look(simulation.mechanism[0], state[0])


def recorded_start(simulation: Simulation) -> dict[str, Any]:
    """What a trial that begins now depends on and its ticks do not tell, as JSON holds it without rounding.

    state: the device as the trial before left it (yields, backlash, stops, ledger); arm: what of the hand stays.
    """
    grip = simulation.hand.grips
    return {
        "state": {name: simulation.state[name][0].tolist() for name in CARRIED},
        "arm": {name: grip[name][0].tolist() for name in ("spring", "damping", "mass")},
    }


def start_again(simulation: Simulation, start: dict[str, Any]) -> None:
    """Bring a device and its hand to a recorded start of this version."""
    for name in CARRIED:
        simulation.state[name][0] = start["state"][name]
    for name in ("spring", "damping", "mass"):
        simulation.hand.grips[name][0] = start["arm"][name]


def is_start(start: dict[str, Any]) -> bool:
    """Whether a recorded start is of this version: it holds every field of the device's state, and no other."""
    return {name: np.shape(value) for name, value in start["state"].items()} == {
        name: STATE[name].shape for name in CARRIED
    }
