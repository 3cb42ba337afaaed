"""One trial, tick by tick, for every kind of hand: here on a simulated device, in `real_trial` on a real one."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
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
from core.records import new_record
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from experiments.assumptions import Assumptions
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules, middle_of
from experiments.trial import tick
from experiments.trial.detour import way_round
from experiments.trial.encoder_sensing import EncoderSensing, decision_noise, new_sensing, sensed
from experiments.trial.normals import Normals
from experiments.trial.operator import OPERATOR, Person, new_operator, on_path, take_handle

#: Draws of noise per axis for one trial; a longer trial goes round.
NOISE_DRAWS = 1 << 16


class Conditions(NamedTuple):
    """The path, the controller and the rules of a trial."""

    path: PathFile
    preset: Preset  # its controller, whatever the plan calls it
    rules: str  # "settled" or "literal"
    trial_rules: TrialRules = TrialRules()  # durations, radii, release, obstacles and assumptions of the protocol


class TrialDevice(NamedTuple):
    """The device of a trial, and how its motion is sensed."""

    device: Device
    simulation: Simulation  # of the device; of a real one, its linkage and the model of its brakes
    sensing: EncoderSensing
    noise: float  # of the sensed velocity, m/s rms
    assumed: Assumptions


@dataclass
class TrialEnd:
    """How a trial ended, as far as its records do not say."""

    abort_reason: str = ""  # of an abort from outside
    filled: int = 0  # samples of a real device that were lost and interpolated
    device_report: dict[str, Any] = field(default_factory=dict)  # of a real device, once the trial has left it


class TrialState(NamedTuple):
    """All that running a trial changes: records, each an array of one, and the end."""

    grips: np.ndarray  # core.simulator.hand.GRIP
    body: np.ndarray  # core.simulator.state.BODY
    braking: np.ndarray  # BRAKING
    ledger: np.ndarray  # LEDGER
    scratch: np.ndarray  # of the integrator
    run: np.ndarray  # tick.RUN
    operator: np.ndarray  # OPERATOR
    memory: np.ndarray  # of the controller
    sensors: np.ndarray  # encoder_sensing.SENSING
    end: TrialEnd


def path_of(planned: PlannedTrial, conditions: Conditions) -> Path:
    """The path of a trial, as the kernels see it."""
    return build_path(conditions.path, f"path {planned.path}")


class Trial(ABC):
    """One trial of the plan.

    A live trial is run by the process of the control loop. The session server sends it the trial, which pickle copies;
    the loop runs the copy and sends back its `state`; `take_back` puts that into the server's trial.
    """

    real = False  # it is for a real device

    def __init__(self, on: TrialDevice, path: Path, planned: PlannedTrial, conditions: Conditions) -> None:
        self.device, self.simulation, self.sensing = on.device, on.simulation, on.sensing
        self.path, self.planned = path, planned
        self.preset, self.trial_rules = conditions.preset, conditions.trial_rules
        obstacles = make_around(self.trial_rules.around, on.device, sensed(on.device, middle_of(path), on.assumed))
        self.controller: Controller = make_controller(
            conditions.preset, on.device.force_normalised_N, conditions.rules, velocity_noise=on.noise, around=obstacles
        )
        self._memory = new_memory()  # of the controller
        self._run = tick.new_run(self.trial_rules, simulated_hand=False, real=self.real)
        self._operator, self._operator_noise = new_record(OPERATOR), np.zeros((1, 2))
        self._operator_path = path
        self._end = TrialEnd()
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were
        self.hand_left = 0  # how often the pointer left its workspace during the movement and let the handle go
        self.start: dict[str, Any] | None = None  # device and arm at the first tick, of a simulated device; for replays

    @property
    def state(self) -> TrialState:
        """What running the trial changes, as it is now: the records themselves, no copies."""
        data = self.simulation.data
        return TrialState(
            data.hand.grips, data.body, data.braking, data.ledger, data.scratch,
            self._run, self._operator, self._memory, self.sensing.sensors, self._end,
        )  # fmt: skip

    def take_back(self, returned: TrialState) -> None:
        """Take over the state of a copy that another process has run; the device is then as that trial left it."""
        *records, self._end = returned
        for ours, theirs in zip(self.state[:-1], records, strict=True):
            ours[...] = theirs

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Unpickle a trial: in this process the code of a controller of its own stands at another address."""
        self.__dict__.update(attributes)
        self.controller = with_address(self.controller, self.preset)

    @abstractmethod
    def _device_report(self) -> dict[str, Any]:
        """The device's part of `outcome`."""

    def aim(self, x: float, y: float) -> None:
        """Set the target of the hand (m) from now on; its velocity counts as zero."""
        self.simulation.hand.grips["target"][0] = (x, y, 0.0, 0.0)

    def run(self, rows: np.ndarray) -> int:
        """Run ticks into rows (n, tick_log.WIDTH) until they are full or the trial is finished; return their number."""
        return int(tick.run_ticks(self.arguments(), rows))

    def arguments(self) -> tick.RunningTrial:
        """The trial as the kernels see it: views of its own arrays."""
        return tick.RunningTrial(
            self.path, self._operator_path, self.controller, self.simulation.model, self.simulation.data,
            self._run.view(np.ndarray), self._operator.view(np.ndarray), self._operator_noise, self._memory,
            self.sensing,
        )  # fmt: skip

    def abort(self, reason: str) -> None:
        """Stop at the next tick, brakes off; the trial ends as aborted with this reason (the first one)."""
        self._end.abort_reason = self._end.abort_reason or reason
        self._run["stop"][0] = 1

    def refuse_failed_controller(self) -> None:
        """InputError if the file of its controller failed: of simulated trials each would."""
        reason = int(self._run["reason"][0])
        if reason in (tick.CONTROLLER_FAILED, tick.DECISION_UNDECLARED):
            after_s = (self.ticks - 1) * tick_log.TICK_S - self.trial_rules.end_s
            raise InputError(f"{self.preset.kind}: {self._words(reason)} ({after_s:.3f} s into a trial)")

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
        x, y = self.simulation.body["tip"][0, :2].tolist()
        return x, y

    @property
    def ticks(self) -> int:
        """Ticks run so far."""
        return int(self._run["tick"][0])

    def outcome(self) -> dict[str, Any]:
        """How the trial ended, for the end record: status, reason, and the device's report."""
        status, code, reason = int(self._run["status"][0]), int(self._run["reason"][0]), self._end.abort_reason
        if status in (tick.RUNNING, tick.ABORTED):
            status = tick.ABORTED
            if code not in (tick.NO_REASON, tick.BY_EXPERIMENTER) or not reason:
                reason = self._words(code)
        elif reason:
            reason = after("after its end: ", reason)
        about: dict[str, Any] = {"status": tick.STATUSES[status], "reason": reason}
        about |= self._device_report()
        about |= {"hand_left": self.hand_left} if self.hand_left else {}
        return about | ({"timing": self.timing} if self.timing else {})

    def _words(self, code: int) -> str:
        release = self.trial_rules.release
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
        path, assumed = path_of(planned, conditions), conditions.trial_rules.assumptions
        noise = decision_noise(device.device, middle_of(path), assumed)
        on = TrialDevice(device.device, device, new_sensing(device.device, assumed), noise, assumed)
        super().__init__(on, path, planned, conditions)
        if person is not None and generator is not None:
            self._take_operator(on_path(person, path), generator, conditions.path)
        self.start = device.recorded_start()

    def _take_operator(self, person: Person, generator: np.random.Generator | Normals, path: PathFile) -> None:
        """Let a simulated operator move the handle, round obstacles on the path."""
        self._run = tick.new_run(self.trial_rules, simulated_hand=True)
        self._operator = new_operator(person, generator)
        self._operator_noise = generator.standard_normal((NOISE_DRAWS, 2))
        self._operator_path = way_round(path, self.trial_rules.around.obstacles, f"path {self.planned.path}")
        take_handle(person, self._operator_path, self.simulation.hand.grips)

    def refine(self, substeps: int) -> None:
        """Simulate each tick in so many steps; operator and controller act once a tick all the same."""
        self._run["substeps"][0] = substeps

    def _device_report(self) -> dict[str, Any]:
        return self.simulation.end_record()
