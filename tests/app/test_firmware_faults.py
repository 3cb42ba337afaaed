"""A trial over the board in C on an emulated Cortex-M4, and the worst that can come to it in a movement: how many ticks
until the currents are zero, that it is told and that nothing is lost; and a few whole trials, byte for byte.

As a script it prints the ticks, on the whole image with --image. The 60 trials of the paper's session:
`python -m tests.benchmarks.firmware_session`.
"""

import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import simulated_bench
from fault_cases import Case, Place
from fault_kinds import HARD, LATE, SILENT, Fault
from firmware_board import Image, Pipe, firmware_boards
from reference_board import made, on_a_cortex_m4

from hardware.emulated_board.board import Board
from tests.benchmarks.firmware_session import differing, run_session

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


def test_whole_trials_leave_the_same_bytes(tmp_path: Path, running: Pipe) -> None:
    sessions = [
        run_session(tmp_path / kind, board, 2)
        for kind, board in (("python", Board), ("firmware", firmware_boards(lambda: running)))
    ]
    assert differing(*sessions) == []


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        processor = Image(made("plant-f405.elf")) if "--image" in sys.argv else Pipe(on_a_cortex_m4())
        there = Place.make(folder)
        for fault in FAULTS:
            case = in_a_movement(there, fault, firmware_boards(lambda: processor))
            ticks, words = case.zero_ms if fault.board else "-", case.words.partition(": ")[2]
            print(f"| {fault.name} | {ticks} | {words or 'nothing: it goes on'} |", flush=True)
            case.close()
        there.session.close()
        processor.close()
