"""The board in C (hardware/firmware) does, step by step, what the Python board does: compiled for this machine, and as
Cortex-M4 machine code in an emulator.

Skipped where compiler or emulator are missing.
"""

from collections import Counter

import numpy as np
import pytest
import simulated_board
from reference_board import TARGETS, Program, RandomHost, RecordedBoard, live_alike, recorded
from simulated_board import samples
from test_board_states import SEEN, happen, in_state
from test_wire_frames import noise_and_damage

from hardware.emulated_board.board import TICK_US
from hardware.wire.frames import encode_frame
from hardware.wire.messages import WATCHDOG_US, Fault, Flag, Heartbeat, Refusal, ResetFault, State


@pytest.fixture(scope="module", params=TARGETS)
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Program:
    return TARGETS[request.param](tmp_path_factory.mktemp("board"))


def test_each_event_in_each_state_does_the_same(program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated_board, "Board", RecordedBoard)
    boards = []
    for state, event in SEEN:
        bench = in_state(state, event)
        bench.board.seen.clear()
        happen(bench, event)
        assert (state, event) in bench.board.seen
        bench.tick(3)
        boards.append(bench.board)
    live_alike(program, boards)


@pytest.mark.parametrize("phase_us", [0, 1, 500, 999])
def test_currents_are_zero_50_ms_after_the_last_command_whenever_it_came(program: Program, phase_us: int) -> None:
    bench = recorded()
    bench.connect()
    bench.now_us += phase_us
    bench.command()
    came_us = bench.now_us
    bench.now_us -= phase_us
    begin = len(bench.board.script)
    bench.tick(60)
    for k, did in enumerate(live_alike(program, [bench.board])[begin:]):
        age_us = bench.now_us - (59 - k) * TICK_US - came_us
        assert any(did.currents) == (age_us <= WATCHDOG_US - TICK_US), f"{age_us} us"
        assert (did.state == State.FAULT) == (not any(did.currents))


@pytest.mark.parametrize("late", [True, False])
def test_a_command_that_is_old_or_late_is_not_obeyed_and_yet_is_no_silence(program: Program, late: bool) -> None:
    bench = recorded()
    bench.connect()
    bench.command(mode=0)
    bench.delay_us = 60_000 if late else 0
    for _ in range(30):  # 1.5 s
        bench.tick(50)
        bench.command(step=int(late))
    did = live_alike(program, [bench.board])[-1]
    assert did.state == State.READY and (did.late if late else did.old) == 30
    bench.tick(1100)
    assert live_alike(program, [bench.board])[-1].state == State.IDLE


@pytest.mark.parametrize("mode", [0, 1])
def test_a_tick_that_was_read_before_the_bytes_that_came_meanwhile_is_no_silence(program: Program, mode: int) -> None:
    bench = recorded()
    bench.connect()
    for _ in range(3):
        bench.now_us += 1400
        bench.command(mode=mode)
        bench.now_us -= 1400
        bench.tick()
    assert live_alike(program, [bench.board])[-1].state == (State.ACTIVE if mode else State.READY)


@pytest.mark.parametrize("state", [State.IDLE, State.READY, State.ACTIVE, State.FAULT])
def test_the_emergency_stop_is_told_and_latched_until_it_is_released(program: Program, state: State) -> None:
    bench = recorded()
    bench.start()
    if state != State.IDLE:
        bench.connect()
    if state in (State.ACTIVE, State.FAULT):
        bench.command()
    if state == State.FAULT:
        bench.tick(60)
    assert bench.state == state
    cause = bench.board.cause or Fault.HOST_REQUEST
    said = samples(bench.tick(2, supply_cut=True))
    assert bench.state == State.FAULT and bench.board.cause == cause and not any(bench.board.currents)
    assert all(sample.flags & Flag.CUT for sample in said) and len(said) == 2 * (state != State.IDLE)
    assert bench.tell(ResetFault())[0].reason == Refusal.FAULT_STANDS
    bench.tick(supply_cut=False)
    assert bench.state == State.FAULT
    bench.tell(ResetFault())
    assert bench.state == State.IDLE
    live_alike(program, [bench.board])


def test_every_limit_lies_where_it_lies_in_python(program: Program) -> None:
    """One less than what is too much is borne, on either side of zero; then one more."""
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
    live_alike(program, boards)
    assert ends == {
        (State.READY, Fault.NONE): 2 + 2 + 2 + 1, (State.ACTIVE, Fault.NONE): 1, (State.FAULT, Fault.OVER_CURRENT): 3,
        (State.FAULT, Fault.FORCE_SATURATED): 3, (State.FAULT, Fault.OVER_SPEED): 2,
    }  # fmt: skip


def test_random_sessions_give_the_same_bytes_states_and_currents(program: Program) -> None:
    boards = [RandomHost(seed).live(1500) for seed in range(16)]
    did = live_alike(program, boards)
    seen: Counter = Counter()
    for board in boards:
        seen.update(board.seen)
    assert set(seen) == set(SEEN), "not every pair of the table was met"
    assert {one.cause for one in did} == {Fault.NONE, *Fault}, "not every fault came first once"
    assert sum(any(one.currents) for one in did) > 1000, "hardly any current flowed"
    for count in ("not_understood", "old", "late", "refused"):
        assert any(getattr(one, count) for one in did), count


def fuzzed(n: int, seed: int) -> tuple[RecordedBoard, int]:
    """A board that met n bytes: noise, damaged frames, and true frames that hold anything; how many were true."""
    rng = np.random.default_rng(seed)
    noise = noise_and_damage(rng, seed, n // 3, n // 3)
    true, size = [], 0
    while size < n // 3:
        kind = int(rng.integers(1, 9))
        length = {1: 1, 2: 24, 3: 21, 4: 17, 6: 4}.get(kind, 0) if rng.random() < 0.7 else int(rng.integers(0, 124))
        true.append(encode_frame(bytes([kind]) + rng.bytes(length)))
        size += len(true[-1])
    stream = b"".join((noise, *true))
    bench = recorded().start()
    cuts = np.unique(rng.integers(0, len(stream), n // 300)).tolist()
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        bench.board.receive(stream[first:last], bench.now_us)
        bench.tick()
    return bench.board, len(true)


def test_a_million_bytes_break_nothing_and_no_damaged_frame_is_taken_for_true(program: Program) -> None:
    board, true = fuzzed(1_000_000, 1)
    did = live_alike(program, [board])
    assert board.decoder.counts.good == true
    assert {one.state for one in did} >= {State.IDLE, State.READY, State.FAULT}
