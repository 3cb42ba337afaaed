"""Try on the server's side: passes, changes in the middle of one, the table; in simulated time."""

import contextlib
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import simulated_loop
from own_files import own_experiment
from protocols import PAPER
from simulated_loop import LocalWindow, local_window
from synthetic_hand import SyntheticHand

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.loop.real_time import HOMEWARD_M_S
from core import tick_log
from core.tick_log import TICK_S
from experiments.inputs import OPERATOR


@contextlib.contextmanager
def trying(setup: Setup) -> Iterator[LocalWindow]:
    """A window whose first pass of Try has begun."""
    with local_window(setup) as opened:
        opened.until_stage(m.NO_SESSION)
        opened.client.send(m.SetSandbox())
        opened.until(lambda s: s.sandbox and s.running)
        yield opened


@pytest.fixture
def window(tmp_path: Path) -> Iterator[LocalWindow]:
    with trying(Setup(tmp_path / "data", sync=False)) as opened:
        yield opened


def change(window: LocalWindow, parameters: dict[str, float] | None = None, **what) -> None:
    settings = window.snapshot.sandbox.settings._replace(**what)
    window.client.send(m.SetSandbox(settings.with_parameters(**parameters or {})))


def drive(window: LocalWindow, until) -> None:
    """A hand that takes the handle along the path again and again, until something is true of snapshot and last row."""
    hand, number, row = None, 0, None
    while True:
        window.look()
        row = window.ticks[-1][-1] if len(window.ticks[-1]) else row
        if row is not None and until(window.snapshot, row):
            return
        running = window.snapshot.running
        if row is None or running is None:
            continue
        tip, phase = (row[tick_log.TIP_X], row[tick_log.TIP_Y]), int(row[tick_log.PHASE])
        if hand is None or running.repetition != number:
            hand, number = SyntheticHand(running.path, tip), running.repetition
        window.client.ring.aim(*hand(tip, phase, 0.02))


def moves(ticks: int):
    """Whether the movement has gone on for so long."""
    seen = []

    def true(_: m.Snapshot, row: np.ndarray) -> bool:
        seen.append(row[tick_log.T]) if row[tick_log.PHASE] == tick_log.MOVE else seen.clear()
        return len(seen) > 1 and seen[-1] - seen[0] > 1e-3 * ticks

    return true


def test_pass_follows_pass_and_each_is_measured(window: LocalWindow) -> None:
    drive(window, lambda s, _: len(s.sandbox.passes) >= 2)  # a busy machine may measure two at once
    first, second = window.snapshot.sandbox.passes[:2]
    assert (first.number, second.number) == (1, 2) and not first.changed and first.status == "done"
    for measure in ("path_error_m", "mean_tip_force_N", "acceleration_weighted_rms_m_s2", "duration_s"):
        found = first.measures[measure]
        assert math.isfinite(found) and found > 0.0
    assert not list(Path(window.opened.folder).glob("sub-*")) and window.pulse.proof is None  # nothing is written
    assert window.rows[-100:, tick_log.ARM_FORCE_MAX].min() > 0.0, "the pointer keeps the handle from pass to pass"


CHANGES = {
    "controller": dict(controller=4, parameters={"gain_N_s_m": 10_000.0}),
    "rules and spring": dict(rules="literal", spring_N_m=600.0),
    "brake strength": dict(brake_strength=0.3),
    "much backlash": dict(backlash_deg=3.0),
    "ideal sensing": dict(sensing="ideal"),
}


@pytest.mark.parametrize("what", CHANGES.values(), ids=CHANGES)
def test_a_change_in_mid_movement_acts_at_the_next_tick_and_moves_nothing(window: LocalWindow, what: dict) -> None:
    drive(window, moves(250))
    window.look()
    run, before = window.client.state.runner.run, len(window.rows)
    change(window, **what)
    drive(window, moves(320))
    rows, trial = window.rows, run.trial
    assert window.client.state.runner.run is run  # the same trial
    assert np.allclose(np.diff(rows[before - 200 :, tick_log.T]), 1e-3, atol=1e-9)  # time does not jump
    speed = np.hypot(rows[:, tick_log.TIP_VX], rows[:, tick_log.TIP_VY])
    step = np.hypot(np.diff(rows[:, tick_log.TIP_X]), np.diff(rows[:, tick_log.TIP_Y]))
    near = slice(before - 20, before + 40)
    assert np.all(step[near] <= 1.2e-3 * np.maximum(speed[:-1], speed[1:])[near] + 1e-7)
    assert np.abs(np.diff(rows[near, tick_log.ENERGY_KINETIC])).max() < 0.01  # J: forces of a few N over a tick
    assert trial.simulation.ledger().residual == pytest.approx(0.0, abs=1e-6)
    assert trial.simulation.ledger().added_by_brakes < 1e-9
    settings, fields = window.snapshot.sandbox.settings, {**what}
    parameters = fields.pop("parameters", {})
    assert settings == settings._replace(**fields).with_parameters(**parameters)


def test_with_encoders_the_controller_knows_the_path_error_a_count_and_a_sample_off_and_keeps_its_samples(window):
    change(window, sensing="ideal")
    drive(window, moves(200))
    change(window, sensing="encoders")
    drive(window, moves(400))
    change(window, spring_N_m=400.0)  # the last samples stay: the velocity that it sees does not begin anew
    drive(window, moves(600))
    rows, sensing = window.rows, window.client.state.runner.run.trial.sensing
    moving = rows[rows[:, tick_log.PHASE] == tick_log.MOVE]
    off = np.abs(moving[:, tick_log.TIP_Y] - 0.4)  # path 1 is level
    known = np.abs(moving[:, tick_log.PATH_DISTANCE])
    assert np.abs(known - off)[:150].max() < 1e-12  # ideal: the truth
    assert np.abs(known[1:] - off[:-1])[-150:].max() < 40e-6  # a millisecond old, and whole counts
    assert 1e-7 < np.abs(known - off)[-150:].max() < 1e-3
    assert sensing.sensors["taken"][0] > 350


def test_a_change_on_the_way_is_noted_and_one_before_the_movement_is_not(window: LocalWindow) -> None:
    change(window, brake_strength=0.9)
    drive(window, lambda s, _: s.sandbox.passes)
    drive(window, moves(100))
    change(window, brake_strength=0.5)
    drive(window, lambda s, _: any(one.changed for one in s.sandbox.passes))
    ended = window.snapshot.sandbox.passes
    (at,) = (place for place, one in enumerate(ended) if one.changed)
    assert at > 0 and [one.settings.brake_strength for one in ended] == at * [0.9] + (len(ended) - at) * [0.5]


def test_weaker_brakes_hold_less(window: LocalWindow) -> None:
    """The hand leans out at the start of the rails: the brakes' largest torques fall with their strength."""
    peaks = []
    for strength in (1.0, 0.2):
        change(window, brake_strength=strength)
        begun = len(window.snapshot.sandbox.passes)
        seen = len(window.rows)
        drive(window, lambda s, _, begun=begun: len(s.sandbox.passes) > begun)
        rows = window.rows[seen:]
        peaks.append(np.abs(rows[:, tick_log.TORQUE : tick_log.TORQUE + 4]).max())
    assert peaks[1] <= 0.2 * 5.3 + 1e-9 < peaks[0]  # K(I_max) of the shipped brake: 5.3 N m


@pytest.mark.parametrize("what", [dict(device="four-brake"), dict(path=2)])
def test_another_device_or_path_begins_another_pass_where_the_handle_is(window: LocalWindow, what: dict) -> None:
    drive(window, moves(500))
    before = len(window.rows)
    change(window, **what)
    window.until(lambda s: s.running and all(getattr(s.sandbox.settings, k) == v for k, v in what.items()))
    drive(window, lambda s, row: row[tick_log.PHASE] == tick_log.HOLD)
    rows = window.rows
    again = before - 50 + int(np.argmin(rows[before - 50 :, tick_log.T]))
    assert rows[again, tick_log.PHASE] == tick_log.APPROACH
    tips = rows[again - 1 : again + 1, tick_log.TIP_X : tick_log.TIP_Y + 1]
    assert np.hypot(*np.diff(tips, axis=0)[0]) < 1e-3
    assert not window.snapshot.sandbox.passes


PX_M = 1.0 / 3100.0  # of the canvas at 1280 x 720 px
CANVAS = np.array([(-0.13, 0.34), (0.13, 0.46)])  # m, its corners: 3 cm around path 1, at least
SPEEDS_PX_S = (300, 600, 1000, 1700, 2500)


def wait(window: LocalWindow, seconds: float) -> np.ndarray:
    """The ticks of so long."""
    came, pieces = 0, len(window.ticks)
    while came < 1e3 * seconds:
        window.look()
        came += len(window.ticks[-1])
    return np.concatenate(window.ticks[pieces:])


def sweep(window: LocalWindow, tip: np.ndarray, angle: float, speed_m_s: float) -> None:
    """The pointer takes the handle, and leaves the canvas from there with it."""
    at, way = tip.copy(), np.array([math.cos(angle), math.sin(angle)])
    while not window.client.taken:
        window.client.ring.aim(*at)
        window.look()
    while np.all((CANVAS[0] < at) & (at < CANVAS[1])):
        window.client.ring.aim(*at)
        window.look()
        at = at + 1e-3 * len(window.ticks[-1]) * speed_m_s * way
    window.client.ring.let_go()


@pytest.mark.parametrize("device", ["three-brake", "four-brake"])
def test_a_handle_that_is_let_go_at_any_speed_in_any_direction_comes_to_rest_on_the_way_back_to_the_start(
    window: LocalWindow, device: str
) -> None:
    start, lost = np.array(PAPER.paths[1].start_m), []
    change(window, device=device)
    wait(window, 0.2)
    for k, (turn, speed) in enumerate((turn, speed) for turn in range(16) for speed in SPEEDS_PX_S):
        if (k + turn) % {"three-brake": 15, "four-brake": 20}[device]:  # directions all round
            continue
        change(window, controller=1 + k % 5)
        tip = wait(window, 0.05)[-1, tick_log.TIP_X : tick_log.TIP_Y + 1]
        sweep(window, tip, 2.0 * math.pi * turn / 16, speed * PX_M)
        rows = wait(window, 0.5 + float(np.hypot(*(CANVAS[1] - CANVAS[0]))) / HOMEWARD_M_S)
        tips = rows[:, tick_log.TIP_X : tick_log.TIP_Y + 1]
        out_m = np.maximum(CANVAS[0] - tips, tips - CANVAS[1]).max(axis=1)
        resting = np.hypot(*rows[-20:, (tick_log.TIP_VX, tick_log.TIP_VY)].T).max() < 1e-3
        if out_m[300:].max() > 0.0 or np.hypot(*(tips[-1] - start)) > 0.004 or not resting:
            lost.append((turn, speed, out_m.max(), tips[-1]))
    assert not lost
    ledger = window.client.state.sandbox.simulation.ledger()
    assert abs(ledger.residual) < 1e-6 * ledger.work_hand and ledger.added_by_brakes < 1e-9
    done = len(window.snapshot.sandbox.passes)
    drive(window, lambda s, _: len(s.sandbox.passes) > done)  # and there it can be touched


def test_in_the_movement_nobody_has_a_handle_that_was_let_go_until_it_is_brought_back(window: LocalWindow) -> None:
    drive(window, moves(300))
    run = window.client.state.runner.run
    window.client.ring.let_go()
    rows = wait(window, 1.0)
    assert set(rows[100:, tick_log.PHASE]) == {tick_log.MOVE} and not rows[100:, tick_log.ARM_FORCE_MAX].any()
    window.client.send(m.BringBack())
    rows = wait(window, 2.0)
    assert window.client.state.runner.run is not run and set(rows[100:, tick_log.PHASE]) == {tick_log.APPROACH}
    assert rows[-1, tick_log.TIP_X : tick_log.TIP_Y + 1] == pytest.approx(PAPER.paths[1].start_m, abs=0.004)
    assert not window.snapshot.sandbox.passes, "a pass that was given up is none"


def test_the_handle_is_brought_back_where_no_pointer_ever_was_and_out_of_the_hand(window: LocalWindow) -> None:
    start, end = PAPER.paths[1].start_m, PAPER.paths[1].end_m
    waits_x = wait(window, 0.3)[-1, tick_log.TIP_X]
    assert start[0] + 0.05 < waits_x < end[0] - 0.03, "till then it waits between both circles"
    window.client.send(m.BringBack())
    assert wait(window, 2.0)[-1, tick_log.TIP_X : tick_log.TIP_Y + 1] == pytest.approx(start, abs=0.004)
    window.client.ring.aim(*start)
    wait(window, 0.1)
    window.client.ring.aim(0.0, 0.43)
    wait(window, 0.5)
    assert window.client.taken
    window.client.send(m.BringBack())
    assert wait(window, 2.0)[-1, tick_log.TIP_X : tick_log.TIP_Y + 1] == pytest.approx(start, abs=0.004)
    assert not window.client.taken


def test_a_simulated_operator_makes_its_passes_alone_until_try_is_left_and_a_session_can_be_opened(tmp_path) -> None:
    with trying(Setup(tmp_path / "data", hand=OPERATOR, sync=False)) as window:
        window.client.send(m.BringBack())
        assert "Only the hand of the pointer" in window.until(lambda s: s.notice_bad).notice
        tried = window.until(lambda s: s.sandbox and s.sandbox.passes).sandbox
        assert tried.passes[0].status == "done" and tried.fixed == ("spring_N_m",)
        change(window, spring_N_m=500.0)
        assert "spring_N_m cannot be changed" in window.until(lambda s: s.notice_bad).notice
        window.client.send(m.EndSandbox())
        window.until(lambda s: s.stage == m.NO_SESSION and s.sandbox is None)
        window.open()
        window.client.send(m.SetSandbox())
        assert "Leave it" in window.until(lambda s: s.notice_bad).notice and window.snapshot.sandbox is None


def test_brakes_off_stops_the_pass_and_the_next_waits_until_they_are_allowed(window: LocalWindow) -> None:
    drive(window, moves(100))
    window.client.brakes_off("Esc")
    window.until(lambda s: not s.running)
    assert not window.within(0.3, lambda s: s.running) and "Esc" in window.snapshot.notice
    window.client.send(m.AllowBrakes())
    allowed = window.until(lambda s: s.running)
    assert not allowed.sandbox.passes
    assert "Turn the brakes on" not in allowed.notice  # it has been done


REFUSED = (
    (dict(device="two-brake"), "device 'two-brake' is none of"),
    (dict(path=9), "path 9 is none of 1, 2"),
    (dict(controller=9), "controller 9 is none of"),
    (dict(rules="mine"), "rules 'mine' is none of"),
    (dict(controller=4, parameters={"gain_N_s_m": -1.0}), "gain_N_s_m"),
    (dict(parameters={"gap_m": math.nan}), "gap_m"),
    (dict(parameters={"wall_N_m": 1.0}), "wall_N_m is no parameter"),
    (dict(blend_width_m=0.0), "blend width"),
    (dict(brake_strength=-0.5), "brake_strength"),
    (dict(brake_strength=0.0), "normalised force"),
    (dict(spring_N_m=math.inf), "spring_N_m"),
    (dict(backlash_deg=-1.0), "backlash_deg"),
)


def test_settings_that_cannot_be_are_refused_and_nothing_changes(window: LocalWindow) -> None:
    before = window.snapshot.sandbox.settings
    for what, says in REFUSED:
        change(window, **what)
        assert says in window.until(lambda s, says=says: s.notice_bad and says in s.notice).notice
        assert window.snapshot.sandbox.settings == before


OWN = '[[controller]]\nname = "Damper"\nalgorithm = "my_damper.py"\nparameters = {damping_N_s_m = 900.0}\n'


def test_a_controller_of_ones_own_can_be_tried(tmp_path: Path) -> None:
    own = own_experiment(tmp_path, f"{PAPER.text}\n{OWN}")
    with trying(Setup(tmp_path / "data", str(own), ("three-brake",), sync=False)) as window:
        change(window, controller=6, parameters={"gap_m": 0.002})
        drive(window, lambda s, _: s.sandbox.passes)
        one = window.snapshot.sandbox.passes[0]
        assert one.status == "done" and one.settings.controller == 6 and one.measures["path_error_m"] < 0.01


class SwingingHand:
    """A pointer that someone moves to try a guide: to the start, then along path 1 and 1 cm to either side of it."""

    start, length = np.array((-0.10, 0.40)), 0.20

    def __init__(self, tip: np.ndarray) -> None:
        self.way, self.at = 0.0, np.array(tip)

    def next(self, tip: np.ndarray, phase: int, seconds: float) -> np.ndarray:
        """Where the pointer is so much later, m."""
        if phase == tick_log.APPROACH:
            left = self.start - self.at
            far = float(np.hypot(*left))
            self.at = self.at + left * min(1.0, 0.08 * seconds / max(far, 1e-9))
            if far < 0.004:  # it goes beyond the start while the handle is short of it
                self.at = self.at + 4.0 * seconds * (self.start - tip)
        elif phase != tick_log.HOLD:
            self.way += 0.08 * seconds
            aside = 0.01 * math.sin(4.0 * math.pi * min(1.0, self.way / self.length))
            self.at = self.start + (self.way, aside)
        return self.at


def felt(setup: Setup, controller: int, passes: int) -> list[np.ndarray]:
    """The forces of the swinging hand (ticks, 2), N, during the movement of one pass after the other."""
    with trying(setup) as window:
        change(window, controller=controller, parameters=window.opened.protocol.controllers[controller].named)
        hand, number = None, 0
        while len(window.snapshot.sandbox.passes) < passes:
            window.look()
            rows, running = window.ticks[-1], window.snapshot.running
            if not len(rows) or running is None:
                continue
            tip, phase = rows[-1, tick_log.TIP_X : tick_log.TIP_Y + 1], int(rows[-1, tick_log.PHASE])
            if hand is None or running.repetition != number or not window.client.taken:
                hand, number = SwingingHand(tip), running.repetition
            window.client.ring.aim(*hand.next(tip, phase, TICK_S * len(rows)))
        moving = np.flatnonzero(window.rows[:, tick_log.PHASE] == tick_log.MOVE)
        split = np.split(moving, np.flatnonzero(np.diff(moving) > 1) + 1)[:passes]
        return [window.rows[one, tick_log.HAND_FX : tick_log.HAND_FY + 1] for one in split]


def apart_N(one: np.ndarray, other: np.ndarray) -> float:
    """How far the forces of two passes lie apart at the same time, root mean square, N."""
    ticks = min(len(one), len(other))
    return float(np.sqrt(np.mean(np.sum((one[:ticks] - other[:ticks]) ** 2, axis=1))))


@pytest.mark.parametrize(("device", "passes"), [("three-brake", 2), ("four-brake", 1)])
def test_each_of_the_five_is_felt_from_every_other_by_more_than_the_same_one_from_pass_to_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str, passes: int
) -> None:
    monkeypatch.setattr(simulated_loop, "PIECE", 20)  # ms: the pointer moves 50 times a second
    found = {number: felt(Setup(tmp_path / f"{number}", devices=(device,)), number, passes) for number in range(1, 6)}
    repeats = [apart_N(*own) for own in found.values() if len(own) == 2]
    pairs = {
        (a, b): min(apart_N(one, other) for one in found[a] for other in found[b])
        for a, b in itertools.combinations(found, 2)
    }
    assert min(pairs.values()) > max(0.5, *repeats, 0.0), (pairs, repeats)


def test_with_the_low_gain_as_printed_nothing_is_felt_of_it(tmp_path: Path) -> None:
    (none,), (low,) = (felt(Setup(tmp_path / f"{number}", low_gain=5.0), number, 1) for number in (1, 5))
    assert apart_N(none, low) == 0.0
