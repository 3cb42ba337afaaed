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
from protocols import PAPER, PEOPLE
from real_bench import Late, RealBench, drawn
from reference_board import on_a_cortex_m4

from core import tick_log
from experiments.recording import Sensors
from experiments.store import files
from experiments.store.session import Participant, Session
from experiments.trial.real_trial import RealTrial
from hardware.emulated_board.board import Board

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


def one_trial(folder: Path, board: type[Board]) -> Path:
    """A trial of a session over a board of this kind, with the same noise each time; the session's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated_bench, "Board", board)
        bench = RealBench()
    person, _ = drawn(3)
    session = Session(folder, Participant("01", operator=person, population=PEOPLE.operators), PAPER, sync=False)
    planned = next(one for one in session.plan if (one.configuration, one.path) == (bench.device.name, 1))
    trial, writer = session.begin(planned, Sensors(bench.link.encoders, bench.link.force_channels))
    assert isinstance(trial, RealTrial) and isinstance(bench.hand, Late)
    with writer:
        trial.connect(bench.link)
        bench.hand.begun = True
        while not trial.finished:
            writer.write(np.array(bench.exchange(trial)).reshape(-1, tick_log.BENCH_WIDTH))
        assert session.finish(trial, writer).status == "done"
    bench.link.close()
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
