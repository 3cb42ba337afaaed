"""The control loop: a process of its own that owns session, trial and recording, and runs the ticks at 1 kHz.

It reads the pointer and the intents of the window from a pipe and tells the window what happens. Without the window
(closed, hung, killed) it goes on until the trial is over or ends it at once, brakes off, with its recording kept.
"""

import gc
import signal
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from app.grasp import Grasp
from app.mailbox import Mailbox
from app.messages import Abort, Aim, Begun, Ended, Failed, Point, Prepared, Quit, Refused, Start, Ticks
from app.pace import MOST_AT_ONCE, Pace
from app.recorder import Recorder
from core import row
from core.device import Device
from core.errors import InputError
from experiments.plan import SEGMENTS, PlannedTrial
from experiments.session import Choices, Session, write_pooled_table
from experiments.trial import MouseHand, Trial, new_simulation

BLOCK_TICKS = 16  # ticks per message to window and recorder: about 60 messages a second
IDLE_S = 0.2  # longest wait for a message between trials
SWITCH_S = 1e-4  # s, longest time the recorder's thread keeps the interpreter while a tick is due
WINDOW_DIED = "the window closed unexpectedly"
TERMINATED = "the control loop was told to end"


def run_loop(connection: Connection, devices: Sequence[Device], data_dir: Path, choices: Choices, sync: bool) -> None:
    """The process: serve the window at the other end of the pipe until it quits or is gone."""
    loop = Loop(Mailbox(connection), devices, data_dir, choices, sync)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the window's: it then tells us to quit
    signal.signal(signal.SIGTERM, lambda *_: loop.end(TERMINATED))
    sys.setswitchinterval(SWITCH_S)
    loop.serve()


def compile_kernels(devices: Sequence[Device]) -> None:
    """Run a few ticks of a trial that nobody sees: kernels are compiled, or read from the cache, before the first."""
    segment = SEGMENTS[1]
    for device in devices:
        simulation = new_simulation(device, segment.start, MouseHand().hand())
        simulation.hand.grips["target"][0, :2] = segment.start
        planned = PlannedTrial(0, 0, device.name, 1, 1, 0)
        Trial(simulation, planned, segment, "settled", 5.0).run(np.empty((2, row.WIDTH)))


class Loop:
    """What the process knows: the session, once there is one, the pointer, and what it has been told."""

    def __init__(
        self, mailbox: Mailbox, devices: Sequence[Device], data_dir: Path, choices: Choices, sync: bool = True
    ) -> None:
        self.mailbox, self.devices, self.data_dir = mailbox, devices, data_dir
        self.choices, self.sync = choices, sync
        self.session: Session | None = None
        self.pointer: Point | None = None  # m, the last one that was seen
        self._start: Start | None = None
        self._abort = ""  # reason to abort the trial
        self._end = ""  # reason to end the process
        self._broken = ""  # why no more trials can be run

    def end(self, reason: str) -> None:
        """Abort what runs, keep it, and leave."""
        self._end = self._end or reason

    def serve(self) -> None:
        """Run trials as they are asked for, until the end."""
        compile_kernels(self.devices)
        self.mailbox.send(Prepared())
        while not self._end:
            self.listen(IDLE_S)
            self.mailbox.flush()
            if self._start and not self._end:
                asked, self._start = self._start, None
                self.start(asked.participant)
        if self.session is not None:
            self.session.close()
        self.mailbox.close()

    def listen(self, wait_s: float = 0.0) -> None:
        """Take in what the window has sent."""
        for message in self.mailbox.receive(wait_s):
            match message:
                case Aim(x, y):
                    self.pointer = (x, y)
                case Start():
                    self._start, self._abort = message, ""
                case Abort(reason):
                    self._abort = reason
                case Quit(reason):
                    self.end(reason)
        if self.mailbox.closed:
            self.end(WINDOW_DIED)

    def start(self, participant: str) -> None:
        """Run the next trial of the plan; the first start creates the session."""
        try:
            if self._broken:
                raise InputError(self._broken)
            if self.session is None:
                self.session = Session(self.data_dir, participant, self.devices, self.choices, sync=self.sync)
            planned = self.session.next_planned()
            if planned is None:
                raise InputError("all trials of the plan are done")
            trial, writer = self.session.begin(planned)
        except (InputError, OSError) as error:
            self.mailbox.send(Refused(str(error)))
            return
        recorder = Recorder(writer)
        try:
            self.run(trial, recorder)
        except BaseException as error:
            trial.abort(f"the control loop failed: {error}")
            self.run_out(trial, recorder)
            raise
        finally:
            recorder.close()
            self.keep(trial, recorder)
            self._start = None  # asked for while the trial ran: not meant for the next one

    def run(self, trial: Trial, recorder: Recorder) -> None:
        """One trial in real time, from its first tick to its last."""
        tip = tip_of(trial)
        grasp = Grasp(tip, self.pointer)
        self.mailbox.send(Begun(trial.planned, tip))
        rows, block, ticks, stopping = np.empty((MOST_AT_ONCE, row.WIDTH)), [], 0, False
        gc.collect()
        gc.disable()
        pace = Pace()
        while not trial.finished:
            late = pace.wait()
            self.listen()
            if self.pointer is not None:
                grasp.point(self.pointer, tip_of(trial))
            trial.aim(*grasp.target)
            reason = self._end or self._abort or recorder.error
            if reason and not stopping:
                trial.abort(reason)
                stopping = True
            n = trial.run(rows[: len(late)])
            rows[:n, row.LATENESS_US] = late[:n]
            block.append(rows[:n].copy())
            ticks += n
            if ticks >= BLOCK_TICKS or trial.finished:
                whole = np.concatenate(block)
                recorder.take(whole)
                self.mailbox.offer(Ticks(whole, grasp.taken, recorder.proof()))
                block, ticks = [], 0
        gc.enable()

    def run_out(self, trial: Trial, recorder: Recorder) -> None:
        """The rest of an aborted trial, brakes off, at once."""
        while not trial.finished:
            rows = np.empty((MOST_AT_ONCE, row.WIDTH))
            recorder.take(rows[: trial.run(rows)])

    def keep(self, trial: Trial, recorder: Recorder) -> None:
        """Close and verify the recording, add the row to the tables, tell the window."""
        session = self.session
        assert session is not None
        try:
            if recorder.error:
                raise OSError(f"the recording failed: {recorder.error}")
            trial_row = session.finish(trial, recorder.writer)
            write_pooled_table(self.data_dir)
        except (InputError, OSError) as error:
            self._broken = f"trial {trial.planned.run} is not complete: {error}"
            self.mailbox.send(Failed(self._broken))
            return
        planned = session.next_planned()
        coming = planned or trial.planned
        x, y = session.simulation(coming.configuration).state["tip"][0, :2]
        reason = trial.outcome()["reason"]
        self.mailbox.send(Ended(trial_row, reason, planned, (float(x), float(y))))


def tip_of(trial: Trial) -> Point:
    """Where the handle is, m."""
    tip = trial.simulation.state["tip"][0]
    return float(tip[0]), float(tip[1])
