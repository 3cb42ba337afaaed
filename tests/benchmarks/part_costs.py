"""`python -m tests.benchmarks.part_costs`: where the time of a step and of a control tick goes, in nanoseconds.

Compiled loops over one part each, the least of several repeats; what is left of a tick is brakes, step and pattern.
"""

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from core import tick_log
from core.control.controllers import decide
from core.kernel import kernel
from core.simulator.event import accept
from core.simulator.event_location import first_event
from core.simulator.runge_kutta import rk4
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from experiments.benchmark.scenes import START, bench_devices, bench_scenes
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.trial.operator import operate
from experiments.trial.population import load_population
from experiments.trial.tick import log_row
from experiments.trial.trial import Trial

COUNT, REPEATS = 5000, 15


@kernel
def smooth_steps(mechanisms, brake_records, hand, states, trials, step, lagged, count):
    """`count` trial steps of RK4 from one state."""
    total = 0.0
    for k in range(count):
        rk4(mechanisms[0], brake_records[0], hand, states[0], trials[0], k * step, step, lagged)
        total += trials[0].tip[0]
    return total


@kernel
def looks_for_events(mechanisms, brake_records, states, trials, step, lagged, count):
    """`count` looks for events inside one and the same trial step."""
    total = 0
    for _ in range(count):
        trials[0].seen = 0
        total += first_event(mechanisms[0], brake_records[0], states[0], trials[0], step, lagged)[0]
    return total


@kernel
def acceptances(mechanisms, brake_records, states, trials, step, lagged, count):
    """`count` times one trial step is taken as the new state."""
    for _ in range(count):
        accept(mechanisms[0], brake_records[0], states[0], trials[0], step, lagged)


@kernel
def decisions(controller, brake_records, path, memory, states, runs, count):
    """`count` decisions of a controller in one state."""
    state, run = states[0], runs[0]
    tip, total = state.tip, 0
    for _ in range(count):
        total += decide(
            controller, brake_records[0], path, memory, tip[0], tip[1], tip[2], tip[3],
            state.hand_force[0], state.hand_force[1], state.g, state.mass, run.current,
        )[0]  # fmt: skip
    return total


@kernel
def operations(operators, hand, path, runs, states, noise, count):
    """`count` ticks of the simulated operator in one state of the device."""
    tip = states[0].tip
    for k in range(count):
        operate(operators[0], hand.grips[0], path, runs[0].phase, runs[0].tick + k, runs[0].phase_tick + k,
                tip[0], tip[1], noise)  # fmt: skip


@kernel
def log_rows(mechanisms, brake_records, states, hand, runs, rows, count):
    """`count` rows of the log."""
    for k in range(count):
        row = rows[k % rows.shape[0]]
        log_row(mechanisms[0], brake_records[0], states[0], hand.grips[0], runs[0], k * 1e-3, row)


def part_costs(repeats: int) -> dict:
    """Least time (ns) of each part of a 1 ms step of S1 and S2 on the four-brake bench device, ideal brakes."""
    device = bench_devices()[1]
    parts: dict[str, dict[str, float]] = {}
    for scene in bench_scenes(device)[:2]:
        s, spare = (Simulation(device, START, hand=scene.hand()) for _ in range(2))
        for simulation in (s, spare):
            simulation.run(0.1, 1e-3, scene.torques[0])
        device_of, step = (s.mechanism, s.brakes), (1e-3, 0, COUNT)  # s, no lag, passes
        parts[scene.name] = {
            "rk4": best(partial(smooth_steps, *device_of, s.hand, s.state, s.trial, *step), repeats),
            "look_for_events": best(partial(looks_for_events, *device_of, s.state, s.trial, *step), repeats),
            "accept": best(partial(acceptances, *device_of, spare.state, s.trial, *step), repeats),
        }
    return parts


def tick_parts(trial: Trial, rows: np.ndarray) -> dict:
    """Least time (ns) of the parts of a tick that are not the device's: the rest of a tick is brakes, step, pattern."""
    a = trial.arguments()
    run, operator, memory = a.run.copy(), a.operator.copy(), a.memory.copy()
    run["phase"][0] = tick_log.MOVE
    return {
        "operator": best(lambda: operations(operator, a.hand, a.path, run, a.state, a.noise, COUNT), 5),
        "decide": best(lambda: decisions(a.controller, a.brakes, a.path, memory, a.state, run, COUNT), 5),
        "log_row": best(lambda: log_rows(a.mechanism, a.brakes, a.state, a.hand, run, rows, COUNT), 5),
    }


def best(loop: Callable[[], object], repeats: int) -> float:
    """Least time of one of the `COUNT` passes of a compiled loop (ns)."""
    loop()
    least = math.inf
    for _ in range(repeats):
        start = time.perf_counter()
        loop()
        least = min(least, time.perf_counter() - start)
    return least / COUNT * 1e9


def main() -> None:
    """Print all of it."""
    protocol = load_protocol()
    device, path = protocol.devices[1], protocol.paths[1]
    generator = np.random.default_rng(1)
    planned = PlannedTrial(1, 1, device.name, 3, 1, 1)
    person = load_population().draw(generator)
    trial = Trial(
        SimulatedDevice(device, path.start_m), planned, path, protocol.controllers[3], protocol.rules, protocol.trial,
        person, generator,
    )  # fmt: skip
    rows = np.empty((8192, tick_log.WIDTH))
    while not trial.finished:
        trial.run(rows)
    found = {f"a step of {name}": of for name, of in part_costs(REPEATS).items()} | {"a tick": tick_parts(trial, rows)}
    for name, of in found.items():
        print(f"{name}, ns: " + ", ".join(f"{part.replace('_', ' ')} {value:.0f}" for part, value in of.items()))


if __name__ == "__main__":
    main()
