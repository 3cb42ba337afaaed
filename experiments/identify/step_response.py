"""Measured current steps, from the file that `phd identify` reads to time constants, Eq. (3), and steady torques.

The file has a row a sample, with `COLUMNS` in any order (others are not read). Rows that agree in the two currents,
the speed and the index are one step; steps that differ in the index alone are repeats. The current changes at t_s = 0
of its step; where the clock runs on from step to step (a step whose rows are all later than 0), at the step's first
row. Rows before the change are not used.

Torque ripple follows the shaft, so the samples of one step are far from independent. Every averaged step therefore
gives one steady torque and one time constant, and all intervals come from the scatter between steps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from core.files import InputError
from core.number_table import read_number_file

COLUMNS = ("t_s", "current_from_A", "current_to_A", "speed_rpm", "torque_N_m", "step_index")
FEWEST_SAMPLES = 20  # of a step, after the current has changed
#: Shares of a sampling interval. A first row so little after t_s = 0 is the change itself on a clock that restarts.
AT_ONCE = 1.5
SAME_CLOCK = 1e-3  # repeats whose times differ by less are averaged sample by sample, others interpolated

RISE, FALL = "rise", "fall"

#: In time constants: length of the transient that is fitted; start of the steady torque; shortest record that settles.
TRANSIENT, STEADY, SETTLES = 8.0, 6.0, 5.0
FEWEST_IN_TRANSIENT = 3  # samples within one time constant
BLOCKS = 20  # block means within one time constant: the mean of an exponential is one, and few samples are quick
#: A time constant this many times the typical one of its speed, or its inverse, was not found.
REACH = 6.0
#: Further than this factor from the typical one it is ripple's more than the brake's: neither the length of the
#: transient nor what is left of it in the steady torque follow it.
NEAR = 2.0


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
        """The key that repeats of a step share."""
        return self.current_from, self.current_to, self.speed_rpm

    def __str__(self) -> str:
        return f"{self.current_from:g} to {self.current_to:g} A at {self.speed_rpm:g} rpm"


def read_steps(path: Path) -> list[Step]:
    """All steps of a file, one for each step_index; a refusal names the line."""
    table = read_number_file(path, "the measured steps", COLUMNS, None)
    t, current_from, current_to, speed, torque, index = table.values.T
    for bad, reason in (
        (current_from < 0.0, "current_from_A must be at least 0"),
        (current_to < 0.0, "current_to_A must be at least 0"),
        (current_from == current_to, "current_from_A and current_to_A are equal: no step"),
        (speed == 0.0, "speed_rpm must not be 0 (below 0: the shaft turned the other way, and torque_N_m with it)"),
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


def mean_step(repeats: Sequence[Step]) -> Step:
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


class Measured(NamedTuple):
    """The result of one averaged step."""

    step: Step
    typical: float  # s, time constant of all steps at that speed in that direction, roughly
    time_constant: float  # s; nan: not found
    steady_torque: float  # N m
    repeated_torques: list[float]  # N m, of each repeat
    places: list[float]  # of each repeat in the session, 0 (first step of the file) to 1 (last)
    turns: int  # whole revolutions that the steady torque is the average of; 0: less than one

    @property
    def direction(self) -> str:
        """Which of the two functions of Eq. (4) it belongs to."""
        return RISE if self.step.rising else FALL


def measure(steps: Sequence[Step], where: str, dead_s: float = 0.0) -> list[Measured]:
    """Time constant and steady torque of each averaged step, whose torque begins to follow `dead_s` late."""
    found = []
    places = np.linspace(0.0, 1.0, len(steps))
    ordered = sorted(zip(steps, places.tolist(), strict=True), key=lambda placed: placed[0].key)
    together = [zip(*repeats, strict=True) for _, repeats in groupby(ordered, key=lambda placed: placed[0].key)]
    averaged = [(mean_step(repeats), repeats, when) for repeats, when in together]
    for key in sorted({(step.speed_rpm, step.rising) for step, *_ in averaged}):
        alike = [entry for entry in averaged if (entry[0].speed_rpm, entry[0].rising) == key]
        typical = typical_time_constant([step for step, *_ in alike], where)
        for step, repeats, when in alike:
            a, height = time_constant_of_step(step, typical, dead_s)
            begin = min(STEADY * typical, 0.9 * float(step.t[-1]))
            height = height if typical / NEAR < a < typical * NEAR else 0.0
            torque, *torques = (steady_torque(each, begin, a, height) for each in [step, *repeats])
            found.append(Measured(step, typical, a, torque, torques, list(when), whole_turns(step, begin)))
    return found


def typical_time_constant(alike: Sequence[Step], where: str) -> float:
    """When (s) the sum of the steps at one speed in one direction has made 1 - 1/e of its change.

    The sum: the changes add up, the ripple of different steps does not.
    """
    first = min(alike, key=lambda step: float(step.t[-1]))
    total = sum((np.interp(first.t, step.t, step.torque) for step in alike), np.zeros(len(first.t)))
    change = (total - total[0]) * (1.0 if first.rising else -1.0)
    end = float(np.mean(change[3 * len(change) // 4 :]))
    a_steps = f"{where}: the time constants at {first.speed_rpm:g} rpm cannot be identified: "
    if end <= 0.0:
        way = "rise when the current rises" if first.rising else "fall when the current falls"
        raise InputError(f"{a_steps}the torque does not {way}")
    reached = int(np.argmax(change >= (1.0 - math.exp(-1.0)) * end))
    typical = float(first.t[reached])
    if reached < FEWEST_IN_TRANSIENT:
        raise InputError(f"{a_steps}the torque has changed within {reached + 1} samples, too few to see how")
    if first.t[-1] < SETTLES * typical:
        raise InputError(f"{a_steps}step {first} ends {first.t[-1]:g} s after the change, before its torque settles")
    return typical


def time_constant_of_step(step: Step, typical: float, dead_s: float = 0.0) -> tuple[float, float]:
    """Time constant from a current step, Eq. (3), whose torque begins to follow `dead_s` late.

    t/a = -ln((tau - tau_2) / (tau_1 - tau_2)), solved for the torque: tau = tau_2 + (tau_1 - tau_2) exp(-t/a), fitted
    by least squares in a, tau_1 and tau_2 over the first 8 typical time constants. Differs from the paper: it
    prints tau_1 and tau_2 exchanged (t = 0 would give ln 0), and takes the slope of the logarithm, which noise bends
    as the torque nears tau_2. Our choice: a straight drift beside the exponential takes up ripple slower than it.

    Returns a in s and tau_1 - tau_2 in N m; nan and 0 where no a within a factor of 6 of `typical` fits best.
    """
    logs = math.log(typical) + np.linspace(-1.0, 1.0, 13) * math.log(REACH)
    transient = Transient(step, TRANSIENT * typical, dead_s)
    best = int(np.argmax([transient.fitted(log)[1] for log in logs]))
    if best in (0, len(logs) - 1):
        return math.nan, 0.0
    log = logs[best]
    for _ in range(2):  # the second time over 8 time constants of its own
        transient = Transient(step, window_of(math.exp(log), typical), dead_s)
        near = log + np.array([-1.0, 1.0]) * (logs[1] - logs[0])
        log = minimize_scalar(lambda at, of: -of.fitted(at)[1], args=(transient,), bounds=near, method="bounded").x
    return math.exp(log), transient.fitted(log)[0]


def window_of(a: float, typical: float) -> float:
    """How long (s) a transient is fitted."""
    return TRANSIENT * min(max(a, typical / NEAR), typical * NEAR)


class Transient:
    """The first samples of a step, as means of blocks, less the best constant and drift."""

    def __init__(self, step: Step, window: float, dead_s: float) -> None:
        count = int(np.searchsorted(step.t, window, side="right"))
        block = max(1, int(np.searchsorted(step.t, window / TRANSIENT)) // BLOCKS)
        count -= count % block
        self.times = step.t[:count].reshape(-1, block)
        self.late = np.maximum(self.times - dead_s, 0.0)
        t = self.times.mean(axis=1)
        self.straight, _ = np.linalg.qr(np.column_stack([np.ones(len(t)), t]))
        self.torque = self.bent(step.torque[:count].reshape(-1, block).mean(axis=1))

    def bent(self, values: np.ndarray) -> np.ndarray:
        """The values less their constant and drift."""
        return values - self.straight @ (self.straight.T @ values)

    def decay(self, log: float) -> np.ndarray:
        """exp(-t/a), at log a."""
        return self.bent(np.exp(self.late * -math.exp(-log)).mean(axis=1))

    def fitted(self, log: float) -> tuple[float, float]:
        """The height (N m) of the exponential that fits best, and the squares that it explains."""
        decay = self.decay(log)
        both, square = float(decay @ self.torque), float(decay @ decay)
        return both / square, both * both / square


def whole_turns(step: Step, begin: float) -> int:
    """How many whole revolutions the shaft turns from `begin` (s) on."""
    return math.floor((step.t[-1] - begin) * step.speed_rpm / 60.0)


def steady_torque(step: Step, begin: float, a: float, height: float) -> float:
    """Average steady torque (N m) from `begin` (s) on, less what is left of the transient height * exp(-t/a).

    Our choice: over the last whole revolutions, where the shaft turns at least one: ripple that repeats with the
    shaft averages out.
    """
    turns = whole_turns(step, begin)
    if turns >= 1:
        begin = float(step.t[-1]) - turns * 60.0 / step.speed_rpm
    used = step.t > begin
    left = height * np.exp(-step.t[used] / a) if height else 0.0
    return float(np.mean(step.torque[used] - left))
