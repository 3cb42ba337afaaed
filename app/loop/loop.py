"""The control loop: a process that runs one trial at a time at 1 kHz (see `real_time`).

It knows nothing of sessions, recordings and windows: the conductor sends it a trial, ready to run, and gets back what
the trial has changed. A conductor that falls silent ends the trial, brakes off, and with the pipe the process.
"""

import contextlib
import pickle
import signal
import sys
from typing import Any

import numpy as np

from app.ipc.messages import REAL_TIME, Done, Prepared, Run, Tried, Try, changed
from app.ipc.ring import CONTROL, Ring
from app.ipc.scheduling import take_scheduling
from app.loop.clock import new_timespec
from app.loop.real_time import ROOM, run_idle, run_trial
from core import tick_log
from core.path_file import build_path
from core.simulator.state import new_record
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.trial.trial import Arguments, Trial, new_simulation


class Loop:
    """The process's own part: one ring, and the trials that come."""

    def __init__(self, ring: Ring) -> None:
        self.ring, self.timespec, self.spare = ring, new_timespec(), np.empty((1, tick_log.WIDTH))
        ring.rows.max()  # every page is in memory before the first tick

    def prepare(self, real_time: bool) -> Prepared:
        """Compile and touch everything that a trial needs, then take the best scheduling that is allowed."""
        run_stopped_trial()
        scheduling, core = take_scheduling(real_time)
        self.ring.control.core = core
        return Prepared(scheduling, core)

    def do(self, job: Try | Run) -> Tried | Done:
        """One job; what to answer."""
        match job:
            case Try(ticks):
                lateness = np.empty(ticks)
                run_idle(lateness, self.timespec)
                return Tried(lateness)
            case Run(arguments):
                run_trial(self.ring.controls, self.ring.rows, self.spare, self.timespec, *arguments)
                return Done(changed(arguments))


def run_stopped_trial() -> None:
    """Run a trial that ends at once, on a ring of its own, and the clock: every kernel of the loop is compiled then."""
    controls, ring = new_record(CONTROL), np.zeros((2 * ROOM, tick_log.WIDTH))
    spare, timespec = np.empty((1, tick_log.WIDTH)), new_timespec()
    run_trial(controls, ring, spare, timespec, *stopped_trial())
    run_idle(np.empty(20), timespec)


def stopped_trial() -> Arguments:
    """A trial like any other that ends after a few ticks."""
    protocol = load_protocol()
    segment, preset = next(iter(protocol.paths)), next(iter(protocol.controllers))
    device, path_file = protocol.devices[0], protocol.paths[segment]
    path = build_path(path_file, "path")
    simulation = new_simulation(device, (path.x0, path.y0), protocol.mouse.hand())
    planned = PlannedTrial(0, 0, device.name, preset, segment, 1)
    trial = Trial(simulation, planned, path_file, protocol.controllers[preset], protocol.rules, protocol.trial)
    arguments = trial.arguments()
    arguments.run["stop"][0], arguments.run["end_ticks"][0] = 1, 20
    return arguments


def main() -> None:
    """The process: jobs from the standard input, answers on the standard output, until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the conductor ends what runs, and then us
    jobs, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr
    sys.modules["scipy"] = None  # type: ignore[assignment]  # numba would import it to see whether there is a BLAS
    loop = Loop(Ring(sys.argv[1]))
    with contextlib.suppress(BrokenPipeError):
        _send(answers, loop.prepare(real_time=sys.argv[2] == REAL_TIME))
        while (job := _next(jobs)) is not None:
            _send(answers, loop.do(job))


def _send(answers: Any, answer: Prepared | Tried | Done) -> None:
    pickle.dump(answer, answers)
    answers.flush()


def _next(jobs: Any) -> Any:
    """The next job; None at the end of the input, also in the middle of one."""
    try:
        return pickle.load(jobs)
    except (EOFError, pickle.UnpicklingError):
        return None
