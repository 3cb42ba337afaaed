"""The control loop for a device on the bench: a process that exchanges with its board every millisecond.

Python per tick: the board's samples pace it, and nothing waits longer than a few ms. Between trials it goes on with
zero currents. Brakes-off is latched on the board, and what the board latches becomes a brakes-off. However the process
ends, the last thing sent is zero; killed, the board's watchdog does it.
"""

import contextlib
import gc
import pickle
import queue
import signal
import sys
import threading
import time
from typing import Any

import numpy as np

from app.ipc.messages import (
    REAL_TIME,
    Connect,
    HomeAt,
    Homed,
    Linked,
    LinkedDone,
    Looked,
    NotDone,
    Prepared,
    Reset,
    RunLinked,
    TakeZero,
    Tried,
    Try,
    Zeroed,
)
from app.ipc.ring import BRAKES_OFF, CONDUCTOR_SILENT, NO_CAUSE, RING_FULL, STOPPED, Ring
from app.ipc.scheduling import take_scheduling
from app.loop.clock import new_timespec
from app.loop.real_time import ROOM, SILENT_NS, run_idle
from core.device import Device
from core.device_interface import LinkError, LinkSample
from core.errors import InputError
from experiments.trial.linked_trial import LinkedTrial, load_kernels
from hardware.sensing.net_force_link import link_to
from hardware.serial_device import SerialLink

NO_CURRENT = (0.0, 0.0, 0.0, 0.0)
TELL_S = 0.1  # between two reports of how the device is
AGAIN_S = 1.0  # between attempts to reach a board that was never reached
LATCHED = "the board: "  # begins the cause of a brakes-off that the board latched


class BoardLoop:
    """One port, one ring, one trial at a time."""

    def __init__(self, ring: Ring, port: str, answers: Any) -> None:
        self.ring, self.port, self._answers = ring, port, answers
        self._flags = ring.controls.view(np.ndarray)
        self._link: SerialLink | None = None
        self._devices: tuple[Device, ...] = ()
        self._problem = "not connected yet"
        self._homed_at = self._zeroed_at = 0.0
        self._sample: LinkSample | None = None
        self._told_s = self._tried_s = 0.0
        self._looking = False  # boards have been asked for, and it has not been told what was found
        self._jobs: queue.SimpleQueue = queue.SimpleQueue()
        self._alone = False  # the conductor is gone
        ring.rows.max()  # every page is in memory before the first tick

    def prepare(self, real_time: bool) -> None:
        """Compile what a trial needs, then take the best scheduling that is allowed."""
        load_kernels()
        run_idle(np.empty(20), new_timespec())
        scheduling, core = take_scheduling(real_time)
        self.ring.control.core = core
        gc.collect()
        gc.freeze()
        self._answer(Prepared(scheduling, core))

    def work(self, jobs: Any) -> None:
        """Until the input ends."""
        threading.Thread(target=self._listen, args=(jobs,), name="jobs", daemon=True).start()
        try:
            while True:
                job = self._next()
                if job is None:
                    return
                if job is not ...:
                    self._do(job)
                self._idle()
        finally:
            if self._link is not None:
                self._link.close()

    def _listen(self, jobs: Any) -> None:
        """Jobs from the conductor, on a thread of its own: reading one may wait."""
        while True:
            try:
                self._jobs.put(pickle.load(jobs))
            except (EOFError, pickle.UnpicklingError, OSError):
                self._jobs.put(None)
                self._alone = True
                return

    def _next(self) -> Any:
        """The next job; None: there will be no more; ...: there is none now."""
        try:
            return self._jobs.get_nowait()
        except queue.Empty:
            return ...

    def _answer(self, answer: Any) -> None:
        pickle.dump(answer, self._answers)
        self._answers.flush()

    def _do(self, job: Any) -> None:
        try:
            match job:
                case Try(ticks):
                    lateness = np.empty(ticks)
                    run_idle(lateness, new_timespec())
                    self._answer(Tried(lateness))
                case Connect(devices):
                    self._devices, self._tried_s, self._looking = devices, 0.0, True
                    self._leave()
                case HomeAt(tip):
                    self._there().home(tip)
                    self._homed_at = time.time()
                    self._answer(Homed(tip))
                case TakeZero():
                    record = self._there().zero()
                    self._zeroed_at = time.time()
                    self._answer(Zeroed(record))
                case Reset(presses):
                    self._reset(presses)
                case RunLinked(trial):
                    if self._link is None:
                        trial.give_up(f"the board cannot be reached: {self._problem}")
                    elif not self._link.zeroed:
                        trial.give_up("the zero of the device does not hold any more")
                    else:
                        self._run(trial, self._link)
                    self._answer(LinkedDone(trial))
        except (LinkError, InputError) as error:
            self._answer(NotDone(str(error)))
        self._told_s = 0.0

    def _there(self) -> SerialLink:
        if self._link is None:
            raise LinkError(f"the board cannot be reached: {self._problem}")
        return self._link

    def _reset(self, presses: int) -> None:
        """A board that is not there has no faults to forget; the brakes-off is past all the same.

        Allowed first: a brakes-off that comes while the board answers stands, as does one that came since the asking.
        """
        if self.ring.presses != presses:
            return
        cause = self.ring.why_off
        self.ring.allow()
        if self._sample is not None and self._sample.fault:
            try:
                self._there().reset()
            except (LinkError, InputError):
                self.ring.switch_off(cause)
                raise
            self._sample = None

    # ------------------------------------------------------------------------------------- between trials

    def _idle(self) -> None:
        """One exchange with zero currents; what is wrong is told."""
        if self._link is None:
            self._connect()
        else:
            self._sample = self._link.exchange(NO_CURRENT) or self._sample
            self._link.samples()
            if self._link.problem:
                self._sample = None
            elif self._sample is not None:
                self._latch(self._link, self._sample)
        self._flags["loop_beat"][0] = time.monotonic_ns()
        now = time.monotonic()
        known = self._link is None or self._link.problem or self._sample is not None
        if known and now - self._told_s >= TELL_S:
            self._told_s = now
            self._answer(self._linked())
            if self._looking:
                self._looking = False
                self._answer(Looked())

    def _latch(self, link: SerialLink, sample: LinkSample) -> None:
        """Brakes-off here is brakes-off on the board, and the other way round."""
        if sample.fault:
            self.ring.switch_off(LATCHED + sample.fault)
        elif self._flags["brakes_off"][0]:
            link.stop()

    def _connect(self) -> None:
        """Try the devices there are; a board that is not there yet is looked for again."""
        now = time.monotonic()
        if not self._devices or now - self._tried_s < AGAIN_S:
            time.sleep(0.01)
            return
        problem = ""
        for device in self._devices:
            link = link_to(device, self.port)
            self._flags["loop_beat"][0] = time.monotonic_ns()  # one that does not answer takes more than a second
            try:
                link.open()
            except InputError as error:
                problem = problem or str(error)
                continue
            self._link, self._sample = link, None
            self._homed_at = self._zeroed_at = 0.0
            break
        self._problem, self._tried_s = problem, time.monotonic()

    def _leave(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link, self._sample, self._problem = None, None, "not connected yet"

    def _linked(self) -> Linked:
        link, sample = self._link, self._sample
        if link is None:
            return Linked(problem=self._problem, port=self.port)
        report = link.report()
        told = Linked(
            link.device.name, report.get("board", ""), link.problem, zeroed=link.zeroed, encoders=link.encoders,
            force_channels=link.force_channels, report=report, port=link.port, homed_at=self._homed_at,
            zeroed_at=self._zeroed_at if link.zeroed else 0.0, told_s=time.monotonic(),
        )  # fmt: skip
        if sample is None:
            return told
        return told._replace(
            fault=sample.fault, homed=sample.homed, tip=sample.tip, hand_force=sample.hand_force, counts=sample.counts,
            theta=sample.theta,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------- a trial

    def _run(self, trial: LinkedTrial, link: SerialLink) -> None:
        """From its first tick to its last; every tick goes into the ring."""
        trial.link = link
        gc.disable()
        try:
            while not trial.finished:
                if (cause := self._why_end()) and not self._flags["cause"][0] and trial.phase != "end":
                    self._flags["cause"][0] = cause
                    trial.abort("")
                for made in trial.exchange():
                    self._keep(made)
                self._flags["loop_beat"][0] = time.monotonic_ns()
        finally:
            trial.link = None
            gc.enable()
            self._sample = None

    def _why_end(self) -> int:
        """Why the trial must end now, as `real_time.why_end`."""
        flags = self._flags
        if flags["brakes_off"][0]:
            return BRAKES_OFF
        if flags["stop"][0]:
            return STOPPED
        if self._alone or time.monotonic_ns() - flags["conductor_beat"][0] > SILENT_NS:
            return CONDUCTOR_SILENT
        if flags["head"][0] - flags["tail"][0] > len(self.ring.rows) - ROOM:
            return RING_FULL
        return NO_CAUSE

    def _keep(self, made: np.ndarray) -> None:
        """Let the others see a tick, or count it where there is no room."""
        flags, size = self._flags, len(self.ring.rows)
        head = int(flags["head"][0])
        if head - flags["tail"][0] >= size:
            flags["dropped"][0] += 1
            return
        self.ring.rows[head % size] = made
        flags["head"][0] = head + 1


def main() -> None:
    """The process: jobs from the standard input, answers on the standard output, until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the conductor ends what runs, and then us
    jobs, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr
    ring, real_time, port = Ring(sys.argv[1]), sys.argv[2] == REAL_TIME, sys.argv[3]
    with contextlib.suppress(BrokenPipeError):
        loop = BoardLoop(ring, port, answers)
        loop.prepare(real_time)
        loop.work(jobs)
