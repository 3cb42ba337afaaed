"""A live session on the bench, over the emulated board's pseudo-terminal, with what a bad day does to it."""

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from emulated import Emulated, when
from live import Window, children, kill, wait_until, window

from app.live import messages as m
from app.live.setup import Setup
from core import row
from experiments.recording import read_recording
from experiments.session_files import cell

DEVICE = "four-brake"
BRAKING = (2, 4)  # controllers that act on everybody


class Session:
    """A window on a bench with the emulated board."""

    def __init__(self, emulated: Emulated, window: Window) -> None:
        self.emulated, self.window = emulated, window

    @property
    def folder(self) -> Path:
        return Path(self.window.opened.folder)

    def device(self) -> m.Check:
        return next(check for check in self.window.snapshot.checks if check.name == "Device")

    def begin(self, currents: bool = True) -> int:
        """A trial, in whose movement currents flow; its run."""
        window = self.window
        while currents and window.snapshot.coming.controller not in BRAKING:
            coming = window.snapshot.coming
            window.bench.send(m.Skip("the brakes may never act"))
            window.until(lambda s, before=coming: s.coming != before)
        segment = window.snapshot.coming.segment
        self.emulated.order(path=msgspec.to_builtins(window.opened.paths[segment]))
        window.start()
        window.until_tick(lambda ticks: (ticks[:, row.PHASE] == row.MOVE).any())
        if currents:
            window.until_tick(lambda ticks: ticks[-1, row.CURRENT : row.CURRENT + 4].any())
        return window.snapshot.running.run

    def row(self, run: int):
        """The row of a run, when it is there; a run that was cut short comes again next."""
        window = self.window
        found = next(r for r in window.until(lambda s: any(r.run == run for r in s.rows)).rows if r.run == run)
        assert (found.status == "done") != (cell(found) == cell(window.snapshot.coming))
        return found

    def allow(self) -> None:
        self.window.until(lambda s: s.brakes_off)
        wait_until(lambda: self.window.look() or self.device().text == "brakes off")
        self.window.bench.send(m.AllowBrakes())
        self.window.until(lambda s: not s.brakes_off and self.device().state == m.GOOD)

    def back(self) -> None:
        """After a board was left alone: it has latched that, unless it had no current at that moment."""
        self.window.until(lambda s: s.brakes_off or self.device().state == m.GOOD)
        if self.window.snapshot.brakes_off:
            self.allow()


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    emulated = Emulated(tmp_path, "--device", DEVICE, "--hand", "operator", "--seed", "3")
    try:
        setup = Setup(tmp_path / "data", devices=(DEVICE,), link=str(emulated.port), sync=False)
        with window(setup) as opened:
            yield Session(emulated, opened)
        truth = emulated.order()
        assert truth["currents_mA"] == [0] * 4 and truth["state"] in ("IDLE", "FAULT"), "it left the board as it must"
    finally:
        emulated.end()


def test_a_session_on_the_bench_through_faults_to_its_end(session: Session) -> None:
    window, emulated = session.window, session.emulated
    window.until_stage(m.NO_SESSION)
    window.bench.send(m.Practice())
    assert "Open a session" in window.until(lambda s: s.said_bad).said
    window.bench.send(m.Open("01"))
    window.until(lambda s: s.stage == m.RERIG and "Let go of the handle" in s.wait_for)
    assert window.opened.real_device and window.opened.hand == "force sensor"
    emulated.order(away=True)
    time.sleep(0.3)
    window.bench.send(m.Confirm())
    window.until_stage(m.READY)
    emulated.order(away=False)
    journal = (session.folder / "journal.jsonl").read_text().splitlines()
    (zero,) = [event for event in map(json.loads, journal) if event["event"] == "zero taken"]
    assert zero["samples"] == 500 and len(zero["force_counts"]) == 6
    assert session.device() == m.Check("Device", m.GOOD, "four-brake, board EMULATED-3")

    # a trial as it should be
    done = session.row(session.begin(currents=False))
    assert done.status == "done" and done.path_error_m < 0.01
    recording = read_recording(session.folder / done.recording)
    assert recording.whole and recording.metadata["link"] == "serial" and recording.metadata["hand"] == "force sensor"
    assert np.nanmin(np.diff(recording.column("board_us"))) == 1000.0 and np.ptp(recording.column("encoder_A_counts"))
    assert abs(recording.outcome["link"]["clock"]["residual_s"]) < 0.05

    # unplugged in the middle of a movement, and plugged in again
    run = session.begin()
    emulated.order(fault="unplug+1")
    lost = session.row(run)
    assert lost.status == "stopped" and window.snapshot.said.startswith(f"Run {run}: ")
    assert read_recording(session.folder / lost.recording).whole
    truth = emulated.order()
    assert when(truth, "currents zero") - when(truth, "unplug begins") <= 0.051
    window.until(lambda s: session.device().text == "not connected")
    session.back()

    # brakes-off from the window, latched on the board
    run = session.begin()
    window.bench.brakes_off("Esc, participant's window")
    off = session.row(run)
    assert off.status == "stopped" and "Esc" in window.snapshot.said
    wait_until(lambda: emulated.order()["state"] == "FAULT")
    assert emulated.order()["currents_mA"] == [0] * 4
    session.allow()
    assert emulated.order()["state"] in ("READY", "ACTIVE")

    # a fault on the board
    run = session.begin(currents=False)
    emulated.order(fault="bad-encoder=A+0.2")
    assert session.row(run).status == "stopped" and "an encoder's signal is bad" in window.snapshot.said
    time.sleep(0.3)
    session.allow()

    # the loop killed while currents flow: the board's own watchdog
    run = session.begin()
    (loop,) = children(window.bench.pid)
    kill(loop, signal.SIGKILL)
    wait_until(lambda: emulated.order()["currents_mA"] == [0] * 4)
    assert session.row(run).status == "recovered"
    truth = emulated.order()
    assert truth["state"] in ("FAULT", "IDLE", "READY") and "currents zero" in [event for _, event in truth["events"]]

    session.allow()

    # the new loop has to be led through the zero again; after that practice needs no session
    window.until(lambda s: s.stage == m.RERIG and "Let go of the handle" in s.wait_for)
    emulated.order(away=True)
    time.sleep(0.3)
    window.bench.send(m.Confirm())
    window.until(lambda s: s.stage == m.READY)
    emulated.order(away=False)
    window.bench.send(m.Leave())
    window.until_stage(m.NO_SESSION)
    window.bench.send(m.Practice())
    practice = window.until_stage(m.RUNNING)
    assert practice.practice and practice.running.configuration == DEVICE
    window.ticks.clear()
    window.until_tick(lambda ticks: len(ticks) > 100)
    window.abort("enough")
    assert window.snapshot.stage == m.NO_SESSION and "enough" in window.snapshot.said
