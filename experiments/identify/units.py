"""What the numbers of a brake can be: a number outside its range is hardly in the unit that its column names."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from experiments.numbers import significant


@dataclass(frozen=True, eq=False)
class Plausible:
    """The range of one number of a brake.

    Our choice: the ranges hold any brake that a hand could work against. Of the units that bring a number into its
    range, the likely one brings it nearest to the paper's brake.
    """

    column: str  # of the steps
    quantity: str
    low: float
    high: float
    paper: float  # of the paper's brake
    unit: str
    others: Mapping[str, float]  # unit -> how much of `unit` one of it is

    def warning(self, value: float) -> str:
        """A sentence on a value outside the range, and the unit that it is likely in."""
        text = (
            f"{self.column}: {self.quantity} would be {significant(value)} {self.unit}, plausible is {self.low:g} to "
            f"{self.high:g} {self.unit}"
        )
        converted = {unit: value * factor for unit, factor in self.others.items()}
        likely = {unit: number for unit, number in converted.items() if self.low <= number <= self.high}
        if not likely:
            return f"{text}: check the unit"
        unit = min(likely, key=lambda unit: abs(math.log(likely[unit] / self.paper)))
        return f"{text}; likely unit: {unit} ({significant(value)} {unit} = {significant(likely[unit])} {self.unit})"


_SPEEDS = {"rad/s": 30.0 / math.pi, "rev/s": 60.0, "deg/s": 1.0 / 6.0}
TIME = Plausible("t_s", "the median time constant", 2e-3, 3.0, 0.06, "s", {"ms": 1e-3, "us": 1e-6, "min": 60.0})
TORQUE = Plausible(
    "torque_N_m", "the largest steady torque", 0.05, 60.0, 5.0, "N m", {"mN m": 1e-3, "N cm": 1e-2, "ozf in": 7.06e-3}
)
CURRENT = Plausible("current_to_A", "the largest current", 0.05, 20.0, 1.0, "A", {"mA": 1e-3})
SPEED = Plausible("speed_rpm", "the highest speed", 10.0, 300.0, 64.0, "rpm", _SPEEDS)
OMEGA_0 = Plausible("speed_rpm", "omega_0", 1.5, 40.0, 8.0, "rpm", _SPEEDS)
