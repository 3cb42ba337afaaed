"""Gives trials to the control loop and follows each to its end; starts a new loop when one dies."""

import numpy as np

from app.ipc.jobs import CheckTiming, Compiling, LoopAnswer, LoopJob, Prepared, RunTrial, TimingChecked, TrialReturned
from app.ipc.messages import WAITING, Check
from app.ipc.ring import BRAKES_OFF, END_TRIAL, HAND_BACK, LET_GO, RING_FULL, SERVER_SILENT, STOPPED, UNTOUCHED, Ring
from app.ipc.scheduling import Scheduling, leave_core
from app.session_server.loop_light import LoopLight
from app.session_server.loop_process import LoopProcess
from app.session_server.preflight import check_compiling
from app.session_server.recorder import OnTicks, Recorder, Timing, timing_of
from core import tick_log
from core.faults import Cause, after, cause
from core.simulator.simulation import Simulation
from experiments.analysis.trials_table import TrialRow
from experiments.store.recording import RecordingWriter
from experiments.store.session import Session
from experiments.trial.trial import Trial

TRY_TICKS = 250  # a quarter of a second of deadlines, before the first trial
HAND_BACK_S = 0.02  # longest wait for a trial that the loop gives back at its next tick
END_S = 3.0  # longest wait for a loop to end by itself
MOST_STARTS = 3  # loops in a row that die before they are ready


class TrialRun:
    """A trial that the loop runs."""

    def __init__(
        self, ring: Ring, loop: LoopProcess, trial: Trial, writer: RecordingWriter | None,
        on_ticks: OnTicks | None = None, grasp: int = UNTOUCHED,
    ) -> None:  # fmt: skip
        """Start it. writer: None for a trial that is not kept. on_ticks: gets all ticks, too.

        grasp: how the pointer has the handle.
        """
        self.planned, self.trial = trial.planned, trial
        self.again = "never"  # as `messages.Abort` has it
        self.tip = trial.tip  # where it begins
        self._ring, self._reason, self._decided = ring, "", False
        ring.begin_trial(grasp, None if trial.real else (trial.path.x0, trial.path.y0))
        self.recorder = Recorder(ring, writer, on_ticks)
        trial.aim(*self.tip)  # nothing pulls until the pointer has touched the handle
        loop.send(RunTrial(trial))

    def stop(self, reason: str, decided: bool = False) -> None:
        """End the trial at its next tick, brakes off; the first reason stands. decided: by the experimenter."""
        if not self._reason:
            self._reason, self._decided = reason, decided
        self._ring.control.stop = END_TRIAL

    def hand_back(self) -> None:
        """Ask the loop for the trial between two ticks, to change it; a trial that ends meanwhile ends."""
        self._ring.control.stop = self._ring.control.stop or HAND_BACK

    @property
    def is_handed_back(self) -> bool:
        """Whether the loop was asked to hand the trial back."""
        return int(self._ring.control.stop) == HAND_BACK

    def returned(self, answer: TrialReturned, scheduling: str) -> None:
        """Take the trial back from the loop. After its last tick the recorder is closed; a trial that was handed back
        before goes on later.
        """
        self.trial.take_back(answer.state)
        if not self.trial.finished:
            return
        self.recorder.close()
        if reason := self._end_reason():
            self.trial.abort(reason)
        self.trial.hand_left = int(self._ring.control.let_go)
        timing = self.recorder.timing(scheduling)
        if timing is not None:
            lost = int(self._ring.control.dropped)
            self.trial.timing = {**timing._asdict(), "ticks": len(self.recorder.lateness_us), "lost": lost}

    def finish(self, session: Session) -> TrialRow:
        """Close and verify the recording and make its row. OSError or InputError: it cannot be written."""
        assert self.recorder.writer is not None
        decided = self._decided and int(self._ring.control.cause) == STOPPED
        return session.finish(self.trial, self.recorder.writer, cut_short=not decided)

    def rescue(self, session: Session) -> None:
        """After the loop is lost: store all its ticks as a recovered recording; the cell is open again. OSError."""
        self.recorder.close()
        if self.recorder.writer is not None:
            session.rescue(self.recorder.writer)

    def _end_reason(self) -> str:
        """Why the loop ended the trial early; "": it did not."""
        off = self._ring.why_off
        reasons = {
            STOPPED: self._reason,
            BRAKES_OFF: after("brakes off: ", off) if isinstance(off, Cause) else cause("brakes-off", why=off),
            SERVER_SILENT: cause("server-silent"),
            RING_FULL: cause("disk-too-slow", seconds=len(self._ring.rows) // 1000),
        }
        return reasons.get(int(self._ring.control.cause), "")


class TrialRunner:
    """Runs one trial at a time on the control loop."""

    def __init__(self, ring: Ring, loop: LoopProcess, real_time: bool, port: str = "") -> None:
        """loop: the first one, already started. real_time: try scheduling that needs a privilege. port: of a board."""
        self._ring, self._loop, self._real_time, self._port = ring, loop, real_time, port
        self._starts = 1
        self.scheduling: Scheduling | None = None  # that the loop got; None: it is not ready yet
        self._compiling: Compiling | None = None  # what it last said of its kernels
        self._light = LoopLight(board=bool(port))
        self._idle_timing: Timing | None = None
        self._last_timing: Timing | None = None  # of the last trial
        self.run: TrialRun | None = None
        self._let_go: Simulation | None = None  # the device whose handle was let go, and not touched since
        self.broken = ""  # why no loop can be started
        self._device_answers: list[LoopAnswer] = []  # the loop's answers about its device

    @property
    def _scheduling_words(self) -> str:
        return self.scheduling.words if self.scheduling else ""

    @property
    def ready(self) -> bool:
        """Whether a trial may start."""
        return self._idle_timing is not None and self.run is None

    def start(
        self, trial: Trial, writer: RecordingWriter | None, on_ticks: OnTicks | None = None, grasp: int | None = None
    ) -> TrialRun:
        """Run a trial; the writer is the runner's until the run has ended or is lost.

        grasp: how the pointer holds the handle; None: it must touch it first (one that was let go still returns).
        """
        if grasp is None:
            grasp = LET_GO if trial.simulation is self._let_go else UNTOUCHED

        def take(ticks: np.ndarray) -> None:
            self._light.take(ticks[:, tick_log.LATENESS_US])
            if on_ticks is not None:
                on_ticks(ticks)

        self.run = TrialRun(self._ring, self._loop, trial, writer, take, grasp)
        return self.run

    def go_on(self, run: TrialRun) -> None:
        """Continue a trial that was handed back."""
        self.run = run
        if run.is_handed_back:  # else it is to end
            self._ring.control.stop = 0
        self._loop.send(RunTrial(run.trial))

    def send(self, job: LoopJob) -> None:
        """Send a job about the device to the loop."""
        self._loop.send(job)

    def device_answers(self) -> list[LoopAnswer]:
        """Answers of the loop about its device since the last call."""
        answers, self._device_answers = self._device_answers, []
        return answers

    def watch(self) -> tuple[TrialRun | None, str]:
        """The run that has ended or was handed back, if any; and why the loop was lost with it, or ""."""
        if self.run is not None and self.run.recorder.error:
            self.run.stop(self.run.recorder.error)
        ended = None
        for answer in self._loop.receive(HAND_BACK_S if self.run and self.run.is_handed_back else 0.0):
            match answer:
                case Compiling():
                    self._compiling = answer
                case Prepared(scheduling):
                    self.scheduling, self._starts = scheduling, 0
                    leave_core(scheduling.core)
                    self._loop.send(CheckTiming(TRY_TICKS))
                case TimingChecked(lateness_us):
                    self._idle_timing = timing_of(lateness_us, self._scheduling_words)
                    self._light.take(lateness_us)
                case TrialReturned():
                    assert self.run is not None
                    ended, self.run = self.run, None
                    self._let_go = ended.trial.simulation if self._ring.grasp == LET_GO else None
                    ended.returned(answer, self._scheduling_words)
                    self._last_timing = ended.recorder.timing(self._scheduling_words)
                case _:
                    self._device_answers.append(answer)
        if ended is None and (self._loop.closed or self._loop.hung):
            return self._replace()
        return ended, ""

    def _replace(self) -> tuple[TrialRun | None, str]:
        why = cause("loop-died" if self._loop.closed else "loop-hung")
        self._loop.kill()
        run, self.run, self._idle_timing = self.run, None, None
        if self._starts >= MOST_STARTS:
            self.broken = cause("no-loop", times=MOST_STARTS)
            return run, self.broken
        self._starts += 1
        self._loop = LoopProcess(self._ring, self._real_time, self._port)
        return run, why

    @property
    def timing(self) -> Timing | None:
        """The lateness over the running trial (None: it has no ticks yet), else the last one, else without work."""
        if self.run is not None:
            return self.run.recorder.timing(self._scheduling_words)
        return self._last_timing or self._idle_timing

    @property
    def check(self) -> Check:
        if self.scheduling is None and self._compiling is not None and not self._loop.closed:
            return check_compiling(self._compiling)
        if self._loop.closed or self._idle_timing is None or self.scheduling is None:
            return Check("Loop", WAITING, "starting again" if self._loop.closed else "preparing")
        return self._light.check(self.scheduling)

    def close(self) -> None:
        """End the loop."""
        self._loop.end(END_S)
