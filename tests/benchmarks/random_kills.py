"""kill -9 of session server, control loop and window in turn, at random moments of one session in real time: whether
anything is lost that was acknowledged. The kills that the suite does: tests/app/test_live_kill.py.

python -m tests.benchmarks.random_kills 60
"""

import contextlib
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

import numpy as np
from live import Window, kill
from processes import gone
from sessions import recording_path
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from experiments.store.files import rows_of, session_folder
from experiments.store.journal import journal_summary
from experiments.store.reader import read_recording
from experiments.store.verify import verify

VICTIMS = ("server", "loop", "window")
LONGEST_S = 6.0  # from the start of a trial to the kill; some then come between two trials


class Killing:
    """One session of a simulated operator that is killed again and again, and always resumed."""

    def __init__(self, setup: Setup, seed: int) -> None:
        self.setup, self.seen, self._random = setup, Counter(), np.random.default_rng(seed)
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
        moment = time.perf_counter() + self._random.uniform(0.0, LONGEST_S)
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
            kept = read_recording(recording_path(self._folder, run)) if rows[run].recording else None
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
