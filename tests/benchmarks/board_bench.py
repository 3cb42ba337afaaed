"""`python -m tests.benchmarks.board_bench [TRIALS]`: a session on the simulated device and, tick for tick alike, behind
the board's protocol in simulated time.

Every trial is run twice with the same person and the same noise. The chain behind the board is the real one: device,
sensors, board, frames, link, filter, `Trial`. A difference is that of a pair; shown is the median of a configuration's
and controller's pairs.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from app.emulated_operator import EmulatedOperator
from core import tick_log
from core.device import Device
from core.path import build_path
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import Metrics, trial_metrics
from experiments.plan import PlannedTrial, make_plan
from experiments.protocol import Protocol, load_protocol
from experiments.recording import recording_of
from experiments.study.helpers import cores, process_pool
from experiments.trial.operator import Person
from experiments.trial.population import load_population
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions, SimulatedTrial, Trial
from hardware.emulated_board.board import TICK_US, Board
from hardware.emulated_board.device import EmulatedDevice, hello_of
from hardware.serial_device import SerialDevice

PARTICIPANT = 1
LONGEST_TICKS = 120_000
SHOWN = {
    "path_error_m": "path error", "mean_tip_force_N": "tip force", "acceleration_dft_sum": "DFT", "sparc": "SPARC",
    "duration_s": "duration",
}  # fmt: skip


class BoardInStep:
    """The board's end and the wire: each read is one tick of the board, at which the commands of the last arrive."""

    name = "bench"

    def __init__(
        self, device: Device, operator: EmulatedOperator, tip: tuple[float, float], board: type[Board] = Board
    ) -> None:
        self.hand, self._operator = operator.hand, operator
        self.board = board(hello_of(device, "SIMULATED"))
        self.device = EmulatedDevice(device, self.board.hello, self, tip, seed=1)
        self._sent = b""
        self.ticks = self.not_taken = 0
        self.moves = False  # before the trial, operator and device stand
        self.read()  # kernels are compiled, or loaded, before a host waits for an answer

    def begin(self) -> None:
        """The trial begins, with the same noise however long it took to connect."""
        self.device.sensors.draw_anew(1)
        self.moves = True

    def now(self) -> float:
        """The time here, s."""
        return TICK_US * 1e-6 * self.ticks

    def read(self) -> bytes:
        """A tick; what the board then says."""
        self.ticks += 1
        now_us, sent, self._sent = self.ticks * TICK_US, self._sent, b""
        out = self.board.receive(sent, now_us)
        out += self.board.tick(self.device.sense(self.board.currents, ()), now_us)
        if self.moves:
            self.device.advance(self.board.currents)
        return out

    def write(self, data: bytes) -> None:
        """What the board hears at its next tick."""
        self._sent += data

    def close(self) -> None:
        """Nothing to close."""

    def tick(self, x: float, y: float) -> None:
        """The hand, which waits for the trial."""
        if self.moves:
            self._operator.tick(x, y)

    def obey(self, order: dict) -> None:
        """Nobody gives orders here."""


class Setting(NamedTuple):
    """One trial of a plan with one person."""

    protocol: Protocol
    planned: PlannedTrial
    person: Person
    seed: tuple[int, ...]  # of the trial's noise

    @property
    def device(self) -> Device:
        return self.protocol.device(self.planned.configuration)

    def generator(self) -> np.random.Generator:
        """The same noise each time."""
        return np.random.default_rng(self.seed)

    @property
    def start(self) -> tuple[float, float]:
        """Where the handle is at first, m: at the start of the path, with a device that was never moved."""
        path = build_path(self.protocol.paths[self.planned.path], "path")
        return path.x0, path.y0

    def operator(self) -> EmulatedOperator:
        """The person's hand at the start, which goes by the phases of the trial alone."""
        path = build_path(self.protocol.paths[self.planned.path], "path")
        operator = EmulatedOperator(self.person, path, self.start, self.generator())
        operator.go_on = lambda x, y: None
        return operator

    @property
    def conditions(self) -> Conditions:
        protocol, planned = self.protocol, self.planned
        preset = protocol.controllers[int(planned.controller)]
        return Conditions(protocol.paths[planned.path], preset, protocol.rules, protocol.trial)


def settings(protocol: Protocol) -> list[Setting]:
    """The trials of one participant, in order."""
    person = load_population("average").draw(np.random.default_rng([protocol.seed, PARTICIPANT]))
    plan = make_plan(protocol, str(PARTICIPANT))
    return [Setting(protocol, planned, person, (protocol.seed, planned.run)) for planned in plan]


def exchanged(trial: RealTrial, operator: EmulatedOperator, ticks: Callable[[], int]) -> Iterator[list[np.ndarray]]:
    """The rows of each exchange of a trial with its device, the operator in step with its phases."""
    while not trial.finished and ticks() < LONGEST_TICKS:
        phase = tick_log.PHASES.index(trial.phase)
        if phase != operator.phase:
            operator.enter(phase)
        yield trial.exchange()


def on_the_simulated_device(setting: Setting) -> tuple[str, Metrics]:
    """How the trial ends there, and its measures."""
    device = SimulatedDevice(setting.device, setting.start)
    trial = SimulatedTrial(device, setting.planned, setting.conditions, setting.person, setting.generator())
    rows = np.empty((LONGEST_TICKS, tick_log.WIDTH))
    return measured(trial, rows[: trial.run(rows)])


def on_the_board(setting: Setting) -> tuple[str, Metrics]:
    """The same over the board."""
    operator = setting.operator()
    trial = RealTrial(setting.device, setting.planned, setting.conditions)
    bench = BoardInStep(setting.device, operator, setting.start)
    link = SerialDevice(setting.device, bench.name, clock=bench.now, open_port=lambda name: bench)
    link.open()
    link.home(setting.start)
    trial.connect(link)
    bench.begin()
    rows = [row for some in exchanged(trial, operator, lambda: bench.ticks) for row in some]
    link.close()
    return measured(trial, np.array(rows))


def measured(trial: Trial, rows: np.ndarray) -> tuple[str, Metrics]:
    """How a trial has ended, and the measures of its rows as a recording of them has."""
    return trial.outcome()["status"], trial_metrics(recording_of(rows, trial.device.braked), trial.path)


def compared(setting: Setting) -> tuple[tuple[str, int], list[float]]:
    """Configuration and controller of a trial, and the relative differences of the measures shown."""
    (_, here), (_, there) = on_the_simulated_device(setting), on_the_board(setting)
    pairs = [(here[name], there[name]) for name in SHOWN]
    planned = setting.planned
    key = planned.configuration, int(planned.controller)
    return key, [b / a - 1.0 if a and b is not None else np.nan for a, b in pairs]


def table(found: Sequence[tuple[tuple[str, int], list[float]]]) -> str:
    """The median of each measure's pairs, %."""
    groups = defaultdict(list)
    for key, differences in found:
        groups[key].append(differences)
    lines = [f"{len(found)} trials; board less simulated device, same person and noise: median of pairs, %", ""]
    lines += [" " * 22 + "".join(f"{title:>14}" for title in SHOWN.values())]
    for (name, controller), differences in sorted(groups.items()):
        medians = 100.0 * np.nanmedian(differences, axis=0)
        lines += [f"{f'{name}, {controller}':22}" + "".join(f"{one:>+14.1f}" for one in medians)]
    return "\n".join(lines)


if __name__ == "__main__":
    coming = settings(load_protocol(low_gain=5.0, sensing="ideal"))[: int(sys.argv[1]) if len(sys.argv) > 1 else 60]
    with process_pool(min(cores(), len(coming))) as pool:
        print(table(list(pool.map(compared, coming))))
