"""`python -m app.compile_kernels`: compile what the first study, simulation and live trial need, once, for the set-up.

Parts of kernels are shared in one process only (see `core.kernel_compiler`): together this takes little longer than
the study alone.
"""

import os
import sys

import numpy as np

from app.ipc.process import spare_scipy
from app.progress import watch_compiling


def main() -> None:
    """Compile all of it and keep it on disk; a bar shows how far it is."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return
    spare_scipy()
    watch_compiling()
    from app.loop.loop import run_stopped_trial
    from core.simulator.simulation import Simulation
    from experiments.protocol import load_protocol
    from experiments.study.sweep import Job
    from experiments.trial.population import load_population
    from experiments.trial.trial import load_kernels

    protocol = load_protocol()
    device, preset = protocol.devices[0], protocol.controllers[1]
    # a trial of a simulated operator on one path, with its measures
    Job(
        0, load_population("average"), device, protocol.rules, protocol.trial, preset, 1, protocol.seed, 1,
        {1: protocol.paths[1]}, (),
    ).run()  # fmt: skip
    Simulation(device, (0.0, 0.4)).run(1e-3, 1e-3, np.zeros(4))  # a scene: every integrator is compiled with a step
    run_stopped_trial()  # the control loop
    load_kernels()  # a trial on a real device


if __name__ == "__main__":
    sys.exit(main())
