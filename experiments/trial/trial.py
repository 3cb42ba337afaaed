"""One trial, tick by tick, for every kind of hand: here on a simulated device, in `real_trial` on a real one."""

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller, with_address
from core.control.guard import make_around
from core.control.velocity_field import new_memory
from core.device import Device
from core.faults import after, cause
from core.files import InputError
from core.path import Path, PathFile, build_path
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from core.simulator.state import new_record
from experiments.assumptions import Assumptions
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules, middle_of
from experiments.trial import tick
from experiments.trial.castor import set_castor, skid_warnings
from experiments.trial.detour import way_round
from experiments.trial.encoder_sensing import EncoderSensing, decision_noise, new_sensing, sensed
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


class Known(NamedTuple):
    """What a trial knows of its device."""

    device: Device
    simulation: Simulation  # of the device; for a real one, its linkage and the model of its brakes
    sensing: EncoderSensing  # of its motion
    noise: float  # of the sensed velocity, m/s
    assumed: Assumptions  # of its age


def path_of(planned: PlannedTrial, conditions: Conditions) -> Path:
    """The path of a trial, as the kernels see it."""
    return build_path(conditions.path, f"path {planned.segment}")


class Trial(ABC):
    """One trial of the plan. It can be sent to the process of the control loop and its outcome taken back."""

    real = False  # it is for a real device
    _sent: tuple[str, ...] = ("_reason",)  # beside arrays, what running it changes

    def __init__(self, known: Known, path: Path, planned: PlannedTrial, conditions: Conditions) -> None:
        self.device, self.simulation, self.sensing, noise, assumed = known
        self.path, self.planned, self.how, self.preset = path, planned, conditions.how, conditions.preset
        self.controller: Controller = make_controller(
            conditions.preset, self.device.force_normalised_N, conditions.rules, velocity_noise=noise,
            around=make_around(self.how.around, self.device, sensed(self.device, middle_of(path), assumed)),
        )  # fmt: skip
        self._way = self.path  # of a simulated operator
        self._memory = new_memory()
        self._run = tick.new_run(self.how, simulated_hand=False, real=self.real)
        self._operator, self._noise = new_record(OPERATOR), np.zeros((1, 2))
        self._reason = ""  # of an abort from outside
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were
        self.let_go = 0  # how often the pointer left its workspace during the movement, and the hand let go
        self.start: dict[str, Any] | None = None  # what the trial depends on beside its ticks, where that is known

    def __setstate__(self, state: dict[str, Any]) -> None:
        """In another process the file of a controller of its own stands at another address."""
        self.__dict__.update(state)
        self.controller = with_address(self.controller, self.preset)

    @abstractmethod
    def _device_report(self) -> dict[str, Any]:
        """The device's part of `outcome`."""

    def aim(self, x: float, y: float) -> None:
        """Set the target of the hand (m) from now on; its velocity counts as zero."""
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
        """The arrays and the end that running the trial has changed, for the process that has device and session."""
        hand, state, scratch = self.simulation.data
        arrays = hand.grips, state, scratch, self._run, self._operator, self._memory, self.sensing.sensors
        return arrays, {name: getattr(self, name) for name in self._sent}

    def take_back(self, changed: Changed) -> None:
        """Take over what another process changed by running the trial."""
        arrays, end = changed
        for ours, theirs in zip(self.changed()[0], arrays, strict=True):
            ours[...] = theirs
        self.__dict__.update(end)

    def abort(self, reason: str) -> None:
        """Stop at the next tick, brakes off; the trial ends as aborted with this reason (the first one)."""
        self._reason = self._reason or reason
        self._run["stop"][0] = 1

    def refuse_failed_controller(self) -> None:
        """InputError if the file of its controller failed: of simulated trials each would."""
        if int(self._run["reason"][0]) == tick.CONTROLLER_FAILED:
            after_s = (self.ticks - 1) * tick_log.TICK_S - self.how.end_s
            raise InputError(
                f"{self.preset.kind}: {self._words(tick.CONTROLLER_FAILED)} ({after_s:.3f} s into a trial)"
            )

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
        """The place of the handle, now or when it was last known, m."""
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

    def _words(self, code: int) -> str:
        release = self.how.release
        force, time_s = (release.force_N, release.time_s) if release else (math.inf, math.inf)
        if not tick.REASONS[code]:
            return "stopped by the experimenter"
        return cause(tick.REASONS[code], speed_max=tick.SPEED_MAX_M_S, force=force, time=time_s)


class SimulatedTrial(Trial):
    """A trial of the plan on a simulated device, which stays as the trial leaves it."""

    simulation: SimulatedDevice

    def __init__(
        self,
        device: SimulatedDevice,
        planned: PlannedTrial,
        conditions: Conditions,
        person: Person | None = None,
        generator: np.random.Generator | Normals | None = None,
    ) -> None:
        """person and generator: a simulated operator; None: the hand is a person's."""
        device.begin()
        path, assumed = path_of(planned, conditions), conditions.how.assumptions
        noise = decision_noise(device.device, middle_of(path), assumed)
        known = Known(device.device, device, new_sensing(device.device, assumed), noise, assumed)
        super().__init__(known, path, planned, conditions)
        hand, state, _ = device.data
        if person is not None and generator is not None:
            person = on_path(person, path)
            self._run = tick.new_run(self.how, simulated_hand=True)
            self._operator = new_operator(person, generator)
            self._noise = generator.standard_normal((NOISE_DRAWS, 2))
            self._way = way_round(conditions.path, self.how.around.obstacles, f"path {planned.segment}")
            take_handle(person, self._way, hand.grips)
        if self.device.castor:
            set_castor(self._run["cobot"][0], self.device, state["tip"][0], hand.grips["mass"][0])
        self.start = device.recorded_start()

    def refine(self, substeps: int) -> None:
        """Simulate each tick in so many steps; operator and controller act once a tick all the same."""
        self._run["substeps"][0] = substeps

    def _device_report(self) -> dict[str, Any]:
        report = self.simulation.end_record()
        if self.device.castor:
            report["warnings"] += skid_warnings(self._run["cobot"][0], self.device.castor)
        return report
