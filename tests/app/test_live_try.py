"""Try over real processes: a pass with a change in the middle of it."""

import time
from pathlib import Path

import numpy as np
import pytest
from live import live_window
from synthetic_hand import SyntheticHand

from app.ipc import messages as m
from app.ipc.messages import Setup
from core import tick_log

FROZEN_S = 0.5  # a change takes milliseconds; this machine may be held up


def test_a_controller_that_is_changed_in_mid_movement_acts_at_once_and_moves_nothing(tmp_path: Path) -> None:
    with live_window(Setup(tmp_path / "data", real_time=False)) as window:
        window.client.send(m.Sandbox())
        running = window.until(lambda s: s.sandbox and s.running).running
        hand, last, changed_at = SyntheticHand(running.segment, window.snapshot.tip), time.perf_counter(), 0
        while not window.snapshot.sandbox.passes:
            window.look()
            rows, now = window.rows, time.perf_counter()
            if not len(rows):
                continue
            if not changed_at and np.count_nonzero(rows[:, tick_log.PHASE] == tick_log.MOVE) > 200:
                changed_at = len(rows)
                free = window.snapshot.sandbox.settings._replace(controller=1)
                window.client.send(m.Sandbox(free))
            tip, phase = (rows[-1, tick_log.TIP_X], rows[-1, tick_log.TIP_Y]), int(rows[-1, tick_log.PHASE])
            window.client.aim(*hand(tip, phase, now - last))
            last = now
            time.sleep(0.005)
        (found,) = window.snapshot.sandbox.passes
        first = rows[: 1 + int(np.argmax(np.diff(rows[:, tick_log.T], append=-1.0) < 0.0))]  # without the next pass
        assert found.changed and found.settings.controller == 1 and found.status == "done"
        assert np.allclose(np.diff(first[:, tick_log.T]), 1e-3, atol=1e-9)
        moves = first[first[:, tick_log.PHASE] == tick_log.MOVE]
        codes = moves[:, tick_log.DECISION]
        free_from = int(np.argmax(codes == 0))  # "none": no control
        assert set(codes[free_from:]) == {0} and 200 <= free_from < 200 + 1e3 * FROZEN_S
        speed = np.hypot(moves[:, tick_log.TIP_VX], moves[:, tick_log.TIP_VY])
        assert np.abs(np.diff(speed)[free_from - 5 : free_from + 5]).max() < 0.05  # m/s in a tick: 50 m/s2
        assert moves[-1, tick_log.TIP_X] == pytest.approx(0.1, abs=0.011)
