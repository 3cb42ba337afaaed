"""The control loop: its pace, its pipe, the grasp, and whole trials without a window or a second process."""

import json
import threading
import time
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest
from synthetic_hand import SyntheticHand

from app import recorder as recorder_module
from app.grasp import GRASP_RADIUS_M, Grasp
from app.loop import WINDOW_DIED, Loop
from app.mailbox import Mailbox
from app.messages import Abort, Aim, Begun, Ended, Failed, Prepared, Quit, Refused, Start, Ticks
from app.pace import MOST_AT_ONCE, Pace
from core import row
from core.device import load_device
from experiments.recording import read_recording
from experiments.session import Choices
from experiments.trials_table import read_table


class Clock:
    """A clock that only sleep moves, each time a little too far."""

    def __init__(self, oversleep: float) -> None:
        self.now, self.oversleep = 10.0, oversleep

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + self.oversleep


def test_a_loop_that_oversleeps_keeps_one_tick_a_millisecond() -> None:
    clock = Clock(oversleep=0.0004)
    pace = Pace(clock, clock.sleep)
    began = clock.now
    late = np.concatenate([pace.wait() for _ in range(1000)])
    assert len(late) == 1000
    assert clock.now - began == pytest.approx(0.999, abs=1e-3)
    assert np.all(late[1:] == pytest.approx(400.0, abs=1e-3))


def test_ticks_missed_in_a_stall_are_run_at_once_each_with_its_own_lateness() -> None:
    clock = Clock(oversleep=0.0)
    pace = Pace(clock, clock.sleep)
    pace.wait()
    clock.now += 0.0105
    assert pace.wait() == pytest.approx([9500.0 - 1000.0 * i for i in range(10)])
    assert len(pace.wait()) == 1


def test_after_a_long_stall_the_time_of_the_trial_waits() -> None:
    clock = Clock(oversleep=0.0)
    pace = Pace(clock, clock.sleep)
    pace.wait()
    clock.now += 60.0
    assert len(pace.wait()) == MOST_AT_ONCE
    late = pace.wait()
    assert len(late) == 1 and late[0] == pytest.approx(0.0, abs=1e-6)


def test_the_spring_pulls_nowhere_until_the_pointer_has_touched_the_handle() -> None:
    tip = (0.0, 0.4)
    grasp = Grasp(tip, pointer=(0.3, 0.4))
    assert not grasp.taken and grasp.target == tip
    grasp.point((1.5 * GRASP_RADIUS_M, 0.4), tip)
    assert not grasp.taken and grasp.target == tip
    grasp.point((0.5 * GRASP_RADIUS_M, 0.4), tip)
    assert grasp.taken and grasp.target == (0.5 * GRASP_RADIUS_M, 0.4)
    grasp.point((0.3, 0.1), tip)  # a jump: the handle stays in hand
    assert grasp.taken and grasp.target == (0.3, 0.1)


def test_a_window_that_does_not_read_never_makes_the_loop_wait_and_loses_no_event() -> None:
    ours, theirs = Pipe()
    mailbox = Mailbox(ours)
    began = time.monotonic()
    offered = [mailbox.offer(bytes(4000)) for _ in range(500)]
    for i in range(300):
        mailbox.send((i, bytes(1000)))
    assert time.monotonic() - began < 2.0  # a send that waits would wait for ever
    assert offered[0] and not offered[-1]
    events: list[int] = []
    while len(events) < 300 and theirs.poll(2.0):
        message = theirs.recv()
        if isinstance(message, tuple):
            events.append(message[0])
        mailbox.flush()
    assert events == list(range(300))
    theirs.close()
    assert mailbox.receive(1.0) == [] and mailbox.closed
    mailbox.close()


class Session:
    """A loop in a thread of this process, and the window's end of its pipe in the test's hands."""

    def __init__(self, data: Path) -> None:
        self.data = data
        ours, theirs = Pipe()
        self.mailbox = Mailbox(ours)
        devices = [load_device("three-brake"), load_device("four-brake")]
        self.loop = Loop(Mailbox(theirs), devices, data, Choices())
        self.thread = threading.Thread(target=self.loop.serve)
        self.thread.start()
        self.said: list = []

    def until(self, kind: type, seconds: float = 120.0):
        """The next message of a kind; the ones before it are kept in `said`."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for message in self.mailbox.receive(0.05):
                self.said.append(message)
            for i, message in enumerate(self.said):
                if isinstance(message, kind):
                    del self.said[: i + 1]
                    return message
        raise AssertionError(f"no {kind.__name__} within {seconds} s")

    def begin(self, participant: str = "01") -> Begun:
        self.mailbox.send(Start(participant))
        return self.until(Begun)

    def run_trial(self) -> Ended:
        """One whole trial by a synthetic hand."""
        begun = self.begin()
        hand = SyntheticHand(begun.planned.segment, begun.tip)
        while True:
            message = self.until((Ticks, Ended))  # type: ignore[arg-type]
            if isinstance(message, Ended):
                return message
            now = message.rows[-1]
            tip = (now[row.TIP_X], now[row.TIP_Y])
            self.mailbox.send(Aim(*hand(tip, int(now[row.PHASE]), 1e-3 * len(message.rows))))

    def end(self) -> None:
        self.mailbox.send(Quit("the test is over"))
        self.thread.join(20.0)
        self.mailbox.close()
        assert not self.thread.is_alive()

    def recording(self, run: int):
        return read_recording(self.data / "sub-01" / "ses-01" / "trials" / f"run-{run:03d}.parquet")


@pytest.fixture
def session(tmp_path: Path):
    opened = Session(tmp_path / "data")
    opened.until(Prepared)
    yield opened
    opened.end()
    assert not [thread for thread in threading.enumerate() if thread.name == "recorder"]


def test_a_trial_in_real_time_has_a_row_for_every_millisecond_and_says_how_late_each_was(session: Session) -> None:
    assert not session.data.exists()  # nothing is made before the first start
    began = time.monotonic()
    ended = session.run_trial()
    wall = time.monotonic() - began
    assert ended.row.status == "done" and ended.next is not None and ended.next.run == 2
    recording = session.recording(1)
    assert recording.whole
    assert np.array_equal(recording.column("t_s"), np.arange(recording.rows) * 1e-3)
    assert recording.rows * 1e-3 <= wall
    assert np.all(recording.column("lateness_us") >= 0.0) and np.any(recording.column("lateness_us") > 0.0)
    hand = np.hypot(recording.column("hand_fx_N"), recording.column("hand_fy_N"))
    assert 0.5 < hand.max() <= 40.0 + 1e-9
    off = ~recording.in_phase("move")
    assert all(not recording.column(f"current_{joint}_A")[off].any() for joint in recording.braked)


def test_an_abort_ends_in_zero_current_keeps_its_reason_and_the_plan_goes_on(session: Session) -> None:
    session.begin()
    session.until(Ticks)
    session.mailbox.send(Abort("the participant asked"))
    ended = session.until(Ended)
    assert (ended.row.status, ended.reason) == ("aborted", "the participant asked")
    recording = session.recording(1)
    assert recording.whole and recording.outcome["reason"] == "the participant asked"
    assert recording.text("phase")[-1] == "end"
    assert not any(recording.column(f"current_{joint}_A")[-1] for joint in recording.braked)
    assert session.begin().planned.run == 2
    session.mailbox.send(Abort("enough"))
    assert session.until(Ended).row.run == 2
    assert [r.status for r in read_table(session.data / "trials.csv")] == ["aborted", "aborted"]


def test_the_handle_stays_when_the_pointer_is_elsewhere_at_the_start(session: Session) -> None:
    session.mailbox.send(Aim(0.3, 0.1))
    begun = session.begin()
    for _ in range(6):
        ticks = session.until(Ticks)
    assert not ticks.taken
    assert ticks.rows[-1, row.TIP_X] == begun.tip[0] and ticks.rows[-1, row.TIP_Y] == begun.tip[1]


def test_a_window_that_is_gone_ends_the_trial_and_its_recording_is_kept(tmp_path: Path) -> None:
    session = Session(tmp_path)
    session.until(Prepared)
    session.begin()
    session.until(Ticks)
    session.mailbox.close()
    session.thread.join(20.0)
    assert not session.thread.is_alive()
    recording = session.recording(1)
    assert recording.whole and recording.outcome["reason"] == WINDOW_DIED
    events = [json.loads(text) for text in (tmp_path / "sub-01/ses-01/journal.jsonl").read_text().splitlines()]
    assert events[-1]["event"] == "trial ended" and events[-1]["status"] == "aborted"


def test_a_participant_with_a_session_is_refused_and_another_one_can_start(session: Session) -> None:
    folder = session.data / "sub-01" / "ses-01"
    folder.mkdir(parents=True)
    (folder / "session.json").write_text("{}")
    session.mailbox.send(Start("01"))
    assert "exists already" in session.until(Refused).sentence
    assert [path.name for path in folder.iterdir()] == ["session.json"]
    assert session.begin("02").planned.run == 1


def test_a_full_disk_ends_the_trial_says_so_and_no_other_one_starts(session: Session, monkeypatch) -> None:
    session.begin()
    session.until(Ticks)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder_module.RecordingWriter, "write", full)
    assert "No space left on device" in session.until(Failed).sentence
    session.mailbox.send(Start("01"))
    assert "No space left on device" in session.until(Refused).sentence
