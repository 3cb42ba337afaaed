"""What measures the screens, and what spares them work. No figure is a limit here: machines differ."""

import gc
import time

import numpy as np
import pytest
from fake_client import opened, pulse, running, ticks
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication
from screens import Screens, settle

from app.ipc import messages as m
from app.window.plots import Plot
from core import tick_log
from tests.benchmarks.pointer_lag import Moves
from tests.benchmarks.screen_bench import table
from tests.benchmarks.screen_cost import LONG_MS, measure
from tests.benchmarks.synthetic_bench import TRIAL_S, SyntheticBench


@pytest.mark.parametrize("both", [False, True])
def test_the_cost_of_drawing_is_measured_and_leaves_nothing_behind(qtbot, both: bool) -> None:
    before, frozen = set(QApplication.topLevelWidgets()), gc.get_freeze_count()
    cost = measure(0.3, 1280, 720, both)
    assert (cost.width, cost.height) == (1280, 720) and cost.platform == "offscreen"
    assert 0.0 < cost.p50_ms <= cost.p99_ms <= cost.max_ms and cost.frames_per_s > 0.0
    assert 0.0 < cost.core_share_least and 0.0 < cost.core_share
    assert cost.long_frames >= (cost.max_ms > LONG_MS)
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    gc.collect()  # the menus that plots come with
    assert set(QApplication.topLevelWidgets()) <= before and gc.get_freeze_count() <= frozen


def test_made_up_ticks_come_once_each_in_order_and_at_1_khz(monkeypatch) -> None:
    now = [100.0]
    monkeypatch.setattr("tests.benchmarks.synthetic_bench.time.perf_counter", lambda: now[0])
    bench = SyntheticBench()
    assert [type(message) for message in bench.receive()] == [m.Opened, m.Snapshot, m.Snapshot]
    found = []
    for step in (0.016, 0.017, 0.2):
        now[0] += step
        found.append(bench.ticks())
    assert len(bench.ticks()) == 0
    t = np.concatenate(found)[:, tick_log.T]
    assert np.allclose(t, 1e-3 * np.arange(len(t))) and 232 <= len(t) <= 233
    now[0] += TRIAL_S
    assert m.RUNNING in [message.stage for message in bench.receive() if isinstance(message, m.Snapshot)]
    now[0] += 0.01
    assert bench.ticks()[0, tick_log.T] == 0.0  # the next trial's


def test_a_move_of_the_pointer_counts_once_the_tick_that_used_it_is_painted(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.participant.show()
    moves = Moves(screens.windows, time.perf_counter)
    moves._timer.stop()
    moves.measuring = True
    moves._move()
    view = screens.participant.view
    view.pointer_moved.emit(0.031, 0.372)
    screens.tick(ticks(tick_log.APPROACH))  # of another place
    QApplication.processEvents()
    assert moves.painted_s == []
    rows = ticks(tick_log.APPROACH)
    rows[-1, [tick_log.TARGET_X, tick_log.TARGET_Y]] = 0.031, 0.372
    screens.tick(rows)
    QApplication.processEvents()
    assert len(moves.painted_s) == 1 and 0.0 < moves.aimed_s[0] <= moves.tick_s[0] <= moves.painted_s[0]
    screens.tick(rows)
    QApplication.processEvents()
    assert len(moves.painted_s) == 1
    moves._move()
    moves._move()
    assert moves.lost == 1


# ------------------------------------------------------------------------------------------------- the verb


def test_the_report_has_a_line_for_every_case_and_the_pointer() -> None:
    one = {
        "windows": "main window", "width": 1280, "height": 720, "scale": 1.0, "platform": "xcb", "seconds": 5.0,
        "frames_per_s": 60.0, "core_share": 0.2, "core_share_least": 0.15, "p50_ms": 5.0,
        "p99_ms": 9.0, "max_ms": 52.0, "max_cpu_ms": 8.0, "long_frames": 1,
    }  # fmt: skip
    pointer = {
        "width": 1920, "height": 1080, "moves": 250, "lost": 2, "aimed_p50_ms": 0.4, "tick_p50_ms": 0.6,
        "drawn_p50_ms": 13.0, "p50_ms": 14.0, "p95_ms": 30.0, "max_ms": 33.0, "limit_ms": 34.3, "within": 0.99,
    }  # fmt: skip
    machine = {"processors": 2, "load_before": 0.1}
    large = {**one, "width": 960, "height": 540, "scale": 2.0}
    result = {"on": "all", "machine": machine, "seconds": 10.0, "windows": [one, large], "pointer": pointer}
    said = table(result)
    assert "1280x720" in said and "1920x1080 200%" in said and "20.0%" in said
    assert "p95 30.0 (1.8 frames)" in said and "99.0% of 252" in said
    assert "not measured, no mouse" in table({**result, "pointer": {"refused": "no mouse"}})


# ------------------------------------------------------------------------------------------------- room


@pytest.mark.parametrize(("width", "height"), ((1280, 720), (1600, 900), (1920, 1080)))
def test_every_panel_has_room_for_what_it_shows(screens: Screens, width: int, height: int) -> None:
    main = screens.hear(opened(), running(), pulse())
    main.resize(width, height)
    settle(main)
    assert (main.width(), main.height()) == (width, height)
    for panel in screens.run.traces.findChildren(Plot):
        assert panel.graph.height() >= 30 and panel.graph.width() > 200
