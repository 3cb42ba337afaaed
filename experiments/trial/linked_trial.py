"""One trial on a device on the bench, with the face of `trial.Trial`: its ticks come from a DeviceLink.

A row of the log belongs to one tick of the board, whose sequence numbers are the 1 ms grid. The samples that came while
the host was late are all recorded, and only the newest decides. A lost one is interpolated between its neighbours and
marked (`filled`), so that measures on the grid survive it. When the samples stop, the recording ends with the last one.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from core import tick_log
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller
from core.control.velocity_field import new_memory
from core.device import Device
from core.device_interface import VELOCITY_NOISE_HZ, DeviceLink, LinkSample
from core.encoder_step import encoder_step
from core.mechanism import JOINTS
from core.path import Path, point_at
from core.path_file import PathFile, build_path
from core.simulator.hand import new_hand
from core.simulator.simulation import FIDELITIES
from core.simulator.state import new_record, new_state, pack_brakes, pack_mechanism
from core.stops import distal_sine
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules, load_protocol
from experiments.trial import linked_tick, tick
from experiments.trial.linked_tick import SPEED_MAX_M_S, WATCH
from experiments.trial.trial import DEFAULT_RULES, run_fields

#: s. Without a sample for so long the currents are zero and the trial ends; the board's watchdog has the same number.
SILENT_S = 0.05
MOST_FILLED = 250  # ticks; a longer gap ends the recording. Our choice: a link counts as lost before
NOT_CLOSED = 10  # samples on end whose encoders are of no pose. Our choice: one may be a damaged count
LONGEST_END_S = 0.5  # beyond `end_s`, in which the recorded end may still come after a fault
WRAP = 1 << 32
#: columns that a lost sample leaves between its neighbours
_SENSED = [
    tick_log.TIP_X,
    tick_log.TIP_Y,
    tick_log.TIP_VX,
    tick_log.TIP_VY,
    tick_log.TIP_AX,
    tick_log.TIP_AY,
    tick_log.HAND_FX,
    tick_log.HAND_FY,
]

NOT_HOMED = "the encoders have not been homed"
CONTRADICT = "the encoders contradict each other: one of them may be stuck"
SILENT = f"no sample came from the board for {1e3 * SILENT_S:.0f} ms"
NO_POSE = "the encoders are of no pose of the linkage: check the homing"


class LinkedTrial:
    """One trial of the plan on the bench. Without a link it is one to be sent to where the link is."""

    def __init__(
        self,
        device: Device,
        planned: PlannedTrial,
        path: PathFile,
        preset: Preset,
        rules: str,
        how: TrialRules = DEFAULT_RULES,
        link: DeviceLink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """preset: its controller, whatever `planned` calls it. how: durations, radii and release of the protocol.

        clock: the one that the link has.
        """
        self.device, self.planned, self.link, self.clock = device, planned, link, clock
        self.path: Path = build_path(path, f"path {planned.segment}")
        noise = encoder_noise(device, self.path)
        self.controller: Controller = make_controller(preset, device.force_normalised_N, rules, velocity_noise=noise)
        self._memory = new_memory()
        self._mechanism = plain(pack_mechanism(device.mechanism))
        self._brakes = plain(pack_brakes(device.brakes, backlash=False))
        self._grips, self._state = plain(new_hand().grips), plain(new_state(0.0, 0.0))
        self._watch = plain(new_record(WATCH))
        self._state["torque_yield"][0] = device.brakes.k[:, 1]
        self._watch["speed_max"][0] = SPEED_MAX_M_S
        self._how = how
        self._watch["release_force"][0] = how.release.force_N if how.release else math.inf
        self._watch["release_ticks"][0] = round(how.release.time_s / tick.TICK_S) if how.release else 0
        self._run = plain(tick.new_run(FIDELITIES.index("mr"), simulated_hand=False))
        for name, value in run_fields(how, simulated_hand=False).items():
            self._run[name][0] = value
        self._reason = ""
        self._last: tuple[int, np.ndarray] | None = None  # sequence and row of the last sample
        self._waiting: list[np.ndarray] = []  # rows that found no room in `run`
        self._began_s = self._heard_s = self._ended_s = math.nan
        self._not_closed = self.filled = 0
        self.report: dict[str, Any] = {}  # what the link says of itself, at the end
        self.timing: dict[str, Any] | None = None  # of a live trial, for the end record: how late its ticks were

    def __getstate__(self) -> dict:
        """To another process, without the link."""
        return {**self.__dict__, "link": None, "clock": time.monotonic}

    def run(self, rows: np.ndarray) -> int:
        """Exchange and fill rows (n, BENCH_WIDTH) until they are full or the trial is finished; how many there are."""
        filled = 0
        while filled < len(rows) and (self._waiting or not self.finished):
            if not self._waiting:
                self._waiting = self.exchange()
                continue
            rows[filled] = self._waiting.pop(0)
            filled += 1
        return filled

    def exchange(self) -> list[np.ndarray]:
        """One exchange with the device; the rows (BENCH_WIDTH,) that it brought, oldest first."""
        assert self.link is not None
        now = self.clock()
        if math.isnan(self._began_s):
            self._began_s = self._heard_s = now
            self.link.samples()  # what came before the trial is not its own
        newest = self.link.exchange(self.currents)
        samples, now = self.link.samples(), self.clock()
        made: list[np.ndarray] = []
        if newest is None:
            self._without_sample(now)
        else:
            self._heard_s = now
            for sample in samples if self._last else samples[-1:]:
                made += self._rows_of(sample, sample is samples[-1], now)
            if self._over(now):
                self._finish()
        return made

    @property
    def currents(self) -> tuple[float, float, float, float]:
        """What the brakes are to have now, A; zero in doubt, and once the trial is over."""
        if self.finished or self._run["stop"][0] or not self.clock() - self._heard_s < SILENT_S:
            return (0.0, 0.0, 0.0, 0.0)
        a, e, b, c = self._run["current"][0].tolist()
        return a, e, b, c

    def abort(self, reason: str) -> None:
        """Stop at the next sample, brakes off at once; the trial ends as aborted with this reason (the first one)."""
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
    def ticks(self) -> int:
        """Ticks run so far."""
        return int(self._run["tick"][0])

    @property
    def tip(self) -> tuple[float, float]:
        """Where the handle was last, m."""
        x, y = self._state["tip"][0, :2].tolist()
        return x, y

    def outcome(self) -> dict:
        """How the trial ended, for the end record: status, reason, what was lost, and what the link says of itself."""
        status, code = int(self._run["status"][0]), int(self._run["reason"][0])
        if status in (tick.RUNNING, tick.ABORTED):
            status, reason = tick.ABORTED, self._why(code)
        else:
            reason = f"after its end: {self._reason}" if self._reason else ""
        return {
            "status": tick.STATUSES[status],
            "reason": reason,
            "ledger": "estimated from sensed force and velocity and the brake model",
            "filled": self.filled,
            "link": self.report,
            **({"timing": self.timing} if self.timing else {}),
        }

    def _why(self, code: int) -> str:
        if code in linked_tick.REASONS:
            release = self._how.release
            pushed = (release.force_N, release.time_s) if release else (math.inf, math.inf)
            return linked_tick.REASONS[code].format(speed_max=SPEED_MAX_M_S, force=pushed[0], time=pushed[1])
        return tick.REASONS[code] if code not in (tick.NO_REASON, tick.BY_EXPERIMENTER) else self._reason

    def _without_sample(self, now: float) -> None:
        """Nothing came: after `SILENT_S` the trial is over, whether or not its end can still be recorded."""
        assert self.link is not None
        if self.link.problem:
            self.abort(self.link.problem)
            self._finish()
        elif now - self._heard_s >= SILENT_S:
            self.abort(SILENT)
            self._end(now)
            if self._over(now):
                self._finish()

    def _over(self, now: float) -> bool:
        """Whether the last tick has been run, or is not worth waiting for."""
        return self.finished or now - self._ended_s > self._how.end_s + LONGEST_END_S

    def _finish(self) -> None:
        """No more ticks: what was recorded is all there is."""
        assert self.link is not None
        self._end(self.clock())
        self._run["finished"][0] = 1
        self.report = self.link.report()

    def _end(self, now: float) -> None:
        """The trial is over, without a sample that says so."""
        run = self._run[0]
        run.current[:] = 0.0
        if run.phase != tick_log.END:
            tick.enter(run, tick_log.END, tick.ABORTED, tick.BY_EXPERIMENTER)
        if math.isnan(self._ended_s):
            self._ended_s = now

    def _rows_of(self, sample: LinkSample, newest: bool, now: float) -> list[np.ndarray]:
        """The row of a sample, behind those of samples that were lost before it; none after the last tick."""
        assert self.link is not None
        self._look_at(sample)
        if self._last is None:
            self._state["distal_side"][0] = math.copysign(1.0, distal_sine(self._mechanism[0], *sample.tip))
        sensed = sensed_row(sample, self.link.encoders, 1e6 * (now - sample.t_s))
        made = []
        for one in [*self._lost_before(sample.sequence, sensed), sensed]:
            if self.finished:
                break
            self._tick(one, newest and one is sensed)
            made.append(one)
        self._last = sample.sequence, sensed
        if self.phase == "end" and math.isnan(self._ended_s):
            self._ended_s = now
        return made

    def _tick(self, made: np.ndarray, newest: bool) -> None:
        linked_tick.linked_tick(
            self.path, self.controller, self._mechanism, self._brakes, self._grips, self._state, self._watch,
            self._run, self._memory, made, int(newest),
        )  # fmt: skip

    def _look_at(self, sample: LinkSample) -> None:
        """What must not be while a hand is at the device ends the trial, with this sample or without it."""
        self._not_closed = 0 if sample.closed else self._not_closed + 1
        if sample.fault:
            self.abort(f"the board: {sample.fault}")
        elif not sample.homed:
            self.abort(NOT_HOMED)
        elif self._not_closed >= NOT_CLOSED:
            self.abort(CONTRADICT)
        lost = (sample.sequence - self._last[0]) % WRAP - 1 if self._last else 0
        if lost >= SILENT_S / tick.TICK_S:
            self.abort(SILENT)
        if not all(map(math.isfinite, sample.tip)):
            self.abort(NO_POSE)
            self._finish()
        elif lost > MOST_FILLED:
            self._finish()

    def _lost_before(self, sequence: int, sensed: np.ndarray) -> list[np.ndarray]:
        """Rows for the samples that were lost since the last one."""
        if self._last is None or self.finished:
            return []
        before, steps = self._last[1], (sequence - self._last[0]) % WRAP
        made = []
        for n in range(1, steps):
            lost = np.full(tick_log.BENCH_WIDTH, math.nan)
            lost[_SENSED] = before[_SENSED] + (sensed[_SENSED] - before[_SENSED]) * (n / steps)
            lost[tick_log.FILLED], lost[tick_log.LATENESS_US] = 1.0, sensed[tick_log.LATENESS_US] + 1e3 * (steps - n)
            made.append(lost)
        self.filled += len(made)
        return made


def encoder_noise(device: Device, path: Path) -> float:
    """Noise (m/s, rms) of a link's velocity in the middle of a path; 0 where the device file says no encoders."""
    encoders = device.sensing.encoders if device.sensing else None
    if encoders is None:
        return 0.0
    counts = [getattr(encoders, joint) or 0 for joint in JOINTS]
    x, y, _, _ = point_at(path, 0.5 * path.length)
    return VELOCITY_NOISE_HZ * encoder_step(device, (x, y), counts)


def load_kernels() -> None:
    """Compile, or load, what a trial needs: seconds that no board waits for."""
    protocol = load_protocol()
    device, path = protocol.devices[0], protocol.paths[1]
    trial = LinkedTrial(device, PlannedTrial(0, 0, device.name, 1, 1, 1), path, protocol.controllers[1], protocol.rules)
    made = np.zeros(tick_log.BENCH_WIDTH)
    made[tick_log.TIP_X : tick_log.TIP_Y + 1] = path.start_m
    distal_sine(trial._mechanism[0], *path.start_m)
    trial._tick(made, newest=True)
    trial._end(0.0)


def plain(record: np.recarray) -> np.ndarray:
    """The same record for calls from Python, which take 30 us longer with the other kind of array."""
    return record.view(np.ndarray)


def sensed_row(sample: LinkSample, encoders: str, late_us: float) -> np.ndarray:
    """A row (BENCH_WIDTH,) with what a sample says; encoders: letters of their joints; late_us: how late it came."""
    made = np.full(tick_log.BENCH_WIDTH, math.nan)
    made[tick_log.TIP_X : tick_log.TIP_Y + 1] = sample.tip
    made[tick_log.TIP_VX : tick_log.TIP_VY + 1] = sample.velocity
    made[tick_log.TIP_AX : tick_log.TIP_AY + 1] = sample.acceleration
    made[tick_log.HAND_FX : tick_log.HAND_FY + 1] = sample.hand_force
    made[tick_log.LATENESS_US] = late_us
    made[tick_log.BOARD_US], made[tick_log.HOST_S], made[tick_log.FILLED] = sample.board_us, sample.t_s, 0.0
    made[[tick_log.COUNT + JOINTS.index(joint) for joint in encoders]] = sample.counts
    made[tick_log.FORCE_COUNT : tick_log.FORCE_COUNT + len(sample.force_counts)] = sample.force_counts
    made[tick_log.MEASURED : tick_log.MEASURED + 4] = sample.current
    return made
