"""A trial on a board in simulated time: device, hand, wires, link and trial in one process, tick by tick."""

import time
from collections.abc import Callable

import numpy as np
from protocols import PAPER, PEOPLE
from simulated_bench import TIP, Bench, BenchWire, TcpWire

from app.emulated_operator import EmulatedOperator
from core import tick_log
from core.control.controllers import Preset
from core.device import Device, load_device
from core.path import build_path
from core.simulator.hand import Hand
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules
from experiments.trial.operator import Person
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions
from hardware.emulated_board.board import Board
from hardware.emulated_board.device import EmulatedHand
from hardware.serial_device import SerialDevice

PATH = PAPER.paths[1]
LONGEST_TICKS = 60_000


class Late:
    """A hand that does nothing until it may."""

    def __init__(self, hand: EmulatedOperator) -> None:
        self.inner, self.begun = hand, False
        self.hand: Hand = hand.hand

    def tick(self, x: float, y: float) -> None:
        if self.begun:
            self.inner.tick(x, y)

    def obey(self, order: dict) -> None:
        self.inner.obey(order)


def drawn(seed: int) -> tuple[Person, np.random.Generator]:
    """A person, and what makes the noise of one trial."""
    return PEOPLE.draw(np.random.default_rng(seed)), np.random.default_rng([seed, 7])


class RealBench:
    """A board with an operator at the handle, or another hand, and the link to it."""

    def __init__(
        self, device: str | Device = "four-brake", seed: int = 3, hand: EmulatedHand | None = None,
        board_began_us: int = 0, wire: type[BenchWire | TcpWire] = BenchWire, board: type[Board] = Board,
    ) -> None:  # fmt: skip
        self.device = load_device(device) if isinstance(device, str) else device
        self.operator: EmulatedOperator | None = None
        if hand is None:
            person, generator = drawn(seed)
            self.operator = EmulatedOperator(person, build_path(PATH, "path"), TIP, generator)
            self.operator.go_on = lambda x, y: None  # it goes by the phases of the trial alone
            hand = Late(self.operator)
        self.board = Bench(self.device, hand, board_began_us, board)
        self.hand, self._wire = hand, wire
        self.link = SerialDevice(self.device, "bench", clock=self.now, open_port=self.open_port)
        self.link.open()
        self.link.home(self.board.device.tip)

    def open_port(self, name: str) -> BenchWire | TcpWire:
        return self._wire(self.board, name)

    def now(self) -> float:
        return self.board.now_s

    def trial(
        self, controller: int = 2, how: TrialRules = PAPER.trial, preset: Preset | None = None, rules: str = PAPER.rules
    ) -> RealTrial:
        planned = PlannedTrial(1, 1, self.device.name, controller, 1, 1)
        if isinstance(self.hand, Late):
            self.hand.begun = True
        preset = preset or PAPER.controllers[controller]
        trial = RealTrial(self.device, planned, Conditions(PATH, preset, rules, how))
        trial.connect(self.link)
        return trial

    def exchange(self, trial: RealTrial) -> list[np.ndarray]:
        """One exchange of a trial; time goes on where there is no link, too."""
        before = self.board.ticks
        if self.operator is not None:
            phase = tick_log.PHASES.index(trial.phase)
            if phase != self.operator.phase:
                self.operator.enter(phase)
        made = trial.exchange()
        if self.board.ticks == before:
            self.pass_time(4)
        return made

    def pass_time(self, ticks: int) -> None:
        """The host is late: what the board says waits."""
        with self.board.lock:
            for _ in range(ticks):
                self.board.backlog += self.board.tick()

    def run(self, trial: RealTrial, until: Callable[[RealTrial], bool] = lambda trial: trial.finished) -> np.ndarray:
        """Exchange until something is so; the rows (n, BENCH_WIDTH)."""
        rows: list[np.ndarray] = []
        while not until(trial):
            assert self.board.ticks < LONGEST_TICKS and not (trial.finished and len(rows) == 0), trial.outcome()
            rows += self.exchange(trial)
        return np.array(rows).reshape(-1, tick_log.BENCH_WIDTH)

    def idle(self, ticks: int) -> None:
        """What the loop does between trials."""
        for _ in range(ticks):
            self.link.exchange((0.0,) * 4)
            self.link.samples()

    def until_back(self, patience_s: float = 60.0) -> float:
        """Exchange zeros until samples come again; s of real time that it took (a thread looks for the board)."""
        began = time.perf_counter()
        while self.link.exchange((0.0,) * 4) is None:
            assert time.perf_counter() - began < patience_s, self.link.problem
            if self.link.problem:
                self.pass_time(4)
        return time.perf_counter() - began
