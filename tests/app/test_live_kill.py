"""kill -9 of window, control loop and session server in mid-trial: what ends, what goes on, and what is kept.

Run as a script with a number of kills, it does as many at random moments and prints what it saw:
python tests/app/test_live_kill.py 60
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[k] / place) for k, place in ((2, ""), (1, "support"))]

import numpy as np
import pytest
from live import Window, kill, live_window
from processes import children, gone, suspend
from protocols import PAPER, changed
from sessions import unfinished
from synthetic_hand import SyntheticHand
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.recording.reader import read_recording
from experiments.session.files import PARQUET_SUFFIX, cell, rows_of, run_path, session_folder
from experiments.session.journal import ENDED, WINDOW_LOST, journal_summary, read_events
from experiments.session.verify import verify

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


def resume(opened: Window, setup: Setup) -> m.Snapshot:
    """A new bench in place of one that is gone, and its session."""
    opened.client.leave()
    opened.join(setup)
    opened.until_stage(m.NO_SESSION)
    assert unfinished(setup.data_dir) == ("01",)
    opened.client.send(m.Open("01", resume=True))
    return opened.until_stage(m.READY)


def test_a_loop_that_is_lost_is_seen_its_trial_recovered_and_run_again(opened: Window, setup: Setup) -> None:
    first = opened.opened.plan[0]
    for run, again, how in ((1, 61, kill), (61, 62, suspend)):
        assert opened.start().running == first._replace(run=run)
        until_current(opened)
        loop = opened.loop()
        how(loop)
        snapshot = opened.until(lambda s: s.notice_bad)
        opened.look()
        assert "control loop" in snapshot.notice and f"run {run}" in snapshot.notice.lower()
        kept = read_recording(trial(setup, run))
        assert kept.whole and kept.outcome["status"] == "recovered"
        assert kept.rows >= len(opened.rows) - 1  # not a tick that the window saw is lost; one may be half written
        wait_until(lambda loop=loop: gone(loop))
        assert opened.until_stage(m.READY).coming == first._replace(run=again)
    assert verify(setup.data_dir)["faults"] == []


def test_a_session_server_that_is_killed_leaves_no_current_no_process_and_a_trial_to_recover(
    opened: Window, setup: Setup
) -> None:
    run = opened.start().running.run
    until_current(opened)
    pids = opened.processes()
    kill(opened.client.pid)
    wait_until(lambda: all(map(gone, pids)))
    opened.look()
    assert not opened.client.alive
    assert opened.rows[-1, tick_log.PHASE] == tick_log.END and not opened.rows[-1, CURRENTS].any()
    snapshot = resume(opened, setup)
    assert (snapshot.rows[-1].run, snapshot.rows[-1].status) == (run, "recovered")
    assert read_recording(trial(setup, run)).rows > 0
    assert cell(snapshot.coming) == cell(snapshot.rows[-1])
    assert verify(setup.data_dir)["faults"] == []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends a process without asking it: there is no SIGTERM")
def test_a_session_server_that_is_told_to_end_keeps_its_trial_which_comes_again(opened: Window, setup: Setup) -> None:
    run = opened.start().running.run
    pids = opened.processes()
    kill(opened.client.pid, signal.SIGTERM)
    wait_until(lambda: all(map(gone, pids)))
    kept = read_recording(trial(setup, run))
    assert kept.whole and kept.outcome["status"] == "stopped"
    assert kept.outcome["reason"] == "the session server was ended by the system"
    snapshot = resume(opened, setup)
    assert snapshot.rows[-1].status == "stopped" and cell(snapshot.coming) == cell(snapshot.rows[-1])


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
    setup = Setup(tmp_path / "data", hand="operator", seed=5, real_time=False)
    support = Path(__file__).resolve().parents[1] / "support"
    environment = {**os.environ, "PYTHONPATH": str(support.parents[1])}
    command = [sys.executable, "-c", WINDOW, setup.to_json(), str(support)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as other:
        server, run = map(int, other.stdout.readline().split())
        pids = [server, *children(server)]
        other.kill()
    with live_window(setup) as opened:  # waits until the trial of the window before is kept
        opened.until_stage(m.NO_SESSION)
        assert all(map(gone, pids)) and unfinished(setup.data_dir) == ("01",)
    kept = read_recording(trial(setup, run))
    assert kept.whole and kept.outcome["status"] in ("done", "timeout") and kept.outcome["timing"]["lost"] == 0
    entries = read_events(setup.data_dir / "sub-01" / "ses-01")
    assert [entry.event for entry in entries[-2:]] == [WINDOW_LOST, ENDED]


@pytest.mark.parametrize("phase", [tick_log.APPROACH, tick_log.MOVE])
def test_a_trial_by_pointer_ends_with_its_window_and_comes_again(tmp_path: Path, phase: int) -> None:
    setup = Setup(tmp_path / "data", seed=5, real_time=False)
    opened = Window(setup)
    opened.open()
    snapshot = opened.start()
    run, hand = snapshot.running.run, SyntheticHand(snapshot.running.segment, snapshot.tip)
    opened.until(lambda _: len(opened.rows))
    while (now := opened.rows[-1])[tick_log.PHASE] < phase:
        opened.client.ring.aim(*hand((now[tick_log.TIP_X], now[tick_log.TIP_Y]), int(now[tick_log.PHASE]), 0.005))
        time.sleep(0.005)
        opened.look()
    pids = opened.processes()
    opened.client.leave()
    wait_until(lambda: all(map(gone, pids)))
    assert read_recording(trial(setup, run)).outcome["status"] == "stopped"
    snapshot = resume(opened, setup)
    assert cell(snapshot.coming) == cell(snapshot.rows[-1])
    opened.client.stop("the test is over")


VICTIMS = ("server", "loop", "window")


class Killing:
    """One session of a simulated operator that is killed again and again, and always resumed."""

    def __init__(self, setup: Setup, seed: int = 1, longest_s: float = 6.0) -> None:
        """longest_s: from the start of a trial to the kill; some then come between two trials."""
        self.setup, self.seen, self._random = setup, Counter(), np.random.default_rng(seed)
        self._longest_s = longest_s
        self._folder = session_folder(setup.data_dir, "01")
        self.window = Window(setup)
        self.window.open()
        self._acknowledged: dict[int, int] = {}  # run -> rows that the window has said are in the file
        self._ticks: dict[int, int] = {}  # run -> ticks that the window has seen

    def kill(self, victim: str) -> None:
        """Start a trial, kill at a random moment, see that nothing is lost, and be ready for the next trial."""
        self._ready()
        window = self.window
        window.start()
        moment = time.perf_counter() + self._random.uniform(0.0, self._longest_s)
        if victim == "window":
            self._lose_window(moment)
        else:
            while time.perf_counter() < moment:
                self._look()
            running = window.snapshot.running
            pids = window.processes()
            kill(window.client.pid if victim == "server" else window.loop())
            self.seen["in a trial" if running else "between trials"] += 1
            if victim == "server":
                self._again(pids)
            else:
                window.until(lambda s: "control loop" in s.notice)
                self._look()
                window.until_stage(m.READY, m.RERIG, m.FINISHED)
        self.seen[victim] += 1
        self._check()

    def _ready(self) -> None:
        window = self.window
        if window.until_stage(m.READY, m.RERIG, m.FINISHED).stage == m.RERIG:
            window.client.send(m.Confirm())
            window.until_stage(m.READY)
        assert window.snapshot.stage == m.READY, "the plan is done: fewer kills"

    def _look(self) -> None:
        """Take in what the window says is safe."""
        window, before = self.window, self.window.snapshot.running
        window.look()
        if window.pulse and window.pulse.proof:
            run = int(window.pulse.proof.name[4:7])
            self._acknowledged[run] = max(self._acknowledged.get(run, 0), window.pulse.proof.rows)
        if before is not None:
            self._ticks[before.run] = len(window.rows)
        time.sleep(0.002)

    def _lose_window(self, moment: float) -> None:
        """The window's end of the pipes is closed, as the system does it when the window is killed."""
        while time.perf_counter() < moment:
            self._look()
        running, pids = self.window.snapshot.running, self.window.processes()
        self.window.client.leave()
        self._again(pids)
        if running is not None:
            done = next(one for one in self.window.snapshot.rows if one.run == running.run)
            assert done.status in ("done", "timeout"), f"a window's end changed a trial: {done}"
            self.seen["in a trial"] += 1

    def _again(self, pids: list[int]) -> None:
        """A new session server in place of the one that is gone; the session is gone on with."""
        wait_until(lambda: all(map(gone, pids)))
        self.window.look()
        if len(self.window.rows):
            assert not self.window.rows[-1, tick_log.CURRENT : tick_log.CURRENT + 4].any(), "currents at the end"
        self.window.client.leave()
        self.window.join(self.setup)
        self.window.until_stage(m.NO_SESSION)
        self.window.client.send(m.Open("01", resume=True))
        self.window.until_stage(m.READY, m.RERIG, m.FINISHED)

    def _check(self) -> None:
        """Every trial that was begun has its row and a whole recording with all that was acknowledged."""
        rows = {one.run: one for one in rows_of(self._folder)}
        begun = journal_summary(self._folder).begun
        assert set(begun) <= set(rows), "a trial that was begun has no row"
        assert verify(self.setup.data_dir)["faults"] == []
        for run in begun:
            kept = read_recording(run_path(self._folder, run, PARQUET_SUFFIX)) if rows[run].recording else None
            held = kept.rows if kept else 0
            assert kept is None or kept.whole
            assert held >= self._acknowledged.get(run, 0), f"run {run}: acknowledged rows are lost"
            if kept is not None and rows[run].status == "recovered":
                lost = max(0, self._ticks.get(run, 0) - held)
                self.seen["most ticks lost of one trial"] = max(self.seen["most ticks lost of one trial"], lost)
        self.seen["recordings checked"] += len(begun)
        for status in set(one.status for one in rows.values()):
            self.seen[f"rows {status}"] = sum(one.status == status for one in rows.values())

    def close(self) -> None:
        """End the window; nothing of it is left."""
        with contextlib.suppress(FileNotFoundError):
            pids = self.window.processes() if not gone(self.window.client.pid) else []
            self.window.client.stop("the test is over")
            wait_until(lambda: all(map(gone, pids)))


def test_kills_at_random_moments_lose_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    setup = Setup(tmp_path / "data", hand="operator", seed=5, real_time=False)
    killing = Killing(setup, longest_s=2.0)
    try:
        for victim in VICTIMS:
            killing.kill(victim)
    finally:
        killing.close()
    assert killing.seen["recordings checked"] >= 3


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
