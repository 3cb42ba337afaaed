"""Current steps as the paper's bench would have measured them, from a brake whose numbers are known.

The grid is the paper's: 0, 0.2 .. 1.0 A, 0.5, 1 .. 64 rpm, three consecutive steps each. Our choice where it is
silent: rising steps start at 0 A and falling ones at the largest current (Eq. (4) takes the current stepped to, so
steps that all fall to 0 A could not tell its dependence on the current); 4 s a step at 1 kHz; white noise of 0.05 N m.
The torque ripple of about 1 N m that the paper saw is here a fixed periodic function of the shaft angle, 1 N m from
lowest to highest at any current, met at a random angle by each step: once, twice and six times a revolution. At low
speed it is an offset that no averaging over the step removes; at high speed it is as fast as the transient.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from core.device_file import BrakeFile
from experiments.identify.step_response import COLUMNS, Step

CURRENTS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # A
SPEEDS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # rpm
RISING = tuple((CURRENTS[0], current) for current in CURRENTS[1:])
FALLING = tuple((CURRENTS[-1], current) for current in CURRENTS[:-1])
REPEATS = 3


class Bench(NamedTuple):
    """How the steps are measured."""

    duration_s: float = 4.0
    sampling_hz: float = 1000.0
    noise_N_m: float = 0.05  # standard deviation of a sample
    ripple_N_m: float = 1.0  # lowest to highest
    ripple_orders: tuple[int, ...] = (1, 2, 6)  # cycles a revolution
    ripple_shares: tuple[float, ...] = (1.0, 0.5, 0.25)  # relative amplitudes
    dead_time_s: float = 0.0  # in which the torque does not follow yet
    drift_per_h: float = 0.0  # share by which every torque grows
    step_every_s: float = 15.0  # from one step to the next
    offset_N_m: float = 0.0  # what the sensor reads without torque
    turns_back: bool = False  # the last repeat of each step with the shaft turned the other way


BENCH = Bench()


def synthetic_steps(
    brake: BrakeFile,
    seed: int,
    bench: Bench = BENCH,
    speeds: tuple[float, ...] = SPEEDS,
    changes: tuple[tuple[float, float], ...] = RISING + FALLING,
    repeats: int = REPEATS,
) -> list[Step]:
    """Steps (current from, to) in A at each speed in rpm, each `repeats` times; the same seed, the same steps."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(bench.duration_s * bench.sampling_hz) + 1) / bench.sampling_hz
    profile = _ripple_amplitudes(bench)
    orders = np.array(bench.ripple_orders)
    steps = []
    for speed in speeds:
        turned = np.exp(1j * np.outer(orders, 2.0 * math.pi * speed / 60.0 * t))  # (orders, n)
        for current_from, current_to in changes:
            start, end = brake.torque_gain(current_from), brake.torque_gain(current_to)
            late = np.maximum(t - bench.dead_time_s, 0.0)
            clean = end + (start - end) * np.exp(-late / time_constant(brake, current_to, speed, end > start))
            for repeat in range(repeats):
                at = profile * np.exp(1j * orders * rng.uniform(0.0, 2.0 * math.pi))
                torque = clean * (1.0 + bench.drift_per_h * bench.step_every_s * len(steps) / 3600.0)
                torque += at.real @ turned.real - at.imag @ turned.imag
                torque += bench.noise_N_m * rng.standard_normal(len(t))
                way = -1.0 if bench.turns_back and repeat == repeats - 1 else 1.0
                steps.append(Step(current_from, current_to, way * speed, t, way * torque + bench.offset_N_m))
    return steps


def time_constant(brake: BrakeFile, current: float, speed_rpm: float, rising: bool) -> float:
    """Time constant (s) of a brake file at a current stepped to, Eq. (4)."""
    table = brake.rise if rising else brake.fall
    if speed_rpm >= brake.omega_0_rpm:
        return table.a_avg_s
    return table.below_omega_0(current, math.log2(max(speed_rpm, brake.floor_rpm)))


def write_steps(steps: Iterable[Step], path: Path) -> None:
    """The steps as a file that `phd identify` reads; repeats are told apart by step_index."""
    seen: dict[tuple[float, float, float], int] = {}
    blocks = []
    for step in steps:
        index = seen[step.key] = seen.get(step.key, -1) + 1
        n = len(step.t)
        marks = [np.full(n, value) for value in (*step.key, index)]
        blocks.append([step.t, *marks[:3], step.torque, marks[3]])
    columns = [pa.array(np.concatenate(parts)) for parts in zip(*blocks, strict=True)]
    with path.open("xb") as file:
        file.write((",".join(COLUMNS) + "\n").encode())
        pa_csv.write_csv(pa.table(columns, names=list(COLUMNS)), file, pa_csv.WriteOptions(include_header=False))


def _ripple_amplitudes(bench: Bench) -> np.ndarray:
    """(orders,) amplitudes (N m) that give the ripple its height from lowest to highest."""
    shares = np.array(bench.ripple_shares)
    angle = np.linspace(0.0, 2.0 * math.pi, 3600)
    shape = shares @ np.cos(np.outer(bench.ripple_orders, angle))
    return shares * bench.ripple_N_m / np.ptp(shape)
