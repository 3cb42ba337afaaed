"""A brake as its measured steps show it: Eqs. (2), (3) and (4) fitted, with intervals, residuals and warnings."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from core.files import InputError
from experiments.identify.fit import (
    A_NAMES,
    K_NAMES,
    LinearFit,
    TimeConstants,
    choose_omega_0,
    fit_time_constants,
    fit_torque_gain,
    scatter_by_omega_0,
)
from experiments.identify.step_response import FALL, RISE, Measured, Step, measure

IDENTIFIED, GIVEN = "identified", "given"
NOT_SEEN_FLAT = "the highest measured speed, no faster step shows where the time constants level off"


class Parameter(NamedTuple):
    """One number with its 95 % interval, value -+ half_width."""

    name: str
    value: float
    half_width: float
    unit: str


@dataclass(frozen=True)
class Identification:
    """A brake as its steps show it."""

    source: str  # the file's name
    steps: int
    measured: list[Measured]  # averaged steps
    gain: LinearFit
    constants: dict[str, TimeConstants]  # by direction
    omega_0_rpm: float
    scatter: dict[float, float]  # omega_0 (rpm) -> scatter relative to the least; empty where it was given
    backlash_deg: float | None  # None where it was not given

    @property
    def flat_part_seen(self) -> bool:
        """Whether two measured speeds at least lie at omega_0 and above: else nothing shows that Eq. (4) is flat."""
        return len({one.step.speed_rpm for one in self.measured if one.step.speed_rpm >= self.omega_0_rpm}) > 1

    @property
    def omega_0_by(self) -> str:
        """Where omega_0 comes from."""
        if not self.scatter:
            return "given"
        if self.flat_part_seen:
            return "least squares over the measured speeds"
        return f"assumed: {NOT_SEEN_FLAT}"

    @property
    def doubtful(self) -> dict[str, str]:
        """Column of the steps -> why its numbers are hardly in its unit."""
        constants = sorted(one.time_constant for one in self.measured if not math.isnan(one.time_constant))
        values = {
            TIME: constants[len(constants) // 2],
            TORQUE: max(abs(one.steady_torque) for one in self.measured),
            CURRENT: self.current_max,
            SPEED: max(one.step.speed_rpm for one in self.measured),
        }
        if self.scatter and self.flat_part_seen:
            values[OMEGA_0] = self.omega_0_rpm
        warnings: dict[str, str] = {}
        for plausible, value in values.items():
            if not plausible.low <= value <= plausible.high:
                warnings.setdefault(plausible.column, plausible.warning(value))
        return warnings

    @property
    def warnings(self) -> list[str]:
        """What a reader of the numbers must know."""
        assumed = self.scatter and not self.flat_part_seen
        return [*self.doubtful.values()] + [f"omega_0_rpm = {self.omega_0_rpm:g} is {self.omega_0_by}"] * bool(assumed)

    @property
    def sources(self) -> dict[str, str]:
        """Key of the brake file -> where its numbers come from: IDENTIFIED, GIVEN, or why they are assumed."""
        return dict.fromkeys(("k", "rise", "fall"), IDENTIFIED) | {
            "current_max_A": "the largest that was measured",
            "knee_A": "as in the paper",
            "floor_rpm": "Eq. (4) is held below",
            "omega_0_rpm": GIVEN if not self.scatter else IDENTIFIED if self.flat_part_seen else NOT_SEEN_FLAT,
            "backlash_deg": "steps do not show it" if self.backlash_deg is None else GIVEN,
        }

    def keys(self, source: str) -> list[str]:
        """Keys of the brake file whose numbers come from `source`, IDENTIFIED or GIVEN."""
        return [key for key, own in self.sources.items() if own == source]

    @property
    def assumed(self) -> dict[str, str]:
        """Key of the brake file -> why, for each number that is assumed."""
        return {key: why for key, why in self.sources.items() if why not in (IDENTIFIED, GIVEN)}

    @property
    def set_aside(self) -> list[Measured]:
        """The averaged steps without a transient that stands out."""
        return [one for one in self.measured if math.isnan(one.time_constant)]

    @property
    def current_max(self) -> float:
        """The largest current measured (A)."""
        return max(max(one.step.current_from, one.step.current_to) for one in self.measured)

    def parameters(self) -> list[Parameter]:
        """k_1 .. k_5, and for rise and fall a_avg and a_1 .. a_6."""
        fits: list[tuple[tuple[str, ...], LinearFit, tuple[str, ...]]] = [
            (K_NAMES, self.gain, ("N m/A", "N m", "N m/A^2", "N m/A", "N m"))
        ]
        for way, of_it in self.constants.items():
            fits.append(((f"{way}.a_avg",), of_it.average, ("s",)))
            names = tuple(f"{way}.{name}" for name in A_NAMES)
            fits.append((names, of_it.surface, ("s/A", "s", "s/A", "s", "s/A", "s")))
        return [
            Parameter(name, float(value), float(half), unit)
            for names, fit, units in fits
            for name, value, half, unit in zip(names, fit.values, fit.half_widths, units, strict=True)
        ]


def identify_steps(
    steps: Iterable[Step], source: str, omega_0_rpm: float | None = None, backlash_deg: float | None = None
) -> Identification:
    """Fit Eqs. (2), (3) and (4); omega_0 by least squares over the measured speeds unless it is given.

    InputError where the steps do not determine a number: it names the number and the reason.
    """
    steps = list(steps)
    for direction, rising in ((RISE, True), (FALL, False)):
        if not any(step.rising == rising for step in steps):
            raise InputError(
                f"{source}: a_avg and a_1 to a_6 of Eq. (4), {direction}, cannot be identified: there is no step "
                f"to a {'higher' if rising else 'lower'} current"
            )
    measured = measure(steps, source)
    gain = fit_torque_gain(measured, source)
    scatter = {} if omega_0_rpm is not None else scatter_by_omega_0(measured, gain, source)
    omega_0 = choose_omega_0(scatter) if omega_0_rpm is None else omega_0_rpm
    constants = fit_time_constants(measured, gain, omega_0, source)
    return Identification(source, len(steps), measured, gain, constants, omega_0, scatter, backlash_deg)


@dataclass(frozen=True, eq=False)
class Plausible:
    """What one number of a brake can be: the unit of its column is in doubt otherwise.

    Our choice: the ranges hold any brake that a hand could work against, and of the units that bring a number into its
    range the likely one is that which brings it nearest to the paper's brake.
    """

    column: str  # of the steps
    what: str
    low: float
    high: float
    paper: float  # of the paper's brake
    unit: str
    others: Mapping[str, float]  # unit -> how much of `unit` one of it is

    def warning(self, value: float) -> str:
        """That a value is outside, and which unit it is likely in."""
        text = (
            f"{self.column}: {self.what} would be {value:.3g} {self.unit}, plausible is {self.low:g} to "
            f"{self.high:g} {self.unit}"
        )
        likely = {unit: value * factor for unit, factor in self.others.items()}
        likely = {unit: there for unit, there in likely.items() if self.low <= there <= self.high}
        if not likely:
            return f"{text}: check the unit"
        unit = min(likely, key=lambda unit: abs(math.log(likely[unit] / self.paper)))
        return f"{text}; likely unit: {unit} ({value:.3g} {unit} = {likely[unit]:.3g} {self.unit})"


_SPEEDS = {"rad/s": 30.0 / math.pi, "rev/s": 60.0, "deg/s": 1.0 / 6.0}
TIME = Plausible("t_s", "the median time constant", 2e-3, 3.0, 0.06, "s", {"ms": 1e-3, "us": 1e-6, "min": 60.0})
TORQUE = Plausible(
    "torque_N_m", "the largest steady torque", 0.05, 60.0, 5.0, "N m", {"mN m": 1e-3, "N cm": 1e-2, "ozf in": 7.06e-3}
)
CURRENT = Plausible("current_to_A", "the largest current", 0.05, 20.0, 1.0, "A", {"mA": 1e-3})
SPEED = Plausible("speed_rpm", "the highest speed", 10.0, 300.0, 64.0, "rpm", _SPEEDS)
OMEGA_0 = Plausible("speed_rpm", "omega_0", 1.5, 40.0, 8.0, "rpm", _SPEEDS)
