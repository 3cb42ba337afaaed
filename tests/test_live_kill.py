"""kill -9 of window, control loop and conductor in mid-trial: what ends, what goes on, and what is kept.

Run as a script with a number of kills, it does as many at random moments and prints what it saw:
python tests/test_live_kill.py 60
"""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parent.parent)]

import pytest
from live import LONG_S, Window, children, gone, kill, wait_until, window
from live_kills import VICTIMS, Killing

from app.live import messages as m
from app.live.place import find
from app.live.setup import Setup
from core import row
from experiments.recording import read_recording
from experiments.verify import verify

ROOT = Path(__file__).resolve().parent.parent
CURRENTS = slice(row.CURRENT, row.CURRENT + 4)

WINDOW = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from live import Window
from app.live.setup import Setup

if __name__ == "__main__":
    window = Window(Setup.from_json(sys.argv[1]))
    window.open()
    window.start()
    window.until_tick(lambda rows: len(rows) > 300)
    print(window.bench.pid, flush=True)
    time.sleep(60)
"""


@pytest.fixture
def setup(tmp_path: Path) -> Setup:
    return Setup(tmp_path / "data", hand="operator", seed=5, real_time=False, patience_s=10.0)


def trials(setup: Setup) -> Path:
    return setup.data_dir / "sub-01" / "ses-01" / "trials"


def until_current(opened: Window) -> None:
    """Wait until the brakes act."""
    opened.until_tick(lambda rows: rows[:, CURRENTS].any())


def test_a_window_that_is_killed_leaves_its_trial_running_and_the_next_one_sees_it_end(setup: Setup) -> None:
    code = WINDOW.format(tests=str(ROOT / "tests"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, setup.to_json()]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as first:
        pid = int(first.stdout.readline())
        first.kill()
    with window(setup) as second:
        assert second.bench.pid == pid
        snapshot = second.until_stage(m.RUNNING, m.READY)
        snapshot = second.until(lambda s: s.rows, LONG_S)
        assert [(r.run, r.status) for r in snapshot.rows] == [(1, "done")]
        assert read_recording(trials(setup) / "run-001.parquet").whole
        second.start()
        second.abort("enough")
    assert verify(setup.data_dir)["faults"] == []


def test_a_bench_that_is_left_alone_waits_a_while_and_then_ends(setup: Setup) -> None:
    setup = setup._replace(patience_s=1.0)
    opened = Window(setup)
    opened.open()
    opened.start()
    opened.bench.send(m.Abort("enough"))
    pids, place = opened.processes(), find(setup.data_dir).ring.parent
    opened.bench.close()
    wait_until(lambda: all(map(gone, pids)), 20.0)
    assert not place.exists() and not (setup.data_dir / ".bench.json").exists()
    assert read_recording(trials(setup) / "run-001.parquet").whole


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_a_loop_that_is_lost_is_seen_its_trial_recovered_and_run_again(setup: Setup, how: int) -> None:
    with window(setup) as opened:
        opened.open()
        opened.start()
        until_current(opened)
        (loop,) = children(opened.bench.pid)
        kill(loop, how)
        snapshot = opened.until(lambda s: s.said_bad, 10.0)
        opened.look()
        assert "control loop" in snapshot.said and "run 1" in snapshot.said.lower()
        kept = read_recording(trials(setup) / "run-001.parquet")
        assert kept.whole and kept.outcome["status"] == "recovered"
        assert kept.rows >= len(opened.rows) - 1  # not a tick that the window saw is lost; one may be half written
        wait_until(lambda: gone(loop), 5.0)
        snapshot = opened.until_stage(m.READY)
        assert snapshot.coming == snapshot.coming._replace(controller=opened.opened.plan[0].controller, run=61)
        assert opened.start().running.run == 61
        opened.abort("enough")
    assert verify(setup.data_dir)["faults"] == []


def test_a_conductor_that_is_killed_leaves_no_current_no_process_and_a_trial_to_recover(setup: Setup) -> None:
    opened = Window(setup)
    opened.open()
    opened.start()
    until_current(opened)
    pids, place = opened.processes(), find(setup.data_dir).ring.parent
    kill(opened.bench.pid)
    wait_until(lambda: all(map(gone, pids)), 10.0)
    assert not place.exists()
    opened.look()
    assert not opened.bench.alive
    assert opened.rows[-1, row.PHASE] == row.END and not opened.rows[-1, CURRENTS].any()
    opened.bench.close()
    with window(setup) as again:
        assert again.until_stage(m.NO_SESSION).resumable == ("01",)
        again.bench.send(m.Open("01", resume=True))
        snapshot = again.until_stage(m.READY)
        assert [(r.run, r.status) for r in snapshot.rows] == [(1, "recovered")]
        assert read_recording(trials(setup) / "run-001.parquet").rows > 0
        again.start()
        again.abort("enough")
    assert verify(setup.data_dir)["faults"] == []


def test_a_bench_that_is_told_to_end_keeps_its_trial(setup: Setup) -> None:
    opened = Window(setup)
    opened.open()
    opened.start()
    pids = opened.processes()
    kill(opened.bench.pid, signal.SIGTERM)
    wait_until(lambda: all(map(gone, pids)), 20.0)
    kept = read_recording(trials(setup) / "run-001.parquet")
    assert kept.whole and kept.outcome["status"] == "aborted" and kept.outcome["reason"] == "the bench was told to end"
    opened.bench.close()
    assert not (setup.data_dir / ".bench.json").exists()


def test_kills_at_random_moments_lose_nothing_that_was_acknowledged(setup: Setup) -> None:
    killing = Killing(setup)
    try:
        for victim in VICTIMS:
            killing.kill(victim)
    finally:
        killing.close()
    assert killing.seen["recordings checked"] >= 3 and not (setup.data_dir / ".bench.json").exists()


def main(kills: int) -> None:
    """So many kills, each victim in turn, on one session in real time with the disk waited for."""
    with tempfile.TemporaryDirectory() as folder:
        killing = Killing(Setup(Path(folder) / "data", hand="operator"), seed=kills)
        try:
            for number in range(kills):
                killing.kill(VICTIMS[number % len(VICTIMS)])
                print(number + 1, dict(killing.seen), flush=True)
        finally:
            killing.close()


if __name__ == "__main__":
    main(int(sys.argv[1]))
