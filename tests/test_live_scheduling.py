"""What the control loop says of its scheduling is what the system says of it; and how late it is can be measured."""

import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from live import children

from app.live.measure import measure
from app.live.scheduling import leave_core, program_cores, take_scheduling

ROOT = Path(__file__).resolve().parent.parent
ASK = """
import os, sys
from app.live.scheduling import take_scheduling
said, core = take_scheduling(real_time={real_time})
print(said, core, os.sched_getscheduler(0) == os.SCHED_FIFO, sorted(os.sched_getaffinity(0)), sep="|")
print(*[line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck")])
"""

linux = pytest.mark.skipif(sys.platform != "linux", reason="nothing of this exists elsewhere")


@linux
@pytest.mark.parametrize("real_time", [True, False])
def test_what_a_loop_says_of_its_scheduling_is_what_it_has(real_time: bool) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ASK.format(real_time=real_time)],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    (said, core, fifo, cores), locked = done.stdout.splitlines()[0].split("|"), done.stdout.splitlines()[1]
    assert said.startswith("real-time: FIFO 50") == (fifo == "True")
    assert said.startswith("default") == (fifo == "False")
    assert not (fifo == "True" and not real_time)
    if int(core) >= 0:
        assert cores == f"[{core}]" and f"core {core}" in said
    if fifo == "True":
        assert ("memory not locked" in said) == (int(locked) == 0)


@linux
def test_other_processes_leave_the_loops_core_and_come_back_to_it() -> None:
    cores = program_cores()
    seen = []

    def look() -> None:
        for core in (max(cores), -1):
            leave_core(core)
            seen.append(os.sched_getaffinity(0))

    thread = threading.Thread(target=look)  # an affinity is a thread's own
    thread.start()
    thread.join()
    assert seen == [cores - {max(cores)} or cores, cores]


def test_a_system_with_nothing_better_to_offer_is_said_to_have_the_default(monkeypatch) -> None:
    import gc

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    said, core = take_scheduling()
    gc.enable()
    gc.unfreeze()
    assert said == "default: Darwin offers nothing better here" and core == -1


@linux
def test_measuring_the_loop_gives_every_tick_its_lateness_and_leaves_nothing() -> None:
    before, cores = threading.active_count(), os.sched_getaffinity(0)
    shares: list[float] = []
    found = measure(0.5, busy=1, real_time=False, progress=shares.append)
    assert found["ticks"] >= 500 and 0.0 <= found["p50_us"] <= found["p99_us"] <= found["max_us"]
    assert re.match(r"default", found["scheduling"])
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert threading.active_count() == before and os.sched_getaffinity(0) == cores
    assert not [pid for pid in children(os.getpid()) if "app.live" in Path(f"/proc/{pid}/cmdline").read_text()]
