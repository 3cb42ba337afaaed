"""A live bench from a window's side: trials, refusals, brakes-off; and that a slow window changes nothing."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from live import Window, gone, wait_until, window
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
def bench(setup: Setup):
    with window(setup) as opened:
        opened.open()
        yield opened


def recording(bench: Window, run: int) -> Recording:
    return read_recording(Path(bench.opened.folder) / "trials" / f"run-{run:03d}.parquet")


def events(bench: Window, name: str) -> list[dict]:
    lines = (Path(bench.opened.folder) / "journal.jsonl").read_text().splitlines()
    return [event for event in map(json.loads, lines) if event["event"] == name]


def test_a_bench_before_its_session_says_what_the_protocol_is_and_that_everything_is_well(bench: Window) -> None:
    assert bench.opened.participant == "01" and len(bench.opened.plan) == 60
    assert [check.name for check in bench.snapshot.checks] == ["Device", "Hand", "Loop", "Disk", "Recording"]
    assert not {check.state for check in bench.snapshot.checks} & {m.BAD, m.WAITING}
    assert bench.snapshot.coming == bench.opened.plan[0]


def test_a_trial_by_hand_has_a_row_for_every_millisecond_and_says_how_late_each_was(bench: Window) -> None:
    began = time.monotonic()
    snapshot = bench.start()
    run = snapshot.running
    hand, seen = SyntheticHand(run.segment, snapshot.tip), 0
    while bench.snapshot.stage == m.RUNNING:
        bench.look()
        rows = bench.rows
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        bench.bench.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 1e-3 * (len(rows) - seen)))
        seen = len(rows)
        time.sleep(0.005)
    wall = time.monotonic() - began
    done = bench.snapshot.rows[-1]
    assert (done.run, done.status) == (run.run, "done")
    kept = recording(bench, run.run)
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
    bench.look()
    shown = bench.rows
    assert np.array_equal(shown[:, tick_log.TIP_X], kept.column("tip_x_m"))  # the window has seen every tick


def test_an_abort_keeps_its_reason_and_the_plan_goes_on(bench: Window) -> None:
    run = bench.start().running.run
    snapshot = bench.abort("the participant asked")
    assert (snapshot.rows[-1].run, snapshot.rows[-1].status) == (run, "aborted")
    kept = recording(bench, run)
    assert kept.whole and kept.outcome["reason"] == "the participant asked"
    assert kept.text("phase")[-1] == "end"
    assert snapshot.coming.run == run + 1
    pooled = read_table(Path(bench.opened.folder).parent.parent / "trials.csv")
    assert [(r.run, r.status) for r in pooled] == [(r.run, r.status) for r in snapshot.rows]


def test_brakes_off_ends_the_trial_and_no_other_starts_until_they_are_allowed_again(bench: Window) -> None:
    run = bench.start().running.run
    bench.bench.brakes_off("Esc on the participant's side")
    snapshot = bench.until(lambda s: s.stage == m.READY)
    assert recording(bench, run).outcome["reason"] == "brakes off: Esc on the participant's side"
    assert snapshot.brakes_off == "Esc on the participant's side"
    assert snapshot.checks[0].state == m.BAD
    bench.bench.send(m.Start())
    snapshot = bench.until(lambda s: s.said_bad)
    assert "Esc on the participant's side" in snapshot.said and snapshot.stage == m.READY
    stopped = snapshot.rows[-1]
    assert (stopped.run, stopped.status) == (run, "stopped") and cell(snapshot.coming) == cell(stopped)
    bench.bench.send(m.AllowBrakes())
    bench.until(lambda s: not s.brakes_off)
    assert cell(bench.start().running) == cell(stopped)  # nobody had to ask for it
    bench.abort("enough")
    causes = [event.get("cause") for event in events(bench, "brakes off")]
    assert causes == ["Esc on the participant's side"] and len(events(bench, "brakes allowed")) == 1


def test_a_pause_lets_the_running_trial_end_and_no_other_begin(bench: Window) -> None:
    bench.start()
    bench.bench.send(m.Pause(True))
    bench.bench.send(m.Note("asked to move \n slower"))
    snapshot = bench.until(lambda s: s.paused and s.notes)
    assert snapshot.stage == m.RUNNING and snapshot.notes[-1].endswith("asked to move slower")
    bench.abort("enough")
    bench.bench.send(m.Start())
    assert "paused" in bench.until(lambda s: s.said_bad).said
    bench.bench.send(m.Pause(False))
    bench.until(lambda s: not s.paused)
    assert len(events(bench, "paused")) == 1
    assert events(bench, "resumed after a pause")[-1]["seconds"] >= 0.0
    assert [event["text"] for event in events(bench, "note")] == ["asked to move slower"]


def test_the_handle_stays_when_the_pointer_is_elsewhere(bench: Window) -> None:
    bench.bench.aim(0.3, 0.1)
    tip = bench.start().tip
    bench.until_tick(lambda rows: len(rows) > 100)
    assert not bench.bench.taken
    assert np.all(bench.rows[:, tick_log.TIP_X] == tip[0]) and np.all(bench.rows[:, tick_log.TIP_Y] == tip[1])
    bench.bench.aim(*tip)
    bench.until_tick(lambda rows: bench.bench.taken)
    bench.abort("enough")


def test_a_pointer_that_leaves_in_mid_movement_lets_go_and_the_trial_says_so(bench: Window) -> None:
    snapshot = bench.start()
    hand, rows = SyntheticHand(snapshot.running.segment, snapshot.tip), bench.rows
    while np.count_nonzero(rows[:, tick_log.PHASE] == tick_log.MOVE) < 300:
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        bench.bench.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 0.01))
        time.sleep(0.01)
        bench.look()
        rows = bench.rows
    assert bench.bench.taken
    bench.bench.let_go()
    bench.until_tick(lambda rows: not bench.bench.taken)
    bench.bench.aim(rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y] - 0.25)  # back, 250 mm away
    seen = len(bench.rows)
    bench.until_tick(lambda rows: len(rows) > seen + 100)
    assert not bench.bench.taken and not bench.rows[seen:, tick_log.HAND_FX : tick_log.HAND_FY + 1].any()
    bench.abort("enough")
    assert recording(bench, snapshot.running.run).outcome["hand_left"] == 1


def test_what_cannot_be_is_refused_in_a_sentence(bench: Window) -> None:
    for intent, says in (
        (m.Open("02"), "A session is open."),
        (m.Confirm(), "A session is open."),
        (m.Answers({"effort": 3.0}), "A session is open."),
    ):
        bench.bench.send(intent)
        bench.until(lambda s, says=says: s.said_bad and s.said == says)
    assert bench.snapshot.stage == m.READY


def test_another_process_cannot_have_the_data_folder_meanwhile(bench: Window, setup: Setup) -> None:
    with pytest.raises(Exception, match="in use by a running process"):
        hold_lock(setup.data_dir)


def test_proof_of_recording_grows_while_a_trial_runs(bench: Window) -> None:
    began = time.monotonic()
    run = bench.start().running.run
    name = f"run-{run:03d}.arrows"
    bench.until(lambda s: bench.pulse and (proof := bench.pulse.proof) and proof.name == name and proof.rows > 0)
    first = bench.pulse.proof
    bench.until(lambda s: bench.pulse.proof and bench.pulse.proof.rows > first.rows)
    assert bench.pulse.proof.bytes > first.bytes
    assert 0.0 <= bench.pulse.proof.age_s < time.monotonic() - began
    assert bench.pulse.timing.p99_us >= bench.pulse.timing.p50_us >= 0.0
    assert bench.pulse.verified == sum(bool(r.recording) for r in bench.snapshot.rows)
    bench.abort("enough")


def test_a_window_that_hangs_changes_nothing_and_then_hears_how_things_are(bench: Window) -> None:
    run = bench.start().running.run
    time.sleep(1.2)  # hangs: reads nothing, while pulses and ticks come
    snapshot = bench.abort("enough")
    assert snapshot.rows[-1].run == run
    kept = recording(bench, run)
    assert kept.whole and kept.rows > 1000 and kept.outcome["timing"]["lost"] == 0


def test_a_window_that_quits_in_a_trial_ends_it_and_leaves_nothing_running(setup: Setup, bench: Window) -> None:
    run = bench.start().running.run
    pids = bench.processes()
    bench.bench.stop("the window was closed")
    wait_until(lambda: all(map(gone, pids)))
    kept = recording(bench, run)
    assert kept.whole and kept.outcome["reason"] == "the window was closed"
    bench.join(setup)
    assert bench.until_stage(m.NO_SESSION).resumable == ("01",)
    bench.bench.send(m.Open("01", resume=True))
    assert bench.until_stage(m.READY).rows[-1].run == run


def test_a_bench_that_recorded_nothing_leaves_nothing(tmp_path: Path) -> None:
    setup = Setup(tmp_path / "new" / "data", real_time=False)
    with window(setup) as opened:
        opened.until_stage(m.NO_SESSION)
        opened.bench.send(m.Practice())
        opened.until_stage(m.RUNNING)
        assert opened.snapshot.practice and opened.snapshot.running.block == 0
        opened.until(lambda s: opened.pulse)
        assert opened.pulse.proof is None
        opened.abort("enough")
    assert not setup.data_dir.exists()


def test_a_folder_that_another_process_has_is_refused(tmp_path: Path) -> None:
    lock = hold_lock(tmp_path)
    bench = Window(Setup(tmp_path, real_time=False))
    bench.until_stage(m.FAILED)
    assert "in use by a running process" in bench.snapshot.said and not bench.bench.alive
    lock.release()
