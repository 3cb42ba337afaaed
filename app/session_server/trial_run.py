"""One live trial, from the moment it is given to the loop until its row is in the table."""

import contextlib

from app.ipc.messages import Done, LinkedDone, Run, RunLinked, Timing, changed
from app.ipc.ring import BRAKES_OFF, CONDUCTOR_SILENT, RING_FULL, STOPPED, Ring
from app.session_server.loop_process import LoopProcess
from app.session_server.recorder import Recorder
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.recording.writer import RecordingWriter
from experiments.session.session import Session
from experiments.trial.trial import Trial

SILENT = "the process that records did not answer for two seconds"


class TrialRun:
    """A trial that the loop runs now."""

    def __init__(
        self, ring: Ring, loop: LoopProcess, planned: PlannedTrial, trial: Trial, writer: RecordingWriter | None
    ) -> None:
        """Start it. writer: None for a trial that is not kept."""
        self.planned, self.trial = planned, trial
        self.tip = trial.tip  # where it begins
        self._ring, self._reason, self._decided = ring, "", False
        ring.begin_trial()
        self.recorder = Recorder(ring, writer)
        self._send(loop)

    def _send(self, loop: LoopProcess) -> None:
        self.trial.aim(*self.tip)  # nothing pulls until the pointer has touched the handle
        loop.send(Run(self.trial.arguments()))

    @property
    def name(self) -> str:
        """For the experimenter: "Run 12"."""
        return f"Run {self.planned.run}" if self.planned.block else "Practice"

    def stop(self, reason: str, decided: bool = False) -> None:
        """End it at its next tick, brakes off; the first reason stands. decided: the experimenter asked for it."""
        if not self._reason:
            self._reason, self._decided = reason, decided
        self._ring.control.stop = 1

    def watch(self) -> None:
        """End it if its recording takes no more."""
        if self.recorder.error:
            self.stop(self.recorder.error)

    def ended(self, answer: Done, scheduling: str) -> None:
        """The loop has run its last tick: the trial is as the loop left it, and every tick is with the writer."""
        self.recorder.close()
        self._take_back(answer)
        if reason := self._why():
            self.trial.abort(reason)
        timing = self.recorder.timing(scheduling)
        if timing is not None:
            lost = int(self._ring.control.dropped)
            self.trial.timing = {**timing._asdict(), "ticks": len(self.recorder.lateness_us), "lost": lost}

    def _take_back(self, answer: Done) -> None:
        for ours, theirs in zip(changed(self.trial.arguments()), answer.changed, strict=True):
            ours[...] = theirs

    def keep(self, session: Session) -> TrialRow:
        """Close and verify the recording and make its row. OSError or InputError if it is not whole."""
        assert self.recorder.writer is not None
        if self.recorder.error:
            raise OSError(self.recorder.error)
        decided = self._decided and int(self._ring.control.cause) == STOPPED
        return session.finish(self.trial, self.recorder.writer, cut_short=not decided, raw_will_do=True)

    def let_go(self) -> None:
        """The recording gets no more: its stream stays as it is."""
        self.recorder.close()
        if self.recorder.writer is not None:
            with contextlib.suppress(OSError, ValueError):  # what the disk does not take is said already
                self.recorder.writer.abandon()

    def rescue(self, session: Session) -> None:
        """The loop is gone: every tick that it has run becomes a recovered recording; the cell is open again."""
        self.let_go()
        if self.recorder.writer is not None:
            session.put_in_order()

    def timing(self, scheduling: str) -> Timing | None:
        """How late its ticks have been so far."""
        return self.recorder.timing(scheduling)

    def _why(self) -> str:
        """Why the loop ended it early; "": it did not."""
        reasons = {
            STOPPED: self._reason,
            BRAKES_OFF: f"brakes off: {self._ring.why_off}",
            CONDUCTOR_SILENT: SILENT,
            RING_FULL: f"the disk could not keep up: it took nothing for {len(self._ring.rows) // 1000} s",
        }
        return reasons.get(int(self._ring.control.cause), "")


class LinkedRun(TrialRun):
    """A trial on the bench: the loop gives it back as it was when it ended."""

    def _send(self, loop: LoopProcess) -> None:
        loop.send(RunLinked(self.trial))

    def ended(self, answer: LinkedDone, scheduling: str) -> None:
        """The loop has run its last tick, and every tick is with the writer."""
        self.trial = answer.trial
        super().ended(Done(()), scheduling)

    def _take_back(self, answer: Done) -> None:
        pass
