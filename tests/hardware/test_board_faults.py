"""What protects the person at the board: limits, watchdog, stale commands, faults that stay until they are reset."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_board import FULL, SimulatedBoard, samples

from hardware.emulated_board.board import FULL_BOARD, OVER_CURRENT_TICKS, SATURATED_TICKS, TICK_US, Age, Freshness
from hardware.wire.messages import WATCHDOG_US, Command, Fault, FaultReport, Flag, Refusal, Refused, ResetFault, State

ZERO = (0, 0, 0, 0)
u16 = st.integers(0, 65535)
four_currents = st.tuples(u16, u16, u16, u16)

#: fault -> readings that bring it about, how many ticks of them, detail
CONDITIONS = {
    Fault.OVER_CURRENT: ({"current_mA": (0, 0, 1250, 0)}, OVER_CURRENT_TICKS, 2),
    Fault.BAD_ENCODER: ({"encoder_good": (True, True, False, True)}, 1, 2),
    Fault.FORCE_SATURATED: ({"force": (0, 0, 0, -66_700, 0, 0)}, SATURATED_TICKS, 3),
}


@given(four_currents, four_currents, st.integers(0, 15))
def test_currents_never_exceed_the_limits_of_host_or_board(asked, limit, brakes: int) -> None:
    bench = SimulatedBoard(FULL_BOARD._replace(brakes=brakes, current_max_mA=(1000, 800, 600, 400)))
    in_force = bench.connect(current=limit).current_mA
    bench.command(*asked)
    for i in range(4):
        assert in_force[i] == min(limit[i], (1000, 800, 600, 400)[i])
        assert bench.board.currents[i] == (min(asked[i], in_force[i]) if brakes >> i & 1 else 0)
    flags = samples(bench.tick())[0].flags
    assert bool(flags & Flag.CLAMPED) == (bench.board.currents != asked)


def test_currents_are_zero_50_ms_after_the_last_command_and_not_before_49() -> None:
    bench = SimulatedBoard().activate()
    last = bench.now_us
    while bench.now_us - last < WATCHDOG_US - TICK_US:
        bench.tick()
        assert any(bench.board.currents)
    said = bench.tick()
    assert bench.now_us - last == WATCHDOG_US
    assert bench.board.currents == ZERO and bench.state == State.FAULT
    assert FaultReport(Fault.WATCHDOG, Fault.WATCHDOG, 255, bench.now_us) in said
    assert samples(said)[0].cause == Fault.WATCHDOG


@pytest.mark.parametrize("step", [0, -1, -(2**20)])
def test_commands_that_repeat_or_come_late_do_not_feed_the_watchdog(step: int) -> None:
    bench = SimulatedBoard()
    bench.connect()
    bench.sequence = 2**21
    bench.command(100, 100, 100, 100)
    for _ in range(60):
        bench.tell(Command(bench.sequence + step, bench.now_us, 1, FULL))
        assert bench.board.currents in ((100, 100, 100, 100), ZERO)
        bench.tick()
    assert bench.board.cause == Fault.WATCHDOG and bench.board.counts.old == 60


def test_a_command_that_waited_in_a_buffer_is_not_obeyed() -> None:
    bench = SimulatedBoard().activate()
    bench.tick(20)
    bench.delay_us = 60_000
    bench.command(900, 900, 900, 900)
    assert bench.board.currents == (500, 500, 500, 500) and bench.board.counts.late == 1
    assert samples(bench.tick())[0].flags & Flag.LATE
    assert not samples(bench.tick())[0].flags & Flag.LATE
    bench.command(mode=0)
    assert bench.state == State.READY, "Off is obeyed however late"


@pytest.mark.parametrize("interval_us", [999, 7001])
@pytest.mark.parametrize("drift", [-5e-4, 5e-4])
def test_clocks_that_drift_apart_do_not_make_commands_late(drift: float, interval_us: int) -> None:
    fresh = Freshness()
    for k in range(200_000_000 // interval_us):
        now_us = k * interval_us
        assert fresh.judge(k + 1, 10**6 + int(now_us * (1.0 + drift)), now_us) is Age.FRESH
        fresh.take(k + 1)
    assert abs(now_us * drift) > 90_000, "less than the limit drifted: shows nothing"
    assert fresh.judge(k + 2, 10**6 + int(now_us * (1.0 + drift)), now_us + 51_000) is Age.LATE


@pytest.mark.parametrize("fault", CONDITIONS, ids=lambda fault: fault.name)
@pytest.mark.parametrize("state", [State.READY, State.ACTIVE])
def test_each_condition_latches_with_its_cause_and_zero_currents(fault: Fault, state: State) -> None:
    readings, ticks, detail = CONDITIONS[fault]
    bench = SimulatedBoard()
    bench.connect()
    for _ in range(ticks - 1):
        if state == State.ACTIVE:
            bench.command()
        bench.tick(**readings)
    if state == State.ACTIVE:
        bench.command()
    assert bench.state == state, "too early"
    said = bench.tick(**readings)
    assert bench.state == State.FAULT and bench.board.currents == ZERO
    assert said[0] == FaultReport(fault, fault, detail, bench.now_us)
    assert (samples(said)[0].faults, samples(said)[0].cause) == (fault, fault)
    assert bench.tell(ResetFault()) == [Refused(5, Refusal.FAULT_STANDS)], "it still stands"
    bench.tick(current_mA=ZERO, encoder_good=(True,) * 4, force=(0,) * 6)
    assert (bench.state, bench.board.faults) == (State.FAULT, fault), "latched"
    bench.command()
    assert bench.board.currents == ZERO
    assert bench.tell(ResetFault())[0].faults == 0
    assert bench.state == State.IDLE


@pytest.mark.parametrize("fault", [Fault.OVER_CURRENT, Fault.FORCE_SATURATED], ids=lambda fault: fault.name)
def test_a_moment_of_noise_is_no_fault(fault: Fault) -> None:
    readings, ticks, _ = CONDITIONS[fault]
    bench = SimulatedBoard()
    bench.connect()
    for _ in range(20):
        bench.tick(ticks - 1, **readings)
        bench.tick(current_mA=ZERO, force=(0,) * 6)
        bench.command(mode=0)
    assert bench.state == State.READY


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(1, 30)), max_size=25))
def test_whatever_happens_currents_flow_only_while_active_and_commanded_within_50_ms(course) -> None:
    bench, last = SimulatedBoard(), None
    for what, ticks in course:
        if what == 0:
            bench.connect()
        elif what == 1:
            bench.tell(ResetFault())
        elif what == 2:
            bench.tick(encoder_good=(False, True, True, True))
            bench.tick(encoder_good=(True,) * 4)
        elif what == 3:
            bench.board.lose_power(bench.now_us)
        else:
            bench.command()
            last = bench.now_us
        for _ in range(ticks):
            bench.tick()
            flows = any(bench.board.currents)
            assert not flows or bench.state == State.ACTIVE
            assert not flows or (last is not None and bench.now_us - last < WATCHDOG_US)
