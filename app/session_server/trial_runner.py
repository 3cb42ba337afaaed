"""Keeps a control loop at hand: starts it, tries it, gives it trials, and starts a new one when it dies."""

from app.ipc.messages import Check, Done, LinkedDone, Prepared, Timing, Tried, Try
from app.ipc.ring import Ring
from app.ipc.scheduling import leave_core
from app.session_server.loop_process import LoopProcess
from app.session_server.preflight import check_loop
from app.session_server.recorder import timing_of
from app.session_server.trial_run import LinkedRun, TrialRun
from experiments.plan import PlannedTrial
from experiments.recording.writer import RecordingWriter
from experiments.trial.linked_trial import LinkedTrial
from experiments.trial.trial import Trial

TRY_TICKS = 250  # a quarter of a second of deadlines, before the first trial
MOST_STARTS = 3  # loops in a row that die before they are ready
DIED = "the control loop ended unexpectedly"
HUNG = "the control loop hung and was ended"
NEVER = f"the control loop cannot be started: it died {MOST_STARTS} times while it was being prepared"


class TrialRunner:
    """One trial at a time, on the loop that lives."""

    def __init__(self, ring: Ring, loop: LoopProcess, real_time: bool, port: str = "") -> None:
        """loop: the first one, already started. real_time: try scheduling that needs a privilege. port: of a board."""
        self._ring, self._loop, self._real_time, self._port = ring, loop, real_time, port
        self._starts = 1
        self._scheduling = ""
        self._tried: Timing | None = None
        self._last: Timing | None = None  # of the last trial
        self.run: TrialRun | None = None
        self.broken = ""  # why no loop can be had
        self.told: list[object] = []  # what the loop of a board has answered besides, until somebody takes it
        self.replaced = False  # the loop is a new one, which knows of no device yet

    @property
    def ready(self) -> bool:
        """Whether a trial may start."""
        return self._tried is not None and self.run is None

    def start(self, planned: PlannedTrial, trial: Trial | LinkedTrial, writer: RecordingWriter | None) -> None:
        """Run a trial; the writer is the runner's until the run has ended or is lost."""
        kind = LinkedRun if isinstance(trial, LinkedTrial) else TrialRun
        self.run = kind(self._ring, self._loop, planned, trial, writer)

    def send(self, job: object) -> None:
        """A job for the loop of a board."""
        self._loop.send(job)

    def watch(self) -> tuple[TrialRun | None, str]:
        """The run that has come to its end, if one has, and "" or why the loop was lost with it."""
        if self.run is not None:
            self.run.watch()
        ended = None
        for answer in self._loop.receive():
            match answer:
                case Prepared(scheduling, core):
                    self._scheduling, self._starts = scheduling, 0
                    leave_core(core)
                    self._loop.send(Try(TRY_TICKS))
                case Tried(lateness_us):
                    self._tried = timing_of(lateness_us, self._scheduling)
                case Done() | LinkedDone():
                    assert self.run is not None
                    ended, self.run = self.run, None
                    ended.ended(answer, self._scheduling)
                    self._last = ended.timing(self._scheduling)
                case _:
                    self.told.append(answer)
        if ended is None and (self._loop.dead or self._loop.hung):
            return self._replace()
        return ended, ""

    def _replace(self) -> tuple[TrialRun | None, str]:
        why = DIED if self._loop.dead else HUNG
        self._loop.kill()
        run, self.run, self._tried = self.run, None, None
        if self._starts >= MOST_STARTS:
            self.broken = NEVER
            return run, NEVER
        self._starts += 1
        self._loop = LoopProcess(self._ring, self._real_time, self._port)
        self.replaced = True
        return run, why

    @property
    def timing(self) -> Timing | None:
        """The loop's lateness over the running trial, or the last, or the time without one."""
        now = self.run.timing(self._scheduling) if self.run else None
        return now or self._last or self._tried

    @property
    def check(self) -> Check:
        """For the pre-flight row."""
        return check_loop(self._tried, self._loop.dead, self._last)

    def close(self) -> None:
        """End the loop."""
        self._loop.close()
