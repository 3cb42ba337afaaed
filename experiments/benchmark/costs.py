"""What `phd bench` times beside the scenes: a whole control tick, a study, the fall-back."""

import math
import time

import numpy as np
from msgspec.structs import replace

from core import tick_log
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Simulation
from experiments.analysis.report import Moved
from experiments.benchmark.scenes import START, bench_devices, bench_scenes
from experiments.plan import make_plan
from experiments.protocol import load_protocol
from experiments.study.unrecorded import person_of, simulation_errors
from experiments.trial.population import load_population
from experiments.trial.trial import Trial, load_kernels


def tick_cost(quick: bool) -> dict:
    """One whole control tick (operator, decide, four MR brakes, step, log row), and the 180-trial study's simulation.

    A study of 3 operators x 2 devices x 2 segments x 5 controllers x 3 trials (quick: one operator, one block), ticks
    alone: what recording, measures and figures cost is not in it.
    """
    load_kernels()  # no clock runs while they are compiled
    protocol = load_protocol()
    operators = 1 if quick else 3
    if quick:
        protocol = replace(protocol, blocks=1)
    rows = np.empty((8192, tick_log.WIDTH))
    spent = {device.name: np.zeros(2) for device in protocol.devices}  # s, ticks
    trials = 0
    for operator in range(1, operators + 1):
        person = load_population().draw(np.random.default_rng(operator))
        simulations = {device.name: SimulatedDevice(device, (0.0, 0.40)) for device in protocol.devices}
        for planned in make_plan(protocol, str(operator)):
            generator = np.random.default_rng([operator, planned.segment, planned.repetition])
            trial = Trial(
                simulations[planned.configuration], planned, protocol.paths[planned.segment],
                protocol.controllers[int(planned.controller)], protocol.rules, protocol.trial, person, generator,
            )  # fmt: skip
            trials += 1
            while not trial.finished:
                start = time.perf_counter()
                n = trial.run(rows)
                spent[planned.configuration] += time.perf_counter() - start, n
    seconds, ticks = sum(spent.values(), np.zeros(2))
    return {
        "trials": trials,
        "ticks": round(ticks),
        "study_simulation_s": seconds,
        "us_per_tick": seconds / ticks * 1e6,
        "us_per_tick_by_device": {name: 1e6 * s / n for name, (s, n) in spent.items()},
    }


def study_errors() -> list[Moved]:
    """How far the measures of the paper's study move with step and fidelity, in its first operator's first block."""
    load_kernels()
    protocol = load_protocol()
    return simulation_errors(protocol, person_of(load_population(), protocol.seed, 1), "01")


def fallback_costs(repeats: int) -> list[dict]:
    """When `event` gives steps to `stepping`, how often, and what such a step costs, on the four-brake bench device.

    A hand spring too stiff for RK4; brakes switched in every step; brakes switched as in S4.
    """
    device = bench_devices()[1]
    free, _, _, switching = bench_scenes(device)
    stiff = spring_hand((1e6, 0.0, 1e6), (30.0, 0.0, 30.0), force_max=60.0, target=(0.09, 0.42))
    fast = np.arange(2000) * 1e-3
    cases = (
        ("hand spring of 1e6 N/m", lambda: stiff, np.zeros(1), free.torques),
        ("brakes switched every step", switching.hand, fast, np.tile(switching.torques[:4], (500, 1))),
        ("brakes switched every 10 ms (S4)", switching.hand, switching.times, switching.torques),
    )
    found = []
    for name, hand, times, torques in cases:
        wall, ledger = math.inf, None
        for _ in range(repeats):
            s = Simulation(device, START, hand=hand())
            start = time.perf_counter()
            s.rows(2, 1e-3, 2000, times, torques, 0, 1)
            wall, ledger = min(wall, time.perf_counter() - start), s.ledger()
        assert ledger is not None
        found.append({"case": name, "steps": ledger.steps, "events": ledger.events, "fallbacks": ledger.fallbacks,
                      "us_per_step": wall / 2000 * 1e6})  # fmt: skip
    return found
