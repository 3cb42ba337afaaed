"""Try: pass after pass along one path, with controller, brakes and hand as the person at the handle sets them.

A pass is a trial (move to the start, hold, go) of which nothing is written. On a simulated device a change acts at
once: the loop hands the trial back between two ticks, the same trial (state, tip, velocity, phase) gets another
controller, other brakes or another spring, and runs on. Only another device or path begins another pass. On a real
device (our choice, for its hand) a change waits for the next pass, and each pass for a Start.
"""

import dataclasses
import math
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

import numpy as np
from msgspec.structs import replace

from app.ipc import messages as m
from app.ipc.messages import Pass, SandboxSettings, SandboxState
from app.ipc.ring import LET_GO, TAKEN, UNTOUCHED
from app.session_server.device_setup import RealSetup, SimulatedSetup, person_at
from app.session_server.preflight import with_advice
from app.session_server.trial_runner import TrialRun, TrialRunner
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller
from core.control.guard import make_around
from core.control.proportional import least_gain_felt
from core.control.rule_sets import RULE_SETS
from core.device import Device
from core.files import InputError
from core.path import build_path, outline
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import APPROACH, PHASE
from core.workspace import tip_is_free
from experiments.analysis.metrics import Metrics, trial_metrics
from experiments.analysis.movement import tip_acceleration
from experiments.assumptions import SENSINGS, Assumptions
from experiments.inputs import INPUTS, OPERATOR
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol, middle_of
from experiments.recording import recording_of
from experiments.trial.encoder_sensing import decision_noise, new_sensing, sensed
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions, SimulatedTrial, Trial

MOST_PASSES = 500  # in the table; the oldest go
PIECES_BEFORE = 100  # looks into the ring, 2 s: of the approach no more is kept, longer than the measures' filter
SPACING_M = 0.005  # between points of the path at which the drag is computed
ONLY_SIMULATED = ("device", "spring_N_m", "brake_strength", "backlash_deg", "sensing")


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
        self.settings = self._initial(protocol.devices[0].name, next(iter(protocol.paths)))
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
                self.simulation = self._ready_simulation()
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
        settings = settings or self._initial(self.settings.device, self.settings.path)
        self._refuse_unknown(settings)
        if settings.path != self.settings.path:
            settings = settings._replace(blend_width_m=self._own_blend_width(settings.path))
        self._refuse_impossible(settings)
        device = self._device_file(settings.device)
        self._controller(settings, device)
        new_sensing(device, self._assumed(settings))
        self.settings, self.on = settings, True
        self._notify("", False)
        places = np.asarray(outline(self._protocol.paths[settings.path], SPACING_M))
        self._least_gain = settings.brake_strength * least_gain_felt(device, places)
        self._update_running_pass()

    def _refuse_unknown(self, settings: SandboxSettings) -> None:
        """InputError for a choice that protocol or program does not have."""
        p = self._protocol
        for name, value, allowed in (
            ("device", settings.device, [device.name for device in p.devices]), ("path", settings.path, p.paths),
            ("controller", settings.controller, p.controllers), ("rules", settings.rules, RULE_SETS),
            ("sensing", settings.sensing, SENSINGS),
        ):  # fmt: skip
            if value not in allowed:
                raise InputError(f"Try: {name} {value!r} is none of {', '.join(map(str, allowed))}.")
        if wrong := settings.values.keys() ^ self.settings.values.keys():
            raise InputError(f"Try: {min(wrong)} is no parameter of this protocol's controllers, or is missing.")

    def _refuse_impossible(self, settings: SandboxSettings) -> None:
        """InputError for numbers that cannot be, and for changes that device and hand do not allow."""
        numbers = {name: getattr(settings, name) for name in ("spring_N_m", "brake_strength", "backlash_deg")}
        for name, number in (numbers | settings.values).items():
            if not 0.0 <= number < math.inf:
                raise InputError(f"Try: {name} {number!r} must be finite and not negative.")
        if not 0.0 < settings.blend_width_m < math.inf:
            raise InputError(f"Try: blend width {settings.blend_width_m!r} must be positive and finite, in m.")
        for name in self.fixed:
            if getattr(settings, name) != getattr(self.settings, name):
                raise InputError(f"Try: {name} cannot be changed with this device and hand.")

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
        initial = self._initial(self.settings.device, self.settings.path)
        passes = tuple(self._passes)
        return SandboxState(self.settings, initial, self.fixed, self.real, self._least_gain, passes)

    @property
    def wants_pass(self) -> bool:
        """Whether a pass is to begin as soon as possible."""
        return self.on and self._running is None

    def _initial(self, device: str, path: int) -> SandboxSettings:
        """The settings of protocol and device, with the first controller that brakes."""
        p = self._protocol
        number = min(p.controllers, key=lambda n: (p.controllers[n].kind == "none", n))
        values: dict[str, float] = {}  # each as the chosen controller has it, else the largest
        for preset in p.controllers.values():
            values |= {name: max(value, values.get(name, value)) for name, value in preset.named.items()}
        play = float(np.degrees(self._device_file(device).brakes.play.max()))
        return SandboxSettings(
            device, path, number, {**values, **p.controllers[number].named}, p.rules, self._own_blend_width(path),
            p.mouse.stiffness_N_m, 1.0, round(play, 6), p.assumptions.sensing,
        )  # fmt: skip

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
            self._apply_settings(run.trial, before)
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
        finished_pass = Pass(self._passes_ended, s, self._initial(s.device, s.path), running.changed, status, {})
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
            self.simulation = self._ready_simulation()
        device = self._device_setup.sandbox_device(p, self.simulation)
        name = device.name if isinstance(device, Device) else device.device.name
        self.settings = s = s._replace(device=name)  # of a real one: the board's
        self._passes_begun += 1
        planned = PlannedTrial(0, 0, name, s.controller, s.path, self._passes_begun)
        conditions = Conditions(p.paths[s.path], self._preset(s), s.rules, p.trial)
        trial: Trial
        if isinstance(device, Device):
            trial = RealTrial(device, planned, conditions)
        else:
            generator = np.random.default_rng(self._passes_ended)
            trial = SimulatedTrial(device, planned, conditions, person_at(self._setup, p, "0"), generator)
        self._apply_settings(trial, None)
        self._start_requested = False
        pieces: list[np.ndarray] = []
        run = self._runner.start(trial, None, partial(append_ticks, pieces), self._grasp)
        self._running = RunningPass(run, pieces, s)

    def _ready_simulation(self) -> SimulatedDevice:
        """The simulated device of the settings; a new one takes over the handle's position if it can reach it."""
        p, s, old = self._protocol, self.settings, self.simulation
        if old is not None and old.device.name == s.device:
            return old
        device, way = self._device_file(s.device), np.asarray(outline(p.paths[s.path], SPACING_M))
        x, y = way[2 * len(way) // 3].tolist()  # in neither circle
        tip = old.tip if old is not None else (x, y)
        if not tip_is_free(device.mechanism, *tip):
            tip = x, y
            self._release_handle()
        hand = p.mouse.hand() if self._setup.hand != OPERATOR else None
        return SimulatedDevice(device, tip, hand)

    def _device_file(self, name: str) -> Device:
        """A device of the protocol; a simulated one under the assumptions."""
        device = self._protocol.device(name)
        return device if self.real else self._protocol.assumptions.applied_to(device)

    def _controller(self, s: SandboxSettings, device: Device, noise: float = 0.0) -> Controller:
        """The controller of the settings; noise: of the velocity that it sees, m/s. InputError: impossible numbers."""
        force = device.force_normalised_N * s.brake_strength
        path = build_path(self._protocol.paths[s.path], "path")
        seen = sensed(device, middle_of(path), self._assumed(s))
        around = make_around(self._protocol.trial.around, self._with_settings(device, s), seen)
        return make_controller(self._preset(s), force, s.rules, noise, around)

    def _with_settings(self, device: Device, s: SandboxSettings) -> Device:
        """The device with brake strength and backlash of the settings, for the guard."""
        play = device.brakes.play if self._own_backlash() else np.full(4, math.radians(s.backlash_deg))
        return dataclasses.replace(device, brakes=device.brakes.stronger(s.brake_strength)._replace(play=play))

    def _assumed(self, s: SandboxSettings) -> Assumptions:
        """The protocol's assumptions with the sensing of the settings."""
        return replace(self._protocol.assumptions, sensing=s.sensing)

    def _preset(self, s: SandboxSettings) -> Preset:
        return self._protocol.controllers[s.controller].replaced(**s.values)

    def _apply_settings(self, trial: Trial, before: SandboxSettings | None) -> None:
        """Give a trial the controller, brakes and spring of the settings; it moves on as it was.

        before: the settings with which it has run; None: it is new.
        """
        s, assumed = self.settings, self._assumed(self.settings)
        trial.path = trial.path._replace(blend_width=s.blend_width_m)
        if not isinstance(trial, SimulatedTrial):  # its controller knows the noise of its sensing
            return
        if before is None or s.sensing != before.sensing:  # else the encoders' last samples stay
            trial.sensing = new_sensing(trial.device, assumed)
        noise = decision_noise(trial.device, middle_of(trial.path), assumed)
        trial.controller, trial.preset = self._controller(s, trial.device, noise), self._preset(s)
        trial.simulation.retune(s.brake_strength, None if self._own_backlash() else math.radians(s.backlash_deg))
        if "spring_N_m" not in self.fixed:
            grip, damping = trial.simulation.hand.grips, self._damping()
            grip["stiffness"][0], grip["damping"][0] = (s.spring_N_m, 0.0, s.spring_N_m), (damping, 0.0, damping)

    def _own_blend_width(self, path: int) -> float:
        """The blend width of a path of the protocol, m."""
        return build_path(self._protocol.paths[path], "path").blend_width

    def _own_backlash(self) -> bool:
        """Whether each brake keeps the backlash of its file."""
        return self.settings.backlash_deg == self._initial(self.settings.device, self.settings.path).backlash_deg

    def _damping(self) -> float:
        """Damping of the hand, N s/m, at the protocol's damping ratio for any spring."""
        mouse = self._protocol.mouse
        return mouse.damping_N_s_m * math.sqrt(self.settings.spring_N_m / mouse.stiffness_N_m)
