"""The conductor's end of the control loop: start it, give it trials, see whether it lives, end it."""

import contextlib
import pickle
import queue
import subprocess
import threading

from app.ipc.board_jobs import Linked, LinkedDone, RunLinked
from app.ipc.jobs import DEFAULT, REAL_TIME, Done, Prepared, Run, Tried, Try
from app.ipc.process import start_python
from app.ipc.ring import Ring

#: Seconds without a tick after which a running loop counts as hung. Our choice: a stall below it is in the lateness.
HUNG_S = 2.0
#: The same for a loop on the bench between trials, which says ten times a second how its board is; a handshake takes a
#: few seconds at most.
BENCH_HUNG_S = 10.0
END_S = 3.0  # longest wait for it to end by itself


class LoopProcess:
    """A control loop in a process of its own, on the conductor's ring."""

    def __init__(self, ring: Ring, real_time: bool = True, port: str = "") -> None:
        """Start it; its first answer is Prepared. real_time: it tries scheduling that needs a privilege.

        port: of a device on the bench; "": the device is simulated.
        """
        self._ring = ring
        self._process = start_python(
            "app.loop.board_loop" if port else "app.loop.loop",
            str(ring.path), REAL_TIME if real_time else DEFAULT, port,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        self._answers: queue.SimpleQueue[Prepared | Tried | Done | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, name="loop's answers", daemon=True)
        self._jobs: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="loop's jobs", daemon=True)  # a loop may not read
        self._reader.start()
        self._writer.start()
        self.running = False  # a trial
        self._beats = False  # also without a trial
        self.dead = False  # seen by the end of its output, at once

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._process.pid

    @property
    def closed(self) -> bool:
        """Whether it has ended and been waited for."""
        return self._process.returncode is not None

    @property
    def hung(self) -> bool:
        """Whether it runs a trial and has had no tick for long, or has a board and did not look at it for long."""
        silent_s = self._ring.loop_silent_s
        return (self.running and silent_s > HUNG_S) or (self._beats and silent_s > BENCH_HUNG_S)

    def send(self, job: Try | Run) -> None:
        """Give it something to do; one that is dead is seen by `dead`. Does not wait for it."""
        self.running = isinstance(job, Run | RunLinked)
        self._jobs.put(pickle.dumps(job))

    def receive(self) -> list[Prepared | Tried | Done]:
        """What it has answered since the last time."""
        answers = []
        while not self._answers.empty():
            answer = self._answers.get()
            if answer is None:
                self.dead = True
            else:
                answers.append(answer)
                self.running &= not isinstance(answer, Done | LinkedDone)
                self._beats |= isinstance(answer, Linked)
        return answers

    def kill(self) -> None:
        """End it at once, whatever it does."""
        self._process.kill()
        self.close()

    def close(self) -> None:
        """Let it end; kill it if it does not."""
        self._jobs.put(None)
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._writer.join()
        self.running, self.dead = False, True

    def _write(self) -> None:
        """Its jobs, until there are no more or it is gone; then its input ends."""
        jobs = self._process.stdin
        assert jobs is not None
        with contextlib.suppress(BrokenPipeError), jobs:
            while (job := self._jobs.get()) is not None:
                jobs.write(job)
                jobs.flush()

    def _read(self) -> None:
        with self._process.stdout as answers:  # type: ignore[union-attr]
            while True:
                try:
                    self._answers.put(pickle.load(answers))
                except (EOFError, pickle.UnpicklingError, OSError):
                    break
        self._answers.put(None)
