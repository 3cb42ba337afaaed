"""What protects the person at the board: limits, watchdog, stale commands, faults that stay until they are reset."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_board import SimulatedBoard, samples

from hardware.emulated_board.board import FULL_BOARD, Age, Freshness
from hardware.wire.messages import WATCHDOG_US, Flag, ResetFault, State

ZERO = (0, 0, 0, 0)
u16 = st.integers(0, 65535)
four_currents = st.tuples(u16, u16, u16, u16)


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
