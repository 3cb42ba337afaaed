"""A session server from its window's side: trials, refusals, brakes-off; and that a slow window changes nothing."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from live import Window, live_window
from processes import gone
from protocols import PAPER, changed
from synthetic_hand import SyntheticHand
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.store.cells import cell
from experiments.store.session import Session

JOINTS = range(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    """The paper's protocol, for a hand whose machine shows it few pictures."""
    folder = tmp_path_factory.mktemp("live")
    (folder / "patient.toml").write_text(
        changed(PAPER.text, time_out_s="200.0", hold_s="0.2", end_radius_m="0.05"), encoding="utf-8"
    )
    return Setup(folder / "data", str(folder / "patient.toml"), real_time=False)


@pytest.fixture(scope="module")
def window(setup: Setup):
    with live_window(setup) as opened:
        opened.open()
        yield opened


def follow(window: Window, up_to: int = len(tick_log.PHASES)) -> None:
    """A hand goes through the running trial, to its end or to a phase."""
    hand, seen, rows = SyntheticHand(window.snapshot.running.path, window.snapshot.tip), 0, window.rows
    while window.snapshot.stage == m.RUNNING and rows[-1, tick_log.PHASE] < up_to:
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        window.client.ring.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 1e-3 * (len(rows) - seen)))
        seen = len(rows)
        time.sleep(0.005)
        window.look()
        rows = window.rows


def test_a_trial_by_hand_has_a_row_for_every_millisecond_and_says_how_late_each_was(window: Window) -> None:
    began = time.perf_counter()
    snapshot = window.start()
    run = snapshot.running
    follow(window)
    wall = time.perf_counter() - began
    done = window.snapshot.rows[-1]
    assert (done.run, done.status) == (run.run, "done")
    kept = window.recording(run.run)
    assert kept.whole and 1e-3 * kept.rows <= wall
    assert np.array_equal(kept.column("t_s"), np.arange(kept.rows) * 1e-3)
    lateness = kept.column("lateness_us")
    assert np.all(lateness >= 0.0) and np.any(lateness > 0.0)
    timing = kept.outcome["timing"]
    assert timing["ticks"] == kept.rows and timing["lost"] == 0
    assert timing["max_us"] == lateness.max() and timing["p99_us"] == np.percentile(lateness, 99.0)
    assert timing["missed"] == np.count_nonzero(lateness >= 1000.0)
    assert timing["scheduling"].startswith("default")
    assert 0.0 < timing["tick_us"] <= timing["tick_max_us"]
    for name, file in (("stolen_ms", "stat"), ("waited_ms", "self/schedstat"), ("switches", "self/status")):
        counted = sys.platform == "linux" and Path("/proc", file).exists()
        assert (timing[name] is not None) == counted and (timing[name] or 0) >= 0
    force = np.hypot(kept.column("hand_fx_N"), kept.column("hand_fy_N"))
    assert 0.5 < force.max() <= 40.0 + 1e-9
    off = ~kept.in_phase("move")
    assert all(not kept.column(f"current_{joint}_A")[off].any() for joint in kept.braked)
    window.look()
    shown = window.rows
    assert np.array_equal(shown[:, tick_log.TIP_X], kept.column("tip_x_m"))  # the window has seen every tick


def test_proof_of_recording_grows_while_a_trial_runs(window: Window) -> None:
    began = time.perf_counter()
    window.until_stage(m.READY)
    window.client.send(m.Start())
    name = f"run-{window.until_stage(m.RUNNING).running.run:03d}"
    assert window.pulse.proof and window.pulse.proof.name == name, "no later than the trial itself"
    window.until(lambda s: window.pulse and (proof := window.pulse.proof) and proof.name == name and proof.rows > 0)
    first = window.pulse.proof
    window.until(lambda s: window.pulse.proof and window.pulse.proof.rows > first.rows)
    assert window.pulse.proof.bytes > first.bytes
    assert 0.0 <= window.pulse.proof.age_s < time.perf_counter() - began
    assert window.pulse.verified == sum(bool(r.recording) for r in window.snapshot.rows)
    window.abort("enough")


def test_a_window_that_hangs_changes_nothing_and_then_hears_how_things_are(window: Window) -> None:
    run = window.start().running.run
    ticks: list[int] = []
    wait_until(lambda: ticks.append(len(window.client.ticks())) or sum(ticks) > 1000)  # it reads nothing of the pipe
    snapshot = window.abort("enough")
    assert snapshot.rows[-1].run == run
    kept = window.recording(run)
    assert kept.whole and kept.rows > 1000 and kept.outcome["timing"]["lost"] == 0


def test_a_trial_by_pointer_ends_with_its_window_and_comes_again(setup: Setup, window: Window) -> None:
    snapshot = window.start()
    follow(window, up_to=tick_log.MOVE)
    pids = window.processes()
    window.client.leave()
    wait_until(lambda: all(map(gone, pids)))
    assert window.recording(snapshot.running.run).outcome["status"] == "stopped"
    session = Session.resume(setup.data_dir, "01", sync=False)
    assert cell(session.next_planned()) == cell(session.rows[-1])
    session.close()
