"""The data folder goes while a session is open: what is in memory is said, kept, and written when there is a place."""

import sys
from pathlib import Path

import pytest
from simulated_loop import local_window

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.inputs import OPERATOR
from experiments.store.journal import NOTE, read_events
from experiments.store.verify import verify

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no folder that is in use")


def test_a_folder_that_goes_in_mid_trial_and_comes_back_costs_no_tick(tmp_path: Path, monkeypatch) -> None:
    for place in ("app.session_server.storage.RETRY_S", "experiments.store.recording.RETRY_S",
                  "experiments.store.recording.COMMIT_S"):  # fmt: skip
        monkeypatch.setattr(place, 0.0)  # the time of the trial is simulated
    data, gone = tmp_path / "data", tmp_path / "data" / "sub-01" / "ses-01"
    with local_window(Setup(data, sync=False, hand=OPERATOR)) as window:
        window.open()
        run = window.start().running.run
        window.until_tick(lambda rows: len(rows) >= 500)
        gone.rename(tmp_path / "away")
        said = window.until(lambda s: s.not_written)
        assert said.stage == m.RUNNING and "The trial goes on, and its ticks are kept in memory" in said.notice
        said = window.until(lambda s: s.stage == m.READY)
        ticks = len(window.rows)
        assert said.in_memory.startswith(f"trial {run}, ") and said.rows == ()
        assert 0 < int(said.in_memory.split()[2].replace(",", "")) <= ticks
        assert f"{gone} is gone" in said.notice and said.notice.count("lost if this program ends") == 1
        assert [check.state for check in said.checks if check.name == "Recording"] == [m.BAD]
        for command in (m.Start(), m.Leave()):
            window.client.send(command)
            window.look()
            assert window.snapshot.stage == m.READY and window.snapshot.notice_bad and window.snapshot.in_memory
        window.client.send(m.Note("the lamp went out"))
        window.until(lambda s: "line" in s.in_memory)
        assert not gone.exists(), "nothing was written into a folder that is none of ours"
        (tmp_path / "away").rename(gone)
        said = window.until(lambda s: not s.not_written)
        assert said.in_memory == "" and [row.status for row in said.rows] == ["done"]
        recording = window.recording(run)
        assert recording.rows == ticks and recording.outcome["status"] == "done"
        assert recording.columns["t_s"][-1] == window.rows[-1, tick_log.T]
        notes = [line.about["text"] for line in read_events(gone) if line.event is NOTE]
        assert notes == ["the lamp went out"] and said.coming.run == run + 1
        assert verify(data)["faults"] == []
