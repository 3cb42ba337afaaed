"""The flags of a trial, from its row and its ticks."""

import numpy as np
from fake_client import PLAN, movement, result

from core import tick_log
from experiments.analysis.flags import trial_flags


def test_a_hand_that_let_the_handle_go_in_the_movement_is_flagged_with_how_often() -> None:
    row, ticks = result(PLAN[0]), movement(1, "AEB", 1.0)
    ticks[:, tick_log.ARM_FORCE_MAX] = 40.0
    assert trial_flags(row, ticks) == []
    ticks[200:300, tick_log.ARM_FORCE_MAX] = 0.0
    (flag,) = trial_flags(row, ticks)
    assert "left the picture once" in flag
    ticks[500:, tick_log.ARM_FORCE_MAX] = 0.0
    assert "2 times" in trial_flags(row, ticks)[0]
    before_it = np.copy(ticks)
    before_it[:, tick_log.PHASE] = tick_log.APPROACH  # harmless there
    assert trial_flags(row, before_it) == []
