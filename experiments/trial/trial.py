"""One trial, tick by tick, for every kind of hand: on a simulated device, or in `real_trial` on a real one."""

import math
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller
from core.control.guard import make_around
from core.control.velocity_field import new_memory
from core.device import Device
from core.faults import after, cause
from core.path import Path, PathFile, build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from core.simulator.state import new_record
from experiments.assumptions import Assumptions
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules
from experiments.trial import tick
from experiments.trial.castor import set_castor, skid_warnings
from experiments.trial.detour import way_round
from experiments.trial.encoder_sensing import Sensing, decision_noise, new_sensing, sensed
from experiments.trial.normals import Normals
from experiments.trial.operator import OPERATOR, Person, new_operator, on_path, take_handle

#: Draws of noise per axis for one trial; a longer trial goes round.
NOISE_DRAWS = 1 << 16

#: what running a trial changes: arrays, and what is known of its end
Changed = tuple[tuple[np.ndarray, ...], dict[str, Any]]


class Conditions(NamedTuple):
    """Under which a trial is run."""

    path: PathFile
    preset: Preset  # its controller, whatever the plan calls it
    rules: str
    how: TrialRules = TrialRules()  # durations, radii and release of the protocol


class Trial:
    """One trial of the plan. It can be sent to the process of the control loop and its outcome taken back."""

    real = False  # it is for a real device
    _told: tuple[str, ...] = ("_reason",)  # beside arrays, what running it changes

    def __init__(
        self,
        device: Any,
        planned: PlannedTrial,
        conditions: Conditions,
        person: Person | None = None,
        generator: np.random.Generator | Normals | None = None,
    ) -> None:
        """device: a `SimulatedDevice`. person and generator: a simulated operator; None: the hand is a person's."""
        path, preset, rules, how = conditions
        self.planned, self.how = planned, how
        self.path: Path = build_path(path, f"path {planned.segment}")
        middle = point_at(self.path, 0.5 * self.path.length)[:2]
        self.device: Device
        self.simulation, self.sensing, noise, assumed = self._prepare(device, middle)
        self.controller: Controller = make_controller(
            preset, self.device.force_normalised_N, rules, velocity_noise=noise,
            around=make_around(how.around, self.device, sensed(self.device, middle, assumed)),
        )  # fmt: skip
        self._way = self.path  # of the operator
        self._memory = new_memory()
        self._run = tick.new_run(how, person is not None, self.real)
        self._operator, self._noise = new_record(OPERATOR), np.zeros((1, 2))
        if person is not None and generator is not None:
            person = on_path(person, self.path)
            self._operator = new_operator(person, generator)
            self._noise = generator.standard_normal((NOISE_DRAWS, 2))
            self._way = way_round(path, how.around.obstacles, f"path {planned.segment}")
            take_handle(person, self._way, self.simulation.hand.grips)
        if self.device.castor:
            hand, state, _ = self.simulation.data
            set_castor(self._run["cobot"][0], self.device, state["tip"][0], hand.grips["mass"][0])
        self._reason = ""  # of an abort from outside
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were
        self.let_go = 0  # how often the pointer left its workspace during the movement, and the hand let go
        self.start: dict[str, Any] | None = self._start()

    def _prepare(self, device: Any, middle: tuple[float, float]) -> tuple[Simulation, Sensing, float, Assumptions]:
        """Set `device`. Device and sensors as the kernels see them, noise (m/s) of the motion seen, and its age.

        middle (m): of the path.
        """
        device.begin()
        self.device, assumed = device.device, self.how.assumptions
        noise = decision_noise(self.device, middle, assumed)
        return device, new_sensing(self.device, assumed), noise, assumed

    def _start(self) -> dict[str, Any] | None:
        """What the trial depends on beside its ticks."""
        assert isinstance(self.simulation, SimulatedDevice)
        return self.simulation.recorded_start()

    def refine(self, substeps: int) -> None:
        """Simulate each tick in so many steps; operator and controller act once a tick all the same."""
        self._run["substeps"][0] = substeps

    def aim(self, x: float, y: float) -> None:
        """Where the hand wants the handle to be (m), from now on; its velocity counts as zero."""
        self.simulation.hand.grips["target"][0] = (x, y, 0.0, 0.0)

    def run(self, rows: np.ndarray) -> int:
        """Run ticks into rows (n, tick_log.WIDTH) until they are full or the trial is finished; how many were run."""
        return int(tick.run_ticks(self.arguments(), rows))

    def arguments(self) -> tick.RunningTrial:
        """The trial as the kernels see it; what they change is changed here."""
        return tick.RunningTrial(
            self.path, self._way, self.controller, self.simulation.model, self.simulation.data,
            self._run.view(np.ndarray), self._operator.view(np.ndarray), self._noise, self._memory, self.sensing,
        )  # fmt: skip

    def changed(self) -> Changed:
        """What running it has changed, to be sent to the process that has the device and the session."""
        hand, state, scratch = self.simulation.data
        arrays = hand.grips, state, scratch, self._run, self._operator, self._memory, self.sensing.sensors
        return arrays, {name: getattr(self, name) for name in self._told}

    def take_back(self, changed: Changed) -> None:
        """It was run in another process, which sends what it changed."""
        arrays, end = changed
        for ours, theirs in zip(self.changed()[0], arrays, strict=True):
            ours[...] = theirs
        self.__dict__.update(end)

    def abort(self, reason: str) -> None:
        """Stop at the next tick, brakes off; the trial ends as aborted with this reason (the first one)."""
        self._reason = self._reason or reason
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
    def tip(self) -> tuple[float, float]:
        """Where the handle is, or was last, m."""
        x, y = self.simulation.state["tip"][0, :2].tolist()
        return x, y

    @property
    def ticks(self) -> int:
        """Ticks run so far."""
        return int(self._run["tick"][0])

    def outcome(self) -> dict[str, Any]:
        """How the trial ended, for the end record: status, reason, and the device's report."""
        status, code, reason = int(self._run["status"][0]), int(self._run["reason"][0]), self._reason
        if status in (tick.RUNNING, tick.ABORTED):
            status = tick.ABORTED
            if code not in (tick.NO_REASON, tick.BY_EXPERIMENTER) or not reason:
                reason = self._words(code)
        elif reason:
            reason = after("after its end: ", reason)
        about: dict[str, Any] = {"status": tick.STATUSES[status], "reason": reason}
        about |= self._device_report()
        about |= {"hand_left": self.let_go} if self.let_go else {}
        return about | ({"timing": self.timing} if self.timing else {})

    def _device_report(self) -> dict[str, Any]:
        """The device's part of `outcome`."""
        assert isinstance(self.simulation, SimulatedDevice)
        report = self.simulation.end_record()
        if self.device.castor:
            report["warnings"] += skid_warnings(self._run["cobot"][0], self.device.castor)
        return report

    def _words(self, code: int) -> str:
        release = self.how.release
        force, time_s = (release.force_N, release.time_s) if release else (math.inf, math.inf)
        if not tick.REASONS[code]:
            return "stopped by the experimenter"
        return cause(tick.REASONS[code], speed_max=tick.SPEED_MAX_M_S, force=force, time=time_s)
