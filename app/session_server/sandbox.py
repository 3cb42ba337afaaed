"""Try: pass after pass along one path, with controller, brakes and hand as the person at the handle sets them.

A pass is a trial (move to the start, hold, go) of which nothing is written. On a simulated device a change acts at
once: the loop hands the trial back between two ticks, the same trial (state, tip, velocity, phase) gets another
controller, other brakes or another spring, and runs on. Only another device or path begins another pass. On a real
device (our choice, for its hand) a change waits for the next pass, and each pass for a Start.
"""

import dataclasses
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

import numpy as np

from app.ipc import messages as m
from app.ipc.messages import Pass, SandboxSettings, SandboxState
from app.ipc.ring import LET_GO, TAKEN, UNTOUCHED
from app.session_server.device_setup import RealSetup, SimulatedSetup, person_at
from app.session_server.preflight import with_advice
from app.session_server.sandbox_model import SandboxModel
from app.session_server.sandbox_settings import ONLY_SIMULATED, own_blend_width, refuse_impossible, refuse_unknown
from app.session_server.trial_runner import TrialRun, TrialRunner
from core.device import Device
from core.files import InputError
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import APPROACH, PHASE
from experiments.analysis.metrics import Metrics, trial_metrics
from experiments.analysis.movement import tip_acceleration
from experiments.inputs import INPUTS
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol
from experiments.recording import recording_of
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions, SimulatedTrial, Trial

MOST_PASSES = 500  # in the table; the oldest go
PIECES_BEFORE = 100  # looks into the ring, 2 s: of the approach no more is kept, longer than the measures' filter


def append_ticks(pieces: list[np.ndarray], rows: np.ndarray) -> None:
    """Add the next ticks (n, width) of a pass, n > 0."""
    pieces.append(rows)
    if rows[-1, PHASE] == APPROACH:
        del pieces[:-PIECES_BEFORE]


def measures_of_pass(pieces: list[np.ndarray], trial: Trial) -> Metrics:
    """The measures of a pass. InputError: ticks are missing."""
    rows = np.concatenate(pieces)
    return trial_metrics(recording_of(rows, trial.device.braked, decisions=trial.preset.decisions), trial.path)


@dataclasses.dataclass
class RunningPass:
    """A pass from its start to its end."""

    run: TrialRun
    pieces: list[np.ndarray]  # its ticks
    settings: SandboxSettings  # with which it runs at present
    changed: bool = False  # in mid movement
    given_up: bool = False  # it ends without a result, and the handle returns to the start


class Sandbox:
    """The settings of Try, its running pass and its table of passes."""

    def __init__(
        self, setup: m.Setup, protocol: Protocol, runner: TrialRunner,
        device: SimulatedSetup | RealSetup, notify: Callable[[str, bool], None],
    ) -> None:  # fmt: skip
        self._setup, self._protocol, self._runner, self._notify = setup, protocol, runner, notify
        self._device_setup = device
        self.real = isinstance(device, RealSetup)
        self.on = False
        self._model = SandboxModel(protocol, self.real, setup.hand)
        self.settings = self._model.initial(protocol.devices[0].name, next(iter(protocol.paths)))
        self.simulation: SimulatedDevice | None = None  # None: not built yet, or the device is real
        self._running: RunningPass | None = None
        self._start_requested = False
        self._grasp = UNTOUCHED  # how the pointer has the handle between two passes
        self._passes_begun = self._passes_ended = 0
        self._least_gain = 0.0  # N s/m; a controller with less does less than the brakes' own drag
        self._passes: list[Pass] = []
        self.failure: BaseException | None = None  # of the preparation
        self.prepared, self.loop_ready = self.real, threading.Event()  # the loop needs the processors more
        threading.Thread(target=self._prepare, name="preparation", daemon=True).start()
        self._measurer = ThreadPoolExecutor(1, "measures")
        self._being_measured: list[tuple[Pass, Future[Metrics]]] = []

    def _prepare(self) -> None:
        """Build the simulated device, compiling its kernels if necessary; then load what the measures need."""
        try:
            if not self.real:
                self.simulation = self._model.simulation(self.settings, None)
                self.prepared = True
            self.loop_ready.wait()
            tip_acceleration(np.zeros((20, 2)))  # else the first trial's measures wait for SciPy
        except BaseException as error:
            self.failure = error  # raised again in `ServerState.watch`, where it ends the server

    # ---------------------------------------------------------------------------------------------- user actions

    def apply(self, settings: SandboxSettings | None) -> None:
        """Use these settings from now on; None: those of protocol and device.

        InputError for settings that cannot be; nothing has then changed.
        """
        before = self.settings
        settings = settings or self._model.initial(before.device, before.path)
        refuse_unknown(settings, self._protocol)
        if settings.path != before.path:
            settings = settings._replace(blend_width_m=own_blend_width(self._protocol, settings.path))
        refuse_impossible(settings, before, self.fixed)
        self._model.check(settings)
        self.settings, self.on = settings, True
        self._notify("", False)
        self._least_gain = self._model.least_gain(settings)
        self._update_running_pass()

    def start_pass(self, blocker: str) -> None:
        """Start the next pass on a real device. InputError: it is not ready, or `blocker` says why not."""
        self._device_setup.sandbox_device(self._protocol, self.simulation)
        if blocker:
            raise InputError(blocker)
        self._start_requested = True

    def bring_back(self) -> None:
        """Let the hand bring the handle to the start; the running pass is given up.

        InputError: no pointer moves the handle.
        """
        if not self.comes_home:
            raise InputError("Only the hand of the pointer can bring the handle of a simulated device back.")
        self._grasp = LET_GO
        if self._running is not None:
            self._running.given_up = True
            self._running.run.hand_back()

    def leave(self) -> None:
        """Leave Try and end the running pass."""
        self.on = self._start_requested = False
        if self._running is not None and self.real:
            self._running.run.stop("Try was left")

    @property
    def fixed(self) -> tuple[str, ...]:
        """The settings that cannot be changed with this device and hand."""
        if self.real:
            return ONLY_SIMULATED
        return () if INPUTS[self._setup.hand].by_pointer else ("spring_N_m",)

    @property
    def comes_home(self) -> bool:
        """Whether the hand can return the handle to the start: the pointer's spring is the hand."""
        return not self.real and INPUTS[self._setup.hand].by_pointer

    @property
    def state(self) -> SandboxState | None:
        """The state for the window; None: Try is not open."""
        if not self.on:
            return None
        initial = self._model.initial(self.settings.device, self.settings.path)
        passes = tuple(self._passes)
        return SandboxState(self.settings, initial, self.fixed, self.real, self._least_gain, passes)

    @property
    def wants_pass(self) -> bool:
        """Whether a pass is to begin as soon as possible."""
        return self.on and self._running is None

    # ------------------------------------------------------------------------------------------- the passes

    def watch(self, blocker: str) -> None:
        """Begin, change or end the pass, and add finished measures to the table. blocker: why no pass may begin."""
        while self._being_measured and self._being_measured[0][1].done():
            self._add_pass(*self._being_measured.pop(0))
        if self._running is None:
            if self.on and not blocker and (self._start_requested or not self.real):
                self._begin()
            self._release_handle()
        else:
            self._update_running_pass()

    def _update_running_pass(self) -> None:
        """Let the loop hand the running pass back if it is to end, or to get other settings."""
        if (running := self._running) is None or self.real:
            return
        if not self.on or running.given_up or running.settings != self.settings:
            running.run.hand_back()

    def owns(self, run: TrialRun) -> bool:
        """Whether this trial is the running pass."""
        return self._running is not None and run is self._running.run

    def lost(self) -> None:
        """Forget the running pass: the loop died with it. The device is as it was before the pass."""
        if self._running is not None:
            self._running.run.recorder.close()
        self._running = None

    def returned(self, run: TrialRun, grasp: int) -> None:
        """Take the pass back from the loop, at its end or to change it. grasp: how the pointer holds the handle."""
        assert self._running is not None
        running, before, wanted = self._running, self._running.settings, self.settings
        same = (wanted.device, wanted.path) == (before.device, before.path)
        if same and self.on and not running.given_up and not run.trial.finished:
            self._model.apply(run.trial, wanted, before)
            running.settings, running.changed = wanted, running.changed or run.trial.phase == "move"
            self._runner.go_on(run)
            return
        self._running, self._grasp = None, LET_GO if running.given_up else grasp
        run.recorder.close()
        status, reason = (run.trial.outcome()[key] for key in ("status", "reason"))
        if not run.trial.finished or not self.on:
            return
        if status == "aborted":
            self._notify(with_advice("This pass", reason), True)
            return
        self._passes_ended += 1
        s = running.settings
        finished_pass = Pass(self._passes_ended, s, self._model.initial(s.device, s.path), running.changed, status, {})
        self._being_measured.append((finished_pass, self._measurer.submit(measures_of_pass, running.pieces, run.trial)))

    def _add_pass(self, finished_pass: Pass, measured: "Future[Metrics]") -> None:
        try:
            found = measured.result()
        except InputError as error:
            self._notify(f"Pass {finished_pass.number} cannot be measured: {error}.", True)
            return
        self._passes.append(finished_pass._replace(measures=found))
        del self._passes[:-MOST_PASSES]
        self._notify("", False)

    def _release_handle(self) -> None:
        """The pointer no longer holds the handle, which returns to the start of the next pass."""
        self._grasp = LET_GO if self._grasp == TAKEN else self._grasp

    def _begin(self) -> None:
        """Begin the next pass."""
        p, s = self._protocol, self.settings
        if not self.real:
            old, self.simulation = self.simulation, self._model.simulation(s, self.simulation)
            if old is not None and self.simulation.tip != old.tip:  # the new one cannot reach it
                self._release_handle()
        device = self._device_setup.sandbox_device(p, self.simulation)
        name = device.name if isinstance(device, Device) else device.device.name
        self.settings = s = s._replace(device=name)  # of a real one: the board's
        self._passes_begun += 1
        planned = PlannedTrial(0, 0, name, s.controller, s.path, self._passes_begun)
        conditions = Conditions(p.paths[s.path], self._model.preset(s), s.rules, p.trial)
        trial: Trial
        if isinstance(device, Device):
            trial = RealTrial(device, planned, conditions)
        else:
            generator = np.random.default_rng(self._passes_ended)
            trial = SimulatedTrial(device, planned, conditions, person_at(self._setup, p, "0"), generator)
        self._model.apply(trial, s, None)
        self._start_requested = False
        pieces: list[np.ndarray] = []
        run = self._runner.start(trial, None, partial(append_ticks, pieces), self._grasp)
        self._running = RunningPass(run, pieces, s)
