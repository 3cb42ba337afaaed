"""Whether measured steps can be in the units that their columns name, and which unit they are likely in if not.

Our choice: the ranges hold any brake that a hand could work against, and of the units that bring a number into its
range the likely one is that which brings it nearest to the paper's brake.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from experiments.identify.step_response import Measured


class Plausible(NamedTuple):
    """What one number of a brake can be."""

    column: str  # of the steps, whose unit is in question
    what: str
    low: float
    high: float
    paper: float  # of the paper's brake
    unit: str
    others: Mapping[str, float]  # unit -> how much of `unit` one of it is


_SPEEDS = {"rad/s": 30.0 / math.pi, "rev/s": 60.0, "deg/s": 1.0 / 6.0}
TIME = Plausible("t_s", "the median time constant", 2e-3, 3.0, 0.06, "s", {"ms": 1e-3, "us": 1e-6, "min": 60.0})
TORQUE = Plausible(
    "torque_N_m", "the largest steady torque", 0.05, 60.0, 5.0, "N m", {"mN m": 1e-3, "N cm": 1e-2, "ozf in": 7.06e-3}
)
CURRENT = Plausible("current_to_A", "the largest current", 0.05, 20.0, 1.0, "A", {"mA": 1e-3})
SPEED = Plausible("speed_rpm", "the highest speed", 10.0, 300.0, 64.0, "rpm", _SPEEDS)
OMEGA_0 = Plausible("speed_rpm", "omega_0", 1.5, 40.0, 8.0, "rpm", _SPEEDS)


def doubtful_units(measured: Sequence[Measured], omega_0_rpm: float | None) -> dict[str, str]:
    """Column -> the warning that its numbers are hardly in its unit. omega_0_rpm: None if the steps do not show it."""
    constants = sorted(one.time_constant for one in measured if not math.isnan(one.time_constant))
    values = [
        (TIME, constants[len(constants) // 2]),
        (TORQUE, max(abs(one.steady_torque) for one in measured)),
        (CURRENT, max(max(one.step.current_from, one.step.current_to) for one in measured)),
        (SPEED, max(one.step.speed_rpm for one in measured)),
    ]
    if omega_0_rpm is not None:
        values.append((OMEGA_0, omega_0_rpm))
    warnings: dict[str, str] = {}
    for range_, value in values:
        if not range_.low <= value <= range_.high:
            warnings.setdefault(range_.column, _warning(range_, value))
    return warnings


def _warning(range_: Plausible, value: float) -> str:
    said = (
        f"{range_.column}: {range_.what} would be {value:.3g} {range_.unit}, plausible is {range_.low:g} to "
        f"{range_.high:g} {range_.unit}"
    )
    likely = {unit: value * factor for unit, factor in range_.others.items()}
    likely = {unit: there for unit, there in likely.items() if range_.low <= there <= range_.high}
    if not likely:
        return f"{said}: check the unit"
    unit = min(likely, key=lambda unit: abs(math.log(likely[unit] / range_.paper)))
    return f"{said}; likely unit: {unit} ({value:.3g} {unit} = {likely[unit]:.3g} {range_.unit})"
