"""Current steps measured at constant speed: the file that `phd identify` reads, and the mean of repeated steps.

One row a sample, in columns of any order (others are not looked at): t_s, current_from_A, current_to_A, speed_rpm,
torque_N_m, step_index. Rows that agree in the two currents, the speed and the index are one step; steps that differ
in the index alone are repeats. The current changes at t_s = 0 of its step; where the clock runs on from step to step
(a step whose rows are all later than 0), at the step's first row. Rows before the change are not used.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import numpy.typing as npt

from core.files import InputError
from experiments.simulate.scene import read_number_table

COLUMNS = ("t_s", "current_from_A", "current_to_A", "speed_rpm", "torque_N_m", "step_index")
FEWEST_SAMPLES = 20  # of a step, after the current has changed
#: Shares of a sampling interval. A first row so little after t_s = 0 is the change itself on a clock that restarts.
AT_ONCE = 1.5
SAME_CLOCK = 1e-3  # repeats whose times differ by less are averaged sample by sample, others interpolated


@dataclass(frozen=True)
class Step:
    """One change of the current, or the mean of its repeats."""

    current_from: float  # A
    current_to: float  # A
    speed_rpm: float
    t: npt.NDArray[np.float64]  # (n,) s since the change, rising
    torque: npt.NDArray[np.float64]  # (n,) N m
    repeats: int = 1

    @property
    def rising(self) -> bool:
        """Whether the current goes up."""
        return self.current_to > self.current_from

    @property
    def key(self) -> tuple[float, float, float]:
        """What repeats have in common."""
        return self.current_from, self.current_to, self.speed_rpm

    def __str__(self) -> str:
        return f"{self.current_from:g} to {self.current_to:g} A at {self.speed_rpm:g} rpm"


def read_steps(path: Path) -> list[Step]:
    """All steps of a file, one for each step_index; a refusal names the line."""
    table = read_number_table(path, "the measured steps")
    columns = [column.strip('"') for column in table.columns]
    missing = [column for column in COLUMNS if column not in columns]
    if missing:
        raise InputError(f"{path}: line 1: the header lacks {', '.join(missing)}")
    t, current_from, current_to, speed, torque, index = (table.values[:, columns.index(column)] for column in COLUMNS)
    for bad, reason in (
        (current_from < 0.0, "current_from_A must be at least 0"),
        (current_to < 0.0, "current_to_A must be at least 0"),
        (current_from == current_to, "current_from_A and current_to_A are equal: no step"),
        (speed <= 0.0, "speed_rpm must be greater than 0 (give speed and torque as magnitudes)"),
    ):
        if bad.any():
            raise InputError(f"{path}: line {table.line(int(np.argmax(bad)))}: {reason}")

    marks = np.column_stack([current_from, current_to, speed, index])
    edges = np.flatnonzero(np.any(np.diff(marks, axis=0) != 0.0, axis=1)) + 1
    rows_of: dict[tuple[float, ...], list[npt.NDArray[np.int_]]] = {}
    for part in np.split(np.arange(len(t)), edges):
        rows_of.setdefault(tuple(marks[part[0]].tolist()), []).append(part)
    steps = []
    for (low, high, rpm, number), parts in rows_of.items():
        rows = np.concatenate(parts)
        time = t[rows]
        falls = np.flatnonzero(np.diff(time) <= 0.0)
        if len(falls):
            row = int(rows[falls[0] + 1])
            raise InputError(
                f"{path}: line {table.line(row)}: t_s must rise within a step, but {t[row]:g} follows "
                f"{time[falls[0]]:g} (give each repeat a step_index of its own)"
            )
        start = time[0] if len(time) > 1 and time[0] > AT_ONCE * (time[1] - time[0]) else 0.0
        used = time >= start
        step = Step(low, high, rpm, time[used] - start, torque[rows[used]])
        if len(step.t) < FEWEST_SAMPLES:
            raise InputError(
                f"{path}: step_index {number:g}, {step}: has {len(step.t)} rows after the current has changed, "
                f"at least {FEWEST_SAMPLES} are needed"
            )
        steps.append(step)
    return steps


def repeats_together(steps: Iterable[Step]) -> list[list[Step]]:
    """The steps, those that differ in the index alone in one list; in order of currents and speed."""
    ordered = sorted(steps, key=lambda step: step.key)
    return [list(repeats) for _, repeats in groupby(ordered, key=lambda step: step.key)]


def mean_step(repeats: list[Step]) -> Step:
    """The mean of the repeats of a step, as in the paper, on the clock of the shortest of them."""
    if len(repeats) == 1:
        return repeats[0]
    first = min(repeats, key=lambda step: float(step.t[-1]))
    t = first.t[first.t >= max(step.t[0] for step in repeats)]
    total = np.zeros(len(t))
    for step in repeats:
        same = len(step.t) == len(t) and np.max(np.abs(step.t - t)) <= SAME_CLOCK * (t[-1] - t[0]) / (len(t) - 1)
        total += step.torque if same else np.interp(t, step.t, step.torque)
    return Step(*first.key, t, total / len(repeats), len(repeats))
