"""kill -9 of window, control loop and conductor in mid-trial: what ends, what goes on, and what is kept.

Run as a script with a number of kills, it does as many at random moments and prints what it saw:
python tests/app/test_live_kill.py 60
"""

import signal
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[k] / place) for k, place in ((2, ""), (1, "support"))]

import pytest
from live import Window, gone, kill, wait_until, window
from live_kills import VICTIMS, Killing
from protocols import PAPER, changed

from app.ipc import messages as m
from app.ipc.address import find
from app.ipc.setup import Setup
from core import tick_log
from experiments.recording.reader import read_recording
from experiments.session.files import cell
from experiments.session.verify import verify

CURRENTS = slice(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    folder = tmp_path_factory.mktemp("killed") / "data"
    endless = changed(PAPER.text, end_radius_m="1e-6", time_out_s="1000.0")  # the kill comes in the movement
    (folder.parent / "endless.toml").write_text(endless, encoding="utf-8")
    return Setup(folder, str(folder.parent / "endless.toml"), hand="operator", seed=5, real_time=False, patience_s=60.0)


@pytest.fixture(scope="module")
def opened(setup: Setup):
    """One session after another kill: each test goes on where the last one ended."""
    with window(setup) as opened:
        opened.open()
        yield opened


def trial(setup: Setup, run: int) -> Path:
    return setup.data_dir / "sub-01" / "ses-01" / "trials" / f"run-{run:03d}.parquet"


def until_current(opened: Window) -> None:
    """Wait until the brakes act."""
    opened.until_tick(lambda rows: rows[:, CURRENTS].any())


def resume(opened: Window, setup: Setup) -> m.Snapshot:
    """A new bench in place of one that is gone, and its session."""
    opened.bench.close()
    opened.join(setup)
    assert opened.until_stage(m.NO_SESSION).resumable == ("01",)
    opened.bench.send(m.Open("01", resume=True))
    return opened.until_stage(m.READY)


def test_a_loop_that_is_lost_is_seen_its_trial_recovered_and_run_again(opened: Window, setup: Setup) -> None:
    first = opened.opened.plan[0]
    for run, again, how in ((1, 61, signal.SIGKILL), (61, 62, signal.SIGSTOP)):
        assert opened.start().running == first._replace(run=run)
        until_current(opened)
        loop = opened.loop()
        kill(loop, how)
        snapshot = opened.until(lambda s: s.said_bad)
        opened.look()
        assert "control loop" in snapshot.said and f"run {run}" in snapshot.said.lower()
        kept = read_recording(trial(setup, run))
        assert kept.whole and kept.outcome["status"] == "recovered"
        assert kept.rows >= len(opened.rows) - 1  # not a tick that the window saw is lost; one may be half written
        wait_until(lambda loop=loop: gone(loop))
        assert opened.until_stage(m.READY).coming == first._replace(run=again)
    assert verify(setup.data_dir)["faults"] == []


def test_a_conductor_that_is_killed_leaves_no_current_no_process_and_a_trial_to_recover(
    opened: Window, setup: Setup
) -> None:
    run = opened.start().running.run
    until_current(opened)
    pids, place = opened.processes(), find(setup.data_dir).ring.parent
    kill(opened.bench.pid)
    wait_until(lambda: all(map(gone, pids)))
    assert not place.exists()
    opened.look()
    assert not opened.bench.alive
    assert opened.rows[-1, tick_log.PHASE] == tick_log.END and not opened.rows[-1, CURRENTS].any()
    snapshot = resume(opened, setup)
    assert (snapshot.rows[-1].run, snapshot.rows[-1].status) == (run, "recovered")
    assert read_recording(trial(setup, run)).rows > 0
    assert cell(snapshot.coming) == cell(snapshot.rows[-1])
    assert verify(setup.data_dir)["faults"] == []


def test_a_bench_that_is_told_to_end_keeps_its_trial_which_comes_again(opened: Window, setup: Setup) -> None:
    run = opened.start().running.run
    pids = opened.processes()
    kill(opened.bench.pid, signal.SIGTERM)
    wait_until(lambda: all(map(gone, pids)))
    kept = read_recording(trial(setup, run))
    assert kept.whole and kept.outcome["status"] == "stopped" and kept.outcome["reason"] == "the bench was told to end"
    assert not (setup.data_dir / ".bench.json").exists()
    snapshot = resume(opened, setup._replace(patience_s=4.0))
    assert snapshot.rows[-1].status == "stopped" and cell(snapshot.coming) == cell(snapshot.rows[-1])


def test_a_bench_that_is_left_alone_waits_a_while_and_then_ends(opened: Window, setup: Setup) -> None:
    run = opened.start().running.run
    opened.abort("enough")
    pids, place = opened.processes(), find(setup.data_dir).ring.parent
    opened.bench.close()
    wait_until(lambda: all(map(gone, pids)))
    assert not place.exists() and not (setup.data_dir / ".bench.json").exists()
    assert read_recording(trial(setup, run)).outcome["status"] == "aborted"
    assert verify(setup.data_dir)["faults"] == []


def test_kills_at_random_moments_lose_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    setup = Setup(tmp_path / "data", hand="operator", seed=5, real_time=False, patience_s=60.0)
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
