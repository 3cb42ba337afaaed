"""The lights of loop and picture: what is true now, by thresholds that are written down."""

from itertools import product

import numpy as np
from fake_client import ready

from app.ipc import messages as m
from app.ipc.scheduling import Scheduling
from app.session_server.loop_light import CALM_S, WINDOW_S, LoopLight
from app.session_server.preflight import check_device
from app.window.picture_light import PictureLight
from core import tick_log
from core.faults import FAULTS, cause

DEFAULT = Scheduling(False, False, -1, "default")


class Clock:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def ticks(count: int, missed: int = 0) -> np.ndarray:
    """The lateness of so many ticks, us, of which some were missed."""
    lateness = np.full(count, 10.0)
    lateness[:missed] = tick_log.MISSED_US
    return lateness


def test_of_two_thousand_ticks_one_missed_is_amber_and_twenty_of_a_board_are_red_for_two_seconds() -> None:
    assert LoopLight(True, Clock()).check(DEFAULT) == m.Check("Loop", m.GOOD, "1 kHz"), "before any tick"
    states = (0, m.GOOD, m.GOOD), (1, m.CAUTION, m.CAUTION), (19, m.CAUTION, m.CAUTION), (20, m.CAUTION, m.BAD)
    for (missed, *of), is_board in product(states, (False, True)):
        light = LoopLight(is_board, clock := Clock())
        light.take(ticks(2000, missed))
        check = light.check(DEFAULT)
        assert check.state == of[is_board]
        assert check.text == (f"late: {missed} tick{'s' * (missed > 1)} missed in the last 2 s" if missed else "1 kHz")
        assert ("close other programs" in check.advice) is bool(missed)
        assert ready(1, checks=(check,)).trial_blocker.startswith("Loop: ") is (check.state == m.BAD)
        clock.now_s += WINDOW_S - 0.1
        assert light.check(DEFAULT).state == check.state
        clock.now_s += 0.2
        assert light.check(DEFAULT).state == (m.BAD if check.state == m.BAD else m.GOOD)


def test_misses_two_seconds_apart_are_not_added() -> None:
    light = LoopLight(True, Clock())
    for _ in range(4):
        light.take(ticks(2000, 10))
    assert light.check(DEFAULT).state == m.CAUTION
    light.take(ticks(1000, 10))
    light.take(ticks(500, 10))
    assert light.check(DEFAULT).state == m.BAD, "but those within two seconds are"


def test_a_boards_loop_that_could_not_keep_up_stays_red_for_ten_seconds_without_a_missed_tick() -> None:
    light = LoopLight(True, clock := Clock())
    light.take(ticks(2000, 30))
    clock.now_s += CALM_S - 0.1
    light.take(ticks(2000))
    assert light.check(DEFAULT).text == "cannot keep up" and light.check(DEFAULT).state == m.BAD
    light.take(ticks(2000, 1))
    clock.now_s += CALM_S - 0.1
    assert light.check(DEFAULT).state == m.BAD, "one more missed tick, and the ten seconds begin again"
    clock.now_s += 0.2
    assert light.check(DEFAULT).state == m.GOOD
    light.take(ticks(2000, 1))
    assert light.check(DEFAULT).state == m.CAUTION, "what was forgotten is not counted again"


def test_a_picture_half_a_second_behind_is_amber_for_two_seconds_and_keeps_no_trial_from_starting() -> None:
    light = PictureLight(clock := Clock())
    assert not light.take(0.4) and light.over(ready(1)) == ready(1)
    assert light.take(0.6)
    seen = light.over(ready(1))
    assert [check.state for check in seen.checks if check.name == "Picture"] == [m.CAUTION] and not seen.trial_blocker
    clock.now_s += WINDOW_S + 0.1
    assert light.over(ready(1)) == ready(1)


def test_brakes_that_are_off_come_with_what_to_do_about_their_fault():
    check = check_device(True, cause("server-silent"))
    assert check.state == m.BAD and check.advice.endswith(FAULTS["server-silent"].advice)
    assert check_device(True, "somebody pressed it").advice == "Brakes off. Somebody pressed it."
