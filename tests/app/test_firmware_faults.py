"""A trial over the board in C on an emulated Cortex-M4, and the worst that can come to it in a movement: how many ticks
until the currents are zero, that it is told and that nothing is lost; and a whole trial, byte for byte.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import simulated_bench
from fault_cases import Case, Place
from fault_kinds import HARD, LATE, SILENT, Fault
from firmware_board import Pipe, firmware_boards
from reference_board import on_a_cortex_m4

from app.emulated_operator import EmulatedOperator
from core import tick_log
from core.device import Device
from core.path import build_path
from experiments.plan import make_plan
from experiments.protocol import load_protocol
from experiments.recording import Sensors
from experiments.store import files
from experiments.store.session import Participant, Session
from experiments.trial.population import load_population
from experiments.trial.real_trial import RealTrial
from hardware.emulated_board.board import TICK_US, Board
from hardware.emulated_board.device import EmulatedDevice, hello_of
from hardware.serial_device import SerialDevice

BOARD_MS, AGAIN_S = 50, 2.0
NOISE = np.random.default_rng(30).bytes(50_000)
GARBAGE = [
    Fault("every frame damaged for 0.3 s", "corrupt=1+0.3", causes=(SILENT, LATE)),
    Fault("50 kB of noise at once", acts=lambda case: case.board.to_board.put(NOISE, case.board.now_s), board=False),
]
NAMES = ("unplug", "brown-out", "uncounted start", "stall 0.4 s", "loop killed", "bad encoder", "over-current")
FAULTS = [*(fault for fault in HARD if fault.name in NAMES), *GARBAGE]


@pytest.fixture(scope="module")
def running() -> Iterator[Pipe]:
    pipe = Pipe(on_a_cortex_m4())
    yield pipe
    pipe.close()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    made_there = Place.make(tmp_path_factory.mktemp("faults"))
    yield made_there
    made_there.session.close()


def in_a_movement(place: Place, fault: Fault, board: type[Board]) -> Case:
    """What comes of it over a board of this kind, until a trial could start again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated_bench, "Board", board)
        case = Case(place, fault, "move")
    case.use_again()
    return case


def without_number(words: str) -> str:
    """What is told, without the number of the trial."""
    return re.sub(r"Trial \d+", "Trial", words)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_the_currents_are_zero_in_time_and_as_soon_as_on_the_python_board(fault, place, running) -> None:
    case = in_a_movement(place, fault, firmware_boards(lambda: running))
    assert case.flowing and case.again_s <= AGAIN_S
    assert not fault.board or case.zero_ms <= BOARD_MS
    assert not fault.causes or any(cause.lower() in case.words.lower() for cause in fault.causes), case.words
    assert case.recording.rows == case.ticks > 0
    case.close()
    like = in_a_movement(place, fault, Board)
    assert (like.zero_ms, like.row.status, without_number(like.words)) == (
        case.zero_ms, case.row.status, without_number(case.words),
    )  # fmt: skip
    like.close()


class InStep:
    """The board's end and the wire: each read is one tick of the board, at which the commands of the last arrive."""

    name = "bench"

    def __init__(self, device: Device, operator: EmulatedOperator, tip: tuple[float, float], kind: type[Board]) -> None:
        self.hand, self._operator = operator.hand, operator
        self.board = kind(hello_of(device, "SIMULATED"))
        self.device = EmulatedDevice(device, self.board.hello, self, tip, seed=1)
        self._sent = b""
        self.ticks, self.not_taken, self.moves = 0, 0, False  # before the trial, operator and device stand
        self.read()  # kernels are compiled, or loaded, before a host waits for an answer

    def now(self) -> float:
        return TICK_US * 1e-6 * self.ticks

    def read(self) -> bytes:
        self.ticks += 1
        now_us, sent, self._sent = self.ticks * TICK_US, self._sent, b""
        out = self.board.receive(sent, now_us)
        out += self.board.tick(self.device.sense(self.board.currents, ()), now_us)
        if self.moves:
            self.device.advance(self.board.currents)
        return out

    def write(self, data: bytes) -> None:
        self._sent += data

    def close(self) -> None:
        pass

    def tick(self, x: float, y: float) -> None:
        """The hand, which waits for the trial."""
        if self.moves:
            self._operator.tick(x, y)


def one_trial(folder: Path, board: type[Board]) -> Path:
    """The first trial of a session over a board of this kind; the session's folder."""
    protocol, population = load_protocol(), load_population()
    person = population.draw(np.random.default_rng([protocol.seed, 1]))
    planned = make_plan(protocol, "1")[0]
    device, path = protocol.device(planned.configuration), build_path(protocol.paths[planned.path], "path")
    session = Session(folder, Participant("01", operator=person, population=population.operators), protocol, sync=False)
    operator = EmulatedOperator(person, path, (path.x0, path.y0), np.random.default_rng((protocol.seed, planned.run)))
    operator.go_on = lambda x, y: None
    bench = InStep(device, operator, (path.x0, path.y0), board)
    link = SerialDevice(device, bench.name, clock=bench.now, open_port=lambda name: bench)
    link.open()
    link.home((path.x0, path.y0))
    trial, writer = session.begin(planned, Sensors(link.encoders, link.force_channels))
    assert isinstance(trial, RealTrial)
    with writer:
        trial.connect(link)
        bench.device.sensors.draw_anew(1)  # the same noise however long it took to connect
        bench.moves = True
        while not trial.finished and bench.ticks < 120_000:
            phase = tick_log.PHASES.index(trial.phase)
            if phase != operator.phase:
                operator.enter(phase)
            writer.write(np.array(trial.exchange()).reshape(-1, tick_log.BENCH_WIDTH))
        session.finish(trial, writer)
    link.close()
    session.close()
    return session.folder


def differing(one: Path, other: Path) -> list[str]:
    """The files of recordings and table that are not the same in both sessions, byte for byte."""
    names = sorted(str(file.relative_to(one)) for file in [*(one / files.TRIALS).iterdir(), one / files.TABLE])
    there = sorted(str(file.relative_to(other)) for file in [*(other / files.TRIALS).iterdir(), other / files.TABLE])
    assert names == there
    return [name for name in names if (one / name).read_bytes() != (other / name).read_bytes()]


def test_a_whole_trial_leaves_the_same_bytes(tmp_path: Path, running: Pipe) -> None:
    sessions = [
        one_trial(tmp_path / kind, board)
        for kind, board in (("python", Board), ("firmware", firmware_boards(lambda: running)))
    ]
    assert differing(*sessions) == []
