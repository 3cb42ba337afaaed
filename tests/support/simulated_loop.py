"""The session server without processes, for tests: its loop runs trials in this process, as fast as it can."""

import contextlib
import pickle
import time
from collections.abc import Iterator

import numpy as np
from live import Window

from app.ipc import messages as m
from app.ipc.messages import Done, Prepared, Run, Setup, Tried, Try
from app.ipc.ring import HAND_BACK, Ring
from app.loop.real_time import end_early, put, take_aim
from app.session_server.commands import do
from app.session_server.server import read_protocol
from app.session_server.state import State
from core import tick_log
from experiments.session.files import hold_lock
from experiments.trial.tick import run_ticks

PIECE = 60  # ticks at each look of the server


class SimulatedLoop:
    """In place of `LoopProcess`: the same jobs and answers, in simulated time."""

    dead = hung = closed = False

    def __init__(self, ring: Ring) -> None:
        self._ring, self._trial = ring, None
        self._answers: list[object] = [Prepared("simulated time", -1)]

    def send(self, job: object) -> None:
        match pickle.loads(pickle.dumps(job)):  # as through the pipe
            case Try(ticks):
                self._answers.append(Tried(np.zeros(ticks)))
            case Run(trial):
                self._trial = trial
                self._force_max = float(trial.arguments().hand.grips["force_max"][0])

    def receive(self, wait_s: float = 0.0) -> list[object]:
        if self._trial is not None:
            self._advance()
        answers, self._answers = self._answers, []
        return answers

    def _advance(self) -> None:
        """As `real_time.run_trial`, without waiting."""
        ring, arguments, row = self._ring, self._trial.arguments(), np.zeros((1, tick_log.WIDTH))
        for _ in range(PIECE):
            if ring.control.stop == HAND_BACK:
                self._answers.append(Done(self._trial.changed()))
                self._trial = None
                return
            end_early(ring.controls, arguments.run, time.monotonic_ns(), len(ring.rows))
            if not arguments.run["simulated_hand"][0]:
                grip, phase = arguments.hand.grips[0], arguments.run["phase"][0]
                take_aim(ring.control, grip, arguments.state[0].tip, phase, self._force_max)
                arguments.run["held"][0] = ring.control.taken
            run_ticks(*arguments, row)
            put(ring.controls, ring.rows, row[0])
            if self._trial.finished:
                arguments.hand.grips["force_max"][0] = self._force_max
                self._answers.append(Done(self._trial.changed()))
                self._trial = None
                return

    def kill(self) -> None:
        self.closed = True

    close = kill


class LocalClient:
    """In place of `Client`: the state of a session server in this process."""

    alive, pid = True, 0

    def __init__(self, setup: Setup) -> None:
        self._ring = Ring()
        setup.data_dir.mkdir(parents=True, exist_ok=True)
        self._lock = hold_lock(setup.data_dir)
        self.state = State(setup, read_protocol(setup), self._ring, SimulatedLoop(self._ring))
        self._opened: m.Opened | None = None
        self._shown: m.Snapshot | None = None
        self.taken = False

    def send(self, command: object) -> None:
        do(self.state, command)

    def receive(self) -> list:
        """One look of the server, and what it would have sent."""
        self._ring.beat()
        self.state.watch()
        opened, shown, said = self.state.opened(), self.state.snapshot(), []
        if opened != self._opened:
            said.append(opened)
        if shown != self._shown:
            said.append(shown)
        self._opened, self._shown = opened, shown
        return [*said, self.state.pulse()]

    def ticks(self) -> np.ndarray:
        return self._ring.newest()

    def aim(self, x: float, y: float) -> None:
        self._ring.aim(x, y)

    def let_go(self) -> None:
        self._ring.let_go()

    def brakes_off(self, cause: str) -> None:
        self._ring.press_off(cause)

    def stop(self, reason: str) -> None:
        self.state.end(reason)
        self._lock.release()

    def leave(self) -> None:
        """As a server that is killed: nothing is brought to its end, and the system lets the locks go."""
        if self.state.session is not None:
            self.state.session.close()
        self._lock.release()


class LocalWindow(Window):
    """A window whose session server is in this process."""

    def join(self, setup: Setup) -> None:
        super().join(setup, LocalClient)


@contextlib.contextmanager
def local_window(setup: Setup) -> Iterator[LocalWindow]:
    """A window with a session server in simulated time."""
    opened = LocalWindow(setup)
    try:
        yield opened
    finally:
        opened.client.stop("the test is over")
