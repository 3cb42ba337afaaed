"""How late the control loop's ticks are on this machine: real trials of a simulated operator, one after the other.

Timed figures depend on what else runs: they are shown, never judged.
"""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

from app.ipc.pipe import start_python
from app.ipc.ring import Ring
from app.ipc.scheduling import leave_core, lost_time, program_cores
from app.session_server.loop_process import LoopProcess
from app.session_server.recorder import timing_of
from app.session_server.trial_runner import TrialRun, TrialRunner
from experiments.plan import make_plan
from experiments.progress import Progress, no_progress
from experiments.protocol import load_protocol
from experiments.study.helpers import end_with
from experiments.study.unrecorded import person_of, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.trial import Trial

LOOK_S = 0.02
WAIT_S = 600.0  # longest wait for the loop to compile its kernels, or for a trial to end


def measure_all(seconds: float, progress: Progress = no_progress) -> list[dict]:
    """`measure` with and without the real-time privilege, if there is one, alone and beside a process per core."""
    cores = len(program_cores())
    found: list[dict] = []
    for real_time in (True, False):
        if found and not found[0]["real_time"]:
            break  # no privilege: it would be the same again
        for busy in (0, cores):
            found.append(measure(seconds, busy, real_time, lambda share: progress((len(found) + share) / 4)))
    return found


def measure(seconds: float, busy: int = 0, real_time: bool = True, progress: Progress = no_progress) -> dict:
    """Run the loop for this time: its lateness (us), missed ticks, and its scheduling.

    busy: processes beside it that only compute. real_time: try scheduling that needs a privilege. OSError if the loop
    dies or does not answer.
    """
    most, lateness_us, worked_us, longest_us = round(1000 * seconds), [np.empty(0)], 0.0, 0.0
    ring = Ring()
    runner = TrialRunner(ring, LoopProcess(ring, real_time), real_time)
    try:
        wait_until(lambda: runner.ready, ring, runner)
        trials = endless_trials()
        loop = int(ring.control.pid), int(ring.control.core)
        before = lost_time(*loop)
        with cpu_load(busy):
            while (ticks := sum(map(len, lateness_us))) < most:
                run = runner.start(next(trials), None)

                def ended(run: TrialRun = run, before: int = ticks) -> bool:
                    now = before + len(run.recorder.lateness_us)
                    if now >= most:
                        run.stop("measured for long enough")
                    progress(min(1.0, now / most))
                    return runner.run is None

                wait_until(ended, ring, runner)
                lateness_us.append(run.recorder.lateness_us)
                timing = runner.timing
                assert timing is not None and timing.tick_us is not None and timing.tick_max_us is not None
                worked_us += timing.tick_us * len(lateness_us[-1])
                longest_us = max(longest_us, timing.tick_max_us)
            lost = lost_time(*loop).since(before)
        assert runner.scheduling is not None
        all_us = np.concatenate(lateness_us)
        timing = timing_of(all_us, runner.scheduling.words)
        timing = timing._replace(**lost._asdict(), tick_us=worked_us / len(all_us), tick_max_us=longest_us)
        return {**timing._asdict(), "ticks": len(all_us), "busy": busy, "real_time": runner.scheduling.real_time}
    finally:
        if runner.run:
            runner.run.recorder.close()
        leave_core(-1)
        runner.close()


def wait_until(condition: Callable[[], bool], ring: Ring, runner: TrialRunner) -> None:
    """Watch the loop until the condition holds. OSError if the loop is lost, or it takes longer than `WAIT_S`."""
    deadline = time.perf_counter() + WAIT_S
    while not condition():
        ring.beat()
        _, lost = runner.watch()
        if lost or time.perf_counter() > deadline:
            raise OSError(lost or "the control loop does not answer")
        time.sleep(LOOK_S)


def endless_trials() -> Iterator[Trial]:
    """Trials of one simulated operator on one device, without end."""
    protocol = load_protocol()
    person, device = person_of(load_population(), protocol.seed, 1), switched_on(protocol.devices[0], protocol)
    while True:
        for planned in make_plan(protocol, "01", coded=False):
            if planned.configuration == protocol.devices[0].name:
                yield trial_of(protocol, person, 1, planned, device, protocol.controllers[int(planned.controller)])


def table(found: list[dict]) -> str:
    """The measurements as a table; "?": the system does not count it."""
    columns = {
        "ticks": "ticks", "p50 µs": "p50_us", "p99 µs": "p99_us", "max µs": "max_us", "missed": "missed",
        "host ms": "stolen_ms", "wait ms": "waited_ms", "switches": "switches", "tick µs": "tick_us", "busy": "busy",
    }  # fmt: skip
    lines = ["".join(f"{head:>9}" for head in columns) + "  scheduling"]
    for measured in found:
        cells = ("?" if measured[name] is None else f"{measured[name]:.0f}" for name in columns.values())
        lines.append("".join(f"{cell:>9}" for cell in cells) + f"  {measured['scheduling']}")
    return "\n".join(lines)


@contextlib.contextmanager
def cpu_load(n: int) -> Iterator[None]:
    """Run n processes that only compute."""
    processes = [start_python("app.verbs.loop_lateness", str(os.getpid())) for _ in range(n)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def main() -> None:
    """A process of `cpu_load`: compute, on any core, until the parent ends."""
    leave_core(-1)
    end_with(int(sys.argv[1]))
    number = 1
    while True:
        number = number * 1_664_525 % 4_294_967_291
