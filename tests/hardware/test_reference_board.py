"""The board in C (hardware/firmware) does, step by step, what the Python board does in each scenario here: compiled for
this machine, and as Cortex-M4 machine code in an emulator. Of the Python board each scenario says what it must do.

A firmware author tests a board with the dialogues of docs/protocol-vectors.json: it must answer byte for byte.
"""

import functools
import itertools
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from reference_board import DIALOGUES, TARGETS, Program, RandomHost, RecordedBoard, hold, live_alike, recorded
from simulated_board import samples
from test_board_states import SEEN, happen, in_state
from test_wire_frames import noise_and_damage

from hardware.emulated_board.board import OVER_CURRENT_TICKS, SATURATED_TICKS, TICK_US
from hardware.wire.frames import encode_frame
from hardware.wire.messages import WATCHDOG_US, Bye, Fault, Flag, Heartbeat, Refusal, ResetFault, State


def dialogues() -> list[RecordedBoard]:
    return [hold(dialogue, RecordedBoard) for dialogue in DIALOGUES]


def each_event_in_each_state() -> list[RecordedBoard]:
    boards = []
    for state, event in SEEN:
        bench = in_state(state, event, RecordedBoard)
        happen(bench, event)
        bench.tick(3)
        boards.append(bench.board)
    return boards


def currents_are_zero_50_ms_after_the_last_command_whenever_it_came() -> list[RecordedBoard]:
    boards = []
    for phase_us in (0, 1, 500, 999):
        bench = recorded()
        bench.connect()
        bench.now_us += phase_us
        bench.command()
        came_us = bench.now_us
        bench.now_us -= phase_us
        for _ in range(60):
            bench.tick()
            flows, age_us = any(bench.board.currents), bench.now_us - came_us
            assert flows == (age_us <= WATCHDOG_US - TICK_US), f"{age_us} us"
            assert (bench.state == State.FAULT) == (not flows)
        boards.append(bench.board)
    return boards


def a_command_that_is_old_or_late_is_not_obeyed_and_yet_is_no_silence() -> list[RecordedBoard]:
    boards = []
    for late in (True, False):
        bench = recorded()
        bench.connect()
        bench.command(mode=0)
        bench.delay_us = 60_000 if late else 0
        for _ in range(30):  # 1.5 s
            bench.tick(50)
            bench.command(step=int(late))
        counts = bench.board.counts
        assert bench.state == State.READY and (counts.late if late else counts.old) == 30
        bench.tick(1100)
        assert bench.state == State.IDLE
        boards.append(bench.board)
    return boards


def only_a_fresh_command_feeds_the_watchdog() -> list[RecordedBoard]:
    boards = []
    for what in ("old", "late", "heartbeat"):
        bench = recorded()
        bench.connect()
        bench.command()
        bench.delay_us = 60_000 if what == "late" else 0
        for _ in range(60):
            if what == "heartbeat":
                bench.tell(Heartbeat(1))
            else:
                bench.command(step=int(what == "late"))
            bench.tick()
        assert bench.board.cause == Fault.WATCHDOG and not any(bench.board.currents)
        boards.append(bench.board)
    return boards


def a_moment_of_noise_is_no_fault() -> list[RecordedBoard]:
    bench = recorded()
    bench.connect()
    for _ in range(20):
        bench.tick(OVER_CURRENT_TICKS - 1, current_mA=(0, 0, 1250, 0))
        bench.tick(current_mA=(0, 0, 0, 0))
        bench.tick(SATURATED_TICKS - 1, force=(0, 0, 0, -66_700, 0, 0))
        bench.tick(force=(0,) * 6)
        bench.command(mode=0)
    assert bench.state == State.READY
    return [bench.board]


def samples_come_each_tick_from_limits_to_bye() -> list[RecordedBoard]:
    bench = recorded().start()
    assert bench.tick(10) == []
    bench.connect()
    got = samples(bench.tick(100))
    assert {(b.sequence - a.sequence, b.board_us - a.board_us) for a, b in itertools.pairwise(got)} == {(1, 1000)}
    assert len(got) == 100
    bench.tell(Bye())
    assert bench.tick(10) == []
    return [bench.board]


def a_tick_that_was_read_before_the_bytes_that_came_meanwhile_is_no_silence() -> list[RecordedBoard]:
    boards = []
    for mode, state in ((0, State.READY), (1, State.ACTIVE)):
        bench = recorded()
        bench.connect()
        for _ in range(3):
            bench.now_us += 1400
            bench.command(mode=mode)
            bench.now_us -= 1400
            bench.tick()
        assert bench.state == state
        boards.append(bench.board)
    return boards


def the_emergency_stop_is_told_and_latched_until_it_is_released() -> list[RecordedBoard]:
    boards = []
    for state in (State.IDLE, State.READY, State.ACTIVE, State.FAULT):
        bench = in_state(state, kind=RecordedBoard)
        cause = bench.board.cause or Fault.HOST_REQUEST
        said = samples(bench.tick(2, supply_cut=True))
        assert bench.state == State.FAULT and bench.board.cause == cause and not any(bench.board.currents)
        assert all(sample.flags & Flag.CUT for sample in said) and len(said) == 2 * (state != State.IDLE)
        assert bench.tell(ResetFault())[0].reason == Refusal.FAULT_STANDS
        bench.tick(supply_cut=False)
        assert bench.state == State.FAULT
        bench.tell(ResetFault())
        assert bench.state == State.IDLE
        boards.append(bench.board)
    return boards


def limits_on_either_side_of_zero() -> list[RecordedBoard]:
    """One less than what is too much is borne; then one more."""
    edges = [{"current_mA": (0, 0, most, 0)} for most in (1200, 1201, -1200, -1201, -(2**15))]
    edges += [{"force": (0, 0, most, 0, 0, 0)} for most in (66_699, 66_700, -66_699, -66_700, -(2**31))]
    edges += [{"turn": turn} for turn in (100, 101, -100, -101)]
    edges += [{"waited_us": waited} for waited in (60_000, 60_001)]  # 50 ms, and 1 ms for each of the ten seconds
    boards, ends = [], Counter()
    for edge in edges:
        bench = recorded()
        bench.connect(speed=(0, 0, 100_000, 0))
        bench.command(mode=0)
        if "waited_us" in edge:
            for _ in range(20):
                bench.now_us += 500_000
                bench.tell(Heartbeat(1))
            bench.delay_us = edge["waited_us"]
            bench.command()
        for k in range(12):
            turned = {"counts": (0, 0, edge["turn"] * k, 0)} if "turn" in edge else {}
            bench.tick(**turned, **{name: edge[name] for name in ("current_mA", "force") if name in edge})
        boards.append(bench.board)
        ends[bench.state, bench.board.cause] += 1
    assert ends == {
        (State.READY, Fault.NONE): 2 + 2 + 2 + 1, (State.ACTIVE, Fault.NONE): 1, (State.FAULT, Fault.OVER_CURRENT): 3,
        (State.FAULT, Fault.FORCE_SATURATED): 3, (State.FAULT, Fault.OVER_SPEED): 2,
    }  # fmt: skip
    return boards


def random_sessions() -> list[RecordedBoard]:
    boards = [RandomHost(seed).live(1200) for seed in range(10)]
    did = [one for board in boards for one in board.did]
    assert {pair for board in boards for pair in board.seen} == set(SEEN), "not every pair of the table was met"
    assert {one.cause for one in did} == {Fault.NONE, *Fault}, "not every fault came first once"
    assert sum(any(one.currents) for one in did) > 1000, "hardly any current flowed"
    for count in ("not_understood", "old", "late", "refused"):
        assert any(getattr(one, count) for one in did), count
    return boards


def noise_damaged_frames_and_true_ones_that_hold_anything() -> list[RecordedBoard]:
    """No damaged frame is taken for true."""
    each, rng = 100_000, np.random.default_rng(1)
    noise = noise_and_damage(rng, 1, each, each)
    true, size = [], 0
    while size < each:
        kind = int(rng.integers(1, 9))
        length = {1: 1, 2: 24, 3: 21, 4: 17, 6: 4}.get(kind, 0) if rng.random() < 0.7 else int(rng.integers(0, 124))
        true.append(encode_frame(bytes([kind]) + rng.bytes(length)))
        size += len(true[-1])
    stream = b"".join((noise, *true))
    bench = recorded().start()
    cuts = np.unique(rng.integers(0, len(stream), each // 100)).tolist()
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        bench.board.receive(stream[first:last], bench.now_us)
        bench.tick()
    assert bench.board.decoder.counts.good == len(true)
    assert {one.state for one in bench.board.did} >= {State.IDLE, State.READY, State.FAULT}
    return [bench.board]


SCENARIOS = (
    dialogues, each_event_in_each_state, currents_are_zero_50_ms_after_the_last_command_whenever_it_came,
    a_command_that_is_old_or_late_is_not_obeyed_and_yet_is_no_silence, only_a_fresh_command_feeds_the_watchdog,
    a_moment_of_noise_is_no_fault, samples_come_each_tick_from_limits_to_bye,
    a_tick_that_was_read_before_the_bytes_that_came_meanwhile_is_no_silence,
    the_emergency_stop_is_told_and_latched_until_it_is_released, limits_on_either_side_of_zero, random_sessions,
    noise_damaged_frames_and_true_ones_that_hold_anything,
)  # fmt: skip


@functools.cache
def boards_of(scenario: Callable[[], list[RecordedBoard]]) -> list[RecordedBoard]:
    """What the Python board lives through in a scenario, which also says what it must do."""
    return scenario()


@pytest.fixture(scope="module", params=["Python", *TARGETS])
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Program | None:
    return None if request.param == "Python" else TARGETS[request.param](tmp_path_factory.mktemp("board"))


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_the_board_in_c_does_what_the_python_board_does(program: Program | None, scenario) -> None:
    boards = boards_of(scenario)
    if program:
        live_alike(program, boards)
