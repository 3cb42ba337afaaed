"""`python -m app.compile_kernels`: compile what the first study, simulation, emulated board and live trial need, once.

With `--no-window`, as the set-up of a verb without one: all but the control loop. Two processes share the work: each
finds on disk the parts of kernels that the other has compiled (see `core.kernels.compiler`). A third would bring
nothing: linking, which is what takes longest, cannot be shared.
"""

import signal
import subprocess
import sys
from collections.abc import Callable

import numpy as np

from app.emulated_operator import drawn_operator
from app.loop.loop import run_stopped_trial
from app.progress import watch_compiling
from core.control.velocity_field import field_around
from core.device import load_device
from core.kernels import INTERPRETED
from core.kernels.cache import cache_place, tellers
from core.path import Polyline, build_path
from core.simulator.simulation import Simulation
from core.tick_log import MOVE
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.study.unrecorded import person_of, run_measured, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.real_trial import load_kernels
from hardware.emulated_board.board import ZERO
from hardware.emulated_board.device import EmulatedDevice, hello_of

NO_WINDOW, SECOND = "--no-window", "--second"
PATH = Polyline(((-0.1, 0.4), (0.0, 0.42), (0.1, 0.4)))


def compile_trials() -> None:
    """Run a trial of a simulated operator on one path, with its measures; then load what a real device needs."""
    protocol = load_protocol()
    device, preset = protocol.devices[0], protocol.controllers[1]
    person, planned = person_of(load_population(), protocol.seed, 1), PlannedTrial(1, 1, device.name, 1, 1, 1)
    run_measured(trial_of(protocol, person, 1, planned, switched_on(device, protocol), preset), "01")
    load_kernels()


def compile_scene() -> None:
    """Run a step of a scene, which needs every integrator."""
    Simulation(load_device("three-brake"), (0.0, 0.4)).run(1e-3, 1e-3, np.zeros(4))


def compile_board() -> None:
    """Run the emulated board's device for a tick, in the hand of a simulated operator who moves along a path."""
    device, path = load_device("three-brake"), build_path(PATH, "path")
    operator = drawn_operator(path, 1)
    operator.enter(MOVE)
    emulated = EmulatedDevice(device, hello_of(device), operator, (path.x0, path.y0), 1)
    emulated.sense(ZERO, ())
    emulated.advance(ZERO)


def compile_loop() -> None:
    """Run the control loop, and work out a field as the window draws it."""
    field_around(build_path(PATH, "path"), np.array([[0.0, 0.38]]), 1.0)
    run_stopped_trial()


def main() -> int:
    """Compile everything and store it, with a progress bar. Exit code 1 if a process failed.

    Nothing is compiled where it could not be stored.
    """
    if INTERPRETED:
        return 0
    tellers[:] = [say]
    place = cache_place()
    if place.folder is None:
        return 0
    if SECOND in sys.argv:
        return compiled(compile_scene, compile_board, *(() if NO_WINDOW in sys.argv else (compile_loop,)))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the second process ends with this one
    second = subprocess.Popen([sys.executable, "-m", "app.compile_kernels", SECOND, *sys.argv[1:]])
    try:
        watch_compiling()
        failed = compiled(compile_trials) or second.wait()
    finally:
        second.terminate()
    if failed:
        return 1
    removed = f"; {place.removed} unused versions removed" if place.removed else ""
    print(f"kernels: compiled{removed}")
    return 0


def compiled(*shares: Callable[[], None]) -> int:
    """Compile these shares of the work; 1 if that failed, for which a sentence is on stderr."""
    try:
        for share in shares:
            share()
    except Exception as error:
        say(f"{share.__name__}: {type(error).__name__}: {error}")
        return 1
    return 0


def say(sentence: str) -> None:
    print("phd:", sentence, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
