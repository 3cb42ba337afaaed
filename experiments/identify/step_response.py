"""What one current step shows: its time constant, Eq. (3), and its steady torque.

Torque ripple follows the shaft, so the samples of one step are far from independent. Every averaged step therefore
gives one steady torque and one time constant, and all intervals come from the scatter between steps.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from core.files import InputError
from experiments.identify.steps import Step, mean_step, repeats_together

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


class Measured(NamedTuple):
    """What one averaged step shows."""

    step: Step
    typical: float  # s, time constant of all steps at that speed in that direction, roughly
    time_constant: float  # s; nan: not found
    steady_torque: float  # N m
    repeated_torques: list[float]  # N m, of each repeat
    turns: int  # whole revolutions that the steady torque is the average of; 0: less than one

    @property
    def direction(self) -> str:
        """Which of the two functions of Eq. (4) it belongs to."""
        return RISE if self.step.rising else FALL


def measure(steps: Iterable[Step], where: str) -> list[Measured]:
    """Time constant and steady torque of each averaged step."""
    found = []
    averaged = [(mean_step(repeats), repeats) for repeats in repeats_together(steps)]
    for key in sorted({(step.speed_rpm, step.rising) for step, _ in averaged}):
        alike = [(step, repeats) for step, repeats in averaged if (step.speed_rpm, step.rising) == key]
        typical = typical_time_constant([step for step, _ in alike], where)
        for step, repeats in alike:
            a, height = time_constant_of_step(step, typical)
            begin = min(STEADY * typical, 0.9 * float(step.t[-1]))
            height = height if typical / NEAR < a < typical * NEAR else 0.0
            torque, *torques = (steady_torque(one, begin, a, height) for one in [step, *repeats])
            found.append(Measured(step, typical, a, torque, torques, whole_turns(step, begin)))
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


def time_constant_of_step(step: Step, typical: float) -> tuple[float, float]:
    """Time constant from a current step, Eq. (3).

    t/a = -ln((tau - tau_2) / (tau_1 - tau_2)), solved for the torque: tau = tau_2 + (tau_1 - tau_2) exp(-t/a), fitted
    by least squares in a, tau_1 and tau_2 over the first 8 typical time constants. Differs from the paper: it
    prints tau_1 and tau_2 exchanged (t = 0 would give ln 0), and takes the slope of the logarithm, which noise bends
    as the torque nears tau_2. Our choice: a straight drift beside the exponential takes up ripple slower than it.

    Returns a in s and tau_1 - tau_2 in N m; nan and 0 where no a within a factor of 6 of `typical` fits best.
    """
    logs = math.log(typical) + np.linspace(-1.0, 1.0, 13) * math.log(REACH)
    explain = _exponential(step, TRANSIENT * typical)
    best = int(np.argmax([explain(log)[1] for log in logs]))
    if best in (0, len(logs) - 1):
        return math.nan, 0.0
    log = logs[best]
    for _ in range(2):  # the second time over 8 time constants of its own
        explain = _exponential(step, TRANSIENT * min(max(math.exp(log), typical / NEAR), typical * NEAR))
        near = log + np.array([-1.0, 1.0]) * (logs[1] - logs[0])
        log = minimize_scalar(lambda at, explain: -explain(at)[1], args=(explain,), bounds=near, method="bounded").x
    return math.exp(log), explain(log)[0]


def _exponential(step: Step, window: float) -> Callable[[float], tuple[float, float]]:
    """A function of log a: the height of exp(-t/a) that fits the first `window` s best, and the squares it explains.

    Both with the best constant and drift beside it.
    """
    count = int(np.searchsorted(step.t, window, side="right"))
    block = max(1, int(np.searchsorted(step.t, window / TRANSIENT)) // BLOCKS)
    count -= count % block
    times = step.t[:count].reshape(-1, block)
    t, torque = times.mean(axis=1), step.torque[:count].reshape(-1, block).mean(axis=1)
    straight, _ = np.linalg.qr(np.column_stack([np.ones(len(t)), t]))
    torque -= straight @ (straight.T @ torque)

    def explain(log: float) -> tuple[float, float]:
        decay = np.exp(times * -math.exp(-log)).mean(axis=1)
        decay -= straight @ (straight.T @ decay)
        both, square = float(decay @ torque), float(decay @ decay)
        return both / square, both * both / square

    return explain


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
