"""kill -9 of window, control loop and conductor in mid-trial: what ends, what goes on, and what is kept.

Run as a script with a number of kills, it does as many at random moments and prints what it saw:
python tests/test_live_kill.py 60
"""

import signal
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parent.parent)]

import pytest
from live import Window, children, gone, kill, wait_until, window
from live_kills import VICTIMS, Killing

from app.live import messages as m
from app.live.place import find
from app.live.setup import Setup
from core import row
from experiments.recording import read_recording
from experiments.verify import verify

CURRENTS = slice(row.CURRENT, row.CURRENT + 4)

@pytest.fixture
def setup(tmp_path: Path) -> Setup:
    return Setup(tmp_path / "data", hand="operator", seed=5, real_time=False, patience_s=10.0)


def trials(setup: Setup) -> Path:
    return setup.data_dir / "sub-01" / "ses-01" / "trials"


def until_current(opened: Window) -> None:
    """Wait until the brakes act."""
    opened.until_tick(lambda rows: rows[:, CURRENTS].any())


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


def test_a_loop_that_is_lost_is_seen_its_trial_recovered_and_run_again(setup: Setup) -> None:
    with window(setup) as opened:
        opened.open()
        first = opened.opened.plan[0]
        for run, again, how in ((1, 61, signal.SIGKILL), (61, 62, signal.SIGSTOP)):
            assert opened.start().running == first._replace(run=run)
            until_current(opened)
            (loop,) = children(opened.bench.pid)
            kill(loop, how)
            snapshot = opened.until(lambda s: s.said_bad, 10.0)
            opened.look()
            assert "control loop" in snapshot.said and f"run {run}" in snapshot.said.lower()
            kept = read_recording(trials(setup) / f"run-{run:03d}.parquet")
            assert kept.whole and kept.outcome["status"] == "recovered"
            assert kept.rows >= len(opened.rows) - 1  # not a tick that the window saw is lost; one may be half written
            wait_until(lambda loop=loop: gone(loop), 5.0)
            assert opened.until_stage(m.READY).coming == first._replace(run=again)
        opened.start()
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
    killing = Killing(setup, longest_s=2.0)
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
