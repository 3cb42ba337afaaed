"""A bench in simulated time on which a board is brought up by a scripted builder, perhaps with a mistake."""

import math
from functools import partial

from simulated_bench import TIP, Bench, reached

from core.tick_log import TICK_S
from experiments.bring_up.brakes_in_motion import HALF_S, LASTS_S, TIMES
from experiments.bring_up.bring_up import BringUp, Result
from experiments.bring_up.checks import in_turn
from experiments.bring_up.step import Step
from experiments.bring_up.steps import PATIENCE_S, steps_for
from hardware.emulated_board.builder import MISTAKES, PRESS_S, SPEED_M_S, BuilderHand, BuiltDevice, board_with
from hardware.emulated_board.device import hello_of
from hardware.serial_device import SerialDevice

HOME = (0.0, 0.40)
SHORT_S, LATENCY_S = 3.0, 1.0  # in place of a minute of the builder's, or of watching the latency
RESTS_S = 0.3


class TimedHand(BuilderHand):
    """A builder's hand that tells when it has obeyed its last order and the handle had time to come to rest."""

    def __init__(self, tip: tuple[float, float]) -> None:
        super().__init__(tip)
        self.at, self.needs_s = tip, 0.0

    @property
    def is_done(self) -> bool:
        return self.needs_s < 0.0

    def tick(self, x: float, y: float) -> None:
        super().tick(x, y)
        self.at = (x, y)
        self.needs_s -= TICK_S

    def obey(self, order: dict) -> None:
        super().obey(order)
        moves_s = math.dist(self.at, order["hold"]) / SPEED_M_S if "hold" in order else 0.0
        self.needs_s = max(moves_s + RESTS_S, PRESS_S)


class BuiltBench(Bench):
    """A `Bench` with a builder's hand."""

    def __init__(self, device, mistake: str = "") -> None:
        self.clock = MISTAKES[mistake].clock if mistake else 1.0
        hand = TimedHand(TIP)
        super().__init__(device, hand)
        self.board = board_with(hello_of(device, "TEST"), mistake)
        self.device = BuiltDevice(device, self.board.hello, hand, TIP, mistake)
        if mistake and MISTAKES[mistake].line:
            self.fault(MISTAKES[mistake].line)

    @property
    def now_s(self) -> float:
        return 100.0 + 1e-3 * self.ticks / self.clock


class ScriptedBuilder:
    """Does what is asked, unless it is told not to."""

    def __init__(self, hand: TimedHand, idle: str = "") -> None:
        self.hand, self.idle = hand, idle  # name of a step at which nothing is done
        self.results: list[Result] = []

    def ask(self, step: Step) -> None:
        if step.order and step.name != self.idle:
            self.hand.obey(step.order)

    def is_ready(self) -> bool:
        return self.hand.is_done

    def show(self, result: Result) -> None:
        self.results.append(result)


def shortened(steps: list[Step], rounds: int = 1) -> list[Step]:
    """The steps without a minute's patience, each brake in motion so many times on and off."""
    shorter = {
        PATIENCE_S: {"lasts_s": SHORT_S},
        LASTS_S: {"lasts_s": rounds * LASTS_S / TIMES, "drive": partial(in_turn, on_s=HALF_S, times=rounds)},
    }
    return [step._replace(**shorter.get(step.lasts_s, {})) for step in steps]


class Bringing:
    """One bring-up."""

    def __init__(self, device, mistake: str = "", idle: str = "", rounds: int = 1) -> None:
        self.bench = BuiltBench(device, mistake)
        self.link: SerialDevice = reached(self.bench, device)
        self.builder = ScriptedBuilder(self.bench.hand, idle)
        self.steps = steps_for(device, self.link.encoders, self.link.force_channels > 0, HOME, LATENCY_S)
        self.steps = shortened(self.steps, rounds)
        self.runner = BringUp(self.link, self.builder, self.fall_silent)

    def runner_steps(self, names: tuple[str, ...]) -> list[Step]:
        """The steps of these names alone, which need no other."""
        kept = [step for step in self.steps if step.name in names]
        return [step._replace(needs=tuple(name for name in step.needs if name in names)) for step in kept]

    def fall_silent(self, seconds: float) -> None:
        for _ in range(round(1e3 * seconds)):
            self.bench.backlog += self.bench.tick()

    def run(self) -> list[Result]:
        try:
            for _ in self.runner.run(self.steps):
                pass
            return self.runner.results
        finally:
            self.link.close()
