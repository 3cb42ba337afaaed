"""The session server without processes, for tests: its loop runs trials in this process, in simulated time."""

import contextlib
import io
import pickle
from collections.abc import Iterator

import numpy as np
from live import Window
from simulated_bench import Bench, BenchWire

from app.ipc import messages as m
from app.ipc.jobs import CheckTiming, Prepared, RunTrial, TimingChecked, TrialReturned
from app.ipc.messages import Setup
from app.ipc.ring import HAND_BACK, Ring
from app.ipc.scheduling import Scheduling
from app.loop.loop import Loop
from app.loop.real_time import end_early, take_aim
from app.session_server.commands import do
from app.session_server.server import read_protocol
from app.session_server.state import ServerState
from core import tick_log
from experiments.store.files import hold_lock
from experiments.trial.tick import RunningTrial, run_ticks
from hardware.serial_device import SerialDevice

SCHEDULING = Scheduling(False, False, -1, "simulated time")

PIECE = 60  # ticks at each look of the server


class SimulatedLoop:
    """In place of `LoopProcess`: the same jobs and answers, in simulated time."""

    hung = closed = False

    def __init__(self, ring: Ring) -> None:
        self._ring, self._trial = ring, None
        self._answers: list[object] = [Prepared(SCHEDULING)]

    def send(self, job: object) -> None:
        match pickle.loads(pickle.dumps(job)):  # as through the pipe
            case CheckTiming(ticks):
                self._answers.append(TimingChecked(np.zeros(ticks)))
            case RunTrial(trial):
                self._trial = trial
                self._force_max = float(trial.simulation.hand.grips["force_max"][0])

    def receive(self, wait_s: float = 0.0) -> list[object]:
        if self._trial is not None:
            self._advance()
        answers, self._answers = self._answers, []
        return answers

    def _advance(self) -> None:
        """As `real_time.run_trial`, without waiting. The controls change between two looks alone."""
        control, running = self._ring.control, self._trial.arguments()
        if control.stop != HAND_BACK:
            end_early(self._ring.controls, running.run, int(control.server_beat), len(self._ring.rows))  # never silent
        ticks = 0
        while ticks < PIECE and control.stop != HAND_BACK and not self._trial.finished:
            ticks += self._run(running, PIECE - ticks)
        if ticks < PIECE:
            running.data.hand.grips[0].force_max = self._force_max
            self._answers.append(TrialReturned(self._trial.state))
            self._trial = None

    def _run(self, running: RunningTrial, most: int) -> int:
        """So many ticks, or one where the hand follows the handle; how many."""
        ring, grip = self._ring, running.data.hand.grips[0]
        if not running.run["simulated_hand"][0]:
            take_aim(ring.control, grip, running.data.body[0].tip, running.run["phase"][0], self._force_max)
            running.run["held"][0] = ring.control.taken
            most = most if ring.control.taken else 1
        rows = np.zeros((most, tick_log.WIDTH))
        ticks = run_ticks(running, rows)
        head = int(ring.control.head)
        ring.rows[(head + np.arange(ticks)) % len(ring.rows)] = rows[:ticks]
        ring.control.head = head + ticks
        return ticks

    def kill(self) -> None:
        self.closed = True

    def end(self, wait_s: float) -> None:
        self.kill()


class BoardLoop:
    """In place of `LoopProcess` with a board: the loop itself, on a board in simulated time.

    At each look of the server it does one job, a trial to its end, or has 20 ms of the time between trials.
    """

    hung = closed = False

    def __init__(self, ring: Ring, board: Bench) -> None:
        self._board, self._jobs, self._out = board, [], io.BytesIO()
        self._loop = Loop(
            ring, "bench", self._out, lambda: board.now_s, self._pass_time,
            lambda device, port: SerialDevice(
                device, port, clock=lambda: board.now_s, open_port=lambda name: BenchWire(board, name),
                sleep=self._pass_time,
            ),
        )  # fmt: skip
        pickle.dump(Prepared(SCHEDULING), self._out)

    def _pass_time(self, seconds: float) -> None:
        with self._board.lock:
            for _ in range(round(1000 * seconds)):
                self._board.backlog += self._board.tick()

    def send(self, job: object) -> None:
        self._jobs.append(pickle.loads(pickle.dumps(job)))  # as through the pipe

    def receive(self, wait_s: float = 0.0) -> list[object]:
        if self._jobs:
            match job := self._jobs.pop(0):
                case CheckTiming(ticks):
                    pickle.dump(TimingChecked(np.zeros(ticks)), self._out)
                case _:
                    self._loop.do(job)
        else:
            end = self._board.ticks + 20
            while self._board.ticks < end:
                self._loop.idle()
        self._out.seek(0)
        answers = []
        with contextlib.suppress(EOFError):
            while True:
                answers.append(pickle.load(self._out))
        self._out.seek(0)
        self._out.truncate()
        return answers

    def kill(self) -> None:
        self.closed = True
        if self._loop.device is not None:
            self._loop.device.close()

    def end(self, wait_s: float) -> None:
        self.kill()


class LocalClient:
    """In place of `Client`: the state of a session server in this process."""

    alive, pid = True, 0

    def __init__(self, setup: Setup, board: Bench | None = None) -> None:
        """board: on the bench; None: the device is simulated."""
        self.ring = Ring(width=tick_log.BENCH_WIDTH if board else tick_log.WIDTH)
        loop = BoardLoop(self.ring, board) if board else SimulatedLoop(self.ring)
        setup.data_dir.mkdir(parents=True, exist_ok=True)
        self._lock = hold_lock(setup.data_dir)
        self.state = ServerState(setup, read_protocol(setup), self.ring, loop)
        self._opened: m.Opened | None = None
        self._shown: m.Snapshot | None = None

    @property
    def taken(self) -> bool:
        return bool(self.ring.control.taken)

    def send(self, command: object) -> None:
        do(self.state, command)

    def receive(self) -> list:
        """One look of the server, and what it would have sent."""
        self.ring.beat()
        self.state.watch()
        opened, shown, said = self.state.opened(), self.state.snapshot(), []
        if opened != self._opened:
            said.append(opened)
        if shown != self._shown:
            said.append(shown)
        self._opened, self._shown = opened, shown
        return [self.state.pulse(), *said]

    def ticks(self) -> np.ndarray:
        return self.ring.newest()

    def brakes_off(self, cause: str) -> None:
        self.ring.press_brakes_off(cause)

    def stop(self, reason: str) -> None:
        self.state.end(reason)
        self._lock.release()

    def leave(self) -> None:
        """As a server that is killed: nothing is brought to its end, and the system lets the locks go."""
        if self.state.storage.progress is not None:
            self.state.storage.progress.session.close()
        self._lock.release()


class LocalWindow(Window):
    """A window whose session server is in this process."""

    def __init__(self, setup: Setup, board: Bench | None = None) -> None:
        self._board = board
        super().__init__(setup)

    def join(self, setup: Setup) -> None:
        super().join(setup, lambda setup: LocalClient(setup, self._board))


@contextlib.contextmanager
def local_window(setup: Setup, board: Bench | None = None) -> Iterator[LocalWindow]:
    """A window with a session server in simulated time."""
    opened = LocalWindow(setup, board)
    try:
        yield opened
    finally:
        opened.client.stop("the test is over")
