"""Whose fault late ticks are: what the system counts, and what it does not."""

import os
import sys
from collections.abc import Callable

import numpy as np
import pytest

from app.ipc.ring import Ring
from app.ipc.scheduling import LostTime, lost_time
from app.session_server.recorder import Recorder
from core import tick_log

STAT = "cpu  1 0 1 9 0 0 0 7 0 0\ncpu0 1 0 0 4 0 0 0 5 0 0\ncpu1 0 0 1 5 0 0 0 2 0 0\nintr 5\n"
FILES = {
    "/proc/stat": STAT,
    "/proc/7/schedstat": "123456789 2500000 345\n",
    "/proc/7/status": "Name:\tpython\nvoluntary_ctxt_switches:\t150\nnonvoluntary_ctxt_switches:\t12\n",
}
linux = pytest.mark.skipif(sys.platform != "linux", reason="another system counts none of this")


def reads(files: dict[str, str]) -> Callable[[str], str]:
    def read(path: str) -> str:
        if path not in files:
            raise FileNotFoundError(path)
        return files[path]

    return read


@linux
@pytest.mark.parametrize(("core", "jiffies"), [(-1, 7), (0, 5), (1, 2), (12, None)])
def test_the_host_the_scheduler_and_the_switches_are_as_the_system_counts_them(core: int, jiffies: int | None) -> None:
    found = lost_time(7, core, reads(FILES))
    stolen = None if jiffies is None else 1e3 * jiffies / os.sysconf("SC_CLK_TCK")
    assert found == LostTime(stolen, pytest.approx(2.5), 12)


def test_the_passport_of_a_trial_holds_the_ticks_own_time_where_the_loop_measured_it(monkeypatch) -> None:
    for worked_us, own in ((0.0, (None, None)), (25.0, (25.0, 50.0))):
        looks = iter([LostTime(10.0, None, 3), LostTime(30.0, None, 8)])
        monkeypatch.setattr("app.session_server.recorder.lost_time", lambda pid, core, looks=looks: next(looks))
        ring = Ring(ticks=64)
        recorder = Recorder(ring, None)
        ring.rows[:40] = np.zeros((40, tick_log.WIDTH))
        ring.control.head = 40
        ring.control.worked, ring.control.worked_most = round(40e3 * worked_us), round(2e3 * worked_us)
        recorder.close()
        timing = recorder.timing("default")
        assert (timing.stolen_ms, timing.waited_ms, timing.switches) == (20.0, None, 5)
        assert (timing.tick_us, timing.tick_max_us) == own
