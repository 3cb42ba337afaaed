"""The ring between loop, recorder and window, and the loop's kernels on it, without a second process."""

import mmap
import os
import sys
import threading
import time

import numpy as np
import pytest
from disks import full
from protocols import PAPER

from app.ipc.client import Client
from app.ipc.messages import Setup
from app.ipc.pipe import Pipe
from app.ipc.ring import BRAKES_OFF, GRASP_RADIUS_M, LET_GO, NO_CAUSE, RING_FULL, SERVER_SILENT, STOPPED, TAKEN, Ring
from app.loop.clock import new_timer, now_ns
from app.loop.loop import stopped_trial
from app.loop.real_time import HOMEWARD_M_S, MOST_BEHIND_NS, ROOM, TICK_NS, due, put, run_trial, take_aim
from core import tick_log
from core.files import InputError
from core.records import new_record
from core.simulator.hand import GRIP, grip_force

SMALL = 64
FOR_EVER_NS = 1 << 62  # a beat of a session server that never falls silent


@pytest.fixture
def ring() -> Ring:
    return Ring(ticks=SMALL)


def put_ticks(ring: Ring, first: int, n: int) -> None:
    """n ticks, numbered in their first column, as the loop puts them."""
    for number in range(first, first + n):
        put(ring.controls, ring.rows, np.full(tick_log.WIDTH, float(number)))


def test_a_ring_that_goes_round_many_times_hands_every_tick_on_once_and_in_order(ring: Ring) -> None:
    window = Ring(ring.handle)
    generator, put_so_far, recorded, shown = np.random.default_rng(1), 0, [], []
    while put_so_far < 20 * SMALL:
        n = int(generator.integers(0, SMALL // 2))
        put_ticks(ring, put_so_far, n)
        put_so_far += n
        rows = ring.unrecorded_ticks()
        ring.mark_recorded(len(rows))
        recorded.append(rows)
        shown.append(window.newest())
    for rows in (np.concatenate(recorded), np.concatenate(shown)):
        assert np.array_equal(rows[:, 0], np.arange(put_so_far))
        assert np.array_equal(rows[:, -1], rows[:, 0]), "no row is half of another"


def test_a_tick_that_could_not_be_recorded_is_taken_again(ring: Ring) -> None:
    put_ticks(ring, 0, 5)
    assert len(ring.unrecorded_ticks()) == 5
    ring.mark_recorded(3)
    assert ring.unrecorded_ticks()[:, 0].tolist() == [3.0, 4.0]


def test_a_window_that_hung_or_comes_later_gets_the_newest_ticks_and_none_that_is_being_overwritten(ring: Ring) -> None:
    window = Ring(ring.handle)
    for first in range(0, 5 * SMALL, SMALL):
        put_ticks(ring, first, SMALL)
        ring.mark_recorded(SMALL)  # the recorder keeps up
    put_ticks(ring, 5 * SMALL, 3)
    rows = window.newest()
    assert rows[-1, 0] == 5 * SMALL + 2 and np.all(np.diff(rows[:, 0]) == 1.0)
    assert SMALL // 2 < len(rows) < SMALL
    assert len(window.newest()) == 0
    put_ticks(ring, 0, 10)
    window = Ring(ring.handle)
    put_ticks(ring, 10, 2)
    assert window.newest()[:, 0].tolist() == [10.0, 11.0]


def test_the_cause_of_a_brakes_off_is_the_first_and_stands_until_brakes_are_allowed(ring: Ring) -> None:
    assert ring.why_off == ""
    ring.switch_off("Esc: the participant's finger – stuck")
    ring.switch_off("another")
    assert Ring(ring.handle).why_off == "Esc: the participant's finger – stuck"
    ring.allow()
    ring.switch_off("")
    assert ring.why_off == "no cause given"
    ring.allow()
    ring.switch_off("é" * 1000)
    assert set(ring.why_off) == {"é"}


def test_a_tick_is_due_a_millisecond_after_the_last_however_late_and_after_a_long_stall_time_waits(ring: Ring) -> None:
    late = MOST_BEHIND_NS
    while late >= MOST_BEHIND_NS:  # held up just then: that is the next test's
        now = now_ns(new_timer())
        late, following = due(ring.control, now - 10 * TICK_NS, new_timer())
    assert late >= 10 * TICK_NS and following == now - 9 * TICK_NS
    late, following = due(ring.control, now_ns(new_timer()) + TICK_NS, new_timer())
    assert late >= 0 and following > now
    now = now_ns(new_timer())
    late, following = due(ring.control, now - 60_000 * TICK_NS, new_timer())
    assert late >= 60_000 * TICK_NS and following > now


def test_the_spring_pulls_nowhere_until_the_pointer_has_touched_the_handle(ring: Ring) -> None:
    grip, tip = new_record(GRIP)[0], np.array([0.0, 0.4, 0.0, 0.0])
    grip.target = (0.0, 0.4, 0.0, 0.0)
    take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)  # no pointer at all
    for x, y in ((0.3, 0.4), (1.5 * GRASP_RADIUS_M, 0.4)):
        ring.aim(x, y)
        take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
        assert not ring.control.taken and grip.target.tolist() == [0.0, 0.4, 0.0, 0.0]
    ring.aim(0.5 * GRASP_RADIUS_M, 0.4)
    take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
    assert ring.control.taken and grip.target[0] == 0.5 * GRASP_RADIUS_M
    ring.aim(0.3, 0.1)  # a jump: the handle stays in hand
    take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
    assert grip.target.tolist() == [0.3, 0.1, 0.0, 0.0] and grip.force_max == 40.0


@pytest.mark.parametrize("phase, counted", [(tick_log.APPROACH, 0), (tick_log.MOVE, 1)])
def test_a_pointer_that_leaves_lets_the_handle_go_and_must_touch_it_again(ring: Ring, phase, counted) -> None:
    hand, tip = PAPER.mouse.hand(), np.array([0.02, 0.4, 0.1, 0.0])
    grip, force_max = hand.grips[0], PAPER.mouse.force_max_N

    def pull(x: float, y: float) -> tuple[float, float]:
        ring.aim(x, y)
        take_aim(ring.control, grip, tip, phase, force_max)
        return grip_force(grip, *tip)

    assert pull(0.02, 0.4) != (0.0, 0.0)
    ring.let_go()
    take_aim(ring.control, grip, tip, phase, force_max)
    assert not ring.control.taken and grip_force(grip, *tip) == (0.0, 0.0)
    tip[:] = 0.05, 0.4, 0.3, 0.0  # it coasts on, and nothing holds it
    assert pull(-0.20, 0.4) == (0.0, 0.0)  # the pointer is back, 250 mm away
    assert abs(pull(0.055, 0.4)[0]) < 0.5 * force_max and ring.control.taken
    assert ring.control.let_go == counted


def test_before_and_after_the_movement_the_spring_goes_home_from_where_the_pointer_left_it(ring: Ring) -> None:
    home = (-0.1, 0.4)
    ring.begin_trial(home=home)
    grip, tip = new_record(GRIP)[0], np.array([0.02, 0.4, 0.1, 0.0])
    for x in (0.02, 0.05):
        ring.aim(x, 0.4)
        take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
    ring.let_go()
    before = grip.target.copy()
    for phase in (tick_log.APPROACH, tick_log.HOLD, tick_log.END):
        take_aim(ring.control, grip, tip, phase, 40.0)
        step = np.hypot(*(grip.target - before)[:2])
        assert grip.force_max == 40.0 and step == pytest.approx(1e-3 * HOMEWARD_M_S) and not ring.control.taken
        before = grip.target.copy()
    for _ in range(2000):
        take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
    assert grip.target.tolist() == [*home, 0.0, 0.0] and ring.grasp == LET_GO
    take_aim(ring.control, grip, tip, tick_log.MOVE, 40.0)
    assert grip.force_max == 0.0, "in the movement it is nobody's"
    ring.aim(0.02, 0.4)
    take_aim(ring.control, grip, tip, tick_log.APPROACH, 40.0)
    assert ring.grasp == TAKEN and grip.target[0] == 0.02


def test_after_a_trial_that_was_let_go_the_spring_is_what_it_was(ring: Ring) -> None:
    running = Running(Ring())
    force_max = float(PAPER.mouse.force_max_N)
    running.ring.aim(*running.trial.data.body[0].tip[:2])
    running.until(20)
    running.ring.let_go()
    running.until(40)
    running.ring.control.stop = 1
    running.end()
    rows = running.ring.unrecorded_ticks()
    assert set(rows[:, tick_log.ARM_FORCE_MAX]) == {0.0, force_max}  # so that a replay feels the same hand
    assert running.trial.data.hand.grips["force_max"][0] == force_max


class Running:
    """A trial of the mouse that the kernel runs in a thread; the recorder's and the server's part is the test's."""

    def __init__(self, ring: Ring, behind: int = 0) -> None:
        """behind: ticks in the ring that the recorder has not taken yet."""
        self.ring, self.trial = ring, stopped_trial().arguments()
        self.trial.run["stop"][0] = 0
        ring.begin_trial()
        ring.control.server_beat = FOR_EVER_NS
        ring.control.tail -= behind
        spare = np.zeros((1, tick_log.WIDTH))
        self.thread = threading.Thread(
            target=run_trial, args=(ring.controls, ring.rows, spare, new_timer(), self.trial)
        )
        self.thread.start()

    def until(self, ticks: int) -> None:
        """Wait until there are so many ticks."""
        while self.ring.control.head < ticks:
            time.sleep(0.002)

    def end(self) -> int:
        """Wait for the end; why it ended."""
        self.thread.join()  # as long as its kernels may have to be compiled
        return int(self.ring.control.cause)

    def assert_ended_without_current(self) -> None:
        rows = self.ring.unrecorded_ticks()
        ended = rows[:, tick_log.PHASE] == tick_log.END
        assert not rows[ended, tick_log.CURRENT : tick_log.CURRENT + 4].any() and ended[-1]
        assert np.allclose(np.diff(rows[:, tick_log.T]), 1e-3)


@pytest.fixture
def large() -> Ring:
    return Ring()


@pytest.mark.parametrize("cause", [STOPPED, BRAKES_OFF, SERVER_SILENT, RING_FULL])
def test_whatever_ends_a_trial_from_outside_it_ends_without_current_and_says_why(large: Ring, cause: int) -> None:
    running = Running(large)
    running.until(50)
    assert large.control.cause == NO_CAUSE
    if cause == STOPPED:
        large.control.stop = 1
    elif cause == BRAKES_OFF:
        large.switch_off("Esc")
    elif cause == SERVER_SILENT:
        large.beat()  # the last one
    elif cause == RING_FULL:
        large.control.tail -= len(large.rows) - ROOM  # a recorder that has taken nothing for long
    assert running.end() == cause
    if cause == RING_FULL:
        large.control.tail += len(large.rows) - ROOM
    running.assert_ended_without_current()
    assert large.control.dropped == 0


def test_a_ring_without_any_room_counts_the_ticks_it_loses_and_overwrites_none(large: Ring) -> None:
    large.rows[:] = -1.0
    assert Running(large, behind=len(large.rows)).end() == RING_FULL
    assert large.control.dropped > 0 and large.control.head == 0
    assert np.all(large.rows == -1.0)


def test_brakes_that_are_off_before_a_trial_never_come_on_in_it(large: Ring) -> None:
    large.switch_off("Esc")
    assert Running(large).end() == BRAKES_OFF
    assert not large.unrecorded_ticks()[:, tick_log.CURRENT : tick_log.CURRENT + 4].any()


def test_without_memory_for_the_ring_no_server_is_started_and_one_sentence_says_why(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(*((mmap, "mmap") if sys.platform == "win32" else (os, "memfd_create")), full)
    with pytest.raises(InputError, match="no memory for the ticks of the control loop"):
        Client(Setup(tmp_path / "data"))
    assert not (tmp_path / "data").exists()


def two_ends() -> tuple[Pipe, Pipe, int]:
    """Ours and theirs; and the end of theirs that hears us, which is still to be read."""
    (hear_us, to_them), (hear_them, to_us) = os.pipe(), os.pipe()
    return Pipe(open(hear_them, "rb"), open(to_them, "wb")), hear_us, to_us


def other_end(hear_us: int, to_us: int) -> Pipe:
    return Pipe(open(hear_us, "rb"), open(to_us, "wb"))


def all_of(pipe: Pipe) -> list:
    """Every message up to the end."""
    got: list = []
    while not pipe.closed:
        got += pipe.receive(1.0)
    return got


@pytest.mark.timeout(60)
def test_an_end_that_does_not_read_never_makes_the_other_wait_and_loses_nothing() -> None:
    ours, *unread = two_ends()
    for i in range(300):
        ours.send((i, bytes(1000)))  # more than the system keeps for it
    began = time.perf_counter()
    ours.flush(0.1)
    assert ours.has_backlog and time.perf_counter() - began < 30.0
    theirs = other_end(*unread)
    ours.close()
    assert [i for i, _ in all_of(theirs)] == list(range(300))
    ours.flush(30.0)
    assert not ours.has_backlog
    theirs.close()
    assert all_of(ours) == []


def test_what_an_end_said_right_before_it_left_is_heard_whole_and_in_order_also_by_one_that_spoke_meanwhile() -> None:
    ours, *unread = two_ends()
    theirs = other_end(*unread)
    theirs.send("nobody reads this")
    ours.send("abort")
    ours.close()
    theirs.send("a snapshot")
    assert all_of(theirs) == ["abort"]
    theirs.close()
    ours, *unread = two_ends()
    theirs = other_end(*unread)
    for message in [np.arange(n) for n in (0, 1, 100_000, 3)]:
        ours.send(message)
    ours.close()
    assert [len(message) for message in all_of(theirs)] == [0, 1, 100_000, 3]
    theirs.close()


def test_an_end_that_is_killed_in_the_middle_of_a_message_is_gone() -> None:
    ours, hear_us, to_us = two_ends()
    os.write(to_us, b"\x80\x05\x95")  # the beginning of a message
    os.close(to_us)
    assert all_of(ours) == []
    os.close(hear_us)
    ours.send("nobody is there")
    ours.flush(30.0)
    assert not ours.has_backlog
