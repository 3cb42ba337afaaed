"""What the control loop says of its scheduling is what the system says of it; and how late it is can be measured."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from processes import children

from app.ipc.scheduling import leave_core, program_cores
from app.loop.clock import SPIN_NS, new_timer, now_ns, sleep_until
from app.verbs.loop_lateness import measure

ROOT = Path(__file__).resolve().parents[2]
ASK = """
import os, sys
from app.ipc.scheduling import take_scheduling
got = take_scheduling(real_time={real_time})
print(got.real_time, got.locked, got.core, got.words, sep="|", end="|")
print(os.sched_getscheduler(0) == os.SCHED_FIFO, sorted(os.sched_getaffinity(0)), sep="|")
print(*[line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck")])
"""

linux = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux what the process got")


@linux
@pytest.mark.parametrize("real_time", [True, False])
def test_what_a_loop_says_of_its_scheduling_is_what_it_has(real_time: bool) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ASK.format(real_time=real_time)],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    said, held_kB = done.stdout.splitlines()
    got_real_time, locked, core, words, fifo, cores = said.split("|")
    assert got_real_time == fifo and words.startswith("real-time: FIFO 50" if fifo == "True" else "default")
    assert not (fifo == "True" and not real_time)
    if int(core) >= 0:
        assert cores == f"[{core}]" and f"core {core}" in words
    if fifo == "True":
        assert (int(held_kB) > 0) == (locked == "True") == ("memory not locked" not in words)


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


@linux
def test_measuring_the_loop_gives_every_tick_its_lateness_and_leaves_nothing() -> None:
    before, cores = set(threading.enumerate()), os.sched_getaffinity(0)
    shares: list[float] = []
    found = measure(0.5, busy=1, real_time=False, progress=shares.append)
    assert found["ticks"] >= 500 and 0.0 <= found["p50_us"] <= found["p99_us"] <= found["max_us"]
    assert found["scheduling"].startswith("default") and not found["real_time"]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert set(threading.enumerate()) <= before and os.sched_getaffinity(0) == cores
    assert not [pid for pid in children(os.getpid()) if "app.loop" in Path(f"/proc/{pid}/cmdline").read_text()]


@pytest.mark.nojit
@pytest.mark.parametrize("ahead_ns", [-1, 0, SPIN_NS // 2, 3 * SPIN_NS])
def test_a_wait_never_ends_before_its_deadline(ahead_ns: int) -> None:
    timer = new_timer()
    deadline = now_ns(timer) + ahead_ns
    woken = sleep_until(deadline, timer)
    assert deadline <= woken <= now_ns(timer)
