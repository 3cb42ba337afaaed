"""A brake identified from its measured steps: Eqs. (2), (3) and (4) as fitted, what is assumed, and the warnings."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from core.files import InputError
from experiments.identify.doubts import Drift, Transients, Zero, drift, measure_transients, one_way, without_drift
from experiments.identify.fit import (
    A_NAMES,
    K_NAMES,
    KNEE_A,
    TimeConstants,
    TorqueGain,
    choose_omega_0,
    fit_constant,
    fit_time_constants,
    fit_torque_gain,
    gain_design,
    scatter_by_omega_0,
)
from experiments.identify.linear import LinearFit
from experiments.identify.step_response import FALL, RISE, Measured, Step
from experiments.identify.units import CURRENT, OMEGA_0, SPEED, TIME, TORQUE
from experiments.numbers import significant

IDENTIFIED, GIVEN = "identified", "given"
ONE_SPEED = "the only measured speed, from there on and below the time constants are a_avg"
NOT_SEEN_FLAT = "the highest measured speed, no faster step shows where the time constants level off"


class Parameter(NamedTuple):
    """One number with its 95 % interval, value -+ half_width."""

    name: str
    value: float
    half_width: float | None  # None: withheld
    unit: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """The bounds of the interval."""
        return None if self.half_width is None else (self.value - self.half_width, self.value + self.half_width)

    @property
    def spread(self) -> str:
        """The interval, behind the number in a file."""
        return "interval withheld" if self.half_width is None else f"+- {significant(self.half_width, 2)} {self.unit}"


@dataclass(frozen=True)
class Identification:
    """A brake as its steps show it."""

    source: str  # the file's name
    steps: int
    measured: list[Measured]  # averaged steps
    gain: TorqueGain
    constants: dict[str, TimeConstants]  # by direction
    omega_0_rpm: float
    scatter: dict[float, float]  # omega_0 (rpm) -> scatter relative to the least; empty where it was given
    backlash_deg: float | None  # None where it was not given
    transients: Transients
    drift: Drift
    zero: Zero | None  # None: the shaft never turned the other way

    @property
    def one_speed(self) -> bool:
        """Whether all steps are at one speed: the time constants are then taken as constant."""
        return any(constants.surface is None for constants in self.constants.values())

    @property
    def flat_part_seen(self) -> bool:
        """Whether at least two measured speeds lie at omega_0 or above, and so show that Eq. (4) is flat there."""
        return len({m.step.speed_rpm for m in self.measured if m.step.speed_rpm >= self.omega_0_rpm}) > 1

    @property
    def omega_0_by(self) -> str:
        """Where omega_0 comes from."""
        source = self.sources["omega_0_rpm"]
        return {GIVEN: GIVEN, IDENTIFIED: "least squares over the measured speeds"}.get(source, f"assumed: {source}")

    @property
    def doubtful(self) -> dict[str, str]:
        """Column of the steps -> why its unit is in doubt."""
        constants = sorted(m.time_constant for m in self.measured if not math.isnan(m.time_constant))
        values = {
            TIME: constants[len(constants) // 2],
            TORQUE: max(abs(m.steady_torque) for m in self.measured),
            CURRENT: self.current_max,
            SPEED: max(m.step.speed_rpm for m in self.measured),
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
        """Warnings that stand with the numbers."""
        zero = self.zero.warnings if self.zero else []
        warnings = [*self.doubtful.values(), *zero, *self.transients.warnings, *self.drift.warnings]
        if self.one_speed:
            speed = self.measured[0].step.speed_rpm
            warnings.append(
                f"speed_rpm: all steps are at {speed:g} rpm, so a_1 to a_6 of Eq. (4) are not seen: the time constants "
                "are taken as constant, and slow joints will answer later than that"
            )
        elif "omega_0_rpm" in self.assumed:
            warnings.append(f"omega_0_rpm = {self.omega_0_rpm:g} is {self.omega_0_by}")
        return warnings

    @property
    def sources(self) -> dict[str, str]:
        """Key of the brake file -> where its numbers come from: IDENTIFIED, GIVEN, or why they are assumed."""
        return dict.fromkeys(("k", "rise", "fall"), IDENTIFIED) | {
            "current_max_A": "the largest that was measured",
            "knee_A": "as in the paper" if self.gain.knee == KNEE_A else GIVEN,
            "floor_rpm": "Eq. (4) is held below",
            "omega_0_rpm": self._omega_0_source(),
            "backlash_deg": "steps do not show it" if self.backlash_deg is None else GIVEN,
        }

    def _omega_0_source(self) -> str:
        if self.one_speed:
            return ONE_SPEED
        if not self.scatter:
            return GIVEN
        return IDENTIFIED if self.flat_part_seen else NOT_SEEN_FLAT

    def keys(self, source: str) -> list[str]:
        """Keys of the brake file whose numbers come from `source`, IDENTIFIED or GIVEN."""
        return [key for key, its_source in self.sources.items() if its_source == source]

    @property
    def assumed(self) -> dict[str, str]:
        """Key of the brake file -> why, for each number that is assumed."""
        return {key: why for key, why in self.sources.items() if why not in (IDENTIFIED, GIVEN)}

    @property
    def set_aside(self) -> list[Measured]:
        """The averaged steps without a transient that stands out."""
        return [m for m in self.measured if math.isnan(m.time_constant)]

    @property
    def current_max(self) -> float:
        """The largest current measured (A)."""
        return max(max(m.step.current_from, m.step.current_to) for m in self.measured)

    def parameters(self) -> list[Parameter]:
        """k_1 .. k_5, and for rise and fall a_avg and a_1 .. a_6."""
        zero = self.zero.half_width if self.zero else 0.0
        rows = []
        for name, value, half, unit in _numbers(K_NAMES, self.gain.fit, ("N m/A", "N m", "N m/A^2", "N m/A", "N m")):
            half += 0.5 * abs(self.drift.share * value) + (zero if unit == "N m" else 0.0)
            rows.append(Parameter(name, value, half, unit))
        for direction, constants in self.constants.items():
            numbers = _numbers(("a_avg",), constants.average, ("s",))
            if constants.surface is not None:
                numbers += _numbers(A_NAMES, constants.surface, ("s/A", "s", "s/A", "s", "s/A", "s"))
            for name, value, half, unit in numbers:
                interval = half if self.transients.exponential else None
                rows.append(Parameter(f"{direction}.{name}", value, interval, unit))
        return rows


def _numbers(names: Sequence[str], fit: LinearFit, units: Sequence[str]) -> list[tuple[str, float, float, str]]:
    """Name, value, half-width of the interval and unit of each number of a fit."""
    return list(zip(names, fit.values.tolist(), fit.half_widths.tolist(), units, strict=True))


class ByHand(NamedTuple):
    """The numbers of a brake that may be given by hand."""

    omega_0_rpm: float | None = None  # None: by least squares over the measured speeds
    backlash_deg: float | None = None  # steps do not show it. None: assumed
    knee_A: float = KNEE_A


NOTHING_GIVEN = ByHand()


def identify_steps(steps: Iterable[Step], source: str, given: ByHand = NOTHING_GIVEN) -> Identification:
    """Fit Eqs. (2), (3) and (4) to the steps; numbers given by hand stay as they are.

    Steps at one speed give Eq. (2) and constant time constants. InputError where the steps do not determine a number:
    it names the number and the reason.
    """
    steps = list(steps)
    for direction, rising in ((RISE, True), (FALL, False)):
        if not any(step.rising == rising for step in steps):
            raise InputError(
                f"{source}: a_avg and a_1 to a_6 of Eq. (4), {direction}, cannot be identified: there is no step "
                f"to a {'higher' if rising else 'lower'} current"
            )
    steps, zero = one_way(steps, source)
    transients = measure_transients(steps, source)
    measured = transients.measured
    gain = fit_torque_gain(measured, given.knee_A, source)
    if zero is None and gain.fit.values[1] + gain.fit.half_widths[1] < 0.0:
        raise InputError(
            f"{source}: torque_N_m: without current it would be {significant(gain.fit.values[1], 3)} N m, and a "
            "brake never drives: the torque sensor's zero is off by at least as much (steps with the shaft turned the "
            "other way, speed_rpm below 0, would tell it)"
        )
    drifted = drift(measured, gain_design(measured, given.knee_A), gain.fit)
    if drifted.share:
        measured = without_drift(measured, drifted.share)
        gain = fit_torque_gain(measured, given.knee_A, source)
    speeds = {each.step.speed_rpm for each in measured}
    scatter: dict[float, float] = {}
    if given.omega_0_rpm is not None:
        omega_0 = given.omega_0_rpm
        constants = fit_time_constants(measured, gain, omega_0, source)
    elif len(speeds) == 1:
        (omega_0,) = speeds
        constants = fit_constant(measured, gain, source)
    else:
        scatter = scatter_by_omega_0(measured, gain, source)
        omega_0 = choose_omega_0(scatter)
        constants = fit_time_constants(measured, gain, omega_0, source)
    return Identification(
        source, len(steps), measured, gain, constants, omega_0, scatter, given.backlash_deg, transients, drifted, zero
    )
