"""Trials on the simulated device and, tick for tick alike, behind the board's protocol in simulated time.

The chain is the real one: device, sensors, board, frames, link, filter, `Trial`. What a real board cannot do
without (encoder steps, a velocity from positions, a tick on the wire, noise) is switched on one by one, so that a
difference can be told apart by its cause. No wall clock: a trial takes as long as the machine needs.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from msgspec.structs import asdict

from app.emulated_operator import EmulatedOperator
from core import tick_log
from core.control.controllers import Preset
from core.device import Device
from core.device_file import Encoders, Sensing
from core.path import build_path
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import Metrics, trial_metrics
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol
from experiments.recording import recording_of
from experiments.trial.operator import Person
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions, SimulatedTrial, Trial
from hardware.emulated_board.board import TICK_US, Board
from hardware.emulated_board.device import EmulatedDevice, hello_of
from hardware.sensing.samples import WINDOW, MotionFilter, Vector, sensing_of
from hardware.serial_device import SerialDevice

LONGEST_TICKS = 120_000
FINE = 1000  # encoders without steps have so many times the counts


class Effects(NamedTuple):
    """What separates a board from the simulated device."""

    counts: float = FINE  # per revolution, times the device file's; 1: its own steps
    window: int = 0  # ms of positions that make the velocity; 0: the simulated device's own
    late: int = 0  # ticks after the one that decided them at which currents act: 1 by USB, 2 by a UART
    noise: bool = False  # of force sensor and amplifiers

    def title(self) -> str:
        """In words."""
        parts = [
            "" if self.counts >= FINE else "steps",
            f"filter of {self.window} ms" if self.window else "",
            ("", "delay", "delay of 2 ticks")[self.late],
            "noise" * self.noise,
        ]
        return " + ".join(filter(None, parts)) or "the wire alone"


ALL = Effects(1, WINDOW, 1, True)
#: ms, of a filter that is much quicker than the product's: more noise, less lag
SHORT = 3
#: one by one, and those that work upon each other together
CASES = (
    Effects(), Effects(late=1), Effects(noise=True), Effects(1), Effects(window=WINDOW), Effects(1, WINDOW),
    Effects(window=SHORT), Effects(1, SHORT), ALL,
)  # fmt: skip


class TrueMotion:
    """In place of the filter: the device's own velocity and acceleration."""

    def __init__(self, device: EmulatedDevice) -> None:
        self._device = device

    def add(self, t_s: float, x: float, y: float) -> tuple[Vector, Vector]:
        """As `MotionFilter.add`."""
        motion, acceleration = self._device.motion, self._device.acceleration
        return (float(motion[2]), float(motion[3])), (float(acceleration[0]), float(acceleration[1]))


class QuickMotion:
    """The product's filter with a shorter window for the velocity; the acceleration stays the 15 ms one."""

    def __init__(self, window: int) -> None:
        self._velocity, self._acceleration = MotionFilter(window), MotionFilter()

    def add(self, t_s: float, x: float, y: float) -> tuple[Vector, Vector]:
        """As `MotionFilter.add`."""
        return self._velocity.add(t_s, x, y)[0], self._acceleration.add(t_s, x, y)[1]


class BoardInStep:
    """The board's end and the wire: each read is one tick of the board."""

    name = "bench"

    def __init__(
        self, device: Device, operator: EmulatedOperator, tip: tuple[float, float], how: Effects,
        board: type[Board] = Board,
    ) -> None:  # fmt: skip
        self.hand, self._operator = operator.hand, operator
        self.board = board(hello_of(device, "SIMULATED"))
        self.device = EmulatedDevice(device, self.board.hello, self, tip, seed=1)
        if not how.noise:
            self.device.sensors.noise[:] = 0.0
        self._late = how.late
        self._sent = self._on_its_way = b""
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
        if self._late > 1:
            sent, self._on_its_way = self._on_its_way, sent
        out = self.board.receive(sent, now_us)
        if self.moves and not self._late:
            self.device.advance(self.board.currents)
        out += self.board.tick(self.device.sense(self.board.currents, ()), now_us)
        if self.moves and self._late:
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
    device: Device
    planned: PlannedTrial
    person: Person
    seed: tuple[int, ...]  # of the trial's noise

    def generator(self) -> np.random.Generator:
        """The same noise each time."""
        return np.random.default_rng(self.seed)

    @property
    def start(self) -> tuple[float, float]:
        """Where the handle is at first, m: at the start of the path, with a device that was never moved."""
        path = build_path(self.protocol.paths[self.planned.segment], "path")
        return path.x0, path.y0

    def operator(self) -> EmulatedOperator:
        """The person's hand at the start, which goes by the phases of the trial alone."""
        path = build_path(self.protocol.paths[self.planned.segment], "path")
        operator = EmulatedOperator(self.person, path, self.start, self.generator())
        operator.go_on = lambda x, y: None
        return operator

    @property
    def preset(self) -> Preset:
        """Its controller."""
        return self.protocol.controllers[int(self.planned.controller)]


def exchanged(trial: RealTrial, operator: EmulatedOperator, ticks: Callable[[], int]) -> Iterator[list[np.ndarray]]:
    """The rows of each exchange of a trial with its device, the operator in step with its phases."""
    while not trial.finished and ticks() < LONGEST_TICKS:
        phase = tick_log.PHASES.index(trial.phase)
        if phase != operator.phase:
            operator.enter(phase)
        yield trial.exchange()


def on_the_simulated_device(setting: Setting) -> tuple[str, Metrics]:
    """How the trial ends there, and its measures."""
    protocol, planned = setting.protocol, setting.planned
    trial = SimulatedTrial(
        SimulatedDevice(setting.device, setting.start),
        planned,
        Conditions(protocol.paths[planned.segment], setting.preset, protocol.rules, protocol.trial),
        setting.person,
        setting.generator(),
    )
    rows = np.empty((LONGEST_TICKS, tick_log.WIDTH))
    return measured(trial, rows[: trial.run(rows)])


def on_the_board(setting: Setting, how: Effects) -> tuple[str, Metrics]:
    """The same over the board."""
    protocol, planned = setting.protocol, setting.planned
    device = with_counts(setting.device, how.counts)
    path_file, operator = protocol.paths[planned.segment], setting.operator()
    trial = RealTrial(device, planned, Conditions(path_file, setting.preset, protocol.rules, protocol.trial))
    bench = BoardInStep(device, operator, setting.start, how)
    link = SerialDevice(device, bench.name, clock=bench.now, open_port=lambda name: bench)
    link.open()
    link.home(setting.start)
    assert link.sensing is not None
    if how.window != WINDOW:
        link.sensing.motion = QuickMotion(how.window) if how.window else TrueMotion(bench.device)
    trial.connect(link)
    bench.begin()
    rows = [row for some in exchanged(trial, operator, lambda: bench.ticks) for row in some]
    link.close()
    return measured(trial, np.array(rows))


def with_counts(device: Device, times: float) -> Device:
    """The device with so many times the encoder counts."""
    encoders, force = sensing_of(device)
    counts = {joint: n and round(times * n) for joint, n in asdict(encoders).items()}
    return replace(device, sensing=Sensing(encoders=Encoders(**counts), force=force))


def measured(trial: Trial, rows: np.ndarray) -> tuple[str, Metrics]:
    """How a trial has ended, and the measures of its rows as a recording of them has."""
    return trial.outcome()["status"], trial_metrics(recording_of(rows, trial.device.braked), trial.path)
