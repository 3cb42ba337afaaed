"""Whatever ends the loop of a board, what it leaves behind is zero current. In simulated time; with real processes that
are killed in test_live_board.py."""

import io
import math
import os
import struct

import pytest
from fault_cases import Case, Place
from fault_kinds import START, Fault
from hypothesis import given, settings
from hypothesis import strategies as st
from real_bench import RealBench

from app.ipc.jobs import NotDone, Reset, RunTrial
from app.ipc.ring import Ring
from app.loop.loop import Loop
from core import tick_log
from hardware.emulated_board.board import FULL_BOARD
from hardware.emulated_board.device import HeldHand
from hardware.serial_device import clamped
from hardware.wire.messages import State

MOST_MA = (1000, 800, 0, 1000)
FOUR = st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=4, max_size=4)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory):
    made = Place.make(tmp_path_factory.mktemp("exits"))
    yield made
    made.session.close()


class Told(io.BytesIO):
    """The pipe to a session server, which breaks when `broken` is set."""

    broken = False

    def write(self, data) -> int:
        if self.broken:
            raise BrokenPipeError
        return super().write(data)


class Exit(Case):
    """A loop that lives until an error in the middle of a movement, while currents flow."""

    def __init__(self, place: Place, error: type[BaseException]) -> None:
        self.error = error
        super().__init__(place, Fault("error", acts=self.fail), "move")

    def fail(self, case: Case) -> None:
        assert all(self.board.board.currents)
        raise self.error("of some kind")

    def live(self) -> None:
        with pytest.raises(self.error, match="of some kind"):
            work(self.loop, self.running)

    def keep(self) -> None:
        self.run.recorder.close()
        self.bench.pass_time(2)


def work(loop: Loop, trial) -> None:
    """The loop's whole life: this trial, and then the end of its input."""
    loop.jobs.put(RunTrial(trial))
    loop.jobs.put(None)
    read, write = os.pipe()  # a session server that lives
    try:
        loop.work(open(read, "rb"))  # noqa: SIM115  (it goes with the thread that reads it)
    finally:
        os.close(write)


@pytest.mark.parametrize("error", [RuntimeError, MemoryError, KeyboardInterrupt, SystemExit])
def test_an_exception_in_the_middle_of_a_trial_ends_in_zero_current(error: type[BaseException], place: Place) -> None:
    case = Exit(place, error)
    assert case.board.board.currents == (0, 0, 0, 0)
    assert case.board.board.state == State.IDLE, "it said good-bye: no watchdog was needed"
    case.bench.link.close()


def test_a_session_server_that_is_gone_when_the_loop_reports_leaves_no_current(place: Place) -> None:
    bench = RealBench(hand=HeldHand(START), device=place.session.protocol.device("four-brake"))
    answers = Told()
    loop = Loop(Ring(width=tick_log.BENCH_WIDTH), "bench", answers)
    loop.device, answers.broken = bench.link, True
    read, write = os.pipe()  # a server that sends nothing
    with pytest.raises(BrokenPipeError):
        loop.work(open(read, "rb"))  # noqa: SIM115  (it goes with the thread that reads it)
    os.close(write)
    bench.pass_time(2)
    assert bench.board.board.state == State.IDLE and bench.board.board.currents == (0, 0, 0, 0)


def test_a_reset_that_finds_another_board_is_told_and_ends_nothing(place: Place) -> None:
    """Its sentence is for the experimenter; the loop goes on, without currents."""
    esc = Fault("Esc", acts=lambda case: case.ring.switch_off("Esc"))
    case = Case(place, esc, "approach")
    case.idle(lambda: bool(case.loop.sample and case.loop.sample.fault))
    case.board.board.hello = FULL_BOARD._replace(device=b"three-brake")
    case.answers.seek(0)
    case.answers.truncate()
    case.loop.do(Reset(case.ring.presses))
    case.answers.seek(0)
    told = case.answer()
    assert isinstance(told, NotDone) and "three-brake" in told.why
    assert case.ring.why_off, "the brakes stay off"
    case.bench.link.close()


@settings(max_examples=100)
@given(FOUR)
def test_no_current_leaves_the_host_that_is_not_a_number_from_zero_to_its_limit(asked: list[float]) -> None:
    sent, put_right = clamped(asked, MOST_MA)
    for current, milliamperes, most in zip(asked, sent, MOST_MA, strict=True):
        assert isinstance(milliamperes, int) and 0 <= milliamperes <= most
        assert milliamperes == (min(most, round(1000.0 * current)) if 0.0 < current < math.inf else 0)
        struct.pack("<H", milliamperes)
    right = all(0.0 <= c < math.inf and round(1000.0 * c) <= most for c, most in zip(asked, MOST_MA, strict=True))
    assert put_right == (not right)


def test_what_was_put_right_is_counted_in_the_recordings_record() -> None:
    link = RealBench(hand=HeldHand(START)).link
    before = link.report()["clamped"]
    link.exchange((math.nan, -1.0, 5.0, math.inf))
    assert link.report()["clamped"] == before + 1
    link.close()
