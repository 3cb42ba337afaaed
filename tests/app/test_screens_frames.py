"""When something is painted: sixty frames a second, the panels with every third, nothing for what stays; what it costs.

No figure is a limit here: machines differ.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from fake_client import PLAN, movement, opened, ready, running, ticks
from PySide6.QtWidgets import QApplication
from screens import Screens, settle

from app.window.canvas.layers import joints_at
from app.window.run.energy import Ledger
from app.window.run.run_page import PANELS_EVERY
from app.window.windows import FRAME_S
from core import tick_log
from core.device import load_device

FOUR = load_device("four-brake")
FRAME = 16  # ticks


@pytest.fixture
def clock(screens: Screens, monkeypatch):
    """The windows' clock, which only the tests move, and the waits (ms) that they ask their timer for."""
    now, waits = SimpleNamespace(s=100.0), []
    monkeypatch.setattr("app.window.windows.time", SimpleNamespace(perf_counter=lambda: now.s))
    monkeypatch.setattr(screens.windows._timer, "start", waits.append)
    screens.windows._due_s = now.s
    return now, waits


def test_sixty_frames_come_in_a_second_although_a_timer_knows_whole_milliseconds_only(screens: Screens, clock) -> None:
    now, waits = clock
    for _ in range(600):
        screens.windows._on_time()
        now.s += 1e-3 * waits[-1]
    assert now.s - 100.0 == pytest.approx(10.0, abs=1e-3)
    assert set(waits) == {16, 17}


def test_a_frame_that_comes_late_is_not_made_up_for_and_the_next_keeps_the_beat(screens: Screens, clock) -> None:
    now, waits = clock
    for late_s in (0.004, 0.0167, 0.11, 1.31):
        now.s = screens.windows._due_s + late_s
        screens.windows._on_time()
        assert 0 <= waits[-1] <= math.ceil(1e3 * FRAME_S)
        beats = (screens.windows._due_s - 100.0) / FRAME_S
        assert beats == pytest.approx(round(beats), abs=1e-6) and screens.windows._due_s > now.s


def test_the_next_frame_is_asked_for_even_if_one_fails(screens: Screens, clock, monkeypatch) -> None:
    now, waits = clock
    monkeypatch.setattr(screens.windows, "frame", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        screens.windows._on_time()
    assert len(waits) == 1


@pytest.mark.parametrize("end", ["result", "death"])
def test_the_panels_go_on_with_every_third_frame_and_end_with_the_last_tick(screens: Screens, end: str) -> None:
    over = next(i for i, planned in enumerate(PLAN) if planned.segment == 1)
    screens.hear(opened(), running(over))
    rows = movement(1, "AEB", 2.0)[: FRAME * (2 * PANELS_EVERY + 2)]
    view, seen = screens.run.workspace.view, []
    for begin in range(0, len(rows), FRAME):
        screens.client.rows = rows[begin : begin + FRAME]
        screens.windows.frame()
        now = rows[begin + FRAME - 1]
        assert view.tip == (now[tick_log.TIP_X], now[tick_log.TIP_Y])  # what follows the hand never waits
        seen.append(screens.run.strip.speed.newest)
    assert len(set(seen[PANELS_EVERY - 1 : -1])) == 2 and seen[-1] == seen[2 * PANELS_EVERY - 1]
    if end == "result":
        screens.hear(ready(over + 1))
    else:
        screens.client.alive = False
        screens.windows.frame()
    ledger = Ledger()
    ledger.add(rows)
    assert vars(screens.run.strip.ledger).items() >= {"hand": ledger.hand, "brakes": ledger.brakes}.items()
    speed = np.hypot(*rows[-1, tick_log.TIP_VX : tick_log.TIP_VY + 1])
    assert screens.run.strip.speed.newest == pytest.approx((speed,))


def test_what_the_hand_looks_at_is_painted_before_the_console(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.participant.show()
    settle(screens.participant)
    painted: list[str] = []
    for name, view in (("console", screens.run.workspace.view), ("participant", screens.participant.view)):
        view.painted.connect(lambda name=name: painted.append(name))
    screens.tick(ticks(tick_log.MOVE, TIP_X=0.02))
    QApplication.processEvents()
    assert painted == ["participant", "console"]


def test_ticks_that_still_waited_are_not_shown_in_the_next_trial(screens: Screens) -> None:
    screens.hear(opened(), running(0))
    screens.client.rows = movement(PLAN[0].segment, "AEB", 1.0)[:FRAME]
    screens.windows.frame()
    screens.hear(running(1))
    screens.run.show_panels()
    assert screens.run.strip.speed.newest == () and not screens.run.strip.ledger.began


def test_arms_keep_their_lengths_and_end_at_the_tip_or_are_not_there() -> None:
    for device in (load_device("three-brake"), FOUR):
        mechanism, reached = device.mechanism, 0
        for x, y in np.random.default_rng(1).uniform((-0.9, -0.9), (0.9, 0.9), (300, 2)).tolist():
            at = joints_at(mechanism, (x, y))
            reached += bool(at)
            ways = [(arm, math.dist((arm.base_x, arm.base_y), (x, y))) for arm in (mechanism.arm_1, mechanism.arm_2)]
            close = (abs(arm.length_1 - arm.length_2) <= way <= arm.length_1 + arm.length_2 for arm, way in ways)
            assert bool(at) is all(close)
            for arm, base, elbow in ((mechanism.arm_1, "A", "E"), (mechanism.arm_2, "B", "C")) if at else ():
                assert math.dist(at[base], at[elbow]) == pytest.approx(arm.length_1)
                assert math.dist(at[elbow], at["D"]) == pytest.approx(arm.length_2)
        assert 0 < reached < 300
