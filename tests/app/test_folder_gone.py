"""The data folder goes while a session is open: what is in memory is said, kept, and written when there is a place."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from disks import full
from live import Window
from sessions import files
from simulated_loop import LocalWindow, local_window

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.session_server import storage as storage_module
from core import tick_log
from experiments.inputs import OPERATOR
from experiments.plan import counted
from experiments.recording.reader import read_recording
from experiments.session.files import cell, rows_of
from experiments.session.journal import MOVED, NOTE, read_events
from experiments.session.verify import verify

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no folder that is in use")


@pytest.fixture
def window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalWindow]:
    monkeypatch.setattr(storage_module, "RETRY_S", 0.0)
    monkeypatch.setattr("experiments.recording.writer.WRITE_INTERVAL_S", 0.0)  # the time of the trial is simulated
    with local_window(Setup(tmp_path / "data", sync=False, hand=OPERATOR)) as opened:
        opened.open()
        yield opened


def session_in(data: Path) -> Path:
    return data / "sub-01" / "ses-01"


def begin(window: Window, ticks: int = 500) -> int:
    """A trial that has so many ticks; its run."""
    run = window.start().running.run
    window.until_tick(lambda rows: len(rows) >= ticks)
    return run


def done(window: Window) -> m.Snapshot:
    """A trial, to its row."""
    begun = begin(window)
    return window.until(lambda s: s.stage == m.READY and any(row.run == begun for row in s.rows))


def refused(window: Window, command: object) -> str:
    window.client.send(command)
    window.look()
    assert window.snapshot.stage == m.READY and window.snapshot.notice_bad
    return window.snapshot.notice


@pytest.mark.parametrize("what", ["data", "data/sub-01/ses-01"])
def test_a_folder_that_goes_in_mid_trial_and_comes_back_costs_no_tick(window, tmp_path, what):
    kept = done(window).rows
    run = begin(window)
    gone = tmp_path / what
    gone.rename(tmp_path / "away")
    said = window.until(lambda s: s.not_written)
    assert said.stage == m.RUNNING and "The trial goes on, and its ticks are kept in memory" in said.notice
    said = window.until(lambda s: s.stage == m.READY)
    ticks = len(window.rows)
    assert said.in_memory == f"run {run}, {counted(ticks, 'tick')}"
    assert f"{gone} is gone" in said.notice and "kept" not in said.notice and "are in memory" in said.notice
    assert [check.state for check in said.checks if check.name == "Recording"] == [m.BAD]
    assert said.rows == kept
    assert "is gone" in refused(window, m.Start())
    window.client.send(m.Note("the lamp went out"))
    window.until(lambda s: "line" in s.in_memory)
    assert not gone.exists(), "nothing was written into a folder that is none of ours"
    (tmp_path / "away").rename(gone)
    said = window.until(lambda s: not s.not_written)
    assert said.in_memory == "" and [row.status for row in said.rows] == ["done", "done"]
    assert window.recording(run).rows == ticks and window.recording(run).outcome["status"] == "done"
    assert window.recording(run).columns["t_s"][-1] == window.rows[-1, tick_log.T]
    assert [line.about["text"] for line in read_events(session_in(tmp_path / "data")) if line.event is NOTE] == [
        "the lamp went out"
    ]
    assert said.coming.run == run + 1
    assert verify(tmp_path / "data")["faults"] == []


def test_a_folder_that_is_deleted_in_mid_trial_is_gone_on_with_in_another(window, tmp_path):
    done(window)
    run = begin(window)
    shutil.rmtree(session_in(tmp_path / "data") / "trials")
    said = window.until(lambda s: s.stage == m.READY)
    ticks = len(window.rows)
    assert "are in memory" in said.notice and len(said.rows) == 1
    other = tmp_path / "other"
    window.client.send(m.MoveTo(str(other)))
    said = window.until(lambda s: s.moved)
    assert said.moved == (str(other), "01") and said.stage == m.NO_SESSION and said.in_memory == "" == said.not_written
    assert (
        "1 recording could not be copied from" in said.notice and "phd verify" in said.notice
    )  # of the first trial, that was deleted
    kept = read_recording(session_in(other) / "trials" / f"run-{run:03d}.parquet")
    assert kept.whole and kept.rows == ticks
    assert [(row.run, row.status) for row in rows_of(session_in(other))] == [(1, "done"), (run, "done")]
    assert [line.event for line in read_events(session_in(other))].count(MOVED) == 1
    faults = verify(other)["faults"]
    assert faults and all("run-001" in str(fault) for fault in faults), faults  # that, and nothing else, is missing
    with local_window(Setup(other, sync=False, hand=OPERATOR)) as there:
        there.until_stage(m.NO_SESSION)
        there.client.send(m.Open("01", resume=True))
        said = there.until_stage(m.READY)
        assert not said.not_written and [row.run for row in said.rows] == [1, run] and said.coming.run == run + 1


def test_between_two_trials_nothing_starts_in_a_folder_that_is_gone_nor_in_an_empty_one_of_its_name(window, tmp_path):
    first = done(window).rows[0]
    trials = session_in(tmp_path / "data") / "trials"
    shutil.rmtree(trials)
    assert f"{trials} is gone, with the 1 recording in it" in refused(window, m.Start())
    trials.mkdir()
    assert "run-001.parquet is gone" in refused(window, m.Start())
    assert not any(trials.iterdir()) and window.snapshot.rows == (first,)
    assert window.snapshot.coming.run == 2 and cell(window.snapshot.coming) != cell(first)


def test_a_folder_of_another_session_in_the_place_of_ours_is_not_written_to(window, tmp_path):
    done(window)
    session = session_in(tmp_path / "data")
    session.rename(tmp_path / "away")
    with local_window(Setup(tmp_path / "second", sync=False, hand=OPERATOR)) as other:
        other.open()
    shutil.copytree(session_in(tmp_path / "second"), session)
    before = files(session)
    assert "is another session's now" in refused(window, m.Start())
    window.client.send(m.Note("whose is this?"))
    for _ in range(5):
        window.look()
    window.client.send(m.Leave())
    window.look()
    assert window.snapshot.in_memory == "1 line of the journal" and files(session) == before


def test_where_only_the_trials_are_gone_what_is_in_memory_is_written_when_the_program_ends(window, tmp_path):
    run = begin(window)
    trials = session_in(tmp_path / "data") / "trials"
    shutil.rmtree(trials)
    window.until(lambda s: s.stage == m.READY)
    window.client.state.end("the window was closed")
    assert window.client.state.snapshot().stage != m.FAILED
    assert read_recording(trials / f"run-{run:03d}.parquet").rows == len(window.rows)


def test_a_session_on_a_full_disk_goes_on_whole_in_another_folder(window, tmp_path, monkeypatch):
    done(window)
    begun = begin(window)
    with monkeypatch.context() as patch:
        patch.setattr("experiments.recording.writer.append_whole", full)
        patch.setattr("experiments.recording.writer.replace_file", full)
        patch.setattr("experiments.session.journal.append_whole", full)
        said = window.until(lambda s: s.stage == m.READY)
        assert "No space left" in said.notice and "Make room" in said.notice and f"run {begun}" in said.in_memory
    monkeypatch.setattr(storage_module, "RETRY_S", 1e9)  # the old one stays full
    window.client.send(m.MoveTo(str(tmp_path / "other")))
    said = window.until(lambda s: s.moved)
    assert "stayed" not in said.notice and verify(tmp_path / "other")["faults"] == []
    assert [row.status for row in rows_of(session_in(tmp_path / "other"))] == ["done", "done"]


def test_a_folder_that_cannot_take_the_session_is_refused_and_nothing_is_left_there(window, tmp_path, monkeypatch):
    done(window)
    begin(window)
    shutil.rmtree(tmp_path / "data")
    said = window.until(lambda s: s.stage == m.READY)
    taken = tmp_path / "taken"
    session_in(taken).mkdir(parents=True)
    (tmp_path / "file").touch()
    for folder, says in (
        (taken, "exists already"), (tmp_path / "file", "cannot be used"), (tmp_path / "data", "choose another"),
    ):  # fmt: skip
        assert says in refused(window, m.MoveTo(str(folder)))
    with monkeypatch.context() as patch:
        patch.setattr("experiments.recording.writer.replace_file", full)
        assert "no space left" in refused(window, m.MoveTo(str(tmp_path / "other")))
    assert not session_in(tmp_path / "other").exists() and not any(session_in(taken).iterdir())
    assert window.snapshot.in_memory == said.in_memory and window.snapshot.not_written
    window.client.send(m.MoveTo(str(tmp_path / "other")))
    assert window.until(lambda s: s.moved).in_memory == ""


def test_a_session_with_ticks_in_memory_alone_is_not_closed_and_what_ends_with_the_program_is_said(window, tmp_path):
    run = begin(window)
    shutil.rmtree(tmp_path / "data")
    said = window.until(lambda s: s.stage == m.READY)
    assert said.notice.count("lost if this program ends") == 1
    window.client.send(m.Leave())
    window.look()
    assert window.snapshot.stage == m.READY and window.snapshot.in_memory
    window.client.state.end("the window was closed")
    last = window.client.state.snapshot()
    assert last.stage == m.FAILED and f"un {run}" in last.notice and "lost" in last.notice


def test_a_loop_that_dies_while_the_folder_is_gone_leaves_its_ticks_in_memory(window, tmp_path):
    run = begin(window)
    (tmp_path / "data").rename(tmp_path / "away")
    window.until(lambda s: s.not_written)
    loop = window.client.state.runner._loop
    window.client.state.runner._replace = lambda: _lost(window.client.state.runner)
    loop.closed = True
    said = window.until(lambda s: s.stage != m.RUNNING)
    assert "in memory" in said.notice and f"run {run}" in said.in_memory
    (tmp_path / "away").rename(tmp_path / "data")
    loop.closed = False
    said = window.until(lambda s: not s.not_written)
    assert [(row.run, row.status) for row in said.rows] == [(run, "recovered")] and cell(said.coming) == cell(
        said.rows[0]
    )
    assert window.recording(run).rows == len(window.rows)


def _lost(runner):
    run, runner.run = runner.run, None
    runner._loop.closed, runner._loop._trial = False, None
    return run, "the control loop ended unexpectedly"
