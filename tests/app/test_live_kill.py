"""kill -9 of window, control loop and session server in mid-trial: what ends, what goes on, and what is kept."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from live import Window, kill, live_window
from processes import children, gone, suspend
from protocols import PAPER, changed
from recorded_disk import RecordedDisk
from sessions import unfinished
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.session_server.server import LOG, take_folder
from core import tick_log
from experiments.store.cells import cell
from experiments.store.journal import ENDED, WINDOW_LOST, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.verify import verify

CURRENTS = slice(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    folder = tmp_path_factory.mktemp("killed") / "data"
    endless = changed(PAPER.text, end_radius_m="1e-6", time_out_s="1000.0")  # the kill comes in the movement
    (folder.parent / "endless.toml").write_text(endless, encoding="utf-8")
    return Setup(folder, str(folder.parent / "endless.toml"), hand="operator", seed=5, real_time=False)


@pytest.fixture(scope="module")
def opened(setup: Setup):
    """One session after another kill: each test goes on where the last one ended."""
    with live_window(setup) as opened:
        opened.open()
        yield opened


def trial(setup: Setup, run: int) -> Path:
    return setup.data_dir / "sub-01" / "ses-01" / "trials" / f"run-{run:03d}.parquet"


def until_current(opened: Window) -> None:
    """Wait until the brakes act."""
    opened.until_tick(lambda rows: rows[:, CURRENTS].any())


def test_a_loop_that_is_lost_is_seen_its_trial_recovered_and_run_again(opened: Window, setup: Setup) -> None:
    first = opened.opened.plan[0]
    for run, again, how in ((1, 61, kill), (61, 62, suspend)):
        assert opened.start().running == first._replace(run=run)
        until_current(opened)
        loop = opened.loop()
        how(loop)
        snapshot = opened.until(lambda s: s.notice_bad)
        opened.look()
        assert "control loop" in snapshot.notice and "trial 1" in snapshot.notice.lower()
        kept = read_recording(trial(setup, run))
        assert kept.whole and kept.outcome["status"] == "recovered"
        assert kept.rows >= len(opened.rows) - 1  # not a tick that the window saw is lost; one may be half written
        wait_until(lambda loop=loop: gone(loop))
        assert opened.until_stage(m.READY).coming == first._replace(run=again)
    assert verify(setup.data_dir)["faults"] == []


def test_a_session_server_that_is_killed_leaves_no_current_no_process_and_a_trial_to_recover(opened, setup) -> None:
    run = opened.start().running.run
    until_current(opened)
    opened.until(lambda _: opened.pulse and opened.pulse.proof and opened.pulse.proof.rows)
    acknowledged, pids = opened.pulse.proof.rows, opened.processes()
    kill(opened.client.pid)
    wait_until(lambda: all(map(gone, pids)))
    opened.look()
    assert not opened.client.alive
    assert opened.rows[-1, tick_log.PHASE] == tick_log.END and not opened.rows[-1, CURRENTS].any()
    session = Session.resume(setup.data_dir, "01", sync=False)
    assert (session.rows[-1].run, session.rows[-1].status) == (run, "recovered")
    assert read_recording(trial(setup, run)).rows >= acknowledged, "rows that were said to be in the file are lost"
    assert cell(session.next_planned()) == cell(session.rows[-1])
    session.close()
    assert verify(setup.data_dir)["faults"] == []


@pytest.fixture
def disk(tmp_path: Path, setup: Setup, monkeypatch: pytest.MonkeyPatch) -> RecordedDisk:
    """Of the programs that are started from now on; what it refuses goes to tmp_path / "own"."""
    disk = RecordedDisk(tmp_path)
    about = {"DISK_ROOT": setup.data_dir, "DISK_LOG": disk.log, "DISK_TOLD": disk.told, "LD_PRELOAD": disk.library}
    for name, value in (about | {"XDG_DATA_HOME": tmp_path / "own"}).items():
        monkeypatch.setenv(name, str(value))
    return disk


def test_ticks_that_are_in_memory_alone_as_the_server_is_told_to_end_are_said_and_come_back(
    opened: Window, setup: Setup, disk: RecordedDisk, tmp_path: Path
) -> None:
    """The process itself, with SIGTERM: the next opening has every tick."""
    opened.client.leave()
    opened.join(setup)  # a new bench in place of the one that is gone
    opened.until_stage(m.NO_SESSION)
    assert unfinished(setup.data_dir) == ("01",)
    opened.client.send(m.Open("01", resume=True))
    run = opened.start().running.run
    opened.until_tick(lambda rows: len(rows) > 300)
    disk.told.write_text("write session.db")
    opened.until(lambda s: s.in_memory)
    opened.until_tick(lambda rows: len(rows) > 1300)
    seen, pids = len(opened.rows), opened.processes()
    kill(opened.client.pid, signal.SIGTERM)
    wait_until(lambda: all(map(gone, pids)))
    (log,) = (setup.data_dir / LOG).read_text().splitlines()
    (setup.data_dir / LOG).unlink()
    ticks = int(re.search(r"([\d,]+) ticks", log)[1].replace(",", ""))
    assert ticks >= seen - 1000 and str(tmp_path / "own") in log
    disk.told.unlink()
    session = Session.resume(setup.data_dir, "01", sync=False)
    assert f"{ticks:,} ticks that the disk had refused are in the session now" in session.repaired.sentence()
    assert cell(session.next_planned()) == cell(session.rows[-1])
    session.close()
    kept = read_recording(trial(setup, run))
    assert kept.whole and kept.rows >= seen - 1
    assert verify(setup.data_dir)["faults"] == []


#: a window in a process of its own: it starts a trial and says whose server and run that is
WINDOW = """
import sys, time
sys.path.insert(0, sys.argv[2])
from live import Window
from app.ipc import messages as m
from app.ipc.messages import Setup

window = Window(Setup.from_json(sys.argv[1]))
window.open()
window.start()
window.until_tick(lambda rows: rows[-1, 1] == 2)
print(window.client.pid, window.snapshot.running.run, flush=True)
while True:
    window.look()
    time.sleep(0.005)
"""


def test_a_window_that_is_killed_changes_nothing_in_its_trial_and_the_next_one_goes_on(tmp_path: Path) -> None:
    (tmp_path / "quick.toml").write_text(changed(PAPER.text, hold_s="0.0", start_radius_m="0.04"), encoding="utf-8")
    setup = Setup(tmp_path / "data", str(tmp_path / "quick.toml"), hand="operator", seed=5, real_time=False)
    support = Path(__file__).resolve().parents[1] / "support"
    environment = {**os.environ, "PYTHONPATH": str(support.parents[1])}
    command = [sys.executable, "-c", WINDOW, setup.to_json(), str(support)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as other:
        server, run = map(int, other.stdout.readline().split())
        pids = [server, *children(server)]
        other.kill()
    with contextlib.ExitStack() as cleanup:  # as the next server, which waits until the trial before is kept
        take_folder(setup, cleanup)
    wait_until(lambda: all(map(gone, pids)))
    assert unfinished(setup.data_dir) == ("01",)
    kept = read_recording(trial(setup, run))
    assert kept.whole and kept.outcome["status"] in ("done", "timeout") and kept.outcome["timing"]["lost"] == 0
    entries = read_events(setup.data_dir / "sub-01" / "ses-01")
    assert [entry.event for entry in entries[-2:]] == [WINDOW_LOST, ENDED]
