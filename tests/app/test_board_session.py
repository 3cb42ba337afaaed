"""A session over a board in simulated time: the steps that make the device ready, and what comes between them."""

import math
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from protocols import PAPER, changed
from simulated_bench import DEVICE, TIP, Bench
from simulated_loop import LocalWindow, local_window

from app.ipc import messages as m
from app.ipc.messages import DeviceStatus, Setup
from experiments.store.journal import HOMED, ZEROED, read_journal
from experiments.store.recording import read_recording
from hardware.emulated_board.device import HeldHand
from hardware.wire.messages import State

PATH = PAPER.paths[1]


class OnBench:
    """A window on a session server with a board."""

    def __init__(self, window: LocalWindow, board: Bench) -> None:
        self.window, self.board = window, board

    @property
    def status(self) -> DeviceStatus:
        return (self.window.pulse and self.window.pulse.device) or DeviceStatus()

    def send(self, *commands: object) -> None:
        for command in commands:
            self.window.client.send(command)

    def until(self, what) -> m.Snapshot:
        return self.window.until(lambda snapshot: what(snapshot) if what.__code__.co_argcount else what())

    def open(self) -> None:
        """A session, homed."""
        self.window.until_stage(m.NO_SESSION)
        self.send(m.Open("01"))
        self.until(lambda s: s.card and "Hold the handle" in s.card.text)
        self.send(m.PrepareDevice(m.HOME))
        self.until(lambda s: s.card and "Let go" in s.card.text)

    def zero(self) -> None:
        self.until(lambda s: s.card and "Let go" in s.card.text)
        self.send(m.Confirm())
        self.window.until_stage(m.READY)
        self.until(lambda: self.status.zeroed)


@pytest.fixture
def on_bench(tmp_path: Path) -> Iterator[OnBench]:
    protocol = tmp_path / "one.toml"
    short = changed(PAPER.text, hold_s="0.0", start_radius_m="0.3", end_radius_m="0.3", end_s="0.2")  # over at once
    protocol.write_text(short, encoding="utf-8")
    board = Bench(DEVICE, HeldHand(TIP))
    setup = Setup(tmp_path / "data", str(protocol), devices=(DEVICE.name,), link="bench", sync=False)
    with local_window(setup, board) as window:
        yield OnBench(window, board)
    board.tick()
    assert not any(board.board.currents) and board.board.state in (State.IDLE, State.FAULT)


def test_the_steps_of_a_real_device_are_led_through_and_the_page_reads_how_it_is(on_bench: OnBench) -> None:
    window = on_bench.window
    window.until_stage(m.NO_SESSION)
    on_bench.until(lambda: on_bench.status.report.get("state") in ("READY", "ACTIVE"))
    told = on_bench.status
    assert (told.device, told.port, told.homed, told.zeroed) == (DEVICE.name, "bench", False, False)
    assert told.report["protocol"] == 1
    assert math.dist(window.snapshot.tip, (0.0, 0.4)) < 0.3, "the place of the handle is unknown: its jig is shown"
    assert len(told.counts) == len(told.encoders) == len(told.report["counts_per_rev"])
    on_bench.send(m.SetSandbox(), m.Start())
    on_bench.until(lambda s: s.notice_bad and "Device page" in s.notice)
    on_bench.send(m.EndSandbox())
    before = time.time()
    on_bench.open()
    on_bench.until(lambda: on_bench.status.homed)
    assert before <= on_bench.status.homed_at <= time.time() and on_bench.status.zeroed_at == 0.0
    middle = [0.5 * (a + b) for a, b in zip(PATH.start_m, PATH.end_m, strict=True)]
    assert on_bench.status.tip == pytest.approx(middle, abs=1e-3), "the encoders stand where the jig holds the handle"
    on_bench.send(m.Confirm())
    assert window.client.state.snapshot().card == m.StepCard(f"Make {DEVICE.name} ready", "Zeroing …", "")
    on_bench.until(lambda: on_bench.status.zeroed)
    first = on_bench.status.zeroed_at
    on_bench.send(m.PrepareDevice(m.ZERO))
    on_bench.until(lambda: on_bench.status.zeroed_at > first)  # again, between two trials


def test_before_a_session_the_device_can_be_homed_zeroed_and_tried_and_the_session_needs_no_step(on_bench) -> None:
    window = on_bench.window
    window.until_stage(m.NO_SESSION)
    on_bench.until(lambda: on_bench.status.device)
    for step, is_done in ((m.HOME, lambda: on_bench.status.homed), (m.ZERO, lambda: on_bench.status.zeroed)):
        on_bench.send(m.PrepareDevice(step))
        on_bench.until(is_done)
    on_bench.send(m.SetSandbox())
    sandbox = on_bench.until(lambda s: s.sandbox).sandbox
    assert sandbox.by_start and not window.within(0.1, lambda s: s.running), "currents flow: a pass waits for a Start"
    on_bench.send(m.SetSandbox(sandbox.settings._replace(brake_strength=0.5)))
    assert "brake_strength cannot be changed" in on_bench.until(lambda s: s.notice_bad).notice
    on_bench.send(m.Start())
    on_bench.until(lambda s: s.sandbox and s.sandbox.passes)
    on_bench.send(m.EndSandbox(), m.Open("01"))
    assert window.until_stage(m.READY).card is None
    events = [entry.event for entry in read_journal(Path(window.opened.folder)).entries]
    assert HOMED in events and ZEROED in events, "the session's journal has both"


def test_homing_in_a_wrong_jig_is_named_by_its_distance_and_done_only_by_somebody_who_is_sure(on_bench) -> None:
    on_bench.open()
    on_bench.zero()
    board, before, jig = on_bench.board, on_bench.status.homed_at, on_bench.status.tip
    with board.lock:
        board.device.motion[0] += 0.0053  # the jig holds the handle so far beside the place
        board.hand.obey({"target": list(board.device.tip)})
    on_bench.until(lambda: math.dist(on_bench.status.tip, jig) > 0.005)
    on_bench.send(m.PrepareDevice(m.HOME))
    notice = on_bench.until(lambda s: s.notice_bad and s.notice).notice
    (off_mm,) = re.findall(r"([\d.]+) mm from its jig", notice)
    assert float(off_mm) == pytest.approx(5.3, abs=0.3) and on_bench.status.homed_at == before
    on_bench.send(m.PrepareDevice(m.HOME, sure=True))
    on_bench.until(lambda: on_bench.status.homed_at > before)
    assert math.dist(on_bench.status.tip, jig) < 1e-3
    on_bench.until(lambda s: s.notice == "")  # what was asked is answered
    again = on_bench.status.homed_at
    on_bench.send(m.PrepareDevice(m.HOME))  # in its place: nothing is asked
    on_bench.until(lambda: on_bench.status.homed_at > again)


def test_no_trial_starts_while_a_step_is_done_and_none_without_a_zero(on_bench: OnBench) -> None:
    window = on_bench.window
    on_bench.open()
    on_bench.zero()
    on_bench.send(m.PrepareDevice(m.CONNECT), m.Start())
    on_bench.until(lambda s: s.notice_bad and "a moment" in s.notice)
    window.until_stage(m.RERIG)
    on_bench.zero()
    on_bench.send(m.Start())
    (row,) = on_bench.until(lambda s: s.rows).rows
    recording = read_recording(Path(window.opened.folder) / row.recording)
    assert recording.whole and recording.outcome["link"]["zero"] is not None
    assert (recording.metadata["link"], recording.metadata["hand"]) == ("serial", "force sensor")
    assert set(np.diff(recording.column("board_us"))) == {1000.0} and np.ptp(recording.column("encoder_A_counts")) >= 0


def test_a_press_of_brakes_off_after_allow_stands_while_the_board_is_busy(on_bench: OnBench) -> None:
    window = on_bench.window
    on_bench.open()
    on_bench.zero()
    window.client.brakes_off("the first press")
    on_bench.until(lambda s: s.brakes_off)
    on_bench.send(m.PrepareDevice(m.CONNECT), m.AllowBrakes())  # the loop connects first
    window.client.brakes_off("the second press")
    on_bench.until(lambda: on_bench.status.device and not on_bench.status.zeroed)
    assert window.snapshot.brakes_off
    on_bench.send(m.AllowBrakes())
    on_bench.until(lambda s: not s.brakes_off)
    on_bench.zero()
