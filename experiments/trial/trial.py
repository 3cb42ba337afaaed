"""One trial, tick by tick, on a simulated device or on a real one, for every kind of hand.

A simulated device's ticks are made by the tick kernel, as many as there is room for (`run`). A real device's come from
its samples (`exchange`): a row of the log belongs to one tick of the board, whose sequence numbers are the 1 ms grid.
The samples that came while the host was late are all recorded, and only the newest decides. A lost one is interpolated
between its neighbours and marked (`filled`), so that measures on the grid survive it. When the samples stop, the
recording ends with the last one.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller
from core.control.guard import make_around
from core.control.velocity_field import new_memory
from core.device import Device
from core.device_interface import DeviceSample, RealDevice, velocity_noise
from core.faults import after, cause
from core.mechanism import JOINTS
from core.path import Path, PathFile, build_path, point_at
from core.simulator.hand import Hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from core.simulator.state import new_record
from core.stops import distal_sine
from experiments.assumptions import DEFAULTS
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules, load_protocol
from experiments.trial import tick
from experiments.trial.castor import set_castor, skid_warnings
from experiments.trial.detour import way_round
from experiments.trial.encoder_sensing import AS_ON_THE_BENCH, Sensing, decision_noise, new_sensing, sensed
from experiments.trial.normals import Normals
from experiments.trial.operator import OPERATOR, TICK_S, Person, new_operator, take_handle

#: Draws of noise per axis for one trial; a longer trial goes round.
NOISE_DRAWS = 1 << 16

#: s. Without a sample for so long the currents are zero and the trial ends; the board's watchdog has the same number.
SILENT_S = 0.05
MOST_FILLED = 250  # ticks; a longer gap ends the recording. Our choice: a board counts as lost before
NOT_CLOSED = 10  # samples on end whose encoders are of no pose. Our choice: one may be a damaged count
LONGEST_END_S = 0.5  # beyond `end_s`, in which the recorded end may still come after a fault
WRAP = 1 << 32
#: columns that a lost sample leaves between its neighbours
_SENSED = slice(tick_log.TIP_X, tick_log.HAND_FY + 1)


#: what running a trial changes: arrays, and what is known of its end
Changed = tuple[tuple[np.ndarray, ...], dict[str, Any]]


class Arguments(NamedTuple):
    """What `run_ticks` takes before the rows, in its order: a trial as the kernels see it."""

    path: Path
    way: Path
    controller: Controller
    mechanism: np.ndarray
    brakes: np.ndarray
    hand: Hand
    state: np.ndarray
    step_scratch: np.ndarray
    run: np.ndarray
    operator: np.ndarray
    noise: np.ndarray
    memory: np.ndarray
    sensing: Sensing


class Trial:
    """One trial of the plan. It can be sent to the process of the control loop and its outcome taken back."""

    def __init__(
        self,
        device: SimulatedDevice | Device,
        planned: PlannedTrial,
        path: PathFile,
        preset: Preset,
        rules: str,
        how: TrialRules = TrialRules(),  # noqa: B008  (it is frozen)
        person: Person | None = None,
        generator: np.random.Generator | Normals | None = None,
    ) -> None:
        """preset: its controller, whatever `planned` calls it. how: durations, radii and release of the protocol.

        device: a simulated one; or the file of a real one, to which the trial is brought later (`connect`).
        person and generator: a simulated operator; None: the hand is a person's.
        """
        self.planned, self.how = planned, how
        self.path: Path = build_path(path, f"path {planned.segment}")
        middle = point_at(self.path, 0.5 * self.path.length)[:2]
        if isinstance(device, SimulatedDevice):
            self.device = device.device
            assumed = how.assumptions
            noise = decision_noise(self.device, middle, assumed)
            self.model: Simulation = device
            self.sensing = new_sensing(self.device, how.assumptions)
            device.begin()
        else:  # what is known of it: sensed motion, and the brake model
            self.device, noise, assumed = device, velocity_noise(device, middle), AS_ON_THE_BENCH
            self.model = Simulation(device, middle, fidelity="mr", integrator="event", backlash=False)
            self.sensing = new_sensing(device, DEFAULTS)
        self.controller: Controller = make_controller(
            preset, self.device.force_normalised_N, rules, velocity_noise=noise,
            around=make_around(how.around, self.device, sensed(self.device, middle, assumed)),
        )  # fmt: skip
        self._way = self.path  # of the operator
        self._memory = new_memory()
        self._run = tick.new_run(how, self.model.fidelity, person is not None, self.real)
        self._operator, self._noise = new_record(OPERATOR), np.zeros((1, 2))
        if person is not None and generator is not None:
            self._operator = new_operator(person, generator)
            self._noise = generator.standard_normal((NOISE_DRAWS, 2))
            self._way = way_round(path, how.around.obstacles, f"path {planned.segment}")
            take_handle(person, self._way, self.model.hand.grips)
        if self.device.castor:
            set_castor(self._run["cobot"][0], self.device, self.model.state["tip"][0], self.model.hand.grips["mass"][0])
        self._reason = ""  # of an abort from outside
        # of a real device
        self._connected: RealDevice | None = None
        self._last: tuple[int, np.ndarray] | None = None  # sequence and row of the last sample
        self._heard_s = self._ended_s = math.nan
        self._not_closed = self.filled = 0
        self._report: dict[str, Any] = {}  # the device's report, once the trial has left it
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were
        self.let_go = 0  # how often the pointer left its workspace during the movement, and the hand let go
        self.start = device.recorded_start() if isinstance(device, SimulatedDevice) else None

    def __getstate__(self) -> dict[str, Any]:
        """To another process: a real device stays where it is."""
        return {**self.__dict__, "_connected": None}

    @property
    def real(self) -> bool:
        """Whether it is for a real device."""
        return not isinstance(self.model, SimulatedDevice)

    def connect(self, device: RealDevice) -> None:
        """Bring it to its real device."""
        self._connected = device

    def leave(self) -> None:
        """Leave the real device; its report goes with the trial."""
        self._report, self._connected = self._there().end_record(), None

    def _there(self) -> RealDevice:
        assert self._connected is not None
        return self._connected

    def refine(self, substeps: int) -> None:
        """Simulate each tick in so many steps; operator and controller act once a tick all the same."""
        self._run["substeps"][0] = substeps

    def aim(self, x: float, y: float) -> None:
        """Where the hand wants the handle to be (m), from now on; its velocity counts as zero."""
        self.model.hand.grips["target"][0] = (x, y, 0.0, 0.0)

    def run(self, rows: np.ndarray) -> int:
        """Run ticks into rows (n, tick_log.WIDTH) until they are full or the trial is finished; how many were run."""
        return int(tick.run_ticks(*self.arguments(), rows))

    def arguments(self) -> Arguments:
        """The trial as the kernels see it; what they change is changed here."""
        mechanism, brakes, hand, state, scratch = self.model.arguments()
        return Arguments(
            self.path, self._way, self.controller, mechanism, brakes, hand, state, scratch, self._run.view(np.ndarray),
            self._operator.view(np.ndarray), self._noise, self._memory, self.sensing,
        )  # fmt: skip

    def changed(self) -> Changed:
        """What running it has changed, to be sent to the process that has the device and the session."""
        a = self.arguments()
        arrays = a.hand.grips, a.state, a.step_scratch, a.run, a.operator, a.memory, a.sensing.sensors
        return arrays, {name: getattr(self, name) for name in ("_reason", "filled", "_report")}

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

    def give_up(self, reason: str) -> None:
        """There is no device to run it on: it ends as aborted, without a tick."""
        self.abort(reason)
        self._run["finished"][0] = 1

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
        x, y = self.model.state["tip"][0, :2].tolist()
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
        if isinstance(self.model, SimulatedDevice):
            about |= self.model.end_record()
            if self.device.castor:
                about["warnings"] += skid_warnings(self._run["cobot"][0], self.device.castor)
        else:
            about["ledger"] = "estimated from sensed force and velocity and the brake model"
            about |= {"filled": self.filled} | (self._connected.end_record() if self._connected else self._report)
        about |= {"hand_left": self.let_go} if self.let_go else {}
        return about | ({"timing": self.timing} if self.timing else {})

    def _words(self, code: int) -> str:
        release = self.how.release
        force, time_s = (release.force_N, release.time_s) if release else (math.inf, math.inf)
        if not tick.REASONS[code]:
            return "stopped by the experimenter"
        return cause(tick.REASONS[code], speed_max=tick.SPEED_MAX_M_S, force=force, time=time_s)

    # ---------------------------------------------------------------------------------------- on a real device

    @property
    def currents(self) -> tuple[float, float, float, float]:
        """What the brakes of a real device are to have now, A; zero in doubt, and once the trial is over."""
        device = self._connected
        if device is None or self.finished or self._run["stop"][0] or not device.clock() - self._heard_s < SILENT_S:
            return (0.0, 0.0, 0.0, 0.0)
        a, e, b, c = self._run["current"][0].tolist()
        return a, e, b, c

    def exchange(self) -> list[np.ndarray]:
        """One exchange with a real device; the rows (BENCH_WIDTH,) of the ticks that it brought, oldest first."""
        device = self._there()
        if math.isnan(self._heard_s):
            self._heard_s = device.clock()
            device.begin()
        newest = device.exchange(self.currents)
        samples, now = device.samples(), device.clock()
        rows: list[np.ndarray] = []
        if newest is None:
            self._without_sample(now)
            return rows
        self._heard_s = now
        for sample in samples if self._last else samples[-1:]:
            rows += self._ticks_of(sample, sample is samples[-1], now)
        if self._over(now):
            self._finish()
        return rows

    def _without_sample(self, now: float) -> None:
        """Nothing came: after `SILENT_S` the trial is over, whether or not its end can still be recorded."""
        if problem := self._there().problem:
            self.abort(problem)
            self._finish()
        elif now - self._heard_s >= SILENT_S:
            self.abort(cause("silent-in-trial", ms=1e3 * SILENT_S))
            self._end(now)
            if self._over(now):
                self._finish()

    def _over(self, now: float) -> bool:
        """Whether the last tick has been run, or is not worth waiting for."""
        return self.finished or now - self._ended_s > self.how.end_s + LONGEST_END_S

    def _finish(self) -> None:
        """No more ticks: what was recorded is all there is."""
        self._end(self._there().clock())
        self._run["finished"][0] = 1

    def _end(self, now: float) -> None:
        """The trial is over, without a further sample."""
        run = self._run[0]
        run.current[:] = 0.0
        if run.phase != tick_log.END:
            tick.enter(run, tick_log.END, tick.ABORTED, tick.BY_EXPERIMENTER)
        if math.isnan(self._ended_s):
            self._ended_s = now

    def _ticks_of(self, sample: DeviceSample, newest: bool, now: float) -> list[np.ndarray]:
        """The row of a sample, behind those of samples that were lost before it; none after the last tick."""
        self._look_at(sample)
        if self._last is None:
            self.model.state["distal_side"][0] = math.copysign(1.0, distal_sine(self.model.mechanism[0], *sample.tip))
        sensed = sensed_row(sample, self._there().encoders, 1e6 * (now - sample.t_s))
        rows = []
        for row in [*self._lost_before(sample.sequence, sensed), sensed]:
            if self.finished:
                break
            self._run["newest"][0] = newest and row is sensed
            self.run(row[np.newaxis])
            rows.append(row)
        self._last = sample.sequence, sensed
        if self.phase == "end" and math.isnan(self._ended_s):
            self._ended_s = now
        return rows

    def _look_at(self, sample: DeviceSample) -> None:
        """What must not be while a hand is at the device ends the trial, with this sample or without it."""
        self._not_closed = 0 if sample.closed else self._not_closed + 1
        if sample.fault:
            self.abort(after("the board: ", sample.fault))
        elif not sample.homed:
            self.abort(cause("not-homed"))
        elif self._not_closed >= NOT_CLOSED:
            self.abort(cause("contradict"))
        lost = (sample.sequence - self._last[0]) % WRAP - 1 if self._last else 0
        if lost >= SILENT_S / TICK_S:
            self.abort(cause("silent-in-trial", ms=1e3 * SILENT_S))
        if not all(map(math.isfinite, sample.tip)):
            self.abort(cause("no-pose"))
            self._finish()
        elif lost > MOST_FILLED:
            self._finish()

    def _lost_before(self, sequence: int, sensed: np.ndarray) -> list[np.ndarray]:
        """Rows for the samples that were lost since the last one."""
        if self._last is None or self.finished:
            return []
        before, steps = self._last[1], (sequence - self._last[0]) % WRAP
        rows = []
        for n in range(1, steps):
            lost = np.full(tick_log.BENCH_WIDTH, math.nan)
            lost[_SENSED] = before[_SENSED] + (sensed[_SENSED] - before[_SENSED]) * (n / steps)
            lost[tick_log.FILLED], lost[tick_log.LATENESS_US] = 1.0, sensed[tick_log.LATENESS_US] + 1e3 * (steps - n)
            rows.append(lost)
        self.filled += len(rows)
        return rows


def sensed_row(sample: DeviceSample, encoders: str, late_us: float) -> np.ndarray:
    """A row (BENCH_WIDTH,) with what a sample holds; encoders: letters of their joints; late_us: how late it came."""
    row = np.full(tick_log.BENCH_WIDTH, math.nan)
    row[tick_log.TIP_X : tick_log.TIP_Y + 1] = sample.tip
    row[tick_log.TIP_VX : tick_log.TIP_VY + 1] = sample.velocity
    row[tick_log.TIP_AX : tick_log.TIP_AY + 1] = sample.acceleration
    row[tick_log.HAND_FX : tick_log.HAND_FY + 1] = sample.hand_force
    row[tick_log.LATENESS_US] = late_us
    row[tick_log.BOARD_US], row[tick_log.HOST_S], row[tick_log.FILLED] = sample.board_us, sample.t_s, 0.0
    row[[tick_log.COUNT + JOINTS.index(joint) for joint in encoders]] = sample.counts
    row[tick_log.FORCE_COUNT : tick_log.FORCE_COUNT + len(sample.force_counts)] = sample.force_counts
    row[tick_log.MEASURED : tick_log.MEASURED + 4] = sample.current
    return row


def load_kernels() -> None:
    """Compile, or load, what a trial on a real device needs: seconds that no board waits for."""
    protocol = load_protocol()
    device, path = protocol.devices[0], protocol.paths[1]
    trial = Trial(device, PlannedTrial(0, 0, device.name, 1, 1, 1), path, protocol.controllers[1], protocol.rules)
    row = np.zeros(tick_log.BENCH_WIDTH)
    x, y, _, _ = point_at(trial.path, 0.0)
    row[tick_log.TIP_X : tick_log.TIP_Y + 1] = x, y
    distal_sine(trial.model.mechanism[0], x, y)
    trial.run(row[np.newaxis])
    trial._end(0.0)
