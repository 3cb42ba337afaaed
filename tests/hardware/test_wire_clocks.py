"""Clocks that do not just run on: a host's that stood still, a board's that went back."""

import numpy as np
import pytest
from real_bench import RealBench
from simulated_bench import WRAP_US

from core import tick_log
from hardware.emulated_board.line_faults import read_fault
from hardware.sensing.board_clock import ClockModel, FreshnessWatch
from hardware.wire.messages import Sample, State


class Stopping:
    """The host's clock of a bench, which can stand still while the board goes on."""

    def __init__(self, bench: RealBench) -> None:
        self.bench, self.stood_s = bench, 0.0
        bench.link.clock = bench.now = self

    def __call__(self) -> float:
        return self.bench.board.now_s - self.stood_s

    def stand_still(self, ticks: int) -> None:
        self.bench.pass_time(ticks)
        self.stood_s += 1e-3 * ticks


def sample(sequence: int, board_us: int, flags: int = 0, echo: int = 0) -> Sample:
    return Sample(sequence, echo, board_us, State.READY, flags, 0, 0, (), (), ())


@pytest.mark.parametrize("steps", [[400], [30, 30]])
def test_after_the_hosts_clock_stood_still_the_next_trial_has_its_currents(steps: list[int]) -> None:
    bench = RealBench()
    clock = Stopping(bench)
    bench.idle(1050)
    for ticks in steps:
        clock.stand_still(ticks)
        bench.idle(50)
    bench.until_back()
    assert bench.link.health.begun_anew == 1 and bench.link.report()["begun_anew"] == 1
    assert bench.board.last_current == 0, "nobody asked for current"
    first = bench.link.exchange((0.0,) * 4)
    assert first.homed and abs(first.t_s - clock()) < 0.01, "the new clock model knows nothing of the old one"
    trial = bench.trial(2)
    bench.run(trial, lambda trial: trial.phase == "move" and bench.board.last_current > 0)
    began = bench.board.ticks
    bench.run(trial, lambda trial: bench.board.ticks > began + 200)
    assert not trial.finished and bench.board.board.state == State.ACTIVE and bench.link.report()["late_commands"] == 0


def test_a_clock_that_stood_still_in_the_first_second_shows_by_commands_that_are_all_late() -> None:
    bench = RealBench()
    clock = Stopping(bench)
    bench.idle(300)
    clock.stand_still(400)
    bench.idle(300)
    assert bench.link.health.begun_anew == 0
    trial = bench.trial(2)
    bench.run(trial)
    assert trial.outcome()["status"] == "aborted" and "every command for late" in trial.outcome()["reason"]
    assert bench.board.last_current == 0
    bench.until_back()


@pytest.mark.parametrize("fault", ["delay=0.1@0+1", "jitter=0.04"])
def test_a_slow_way_is_no_clock_that_stood_still(fault: str) -> None:
    bench = RealBench()
    bench.idle(1050)
    bench.board.faults.append(read_fault(fault, bench.board.now_s))
    bench.idle(1500)
    assert bench.link.health.begun_anew == bench.link.health.lost_links == 0


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_drift_apart_stand_still_at_no_time(drift: float) -> None:
    watch = FreshnessWatch()
    generator = np.random.default_rng(1)
    for n in range(0, 2_000_000, 100):  # 2000 s
        assert not watch.doubt(sample(n, 1000 * n), 7.0 + 1e-3 * n * (1.0 + drift) + generator.exponential(2e-3))


def test_one_command_that_is_taken_in_now_and_then_is_no_reason_to_begin_anew() -> None:
    watch = FreshnessWatch()
    assert not any(watch.doubt(sample(n, 1000 * n, 32, n // 100), 1e-3 * n) for n in range(3000))
    assert any(watch.doubt(sample(n, 1000 * n, 32, 30), 1e-3 * n) for n in range(3000, 3300))


def test_board_time_that_goes_back_is_counted_and_the_clock_model_begins_anew() -> None:
    bench = RealBench(board_began_us=WRAP_US - 1_500_000)  # goes round in 1.5 s, as 32 bits of microseconds do
    bench.idle(800)
    assert bench.link.report()["board_time_back"] == 0
    trial = bench.trial()
    rows = bench.run(trial)
    assert trial.outcome()["status"] == "done" and np.any(np.diff(rows[:, tick_log.BOARD_US]) < 0)
    assert trial.outcome()["link"]["board_time_back"] == 1
    assert np.max(np.abs(rows[:, tick_log.LATENESS_US])) < 5000
    assert np.max(np.abs(np.diff(rows[:, tick_log.HOST_S]) - 1e-3)) < 2e-3
    assert np.max(np.abs(rows[:, [tick_log.TIP_VX, tick_log.TIP_VY]])) < 2.0


def test_a_clock_says_whether_the_board_had_power_all_the_time() -> None:
    """Whatever the two clocks show, however they drift apart, however long the way, the link or the board was."""
    generator, decided = np.random.default_rng(5), {True: 0, False: 0}
    for _ in range(300):
        model, zero_s, drift = ClockModel(), generator.uniform(-1e5, 1e5), generator.uniform(-1e-4, 1e-4)
        began_s = generator.choice([0.0, generator.uniform(0.0, 3e5)])  # by the board's clock, when it was first heard
        heard_s = generator.choice([0.3, 3.0, 60.0])
        times = began_s + np.sort(generator.uniform(0.0, heard_s, 50)) + 0.2
        for true_s in times:
            model.add(round(1e6 * true_s), zero_s + (1.0 + drift) * true_s + 5e-4 + generator.exponential(5e-3))
        away_s, went_on = generator.choice([0.15, 1.0, 30.0, 1e3]), bool(generator.random() < 0.5)
        now_s = times[-1] + away_s
        says_s = now_s if went_on else generator.uniform(0.1, max(0.11, away_s - 0.02))
        asked_s = zero_s + (1.0 + drift) * now_s - generator.choice([1e-3, 4e-3])
        assert model.went_on(round(1e6 * says_s), asked_s) == went_on, (began_s, heard_s, away_s, says_s)
        decided[went_on] += 1
    assert min(decided.values()) > 100


def test_currents_are_zero_in_doubt_before_anything_has_been_exchanged_again() -> None:
    bench = RealBench()
    bench.idle(50)
    trial = bench.trial(2)
    bench.run(trial, until=lambda trial: trial.phase == "move" and any(trial.currents))
    flowed = trial.currents
    bench.pass_time(40)
    assert trial.currents == flowed
    bench.pass_time(20)
    assert trial.currents == (0.0,) * 4 and not trial.finished


def test_nobody_who_listens_anew_after_a_while_takes_that_for_silence() -> None:
    bench = RealBench()
    bench.idle(100)
    for _ in range(400):
        bench.board.tick()  # nobody asks, and nobody keeps what comes
    bench.board.faults.append(read_fault("drop=1+0.003", bench.board.now_s))
    for _ in range(3):
        bench.link.exchange((0.0,) * 4)
    assert bench.link.exchange((0.0,) * 4) is not None and bench.link.health.lost_links == 0
