"""The data folder goes while a session is open: what is in memory is said, kept, and written when there is a place."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from disks import Disk
from live import Window
from simulated_loop import LocalWindow, local_window

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.session_server import storage as storage_module
from core import tick_log
from experiments.inputs import OPERATOR
from experiments.store.journal import NOTE, read_events
from experiments.store.verify import verify

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no folder that is in use")


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


@pytest.fixture
def window(tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalWindow]:
    monkeypatch.setattr(storage_module, "RETRY_S", 0.0)
    monkeypatch.setattr("experiments.store.recording.COMMIT_S", 0.0)  # the time of the trial is simulated
    monkeypatch.setattr("experiments.store.recording.RETRY_S", 0.0)
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


def test_a_folder_that_goes_in_mid_trial_and_comes_back_costs_no_tick(window, tmp_path):
    kept = done(window).rows
    run = begin(window)
    gone = session_in(tmp_path / "data")
    gone.rename(tmp_path / "away")
    said = window.until(lambda s: s.not_written)
    assert said.stage == m.RUNNING and "The trial goes on, and its ticks are kept in memory" in said.notice
    said = window.until(lambda s: s.stage == m.READY)
    ticks = len(window.rows)
    assert 0 < int(said.in_memory.split()[2].replace(",", "")) <= ticks and said.in_memory.startswith(f"trial {run}, ")
    assert f"{gone} is gone" in said.notice and f"trial {run}, " in said.notice
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


def test_a_session_with_ticks_in_memory_alone_is_not_closed_and_what_ends_with_the_program_is_said(window, tmp_path):
    run = begin(window)
    shutil.rmtree(tmp_path / "data")
    said = window.until(lambda s: s.stage == m.READY)
    assert said.notice.count("lost if this program ends") == 1
    window.client.send(m.Leave())
    window.look()
    assert window.snapshot.stage == m.READY and window.snapshot.in_memory
    ticks = window.client.state.storage.open.session.database.pending_ticks
    window.client.state.end("the window was closed")
    last = window.client.state.snapshot()
    assert last.stage == m.FAILED and f"{ticks} ticks" in last.notice.replace(",", "") and run == 1
    assert "they are in" in last.notice
