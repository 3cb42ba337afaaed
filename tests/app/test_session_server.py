"""The session server from its window's side, in simulated time: trials, refusals, brakes-off, what it says."""

import time
from pathlib import Path

import numpy as np
import pytest
from live import Window
from protocols import PAPER
from sessions import unfinished
from simulated_loop import local_window
from synthetic_hand import SyntheticHand

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.store.cells import cell
from experiments.store.session import Participant, Session
from tests.support.rows import read_rows


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory):
    """One session after another test: each goes on where the last one ended."""
    with local_window(Setup(tmp_path_factory.mktemp("served") / "data", sync=False)) as opened:
        opened.open()
        yield opened


def test_an_abort_keeps_its_reason_and_the_plan_goes_on(window: Window) -> None:
    run = window.start().running.run
    snapshot = window.abort("the participant asked")
    assert (snapshot.rows[-1].run, snapshot.rows[-1].status) == (run, "aborted")
    kept = window.recording(run)
    assert kept.whole and kept.outcome["reason"] == "the participant asked"
    assert kept.text("phase")[-1] == "end"
    assert snapshot.coming.run == run + 1
    table = read_rows(Path(window.opened.folder) / "trials.csv")
    assert [(r.run, r.status) for r in table] == [(r.run, r.status) for r in snapshot.rows]


def test_brakes_off_ends_the_trial_and_no_other_starts_until_they_are_allowed_again(window: Window) -> None:
    run = window.start().running.run
    window.client.brakes_off("Esc on the participant's side")
    snapshot = window.until(lambda s: s.stage == m.READY)
    assert window.recording(run).outcome["reason"] == "brakes off: Esc on the participant's side"
    assert snapshot.brakes_off == "Esc on the participant's side"
    assert snapshot.checks[0].state == m.BAD
    window.client.send(m.Start())
    snapshot = window.until(lambda s: s.notice_bad)
    assert "Esc on the participant's side" in snapshot.notice and snapshot.stage == m.READY
    stopped = snapshot.rows[-1]
    assert (stopped.run, stopped.status) == (run, "stopped") and cell(snapshot.coming) == cell(stopped)
    window.client.send(m.AllowBrakes())
    window.until(lambda s: not s.brakes_off)
    assert cell(window.start().running) == cell(stopped)  # nobody had to ask for it
    window.abort("enough")
    causes = [event.get("cause") for event in window.events("brakes off")]
    assert causes == ["Esc on the participant's side"] and len(window.events("brakes allowed")) == 1


def test_a_pause_lets_the_running_trial_end_and_no_other_begin(window: Window) -> None:
    window.start()
    window.client.send(m.Pause(True))
    window.client.send(m.Note("asked to move \n slower"))
    snapshot = window.until(lambda s: s.paused and s.notes)
    assert snapshot.stage == m.RUNNING and snapshot.notes[-1].endswith("asked to move slower")
    window.abort("enough")
    window.client.send(m.Start())
    assert "paused" in window.until(lambda s: s.notice_bad).notice
    window.client.send(m.Pause(False))
    window.until(lambda s: not s.paused)
    assert len(window.events("paused")) == 1
    assert window.events("resumed after a pause")[-1]["seconds"] >= 0.0
    assert [event["text"] for event in window.events("note")] == ["asked to move slower"]


def test_a_pointer_that_leaves_in_mid_movement_lets_go_and_the_trial_says_so(window: Window) -> None:
    snapshot = window.start()
    hand, rows = SyntheticHand(snapshot.running.path, snapshot.tip), window.rows
    while np.count_nonzero(rows[:, tick_log.PHASE] == tick_log.MOVE) < 300:
        tip = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y])
        window.client.ring.aim(*hand(tip, int(rows[-1, tick_log.PHASE]), 0.01))
        time.sleep(0.01)
        window.look()
        rows = window.rows
    assert window.client.taken
    window.client.ring.let_go()
    window.until_tick(lambda rows: not window.client.taken)
    window.client.ring.aim(rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y] - 0.25)  # back, 250 mm away
    seen = len(window.rows)
    window.until_tick(lambda rows: len(rows) > seen + 100)
    assert not window.client.taken and not window.rows[seen:, tick_log.HAND_FX : tick_log.HAND_FY + 1].any()
    window.abort("enough")
    assert window.recording(snapshot.running.run).outcome["hand_left"] == 1


def test_what_cannot_be_is_refused_in_a_sentence(window: Window) -> None:
    for intent, says in (
        (m.Open("02"), "A session is open."),
        (m.Confirm(), "A session is open."),
        (m.Answers({"effort": 3.0}), "A session is open."),
    ):
        window.client.send(intent)
        window.until(lambda s, says=says: s.notice_bad and s.notice == says)
    assert window.snapshot.stage == m.READY


def test_trials_with_another_hand_are_not_mixed_into_a_session(tmp_path: Path) -> None:
    Session(tmp_path / "data", Participant("01", "force sensor"), PAPER, sync=False).close()
    with local_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.until_stage(m.NO_SESSION)
        seen.client.send(m.Open("01", resume=True))
        said = seen.until_stage(m.READY)
        assert said.notice_bad and "a device on the bench" in said.notice and "mouse" in said.notice
        seen.client.send(m.Start())
        seen.until(lambda s: s.notice_bad and s.notice.startswith("This session was begun with"))
        seen.client.send(m.Note("opened by mistake"))
        assert seen.until(lambda s: s.notes).rows == ()
    assert not any((tmp_path / "data").rglob("run-*"))


def test_a_session_whose_hand_nobody_knows_is_opened_and_not_gone_on_with(tmp_path: Path) -> None:
    Session(tmp_path / "data", Participant("01", "a foot"), PAPER, sync=False).close()
    with local_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.until_stage(m.NO_SESSION)
        seen.client.send(m.Open("01", resume=True))
        assert seen.until(lambda s: "'a foot'" in s.notice).stage == m.NO_SESSION


def test_a_session_is_not_left_in_mid_trial_and_what_it_recorded_stays(tmp_path: Path) -> None:
    with local_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.open()
        seen.client.send(m.Start())
        seen.until_stage(m.RUNNING)
        seen.client.send(m.Leave())
        refused = seen.until(lambda s: s.notice_bad)
        assert refused.stage == m.RUNNING and refused.notice == "A trial is running." and not refused.can_leave
        seen.client.send(m.Abort("enough", again="now"))
        assert seen.until_stage(m.READY).can_leave
        seen.client.send(m.Leave())
        assert not seen.until_stage(m.NO_SESSION).can_leave
        seen.client.send(m.Open("01", resume=True))
        assert [row.status for row in seen.until(lambda s: s.rows).rows] == ["redone"]
        run = seen.start().running.run
        seen.client.stop("the window was closed")
        assert seen.recording(run).whole and seen.recording(run).outcome["reason"] == "the window was closed"
    assert unfinished(tmp_path / "data") == ("01",)


def test_a_studys_folder_takes_no_other_session(tmp_path: Path) -> None:
    (tmp_path / "study.db").touch()
    with local_window(Setup(tmp_path, sync=False)) as seen:
        seen.until_stage(m.NO_SESSION)
        seen.client.send(m.Open("03"))
        assert "holds a study, which takes no other session" in seen.until(lambda s: s.notice_bad).notice
    assert not list(tmp_path.glob("sub-*"))
