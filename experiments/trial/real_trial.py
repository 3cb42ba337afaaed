"""A trial on a real device: its ticks come from the device's samples.

A row of the log belongs to one tick of the board, whose sequence numbers are the 1 ms grid (`exchange`). The samples
that came while the host was late are all recorded, and only the newest decides. A lost one is interpolated between its
neighbours and marked (`filled`), so that measures on the grid survive it. When the samples stop, the recording ends
with the last one.
"""

import math
from typing import Any

import numpy as np

from core import tick_log
from core.device import Device, without_backlash
from core.device_interface import DeviceSample, RealDevice, velocity_noise
from core.faults import cause
from core.mechanism import JOINTS
from core.path import point_at
from core.simulator.simulation import Simulation
from core.stops import distal_sine
from core.tick_log import TICK_S
from experiments.assumptions import DEFAULTS
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol, middle_of
from experiments.trial import tick
from experiments.trial.encoder_sensing import AS_ON_THE_BENCH, new_sensing
from experiments.trial.trial import Conditions, Trial, TrialDevice, path_of

#: s. Without a sample for so long the currents are zero and the trial ends; the board's watchdog has the same number.
SILENT_S = 0.05
MOST_FILLED = 250  # ticks; a longer gap ends the recording. Our choice: a board counts as lost before
NOT_CLOSED = 10  # samples on end whose encoders are of no pose. Our choice: one may be a damaged count
#: In the end record: whose energies these are
LEDGER = "estimated from sensed force and velocity and the brake model"
LONGEST_END_S = 0.5  # beyond `end_s`, in which the recorded end may still come after a fault
WRAP = 1 << 32
#: columns that a lost sample leaves between its neighbours
_SENSED = slice(tick_log.TIP_X, tick_log.HAND_FY + 1)


class RealTrial(Trial):
    """A trial of the plan on the device of a file, to which it is brought later (`connect`)."""

    real = True

    def __init__(self, device: Device, planned: PlannedTrial, conditions: Conditions) -> None:
        path = path_of(planned, conditions)
        middle = middle_of(path)
        model, noise = Simulation(without_backlash(device), middle, fidelity="mr"), velocity_noise(device, middle)
        on = TrialDevice(device, model, new_sensing(device, DEFAULTS), noise, AS_ON_THE_BENCH)
        super().__init__(on, path, planned, conditions)
        self._connected: RealDevice | None = None
        self._last: tuple[int, np.ndarray] | None = None  # sequence and row of the last sample
        self._last_sample_s = self._ended_s = math.nan
        self._not_closed = 0

    def _device_report(self) -> dict[str, Any]:
        report = self._connected.end_record() if self._connected else self._end.device_report
        return {"ledger": LEDGER, "filled": self._end.filled} | report

    def __getstate__(self) -> dict[str, Any]:
        """To another process: the device stays where it is."""
        return {**self.__dict__, "_connected": None}

    def connect(self, device: RealDevice) -> None:
        """Run on this device from now on."""
        self._connected = device

    def leave(self) -> None:
        """Leave the device; its report goes with the trial."""
        self._end.device_report, self._connected = self._bench.end_record(), None

    @property
    def _bench(self) -> RealDevice:
        """The device, which is connected."""
        assert self._connected is not None
        return self._connected

    def give_up(self, reason: str) -> None:
        """End as aborted, without a tick: no device can run it."""
        self.abort(reason)
        self._run["finished"][0] = 1

    @property
    def currents(self) -> tuple[float, float, float, float]:
        """The currents (A) for the brakes of a real device now; zero in doubt, and once the trial is over."""
        device = self._connected
        is_silent = device is None or not device.clock() - self._last_sample_s < SILENT_S  # before the first: NaN
        if is_silent or self.finished or self._run["stop"][0]:
            return (0.0, 0.0, 0.0, 0.0)
        a, e, b, c = self._run["current"][0].tolist()
        return a, e, b, c

    def exchange(self) -> list[np.ndarray]:
        """One exchange with a real device; the rows (BENCH_WIDTH,) of the ticks that it brought, oldest first."""
        device = self._bench
        if math.isnan(self._last_sample_s):
            self._last_sample_s = device.clock()
            device.begin()
        newest = device.exchange(self.currents)
        samples, now = device.samples(), device.clock()
        rows: list[np.ndarray] = []
        if newest is None:
            self._without_sample(now)
            return rows
        self._last_sample_s = now
        for sample in samples if self._last else samples[-1:]:
            rows += self._ticks_of(sample, sample is samples[-1], now)
        if self._is_over(now):
            self._finish()
        return rows

    def _without_sample(self, now: float) -> None:
        """End the trial where the device has a problem or was silent for `SILENT_S`."""
        if problem := self._bench.problem:
            self.abort(problem)
            self._finish()
        elif now - self._last_sample_s >= SILENT_S:
            self.abort(cause("silent-in-trial", ms=1e3 * SILENT_S))
            self._enter_end(now)
            if self._is_over(now):
                self._finish()

    def _is_over(self, now: float) -> bool:
        """Whether the last tick has been run, or has not come in time."""
        return self.finished or now - self._ended_s > self.trial_rules.end_s + LONGEST_END_S

    def _finish(self) -> None:
        """End the recording here: no further tick is run."""
        self._enter_end(self._bench.clock())
        self._run["finished"][0] = 1

    def _enter_end(self, now: float) -> None:
        """Enter the phase `end` with zero currents, without waiting for a further sample."""
        run = self._run[0]
        run.current[:] = 0.0
        if run.phase != tick_log.END:
            tick.enter(run, tick_log.END, tick.ABORTED, tick.BY_EXPERIMENTER)
        if math.isnan(self._ended_s):
            self._ended_s = now

    def _ticks_of(self, sample: DeviceSample, newest: bool, now: float) -> list[np.ndarray]:
        """The row of a sample, behind those of samples that were lost before it; none after the last tick."""
        self._check_sample(sample)
        if self._last is None:
            self.simulation.body["distal_side"][0] = math.copysign(
                1.0, distal_sine(self.simulation.mechanism[0], *sample.tip)
            )
        sensed = sensed_row(sample, self._bench.encoders, 1e6 * (now - sample.t_s))
        rows = []
        for row in [*self._filled_before(sample.sequence, sensed), sensed]:
            if self.finished:
                break
            self._run["bench"]["newest"][0] = newest and row is sensed
            self.run(row[np.newaxis])
            rows.append(row)
        self._last = sample.sequence, sensed
        if self.phase == "end" and math.isnan(self._ended_s):
            self._ended_s = now
        return rows

    def _check_sample(self, sample: DeviceSample) -> None:
        """End the trial where this sample shows a fault of the board, of its encoders or of the wire."""
        self._not_closed = 0 if sample.closed else self._not_closed + 1
        if sample.fault:
            self.abort(sample.fault)
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

    def _filled_before(self, sequence: int, sensed: np.ndarray) -> list[np.ndarray]:
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
        self._end.filled += len(rows)
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
    trial = RealTrial(
        device, PlannedTrial(0, 0, device.name, 1, 1, 1), Conditions(path, protocol.controllers[1], protocol.rules)
    )
    row = np.zeros(tick_log.BENCH_WIDTH)
    x, y, _, _ = point_at(trial.path, 0.0)
    row[tick_log.TIP_X : tick_log.TIP_Y + 1] = x, y
    distal_sine(trial.simulation.mechanism[0], x, y)
    trial.run(row[np.newaxis])
    trial._enter_end(0.0)
