"""Steps between two currents alone, as those of `phd bring-up`: how much torque the larger current adds, and how soon.

They make no brake: Eq. (2) takes four currents and Eq. (4) three speeds. Our choice: the height of every transient is
the difference of all steady torques, so that few and noisy steps are enough for Eq. (3); each step has a constant of
its own, and steps one way are taken together, whatever their speeds. Intervals of 95 % come from the scatter of the
steps: of the torque by Welch's t, of a time constant by leaving out one step at a time (jackknife of its logarithm).
What shifts all steps alike they do not show.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from core.files import InputError
from experiments.identify.linear import CONFIDENCE
from experiments.identify.step_response import FALL, RISE, SETTLES, Step

FEWEST = 3  # steps one way whose scatter gives an interval of their time constant. Our choice

NOT_SEEN = {
    "k_1 to k_5, knee_A": "steps to two currents show one difference of Eq. (2); it takes four, one below the knee",
    "omega_0_rpm, a_1 to a_6": "Eq. (4) takes steps to two currents at each of three speeds",
    "backlash_deg": "steps do not show it",
}


class Number(NamedTuple):
    """One number, with its 95 % interval."""

    name: str
    value: float
    low: float | None  # None: withheld, too few steps show how they scatter
    high: float | None
    unit: str


class TwoCurrents(NamedTuple):
    """The difference of the steady torques and the time constants, from steps between two currents."""

    source: str
    steps: int
    currents_A: tuple[float, float]
    numbers: list[Number]


def has_two_currents(steps: Sequence[Step]) -> bool:
    """Whether all steps are between the same two currents."""
    return len({current for step in steps for current in (step.current_from, step.current_to)}) == 2


def identify_two_currents(steps: Sequence[Step], source: str) -> TwoCurrents:
    """The difference of the steady torques, a time constant each way. InputError: steps one way alone, or no torque."""
    low, high = sorted({steps[0].current_from, steps[0].current_to}) if steps else (0.0, 0.0)
    up, down = ([step for step in steps if step.rising == rising] for rising in (True, False))
    if not up or not down:
        way = "lower" if up else "higher"
        raise InputError(f"{source}: there is no step to the {way} current, so nothing shows what {high:g} A add")
    added = _added(up, down, f"K({high:g} A) - K({low:g} A)")
    if added.value <= 0.0:
        raise InputError(f"{source}: torque_N_m: {high:g} A add no torque ({added.value:.3g} N m)")
    constants = [_time_constant(up, RISE, added.value), _time_constant(down, FALL, -added.value)]
    return TwoCurrents(source, len(steps), (low, high), [added, *constants])


def _turned(step: Step) -> np.ndarray:
    """The torque (n,), N m, its sign as if the shaft had turned forwards."""
    return math.copysign(1.0, step.speed_rpm) * step.torque


def _added(up: Sequence[Step], down: Sequence[Step], name: str) -> Number:
    """The steady torque after steps up less that after steps down, each the mean of the last quarter of a step."""
    after_up, after_down = ([float(_turned(s)[3 * len(s.t) // 4 :].mean()) for s in steps] for steps in (up, down))
    value = float(np.mean(after_up) - np.mean(after_down))
    if min(len(up), len(down)) < 2:
        return Number(name, value, None, None, "N m")
    interval = stats.ttest_ind(after_up, after_down, equal_var=False).confidence_interval(CONFIDENCE)
    return Number(name, value, float(interval.low), float(interval.high), "N m")


def _time_constant(steps: Sequence[Step], way: str, height: float) -> Number:
    """The time constant a of Eq. (3) that fits all steps best, for a change of the torque of this height (N m)."""
    slowest, fastest = (f"{of(abs(step.speed_rpm) for step in steps):.3g}" for of in (min, max))
    name = f"{way}.a at {slowest} rpm" if slowest == fastest else f"{way}.a, {slowest} to {fastest} rpm"
    a, n = _nearest(steps, height), len(steps)
    if n < FEWEST:
        return Number(name, a, None, None, "s")
    logs = np.log([_nearest([*steps[:i], *steps[i + 1 :]], height) for i in range(n)])
    spread = math.sqrt((n - 1) / n * float(np.sum((logs - logs.mean()) ** 2)))
    factor = math.exp(float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, n - 1)) * spread)
    return Number(name, a, a / factor, a * factor, "s")


def _nearest(steps: Sequence[Step], height: float) -> float:
    """a (s) of the least squares over all samples."""

    def squares(log: float) -> float:
        rest = [_turned(step) + height * np.exp(-step.t * math.exp(-log)) for step in steps]
        return sum(float(np.sum((part - part.mean()) ** 2)) for part in rest)

    quickest = max(float(step.t[1] - step.t[0]) for step in steps)
    bounds = math.log(quickest), math.log(min(float(step.t[-1]) for step in steps) / SETTLES)
    return math.exp(float(minimize_scalar(squares, bounds=bounds, method="bounded").x))


def summary_of(found: TwoCurrents) -> dict[str, Any]:
    """The same as JSON holds it."""
    numbers = [number._asdict() for number in found.numbers]
    return found._asdict() | {"numbers": numbers, "not_seen": NOT_SEEN}
