"""Try's five controllers are felt: the same hand at the pointer gets another force from each of them."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import simulated_loop
from simulated_loop import LocalWindow, local_window

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log
from core.tick_log import TICK_S

SPEED_M_S, TO_START_M_S, ASIDE_M, SWINGS = 0.08, 0.08, 0.01, 2.0
PULL_PER_S = 4.0  # at which the pointer goes beyond the start while the handle is short of it
FELT_N = 0.5


class SwingingHand:
    """A pointer that someone moves to try a guide: to the start, then along path 1 and 1 cm to either side of it."""

    start, length = np.array((-0.10, 0.40)), 0.20

    def __init__(self, tip: np.ndarray) -> None:
        self.way, self.at = 0.0, np.array(tip)

    def next(self, tip: np.ndarray, phase: int, seconds: float) -> np.ndarray:
        """Where the pointer is so much later, m."""
        if phase == tick_log.APPROACH:
            left = self.start - self.at
            far = float(np.hypot(*left))
            self.at = self.at + left * min(1.0, TO_START_M_S * seconds / max(far, 1e-9))
            self.at = self.at + (PULL_PER_S * seconds * (self.start - tip) if far < 0.004 else 0.0)
        elif phase != tick_log.HOLD:
            self.way += SPEED_M_S * seconds
            aside = ASIDE_M * math.sin(2.0 * math.pi * SWINGS * min(1.0, self.way / self.length))
            self.at = self.start + (self.way, aside)
        return self.at


def passes(window: LocalWindow, count: int) -> list[np.ndarray]:
    """The forces of the swinging hand (ticks, 2), N, during the movement of one pass after the other."""
    hand, number, forces = None, 0, []
    while len(window.snapshot.sandbox.passes) < count:
        window.look()
        rows, running = window.ticks[-1], window.snapshot.running
        if not len(rows) or running is None:
            continue
        tip, phase = rows[-1, tick_log.TIP_X : tick_log.TIP_Y + 1], int(rows[-1, tick_log.PHASE])
        if hand is None or running.repetition != number or not window.client.taken:
            hand, number = SwingingHand(tip), running.repetition
        window.client.ring.aim(*hand.next(tip, phase, TICK_S * len(rows)))
    rows = window.rows
    moving = np.flatnonzero(rows[:, tick_log.PHASE] == tick_log.MOVE)
    for one in np.split(moving, np.flatnonzero(np.diff(moving) > 1) + 1)[:count]:
        forces.append(rows[one, tick_log.HAND_FX : tick_log.HAND_FY + 1])
    return forces


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """How far two passes lie apart: root mean square of the difference of their forces at the same time, N."""
    ticks = min(len(one), len(other))
    return float(np.sqrt(np.mean(np.sum((one[:ticks] - other[:ticks]) ** 2, axis=1))))


@pytest.fixture(autouse=True)
def mouse_reports(monkeypatch):
    """The pointer moves 50 times a second."""
    monkeypatch.setattr(simulated_loop, "PIECE", 20)


def tried(folder: Path, device: str, number: int, count: int, low_gain: float | None = None) -> list[np.ndarray]:
    """So many passes with a controller."""
    with local_window(Setup(folder / f"{number}", devices=(device,), low_gain=low_gain, sync=False)) as window:
        window.until_stage(m.NO_SESSION)
        window.client.send(m.SetSandbox())
        settings = window.until(lambda s: s.sandbox and s.running).sandbox.settings
        own = window.opened.protocol.controllers[number].named
        window.client.send(m.SetSandbox(settings._replace(controller=number).with_parameters(**own)))
        return passes(window, count)


@pytest.mark.parametrize(("device", "count"), [("three-brake", 2), ("four-brake", 1)])
def test_each_of_the_five_is_felt_from_every_other_by_more_than_the_same_one_from_pass_to_pass(tmp_path, device, count):
    found = {number: tried(tmp_path, device, number, count) for number in range(1, 6)}
    repeats = max(
        (apart(one, other) for own in found.values() for one, other in itertools.combinations(own, 2)), default=0
    )
    pairs = {
        (a, b): min(apart(one, other) for one in found[a] for other in found[b])
        for a, b in itertools.combinations(found, 2)
    }
    assert min(pairs.values()) > max(FELT_N, repeats), (pairs, repeats)


def test_with_the_low_gain_as_printed_nothing_is_felt_of_it(tmp_path):
    (none,), (low,) = (tried(tmp_path, "three-brake", number, 1, 5.0) for number in (1, 5))
    assert apart(none, low) == 0.0
