"""The control loop: a process that runs one trial at a time at 1 kHz, on a simulated or a real device.

It knows nothing of sessions, recordings and windows: the session server sends it a trial, ready to run, and gets back
what the trial has changed. A simulated trial runs as compiled code (see `real_time`). A real device's samples pace the
loop, Python per tick, and nothing waits longer than a few ms; between trials the loop goes on with zero currents.
Brakes-off is latched on the board, and a fault that the board latches becomes a brakes-off. However the process ends,
the last thing sent is zero; killed, the board's watchdog does it. A server that falls silent ends the trial, brakes
off, and with the pipe the process.
"""

import contextlib
import gc
import os
import pickle
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import BinaryIO

import numpy as np

from app.ipc import jobs
from app.ipc.messages import DeviceStatus
from app.ipc.ring import CONTROL, Ring
from app.ipc.scheduling import take_scheduling
from app.loop.clock import NATIVE, new_timer, timer_words
from app.loop.real_time import ROOM, end_early, put, run_idle, run_trial
from core import tick_log
from core.device import Device
from core.device_interface import DeviceError, DeviceSample, RealDevice
from core.faults import after, cause_of
from core.files import InputError
from core.kernels.cache import LINKING, watchers
from core.own_consent import allow_everything
from core.path import build_path
from core.records import new_record
from core.simulator.simulated_device import SimulatedDevice
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.trial.real_trial import RealTrial, load_kernels
from experiments.trial.tick import RUN
from experiments.trial.trial import Conditions, SimulatedTrial, Trial
from hardware.serial_device import device_at

NO_CURRENT = (0.0, 0.0, 0.0, 0.0)
REPORT_S = 0.1  # between two reports of how a real device is
RETRY_S = 1.0  # between attempts to reach a board that was never reached


class Loop:
    """One ring, one trial at a time."""

    def __init__(
        self, ring: Ring, port: str, answers: BinaryIO,
        clock: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep,
        make_device: Callable[[Device, str], RealDevice] = device_at,
    ) -> None:  # fmt: skip
        """port: of a real device; "": the device is simulated. answers: the pipe to the server.

        clock, sleep, make_device: of the machine, but for tests.
        """
        self.ring, self.port, self._answers, self._make_device = ring, port, answers, make_device
        self.device: RealDevice | None = None  # the real one, once it was reached
        self.sample: DeviceSample | None = None  # its newest
        self.jobs: queue.SimpleQueue = queue.SimpleQueue()  # None: there will be no more
        self._clock, self._sleep = clock, sleep
        # for calls of compiled kernels, which take 30 us longer with records
        self._controls = ring.controls.view(np.ndarray) if NATIVE else ring.controls
        self._timer, self._row = new_timer(), np.empty((1, tick_log.WIDTH))
        self._devices: tuple[Device, ...] = ()
        self._problem = "not connected yet"
        self._homed_at = self._zeroed_at = 0.0
        self._reported_s = self._tried_s = 0.0
        self._searching = False  # for a board, and what was found is not reported yet
        ring.rows.max()  # every page is in memory before the first tick

    def prepare(self, real_time: bool) -> None:
        """Compile and touch everything that a trial needs, then take the best scheduling that is allowed."""
        watchers[:] = [self._tell_compiling]
        if self.port:
            load_kernels()
            row = np.zeros(tick_log.BENCH_WIDTH)
            put(new_record(CONTROL), np.zeros((2 * ROOM, tick_log.BENCH_WIDTH)), row)
            end_early(new_record(CONTROL), new_record(RUN), 0, 2 * ROOM)
            run_idle(np.empty(20), self._timer)
        else:
            run_stopped_trial()
        scheduling = take_scheduling(real_time)._replace(timer=timer_words(self._timer))
        self.ring.control.core, self.ring.control.pid = scheduling.core, os.getpid()
        watchers.clear()
        self._answer(jobs.Prepared(scheduling))

    def _tell_compiling(self, number: int, of: int, name: str) -> None:
        if name:
            self._answer(jobs.Compiling(number, of, name == LINKING))

    def work(self, given: BinaryIO) -> None:
        """Jobs from a pipe, until it ends."""
        threading.Thread(target=self._listen, args=(given,), name="jobs", daemon=True).start()
        try:
            while True:
                try:
                    job = self.jobs.get(block=not self.port)
                except queue.Empty:
                    self.idle()
                    continue
                if job is None:
                    return
                self.do(job)
        finally:
            if self.device is not None:
                self.device.close()

    def _listen(self, given: BinaryIO) -> None:
        """Reading a job may wait, so it has a thread of its own. At the end of the pipe a running trial ends."""
        try:
            with contextlib.suppress(EOFError, pickle.UnpicklingError, OSError):
                while True:
                    self.jobs.put(pickle.load(given))
        finally:
            self.ring.control.server_beat = 0
            self.jobs.put(None)

    def _answer(self, answer: jobs.LoopAnswer) -> None:
        try:
            pickle.dump(answer, self._answers)
            self._answers.flush()
        except OSError as error:  # the server is gone; Windows calls that an invalid argument
            raise BrokenPipeError from error

    def do(self, job: jobs.LoopJob) -> None:
        """Do a job and send the answer."""
        try:
            match job:
                case jobs.CheckTiming(ticks):
                    lateness = np.empty(ticks)
                    run_idle(lateness, self._timer)
                    self._answer(jobs.TimingChecked(lateness))
                case jobs.RunTrial(trial):
                    self.run(trial)
                    self._answer(jobs.TrialReturned(trial.state))
                    if trial.finished:  # else it comes back at once
                        gc.collect()
                case jobs.Connect(devices):
                    self._devices, self._tried_s, self._searching = devices, 0.0, True
                    self._disconnect()
                case jobs.HomeAt(tip):
                    self._reached().home(tip)
                    self._homed_at = time.time()
                    self._answer(jobs.HomeSet(tip))
                case jobs.TakeZero():
                    record = self._reached().zero()
                    self._zeroed_at = time.time()
                    self._answer(jobs.Zeroed(record))
                case jobs.Reset(presses):
                    self._reset(presses)
        except (DeviceError, InputError) as error:
            self._answer(jobs.NotDone(str(error)))
        self._reported_s = 0.0

    # ------------------------------------------------------------------------------------------------ a trial

    def run(self, trial: Trial) -> None:
        """Run a trial to its last tick, or until it is to be handed back; every tick goes into the ring."""
        if not isinstance(trial, RealTrial):
            run_trial(self.ring.controls, self.ring.rows, self._row, self._timer, trial.arguments())
        elif self.device is None:
            trial.give_up(after("the board cannot be reached: ", self._problem))
        elif not self.device.zeroed:
            trial.give_up("the zero of the device does not hold any more")
        else:
            self._run_on(self.device, trial)

    def _run_on(self, device: RealDevice, trial: RealTrial) -> None:
        trial.connect(device)
        run = trial.arguments().run
        try:
            while not trial.finished:
                end_early(self._controls, run, self._now_ns(), len(self.ring.rows))
                for row in trial.exchange():
                    put(self._controls, self.ring.rows, row)
                self.ring.control.loop_beat = self._now_ns()
        finally:
            trial.leave()
            self.sample = None

    def _now_ns(self) -> int:
        return round(1e9 * self._clock())

    # ------------------------------------------------------------------------------- between trials, a real device

    def idle(self) -> None:
        """One exchange with zero currents; now and then the server gets a report of the device."""
        device = self.device
        if device is None:
            self._connect()
        else:
            self.sample = device.exchange(NO_CURRENT) or self.sample
            device.samples()
            if device.problem:
                self.sample = None
            elif self.sample is not None:
                self._latch(device, self.sample)
        self.ring.control.loop_beat = self._now_ns()
        known = device is None or device.problem or self.sample is not None
        if known and self._clock() - self._reported_s >= REPORT_S:
            self.report_device()

    def report_device(self) -> None:
        """Send the state of the device to the server."""
        self._reported_s = self._clock()
        self._answer(self._status())
        if self._searching:
            self._searching = False
            self._answer(jobs.ConnectEnded())

    def _latch(self, device: RealDevice, sample: DeviceSample) -> None:
        """Pass a brakes-off on to the board, and a fault of the board on as a brakes-off."""
        if sample.fault:
            self.ring.switch_off(sample.fault)
        elif self.ring.control.brakes_off:
            device.stop()

    def _connect(self) -> None:
        """Try to reach one of the devices, at most once a second."""
        if not self._devices or self._clock() - self._tried_s < RETRY_S:
            self._sleep(0.01)
            return
        problem = ""
        for file in self._devices:
            self.ring.control.loop_beat = self._now_ns()  # one that does not answer takes more than a second
            try:
                device = self._make_device(file, self.port)
                device.open()
            except InputError as error:
                problem = problem or cause_of(error)
                continue
            self.device, self.sample = device, None
            self._homed_at = self._zeroed_at = 0.0
            break
        self._problem, self._tried_s = problem, self._clock()

    def _disconnect(self) -> None:
        if self.device is not None:
            self.device.close()
        self.device, self.sample, self._problem = None, None, "not connected yet"

    def _reached(self) -> RealDevice:
        """The real device. DeviceError: none was reached."""
        if self.device is None:
            raise DeviceError(after("the board cannot be reached: ", self._problem))
        return self.device

    def _reset(self, presses: int) -> None:
        """Reset the brakes-off, and the fault of a board that is connected, unless it was pressed again since.

        The brakes are allowed first, so that a brakes-off that comes while the board answers stands.
        """
        if self.ring.presses != presses:
            return
        cause = self.ring.why_off
        self.ring.allow()
        if self.sample is not None and self.sample.fault:
            try:
                self._reached().reset()
            except (DeviceError, InputError):
                self.ring.switch_off(cause)
                raise
            self.sample = None

    def _status(self) -> DeviceStatus:
        device, sample = self.device, self.sample
        if device is None:
            return DeviceStatus(problem=self._problem, port=self.port)
        report = device.report()
        status = DeviceStatus(
            device.device.name, report.get("board", ""), device.problem, zeroed=device.zeroed, encoders=device.encoders,
            force_channels=device.force_channels, report=report, port=device.port, homed_at=self._homed_at,
            zeroed_at=self._zeroed_at if device.zeroed else 0.0, reported_s=self._clock(),
        )  # fmt: skip
        if sample is None:
            return status
        return status._replace(
            fault=sample.fault, homed=sample.homed, tip=sample.tip, hand_force=sample.hand_force, counts=sample.counts,
            theta=sample.theta,
        )  # fmt: skip


def run_stopped_trial() -> None:
    """Run a trial that ends at once, on a ring of its own, and the clock: every kernel of the loop is compiled then."""
    controls, ring, timer = new_record(CONTROL), np.zeros((2 * ROOM, tick_log.WIDTH)), new_timer()
    run_trial(controls, ring, np.empty((1, tick_log.WIDTH)), timer, stopped_trial().arguments())
    run_idle(np.empty(20), timer)


def stopped_trial() -> Trial:
    """A simulated trial like any other that ends after a few ticks."""
    protocol = load_protocol()
    number, preset = next(iter(protocol.paths)), next(iter(protocol.controllers))
    file, path_file = protocol.devices[0], protocol.paths[number]
    path = build_path(path_file, "path")
    device = SimulatedDevice(file, (path.x0, path.y0), protocol.mouse.hand())
    planned = PlannedTrial(0, 0, file.name, preset, number, 1)
    trial = SimulatedTrial(
        device, planned, Conditions(path_file, protocol.controllers[preset], protocol.rules, protocol.trial)
    )
    run = trial.arguments().run
    run["stop"][0], run["end_ticks"][0] = 1, 20
    return trial


def main() -> None:
    """The process: jobs from the standard input, answers on the standard output, until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the server ends what runs, and then us
    allow_everything()
    given, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr
    ring, real_time, port = Ring(sys.argv[1]), sys.argv[2] == jobs.REAL_TIME, sys.argv[3]
    with contextlib.suppress(BrokenPipeError):
        loop = Loop(ring, port, answers)
        loop.prepare(real_time)
        loop.work(given)
