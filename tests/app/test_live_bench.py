"""A session server from its window's side: trials, refusals, brakes-off; and that a slow window changes nothing."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from live import Window, gone, live_window, wait_until
from synthetic_hand import SyntheticHand

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.analysis.trials_table import read_table
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session.files import cell, hold_lock

JOINTS = range(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    return Setup(tmp_path_factory.mktemp("live") / "data", real_time=False)


@pytest.fixture(scope="module")
def window(setup: Setup):
    with live_window(setup) as opened:
        opened.open()
        yield opened


def recording(window: Window, run: int) -> Recording:
    return read_recording(Path(window.opened.folder) / "trials" / f"run-{run:03d}.parquet")


def events(window: Window, name: str) -> list[dict]:
    lines = (Path(window.opened.folder) / "journal.jsonl").read_text().splitlines()
    return [event for event in map(json.loads, lines) if event["event"] == name]


def test_a_bench_before_its_session_says_what_the_protocol_is_and_that_everything_is_well(window: Window) -> None:
    assert window.opened.participant == "01" and len(window.opened.plan) == 60
    assert [check.name for check in window.snapshot.checks] == ["Device", "Hand", "Loop", "Disk", "Recording"]
    assert not {check.state for check in window.snapshot.checks} & {m.BAD, m.WAITING}
    assert window.snapshot.coming == window.opened.plan[0]


def test_a_trial_by_hand_has_a_row_for_every_millisecond_and_says_how_late_each_was(window: Window) -> None:
    began = time.monotonic()
    snapshot = window.start()
    run = snapshot.running
    hand, seen = SyntheticHand(run.segment, snapshot.tip), 0
    while window.snapshot.stage == m.RUNNING:
        window.look()
        rows = window.rows
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        window.client.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 1e-3 * (len(rows) - seen)))
        seen = len(rows)
        time.sleep(0.005)
    wall = time.monotonic() - began
    done = window.snapshot.rows[-1]
    assert (done.run, done.status) == (run.run, "done")
    kept = recording(window, run.run)
    assert kept.whole and 1e-3 * kept.rows <= wall
    assert np.array_equal(kept.column("t_s"), np.arange(kept.rows) * 1e-3)
    lateness = kept.column("lateness_us")
    assert np.all(lateness >= 0.0) and np.any(lateness > 0.0)
    timing = kept.outcome["timing"]
    assert timing["ticks"] == kept.rows and timing["lost"] == 0
    assert timing["max_us"] == lateness.max() and timing["p99_us"] == np.percentile(lateness, 99.0)
    assert timing["missed"] == np.count_nonzero(lateness >= 1000.0)
    assert timing["scheduling"].startswith("default")
    force = np.hypot(kept.column("hand_fx_N"), kept.column("hand_fy_N"))
    assert 0.5 < force.max() <= 40.0 + 1e-9
    off = ~kept.in_phase("move")
    assert all(not kept.column(f"current_{joint}_A")[off].any() for joint in kept.braked)
    window.look()
    shown = window.rows
    assert np.array_equal(shown[:, tick_log.TIP_X], kept.column("tip_x_m"))  # the window has seen every tick


def test_an_abort_keeps_its_reason_and_the_plan_goes_on(window: Window) -> None:
    run = window.start().running.run
    snapshot = window.abort("the participant asked")
    assert (snapshot.rows[-1].run, snapshot.rows[-1].status) == (run, "aborted")
    kept = recording(window, run)
    assert kept.whole and kept.outcome["reason"] == "the participant asked"
    assert kept.text("phase")[-1] == "end"
    assert snapshot.coming.run == run + 1
    pooled = read_table(Path(window.opened.folder).parent.parent / "trials.csv")
    assert [(r.run, r.status) for r in pooled] == [(r.run, r.status) for r in snapshot.rows]


def test_brakes_off_ends_the_trial_and_no_other_starts_until_they_are_allowed_again(window: Window) -> None:
    run = window.start().running.run
    window.client.brakes_off("Esc on the participant's side")
    snapshot = window.until(lambda s: s.stage == m.READY)
    assert recording(window, run).outcome["reason"] == "brakes off: Esc on the participant's side"
    assert snapshot.brakes_off == "Esc on the participant's side"
    assert snapshot.checks[0].state == m.BAD
    window.client.send(m.Start())
    snapshot = window.until(lambda s: s.said_bad)
    assert "Esc on the participant's side" in snapshot.said and snapshot.stage == m.READY
    stopped = snapshot.rows[-1]
    assert (stopped.run, stopped.status) == (run, "stopped") and cell(snapshot.coming) == cell(stopped)
    window.client.send(m.AllowBrakes())
    window.until(lambda s: not s.brakes_off)
    assert cell(window.start().running) == cell(stopped)  # nobody had to ask for it
    window.abort("enough")
    causes = [event.get("cause") for event in events(window, "brakes off")]
    assert causes == ["Esc on the participant's side"] and len(events(window, "brakes allowed")) == 1


def test_a_pause_lets_the_running_trial_end_and_no_other_begin(window: Window) -> None:
    window.start()
    window.client.send(m.Pause(True))
    window.client.send(m.Note("asked to move \n slower"))
    snapshot = window.until(lambda s: s.paused and s.notes)
    assert snapshot.stage == m.RUNNING and snapshot.notes[-1].endswith("asked to move slower")
    window.abort("enough")
    window.client.send(m.Start())
    assert "paused" in window.until(lambda s: s.said_bad).said
    window.client.send(m.Pause(False))
    window.until(lambda s: not s.paused)
    assert len(events(window, "paused")) == 1
    assert events(window, "resumed after a pause")[-1]["seconds"] >= 0.0
    assert [event["text"] for event in events(window, "note")] == ["asked to move slower"]


def test_the_handle_stays_when_the_pointer_is_elsewhere(window: Window) -> None:
    window.client.aim(0.3, 0.1)
    tip = window.start().tip
    window.until_tick(lambda rows: len(rows) > 100)
    assert not window.client.taken
    assert np.all(window.rows[:, tick_log.TIP_X] == tip[0]) and np.all(window.rows[:, tick_log.TIP_Y] == tip[1])
    window.client.aim(*tip)
    window.until_tick(lambda rows: window.client.taken)
    window.abort("enough")


def test_a_pointer_that_leaves_in_mid_movement_lets_go_and_the_trial_says_so(window: Window) -> None:
    snapshot = window.start()
    hand, rows = SyntheticHand(snapshot.running.segment, snapshot.tip), window.rows
    while np.count_nonzero(rows[:, tick_log.PHASE] == tick_log.MOVE) < 300:
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        window.client.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 0.01))
        time.sleep(0.01)
        window.look()
        rows = window.rows
    assert window.client.taken
    window.client.let_go()
    window.until_tick(lambda rows: not window.client.taken)
    window.client.aim(rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y] - 0.25)  # back, 250 mm away
    seen = len(window.rows)
    window.until_tick(lambda rows: len(rows) > seen + 100)
    assert not window.client.taken and not window.rows[seen:, tick_log.HAND_FX : tick_log.HAND_FY + 1].any()
    window.abort("enough")
    assert recording(window, snapshot.running.run).outcome["hand_left"] == 1


def test_what_cannot_be_is_refused_in_a_sentence(window: Window) -> None:
    for intent, says in (
        (m.Open("02"), "A session is open."),
        (m.Confirm(), "A session is open."),
        (m.Answers({"effort": 3.0}), "A session is open."),
    ):
        window.client.send(intent)
        window.until(lambda s, says=says: s.said_bad and s.said == says)
    assert window.snapshot.stage == m.READY


def test_another_process_cannot_have_the_data_folder_meanwhile(window: Window, setup: Setup) -> None:
    with pytest.raises(Exception, match="in use by a running process"):
        hold_lock(setup.data_dir)


def test_proof_of_recording_grows_while_a_trial_runs(window: Window) -> None:
    began = time.monotonic()
    run = window.start().running.run
    name = f"run-{run:03d}.arrows"
    window.until(lambda s: window.pulse and (proof := window.pulse.proof) and proof.name == name and proof.rows > 0)
    first = window.pulse.proof
    window.until(lambda s: window.pulse.proof and window.pulse.proof.rows > first.rows)
    assert window.pulse.proof.bytes > first.bytes
    assert 0.0 <= window.pulse.proof.age_s < time.monotonic() - began
    assert window.pulse.timing.p99_us >= window.pulse.timing.p50_us >= 0.0
    assert window.pulse.verified == sum(bool(r.recording) for r in window.snapshot.rows)
    window.abort("enough")


def test_a_window_that_hangs_changes_nothing_and_then_hears_how_things_are(window: Window) -> None:
    run = window.start().running.run
    time.sleep(1.2)  # hangs: reads nothing, while pulses and ticks come
    snapshot = window.abort("enough")
    assert snapshot.rows[-1].run == run
    kept = recording(window, run)
    assert kept.whole and kept.rows > 1000 and kept.outcome["timing"]["lost"] == 0


def test_a_window_that_quits_in_a_trial_ends_it_and_leaves_nothing_running(setup: Setup, window: Window) -> None:
    run = window.start().running.run
    pids = window.processes()
    window.client.stop("the window was closed")
    wait_until(lambda: all(map(gone, pids)))
    kept = recording(window, run)
    assert kept.whole and kept.outcome["reason"] == "the window was closed"
    window.join(setup)
    assert window.until_stage(m.NO_SESSION).resumable == ("01",)
    window.client.send(m.Open("01", resume=True))
    assert window.until_stage(m.READY).rows[-1].run == run


def test_a_bench_that_recorded_nothing_leaves_nothing(tmp_path: Path) -> None:
    setup = Setup(tmp_path / "new" / "data", real_time=False)
    with live_window(setup) as opened:
        opened.until_stage(m.NO_SESSION)
        opened.client.send(m.Sandbox())
        opened.until_stage(m.RUNNING)
        assert opened.snapshot.practice and opened.snapshot.running.block == 0
        opened.until(lambda s: opened.pulse)
        assert opened.pulse.proof is None
        opened.client.send(m.EndSandbox())
        opened.until_stage(m.NO_SESSION)
    assert not setup.data_dir.exists()


def test_a_folder_that_another_process_has_is_refused(tmp_path: Path) -> None:
    lock = hold_lock(tmp_path)
    window = Window(Setup(tmp_path, real_time=False))
    window.until_stage(m.FAILED)
    assert "in use by a running process" in window.snapshot.said and not window.client.alive
    lock.release()
