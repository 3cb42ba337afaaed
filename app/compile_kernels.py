"""`python -m app.compile_kernels`: compile what the first study, simulation and live trial need, once, for the set-up.

Parts of kernels are shared in one process only (see `core.kernel_compiler`): together this takes little longer than
the study alone.
"""

import os
import sys
from typing import TYPE_CHECKING

import numpy as np

from app.ipc.process import spare_scipy
from app.progress import watch_compiling

if TYPE_CHECKING:
    from core.device import Device
    from experiments.protocol import Protocol


def main() -> None:
    """Compile all of it and keep it on disk; a bar says how far it is."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return
    spare_scipy()
    watch_compiling()
    from experiments.protocol import load_protocol

    protocol = load_protocol()
    compile_study(protocol)
    compile_simulation(protocol.devices[0])
    compile_loop()


def compile_study(protocol: "Protocol") -> None:
    """A trial of a simulated operator, with its measures."""
    from experiments.study.sweep import Job, run_job
    from experiments.trial.population import load_population

    segment = next(iter(protocol.paths))
    run_job(Job(
        0, next(iter(protocol.controllers.values())), protocol.devices[0], load_population("average"), protocol.rules,
        1, protocol.seed, 1, {segment: protocol.paths[segment]}, protocol.trial,
    ))  # fmt: skip


def compile_simulation(device: "Device") -> None:
    """A step of a scene; every integrator is compiled with it."""
    from core.simulator.simulation import Simulation

    Simulation(device, (0.0, 0.4)).run(1e-3, 1e-3, np.zeros(4))


def compile_loop() -> None:
    """What the control loop runs."""
    from app.loop.loop import run_stopped_trial

    run_stopped_trial()


if __name__ == "__main__":
    sys.exit(main())
