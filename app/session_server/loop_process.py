"""The session server's end of the control loop: start it, give it trials, see whether it lives, end it."""

from app.ipc.jobs import DEFAULT, REAL_TIME, RunTrial, TrialReturned
from app.ipc.messages import DeviceStatus
from app.ipc.pipe import Child
from app.ipc.ring import Ring

#: Seconds without a tick after which a running loop counts as hung. Our choice: a stall below it is in the lateness.
HUNG_S = 2.0
#: The same for a loop with a real device between trials, which says ten times a second how it is; a handshake takes a
#: few seconds at most.
BENCH_HUNG_S = 10.0


class LoopProcess(Child):
    """A control loop in its own process; `closed` once it is dead."""

    def __init__(self, ring: Ring, real_time: bool = True, port: str = "") -> None:
        """Start it; its first answer is Prepared. real_time: try scheduling that needs a privilege.

        port: of a real device; "": the device is simulated.
        """
        self._ring = ring
        self._running = False  # a trial
        self._beats = False  # also without a trial
        super().__init__("app.loop.loop", ring.handle, REAL_TIME if real_time else DEFAULT, port, **ring.inherited)

    @property
    def hung(self) -> bool:
        """Whether it has had no tick for too long in a trial, or no answer from its board for too long."""
        silent_s = self._ring.loop_silent_s
        return (self._running and silent_s > HUNG_S) or (self._beats and silent_s > BENCH_HUNG_S)

    def send(self, job: object) -> None:
        """Send a job; does not wait for it."""
        self._running = isinstance(job, RunTrial)
        super().send(job)

    def receive(self, wait_s: float = 0.0) -> list:
        """The loop's answers since the last call; waits at most `wait_s` for the first."""
        answers = super().receive(wait_s)
        for answer in answers:
            self._running &= not isinstance(answer, TrialReturned)
            self._beats |= isinstance(answer, DeviceStatus)
        return answers
