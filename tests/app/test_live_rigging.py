"""Steps on the device on the bench while trials, brakes-off and sessions come between them."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from emulated import Emulated
from live import Window, live_window, wait_until
from live_board import lets_go
from protocols import PAPER

from app.ipc import messages as m
from app.ipc.messages import Setup
from experiments.recording.reader import read_recording
from experiments.session.session import Session

DEVICE = "four-brake"


class OnBench:
    """A window on an emulated board, a session open, the handle homed."""

    def __init__(self, seen: Window, emulated: Emulated) -> None:
        self.seen, self.emulated = seen, emulated
        seen.until_stage(m.NO_SESSION)
        wait_until(lambda: self.status and self.status.device)
        seen.client.send(m.Open("01"))
        seen.until_stage(m.RERIG)

    @property
    def status(self):
        self.seen.look()
        return self.seen.pulse.device if self.seen.pulse else None

    def zero(self) -> None:
        """Until it is taken: a machine that is held up loses samples, and the person is asked again."""
        asked_s = -math.inf

        def taken() -> bool:
            nonlocal asked_s
            status, now = self.status, time.monotonic()
            if lets_go(self.seen.snapshot) and now - asked_s > 5.0:  # not twice: it would be done again
                asked_s = now
                self.seen.client.send(m.Rig(m.ZERO))
            return bool(status and status.zeroed and self.seen.snapshot.stage == m.READY)

        wait_until(taken)


@pytest.fixture
def on_bench(tmp_path: Path) -> Iterator[OnBench]:
    emulated = Emulated(tmp_path, "--device", DEVICE, "--hand", "still", "--seed", "3")
    try:
        with live_window(Setup(tmp_path / "data", devices=(DEVICE,), link=str(emulated.port), sync=False)) as seen:
            yield OnBench(seen, emulated)
    finally:
        emulated.end()


def test_a_board_that_is_connected_anew_is_made_ready_again(on_bench: OnBench) -> None:
    on_bench.zero()
    on_bench.seen.client.send(m.Rig(m.CONNECT))
    on_bench.seen.until_stage(m.RERIG)
    on_bench.zero()


def test_no_trial_starts_while_a_step_is_done_and_none_without_a_zero(on_bench: OnBench) -> None:
    seen = on_bench.seen
    on_bench.zero()
    seen.client.send(m.Rig(m.CONNECT))
    seen.client.send(m.Start())
    seen.until(lambda s: s.said_bad and "a moment" in s.said)
    seen.until_stage(m.RERIG)
    on_bench.zero()
    seen.start()
    seen.client.send(m.Abort("seen"))
    rows = seen.until(lambda s: s.rows).rows
    recording = read_recording(Path(seen.opened.folder) / rows[0].recording)
    assert recording.outcome["link"]["zero"] is not None


def test_a_press_of_brakes_off_after_allow_stands_while_the_board_is_busy(on_bench: OnBench) -> None:
    seen = on_bench.seen
    on_bench.zero()
    seen.client.brakes_off("the first press")
    seen.until(lambda s: s.brakes_off)
    seen.client.send(m.Rig(m.CONNECT))  # the loop is busy for a while
    seen.client.send(m.AllowBrakes())
    seen.client.send(m.Note("after that"))
    seen.until(lambda s: s.notes)
    seen.client.brakes_off("the second press")
    wait_until(lambda: on_bench.status.device and not on_bench.status.zeroed)
    assert seen.snapshot.brakes_off
    seen.client.send(m.AllowBrakes())
    seen.until(lambda s: not s.brakes_off)
    on_bench.zero()


def test_trials_with_another_hand_are_not_mixed_into_a_session(tmp_path: Path) -> None:
    Session(tmp_path / "data", "01", PAPER, sync=False, hand="force sensor").close()
    with live_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.until_stage(m.NO_SESSION)
        seen.client.send(m.Open("01", resume=True))
        said = seen.until_stage(m.READY)
        assert said.said_bad and "a device on the bench" in said.said and "mouse" in said.said
        seen.client.send(m.Start())
        seen.until(lambda s: s.said_bad and s.said.startswith("It was begun with"))
        seen.client.send(m.Note("opened by mistake"))
        assert seen.until(lambda s: s.notes).rows == ()
    assert not any((tmp_path / "data").rglob("run-*"))


def test_a_session_whose_hand_nobody_knows_is_opened_and_not_gone_on_with(tmp_path: Path) -> None:
    Session(tmp_path / "data", "01", PAPER, sync=False, hand="a foot").close()
    with live_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.until_stage(m.NO_SESSION)
        seen.client.send(m.Open("01", resume=True))
        assert "'a foot'" in seen.until_stage(m.READY).said


def test_a_session_is_left_and_opened_again_in_one_go(tmp_path: Path) -> None:
    with live_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.open()
        for intent in (m.Leave(), m.Open("01", resume=True), m.Note("here again")):
            seen.client.send(intent)
        assert seen.until(lambda s: s.notes).stage == m.READY
