"""What ends a trial on the bench for the sake of hand or device: limits, silence, and the release of a trapped hand."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from msgspec.structs import replace
from protocols import PAPER
from real_bench import PATH, RealBench
from simulated_bench import TIP

from core import tick_log
from core.control import algorithm
from core.control.controllers import Preset
from core.device import load_device
from core.device_interface import DeviceSample
from core.records import new_record
from core.simulator.state import pack_brakes
from experiments.protocol_file import Release
from experiments.trial.tick import DISOBEYED_TICKS, RUN, SPEED_MAX_M_S, disobeys
from hardware.emulated_board.device import HeldHand

CURRENTS = slice(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture
def held() -> Iterator[RealBench]:
    """A hand on a spring at the handle, which is held at the start of the path."""
    bench = RealBench(hand=HeldHand(TIP))
    bench.hand.obey({"target": list(PATH.start_m)})
    yield bench
    bench.link.close()


def locked(bench: RealBench, **release) -> tuple:
    """A trial in `move` whose controller locks everything when pushed back; and the rules that it has."""
    how = replace(PAPER.trial, hold_s=0.05, start_radius_m=0.02, release=Release(**release))
    trial = bench.trial(5, how, Preset("locks", "proportional", (0.0, 5.0)), "literal")
    bench.run(trial, lambda trial: trial.phase == "move")
    bench.hand.obey({"target": [PATH.start_m[0] - 0.3, PATH.start_m[1] + 0.3]})
    return trial, how


@pytest.mark.parametrize(("force", "seconds"), [(15.0, 0.5), (30.0, 1.0)])
def test_a_hand_that_pushes_hard_against_a_full_lock_is_let_go(held: RealBench, force: float, seconds: float) -> None:
    trial, _ = locked(held, force_N=force, time_s=seconds)
    rows = held.run(trial)
    outcome = trial.outcome()
    assert outcome["status"] == "aborted" and "the brakes let go" in outcome["reason"]
    assert f"{force:g} N for {seconds:g} s" in outcome["reason"]
    moving = rows[rows[:, tick_log.PHASE] == tick_log.MOVE]
    full = (moving[:, CURRENTS] >= 1.0).all(axis=1)
    hard = np.hypot(moving[:, tick_log.HAND_FX], moving[:, tick_log.HAND_FY]) >= force
    assert 1e3 * seconds - 5 <= np.count_nonzero(full & hard) <= 2e3 * seconds, "neither early nor late"
    assert not any(held.board.board.currents)


def test_without_a_release_or_below_its_force_a_lock_holds(held: RealBench) -> None:
    trial, _ = locked(held, force_N=60.0, time_s=0.2)
    rows = held.run(trial, lambda trial: trial.finished or trial.ticks > 3000)
    assert not trial.finished and (rows[-500:, CURRENTS] >= 1.0).all()
    assert np.isin(rows[-500:, tick_log.DECISION], list(algorithm.LOCKED)).all()


class Told:
    """A link that says what the test wants."""

    encoders, force_channels, problem = "AB", 6, ""

    def __init__(self, device) -> None:
        self.device, self.asked, self.next, self.now = device, [], None, 0.0

    def exchange(self, currents):
        self.asked.append(tuple(currents))
        self.now += 1e-3
        return self.next

    def samples(self):
        return [self.next] if self.next else []

    def clock(self):
        return self.now

    def begin(self):
        pass

    def end_record(self):
        return {}


def sample(
    n: int, tip=PATH.start_m, velocity=(0.0, 0.0), force=(0.0, 0.0), current=(0.0,) * 4, **other
) -> DeviceSample:
    return DeviceSample(
        1e-3 * n, 1000 * n, n, 0, (0, 0), (0,) * 6, (0.0,) * 4, tip, velocity, (0.0, 0.0), force, current,
        **{"closed": True, "homed": True, "fault": ""} | other,
    )  # fmt: skip


def told_trial(held: RealBench) -> tuple:
    """A trial in `move` on a link that says what the test wants."""
    link = Told(held.device)
    trial = held.trial(2, replace(PAPER.trial, hold_s=0.01))
    trial.connect(link)
    n = 0
    while trial.phase != "move":
        n += 1
        link.next = sample(n)
        trial.exchange()
    return trial, link, n


@pytest.mark.parametrize(
    ("says", "reason"),
    [
        ({"velocity": (SPEED_MAX_M_S * 1.01, 0.0)}, "faster than"),
        ({"tip": (0.55, 0.2)}, "the device file says it cannot be"),
        ({"homed": False}, "have not been homed"),
        ({"fault": "a joint turned faster than its limit"}, "a joint turned faster"),
        ({"tip": (math.nan, math.nan)}, "match no position"),
        ({"force": (math.nan, 0.0)}, "not finite"),
    ],
)
def test_what_must_not_be_ends_the_trial_and_the_currents_at_that_sample(
    held: RealBench, says: dict, reason: str
) -> None:
    trial, link, n = told_trial(held)
    link.next = sample(n + 1, tip=(-0.08, 0.41), velocity=(0.1, 0.0), force=(4.0, 1.0))
    trial.exchange()
    assert any(trial.currents), "the brakes have something to let go of"
    link.next = sample(n + 2, **{"tip": (-0.08, 0.41), "force": (4.0, 1.0)} | says)
    trial.exchange()
    assert not any(trial.currents) and trial.phase == "end"
    link.next = sample(n + 3)
    trial.exchange()
    assert link.asked[-1] == (0.0,) * 4
    outcome = trial.outcome()
    assert outcome["status"] == "aborted" and reason in outcome["reason"]


@pytest.mark.parametrize("measured", [1e6, math.inf, math.nan, -1.0])
def test_a_measured_current_that_no_brake_can_have_gives_no_torque_that_none_can_have(
    held: RealBench, measured: float
) -> None:
    trial, link, n = told_trial(held)
    rows = []
    for k in range(1, 400):
        link.next = sample(n + k, tip=(-0.08, 0.41), velocity=(0.05, 0.02), current=(measured,) * 4)
        rows += trial.exchange()
    torques = np.array(rows)[:, tick_log.TORQUE : tick_log.TORQUE + 4]
    most = max(brake.torque_gain(brake.current_max_A) for brake in held.device.brake_files.values())
    assert np.isfinite(torques).all() and torques.any() and np.abs(torques).max() <= most + 1e-9


def test_encoders_of_no_pose_are_borne_for_some_samples_and_then_end_the_trial(held: RealBench) -> None:
    trial, link, n = told_trial(held)
    for k in range(1, 10):
        link.next = sample(n + k, closed=False)
        trial.exchange()
    assert trial.phase == "move"
    link.next = sample(n + 10, closed=False)
    trial.exchange()
    assert trial.phase == "end" and "contradict each other" in trial.outcome()["reason"]


def test_a_silent_board_gets_no_current_after_50_ms_and_the_trial_ends(held: RealBench) -> None:
    trial, link, n = told_trial(held)
    link.next = sample(n + 1, tip=(-0.08, 0.41), velocity=(0.1, 0.0), force=(4.0, 1.0))
    trial.exchange()
    link.next, last = None, link.now
    while not trial.finished:
        trial.exchange()
    blind = [now for now, asked in zip(np.arange(1, len(link.asked) + 1) * 1e-3, link.asked, strict=True) if any(asked)]
    assert blind[-1] - last <= 0.051
    assert "no sample came from the board for 50 ms" in trial.outcome()["reason"]
    assert trial.ticks == n + 1, "what was not sensed is not recorded"


def test_a_long_gap_ends_the_recording_and_is_not_made_up(held: RealBench) -> None:
    trial, link, n = told_trial(held)
    link.next = sample(n + 10_000)
    assert trial.exchange() == [] and trial.finished and trial.outcome()["filled"] == 0
    assert "no sample came" in trial.outcome()["reason"]


@pytest.mark.parametrize("on", [0, 3])
def test_a_driver_that_stays_on_ends_the_trial_in_any_phase(held: RealBench, on: int) -> None:
    link = Told(held.device)
    trial = held.trial(2)
    trial.connect(link)
    current = tuple(0.6 * (i == on) for i in range(4))
    n = 0
    while not trial.finished and n < 5000:
        n += 1
        link.next = sample(n, tip=(0.0, 0.3), current=current)  # away from the start: no current is asked for
        trial.exchange()
    outcome = trial.outcome()
    assert outcome["status"] == "aborted" and "did not get the currents" in outcome["reason"]
    assert DISOBEYED_TICKS < n - round(1e3 * PAPER.trial.end_s) < 2 * DISOBEYED_TICKS


def test_a_board_that_lets_no_current_flow_ends_the_trial(held: RealBench) -> None:
    trial, link, n = told_trial(held)
    began = n
    while not trial.finished and n < began + 5000:
        n += 1
        link.next = sample(n, tip=(-0.08, 0.41), velocity=(0.1, 0.0), force=(4.0, 1.0))
        trial.exchange()
    assert "did not get the currents" in trial.outcome()["reason"]
    assert n - began - round(1e3 * PAPER.trial.end_s) < 10 * DISOBEYED_TICKS


@pytest.mark.nojit
def test_currents_that_chatter_and_come_late_are_no_disobedience() -> None:
    run, row = new_record(RUN), np.zeros(tick_log.BENCH_WIDTH)
    brakes = pack_brakes(load_device("four-brake").brakes, backlash=False)
    asked = np.random.default_rng(1).integers(0, 2, (3000, 4)).astype(float)
    noise = np.random.default_rng(2).normal(0.0, 0.01, (3000, 4))
    for n in range(3000):
        run["current"][0] = asked[n]
        row[tick_log.MEASURED : tick_log.MEASURED + 4] = asked[max(n - 20, 0)] + noise[n]
        assert not disobeys(brakes[0], run[0], row)
