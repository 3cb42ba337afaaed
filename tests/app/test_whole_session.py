"""A whole session in simulated time, as short as a protocol can make it: practice, redo, skip, questions, break,
re-rig, an interruption, the key of a blind session, the next participant. One window: each test goes on where the last
one ended.
"""

import re
import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest
from live import Window
from protocols import PAPER, changed
from sessions import unfinished
from simulated_loop import local_window
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from experiments.store.cells import cell
from experiments.store.overview import scan_folder
from experiments.store.recording import read_recording
from experiments.store.verify import verify
from tests.support.rows import read_rows

LEAST_S = 1.0  # of a break


def protocol_text() -> str:
    """Two controllers on one path of two devices, two blocks; a trial ends as soon as it has begun."""
    text = changed(
        PAPER.text, blocks="2", practice_trials="1", blind="true", hold_s="0.0", start_radius_m="0.3",
        end_radius_m="0.3", end_s="0.2", on="true",
    )  # fmt: skip
    text = re.sub(r"\[\[path\]\]\s*number = 2\n(.+\n)+", "", text)
    text = re.sub(r"\[\[controller\]\]\s*number = [345]\n(.+\n)+", "", text)
    return f"{text}\n[breaks]\nafter_trials = 2\nleast_s = {LEAST_S}\n"


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    folder = tmp_path_factory.mktemp("session")
    (folder / "short.toml").write_text(protocol_text(), encoding="utf-8")
    return Setup(folder / "data", str(folder / "short.toml"), real_time=False, participant="07")


@pytest.fixture(scope="module")
def window(setup: Setup):
    with local_window(setup) as opened:
        yield opened


def ask(window: Window, intent: object, what: Callable[[m.Snapshot], object]) -> m.Snapshot:
    window.client.send(intent)
    return window.until(what)


def refused(window: Window, intent: object, says: str) -> None:
    assert says in ask(window, intent, lambda s: s.notice_bad and says in s.notice).notice


def run_one(window: Window) -> m.Snapshot:
    """One trial from its start to what comes after it."""
    window.start()
    window.touch()
    return window.until(lambda s: s.stage != m.RUNNING)


def answer(window: Window) -> m.Snapshot:
    assert window.snapshot.stage == m.QUESTIONS
    return ask(window, m.Answers({"effort": 35.0}), lambda s: s.stage != m.QUESTIONS)


def test_a_first_try_is_with_a_controller_that_brakes(window: Window) -> None:
    window.until_stage(m.NO_SESSION)
    assert window.opened.hand == "mouse"
    window.client.send(m.SetSandbox())
    tried = window.touch().running
    assert window.opened.protocol.controllers[tried.controller].kind != "none" and tried.block == 0
    window.client.send(m.EndSandbox())
    window.until_stage(m.NO_SESSION)


def test_practice_comes_first_and_counts_nowhere(window: Window) -> None:
    snapshot = window.open("07")
    assert snapshot.blind and snapshot.practice and snapshot.coming.block == 0
    assert {trial.controller for trial in window.opened.plan} == {"K1", "K2"} and len(window.opened.plan) == 8
    snapshot = run_one(window)
    assert snapshot.rows == () and snapshot.coming == window.opened.plan[0] and not snapshot.practice
    practised = Path(window.opened.folder) / "practice" / "run-001.parquet"
    assert read_recording(practised).metadata["block"] == 0
    assert not (Path(window.opened.folder) / "trials.csv").exists()


def test_a_trial_that_is_redone_is_kept_and_its_cell_comes_again_under_a_new_number(window: Window) -> None:
    assert [row.status for row in run_one(window).rows] == ["done"]
    kept = Path(window.opened.folder) / "trials" / "run-001.parquet"
    before = kept.read_bytes()
    snapshot = ask(window, m.Redo(1, "a door slammed"), lambda s: s.rows[0].status == "redone")
    first = window.opened.plan[0]
    assert cell(snapshot.coming) == cell(first) and snapshot.coming.run not in {t.run for t in window.opened.plan}
    refused(window, m.Redo(1, "again"), "run 1")
    snapshot = run_one(window)
    assert [(row.run, row.status) for row in snapshot.rows] == [(1, "redone"), (9, "done")]
    assert kept.read_bytes() == before and snapshot.coming == window.opened.plan[1]
    assert [event["reason"] for event in window.events("redone")] == ["a door slammed"]


def test_after_a_block_come_the_questions_and_then_the_break_which_lasts_its_time(window: Window) -> None:
    ask(window, m.Pause(True), lambda s: s.paused)
    refused(window, m.Start(), "paused")
    ask(window, m.Note("sits nearer now"), lambda s: s.notes)
    ask(window, m.Pause(False), lambda s: not s.paused)
    run_one(window)
    snapshot = answer(window)
    assert snapshot.stage == m.BREAK and 0.0 <= snapshot.card.wait_s <= LEAST_S
    refused(window, m.Start(), "break")
    wait_until(lambda: ask(window, m.Confirm(), lambda s: s.stage == m.READY or "more" in s.notice).stage == m.READY)
    trial, rest = (window.events(name)[-1]["time"] for name in ("trial ended", "break ended"))
    assert (datetime.fromisoformat(rest) - datetime.fromisoformat(trial)).total_seconds() > LEAST_S - 0.01
    (answers,) = window.events("answers")
    assert (answers["configuration"], answers["block"], answers["values"]) == ("three-brake", 1, {"effort": 35.0})


def test_a_skipped_trial_is_marked_and_a_re_rig_waits_to_be_confirmed(window: Window) -> None:
    skipped = window.snapshot.coming
    snapshot = ask(window, m.Skip("short of time"), lambda s: s.rows[-1].status == "skipped")
    assert snapshot.rows[-1].run == skipped.run and snapshot.rows[-1].recording == ""
    run_one(window)
    snapshot = answer(window)
    assert snapshot.stage == m.RERIG and "four-brake" in snapshot.card.text
    refused(window, m.Start(), "re-rigged")
    snapshot = ask(window, m.Confirm(), lambda s: s.stage == m.READY)
    assert snapshot.coming.configuration == "four-brake" and snapshot.coming.block == 0
    snapshot = ask(window, m.Skip("knows it already"), lambda s: s.coming.block)
    assert len(snapshot.rows) == 5 and snapshot.coming == window.opened.plan[4]


def test_redoing_a_trial_of_the_other_configuration_needs_that_one_on_the_bench(window: Window) -> None:
    run = window.opened.plan[1].run
    snapshot = ask(window, m.Redo(run, "the arm was loose"), lambda s: s.stage == m.RERIG)
    assert snapshot.coming.configuration == "three-brake"
    ask(window, m.Confirm(), lambda s: s.stage == m.READY)
    snapshot = run_one(window)
    assert snapshot.stage == m.RERIG and snapshot.coming.configuration == "four-brake"  # nothing is asked twice
    assert ask(window, m.Confirm(), lambda s: s.stage == m.READY).coming == window.opened.plan[4]


def test_an_interrupted_session_goes_on_where_it_was(window: Window, setup: Setup) -> None:
    run_one(window)
    before, opened = window.snapshot, window.opened
    window.client.leave()
    window.join(setup._replace(participant=""))
    window.until_stage(m.NO_SESSION)
    assert unfinished(setup.data_dir) == ("07",)
    snapshot = ask(window, m.Open("07", resume=True), lambda s: s.stage == m.READY)
    assert (snapshot.rows, snapshot.coming, snapshot.notes) == (before.rows, before.coming, before.notes)
    assert snapshot.blind and window.opened.plan == opened.plan and window.opened.plan_sha256 == opened.plan_sha256


def test_the_key_of_a_finished_session_is_opened_by_somebody_with_a_name(window: Window) -> None:
    while window.snapshot.stage != m.FINISHED:
        if window.snapshot.stage == m.READY:
            run_one(window)
        elif window.snapshot.stage == m.QUESTIONS:
            answer(window)
        else:
            ask(window, m.Confirm(), lambda s: s.stage != m.BREAK or "more" in s.notice)
    window.client.send(m.Leave())  # the key may wait
    window.until_stage(m.NO_SESSION)
    window.client.send(m.Open("07", resume=True))
    assert window.until_stage(m.FINISHED).blind
    refused(window, m.Unblind(" "), "say who")
    snapshot = ask(window, m.Unblind("R. Book"), lambda s: not s.blind)
    assert {trial.controller for trial in window.opened.plan} == {1, 2}
    assert {row.controller for row in snapshot.rows} == {1, 2}
    assert [event["who"] for event in window.events("unblinded")] == ["R. Book"]
    pooled = read_rows(Path(window.opened.folder) / "trials.csv")
    assert {row.controller for row in pooled} == {1, 2} and len(pooled) == len(snapshot.rows)
    settled = [row for row in snapshot.rows if row.status not in ("redone", "recovered")]
    assert sorted(map(cell, settled)) == sorted(map(cell, window.opened.plan))


def test_what_somebody_did_to_another_session_stops_nobody(window: Window, setup: Setup) -> None:
    for number, text in enumerate((b"{", b"SQLite format 3\0", b"\xff" * 5000)):
        folder = setup.data_dir / f"sub-x{number}" / "ses-01"
        (folder / "trials").mkdir(parents=True)
        (folder / "session.db").write_bytes(text * 3000)
    damaged = {one.participant for one in scan_folder(setup.data_dir).sessions if one.problem}
    assert damaged == {"x0", "x1", "x2"}
    window.client.send(m.Redo(window.snapshot.rows[-1].run, "see what the others do"))
    snapshot = window.until(lambda s: s.stage != m.FINISHED)
    assert not snapshot.notice_bad
    while window.snapshot.stage == m.RERIG:
        ask(window, m.Confirm(), lambda s: s.stage != m.RERIG)
    assert run_one(window).stage == m.FINISHED
    for folder in setup.data_dir.glob("sub-x*"):
        shutil.rmtree(folder)


def test_the_next_participant_has_a_session_of_their_own(window: Window, setup: Setup) -> None:
    window.client.send(m.Leave())
    snapshot = window.until_stage(m.NO_SESSION)
    assert unfinished(setup.data_dir) == () and window.opened.participant == ""
    refused(window, m.Open("07"), "exists already")
    snapshot = window.open("01")
    assert snapshot.rows == () and snapshot.notes == () and window.opened.plan[0].configuration == "three-brake"
    window.client.send(m.Leave())  # before its end: it can be gone on with
    window.until_stage(m.NO_SESSION)
    assert unfinished(setup.data_dir) == ("01",)
    assert verify(setup.data_dir)["faults"] == []
