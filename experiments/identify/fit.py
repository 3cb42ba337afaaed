"""A brake as its measured steps show it: Eqs. (2), (3) and (4) fitted, with intervals, residuals and warnings.

Refused where the steps do not determine a number: the sentence names it, and what was measured instead.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.files import InputError
from experiments.identify.doubts import Drift, Transients, Zero, drift, measure_transients, one_way, without_drift
from experiments.identify.linear import (
    Array,
    LinearFit,
    fit_linear,
    undetermined,
    variance_by_group,
    weights_with_ripple,
)
from experiments.identify.step_response import FALL, REACH, RISE, Measured, Step
from experiments.numbers import significant

KNEE_A = 0.2  # Eq. (2), of the paper's brake
K_NAMES = ("k_1", "k_2", "k_3", "k_4", "k_5")
A_NAMES = ("a_1", "a_2", "a_3", "a_4", "a_5", "a_6")
#: Our choice: the lowest omega_0 with at most this many times the least scatter. The lowest, since a surface that
#: reaches a_avg at omega_0 follows the flat part for another octave and fits as well there.
MORE_SCATTER = 1.16
#: Relative. Time constants that scatter less than this fit perfectly.
PERFECT = 1e-3


class TorqueGain(NamedTuple):
    """Eq. (2) as fitted: k_1 .. k_5 and the knee (A)."""

    knee: float
    fit: LinearFit

    def at(self, current: float) -> float:
        """K (N m) at a current (A)."""
        return float(np.dot(gain_row(current, self.knee), self.fit.coefficients))


def gain_row(current: float, knee: float) -> list[float]:
    """K of Eq. (2) at a current is this row times (k_1, k_2, k_3, k_4); k_5 makes K continuous at the knee."""
    if current < knee:
        return [current, 1.0, 0.0, 0.0]
    return [knee, 1.0, current**2 - knee**2, current - knee]


def surface_row(current: float, speed_rpm: float) -> list[float]:
    """a of Eq. (4) below omega_0 is this row times (a_1 .. a_6)."""
    w = math.log2(speed_rpm)
    return [current, w, current * w, w * w, current * w * w, 1.0]


def gain_design(found: Sequence[Measured], knee: float) -> Array:
    """(n, 4) rows of Eq. (2)."""
    return np.array([gain_row(m.step.current_to, knee) for m in found])


def fit_torque_gain(found: Sequence[Measured], knee: float, where: str) -> TorqueGain:
    """k_1 .. k_5 of the torque gain, Eq. (2), from the steady torques, each at the current stepped to.

    Our choice: K is continuous at the knee (0.2 A in the paper), else it has no inverse there. Weights from the
    scatter of the single repeats about the fit: one for all steps whose torque is an average of whole revolutions,
    else one for each speed (where a step turns less than a revolution, ripple is an offset, and the less it turns the
    larger).
    """
    design = gain_design(found, knee)
    names = undetermined(design, K_NAMES[:4])
    if names:
        names += [K_NAMES[4]] if set(names) & {"k_1", "k_3", "k_4"} else []
        raise InputError(
            f"{where}: {listed(names)} of Eq. (2) cannot be identified: {_measured_at(found, speeds=False)}, and it "
            f"takes steps to four currents, one of them below {knee:g} A and two above, and more than four steps"
        )
    groups = np.unique([0.0 if m.turns else m.step.speed_rpm for m in found], return_inverse=True)[1]
    repeats = [len(m.repeated_torques) for m in found]
    torques = np.concatenate([m.repeated_torques for m in found])
    variances = variance_by_group(np.repeat(design, repeats, axis=0), torques, np.repeat(groups, repeats))
    contrasts = np.vstack([np.eye(4), [knee, 1.0, -(knee**2), -knee]])
    steady = np.array([m.steady_torque for m in found])
    return TorqueGain(knee, fit_linear(design, steady, np.array(repeats) / variances[groups], contrasts))


def torque_change(step: Step, gain: TorqueGain) -> float:
    """The change of the steady torque by a step (N m), by the fit of Eq. (2)."""
    return gain.at(step.current_to) - gain.at(step.current_from)


class TimeConstants(NamedTuple):
    """Eq. (4) for one direction."""

    average: LinearFit  # of a_avg
    surface: LinearFit | None  # of a_1 .. a_6; None: one speed alone was measured, a_avg stands for every speed
    at_average: list[Measured]  # the steps that each rests on
    at_surface: list[Measured]


class _Side(NamedTuple):
    """The steps in one direction with a time constant at omega_0 and above, or below."""

    steps: list[Measured]
    design: Array  # (n, 1) of a_avg, or (n, 6) of a_1 .. a_6
    open: list[str]  # the numbers that they leave open
    why: str


def _sides(found: Sequence[Measured], direction: str, omega_0: float) -> tuple[_Side, _Side]:
    """The steps in a direction at omega_0 (rpm) and above, and below."""
    usable = [m for m in found if m.direction == direction and not math.isnan(m.time_constant)]
    fast = [m for m in usable if m.step.speed_rpm >= omega_0]
    slow = [m for m in usable if m.step.speed_rpm < omega_0]
    flat = np.ones((len(fast), 1))
    surface = np.array([surface_row(m.step.current_to, m.step.speed_rpm) for m in slow]).reshape(-1, 6)
    return (
        _Side(
            fast, flat, undetermined(flat, ["a_avg"]),
            f"at omega_0 = {omega_0:g} rpm and above {_measured_at(fast)}, and it takes at least two steps there",
        ),
        _Side(
            slow, surface, undetermined(surface, A_NAMES),
            f"below omega_0 = {omega_0:g} rpm {_measured_at(slow)}, and it takes steps to two currents at each of "
            "three speeds, and more than six steps",
        ),
    )  # fmt: skip


def fit_time_constants(
    found: Sequence[Measured], gain: TorqueGain, omega_0: float, where: str
) -> dict[str, TimeConstants]:
    """a_avg and a_1 .. a_6 of the time constants, Eq. (4), rising and falling apart; omega_0 in rpm.

    The current is the one stepped to, omega_L is log2 of the speed in rpm. Our choice: a weight of (change of the
    torque)^2 / a, which is how well a transient shows a under white noise, less where the scatter grows with
    the speed: the faster the shaft, the more of the ripple falls into a transient.
    """
    fits = {}
    for direction in (RISE, FALL):
        fast, slow = _sides(found, direction, omega_0)
        for side in (fast, slow):
            if side.open:
                raise InputError(
                    f"{where}: {listed(side.open)} of Eq. (4), {direction}, cannot be identified: {side.why}"
                )
        fits[direction] = TimeConstants(_fit(fast, gain), _fit(slow, gain), fast.steps, slow.steps)
    return fits


def fit_constant(found: Sequence[Measured], gain: TorqueGain, where: str) -> dict[str, TimeConstants]:
    """a_avg of steps at one speed: how the time constants depend on the speed is not seen."""
    fits = {}
    for direction in (RISE, FALL):
        every, _ = _sides(found, direction, 0.0)
        if every.open:
            raise InputError(
                f"{where}: a_avg of Eq. (4), {direction}, cannot be identified: {_measured_at(every.steps)}, and it "
                "takes at least two steps"
            )
        fits[direction] = TimeConstants(_fit(every, gain), None, every.steps, [])
    return fits


def _fit(side: _Side, gain: TorqueGain) -> LinearFit:
    """Least squares of the time constants; the weights follow the fit, from typical constants on."""
    values = np.array([m.time_constant for m in side.steps])
    typical = np.array([m.typical for m in side.steps])
    speeds = np.array([m.step.speed_rpm for m in side.steps])
    squares = np.array([torque_change(m.step, gain) for m in side.steps]) ** 2
    expected = typical
    for _ in range(3):
        weights = weights_with_ripple(side.design, values, squares / expected, speeds)
        fit = fit_linear(side.design, values, weights)
        expected = np.clip(fit.fitted, typical / REACH, typical * REACH)
    return fit


def scatter_by_omega_0(found: Sequence[Measured], gain: TorqueGain, where: str) -> dict[float, float]:
    """omega_0 (rpm) -> scatter of the time constants about Eq. (4), relative to the least.

    Every measured speed at which the steps determine all numbers is tried. The scatter is the geometric mean over all
    steps of the standard deviation at their speed, so that the worst speed does not hide what the others show.
    """
    speeds = sorted({m.step.speed_rpm for m in found})
    lacking = {
        omega_0: sum(
            len(next((side.open for side in _sides(found, direction, omega_0) if side.open), []))
            for direction in (RISE, FALL)
        )
        for omega_0 in speeds
    }
    fewest = min(speeds, key=lacking.__getitem__)
    if lacking[fewest]:
        fit_time_constants(found, gain, fewest, where)  # refuses
    usable = [m for m in found if not math.isnan(m.time_constant)]
    trust = np.array([abs(torque_change(m.step, gain)) / math.sqrt(m.typical) for m in usable])
    values = np.array([m.time_constant for m in usable]) * trust
    all_speeds = np.array([m.step.speed_rpm for m in usable])
    _, groups, counts = np.unique(all_speeds, return_inverse=True, return_counts=True)
    rising = np.array([[m.step.rising] for m in usable])
    surface = np.array([[0.0, *surface_row(m.step.current_to, m.step.speed_rpm)] for m in usable])
    scatter = {}
    for omega_0 in (speed for speed in speeds if not lacking[speed]):
        rows = np.where(all_speeds[:, None] >= omega_0, [1.0, *[0.0] * 6], surface)  # times (a_avg, a_1 .. a_6)
        design = np.hstack([np.where(rising, rows, 0.0), np.where(rising, 0.0, rows)]) * trust[:, None]
        variance = variance_by_group(design, values, groups) + PERFECT**2 * float(np.median(values**2))
        scatter[omega_0] = math.exp(0.5 * float(np.average(np.log(variance), weights=counts)))
    least = min(scatter.values())
    return {omega_0: value / least for omega_0, value in scatter.items()}


def choose_omega_0(scatter: dict[float, float]) -> float:
    """omega_0 (rpm) from `scatter_by_omega_0`: where the paper looked at Fig. 7, least squares over the speeds."""
    return min(omega_0 for omega_0, value in scatter.items() if value <= MORE_SCATTER)


def _measured_at(found: Sequence[Measured], speeds: bool = True) -> str:
    """The currents and speeds of the steps, for a refusal."""
    if not found:
        return "no step shows a time constant"
    count = f"{len(found)} averaged step{'s' if len(found) > 1 else ''}"
    text = f"{count} to {_numbers(m.step.current_to for m in found)} A"
    return text + (f" at {_numbers(m.step.speed_rpm for m in found)} rpm" if speeds else "") + " only"


def _numbers(values: Iterable[float]) -> str:
    return listed([f"{value:g}" for value in sorted(set(values))])


def listed(words: Sequence[str]) -> str:
    """The words as in a sentence: a, b and c."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


# --------------------------------------------------------------------------------------- the brake as its steps show it

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
        """Whether the steps are all at one speed, so that nothing shows how the time constants depend on it."""
        return any(of_it.surface is None for of_it in self.constants.values())

    @property
    def flat_part_seen(self) -> bool:
        """Whether two measured speeds at least lie at omega_0 and above: else nothing shows that Eq. (4) is flat."""
        return len({m.step.speed_rpm for m in self.measured if m.step.speed_rpm >= self.omega_0_rpm}) > 1

    @property
    def omega_0_by(self) -> str:
        """Where omega_0 comes from."""
        source = self.sources["omega_0_rpm"]
        return {GIVEN: GIVEN, IDENTIFIED: "least squares over the measured speeds"}.get(source, f"assumed: {source}")

    @property
    def doubtful(self) -> dict[str, str]:
        """Column of the steps -> why its numbers are hardly in its unit."""
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
        if self.one_speed:
            speed = self.measured[0].step.speed_rpm
            seen = (
                f"speed_rpm: all steps are at {speed:g} rpm, so a_1 to a_6 of Eq. (4) are not seen: the time constants "
            )
            return [*self._doubts, f"{seen}are taken as constant, and slow joints will answer later than that"]
        assumed = "omega_0_rpm" in self.assumed
        return self._doubts + [f"omega_0_rpm = {self.omega_0_rpm:g} is {self.omega_0_by}"] * assumed

    @property
    def _doubts(self) -> list[str]:
        """Units and faults of the bench."""
        zero = self.zero.warnings if self.zero else []
        return [*self.doubtful.values(), *zero, *self.transients.warnings, *self.drift.warnings]

    @property
    def sources(self) -> dict[str, str]:
        """Key of the brake file -> where its numbers come from: IDENTIFIED, GIVEN, or why they are assumed."""
        return dict.fromkeys(("k", "rise", "fall"), IDENTIFIED) | {
            "current_max_A": "the largest that was measured",
            "knee_A": "as in the paper" if self.gain.knee == KNEE_A else GIVEN,
            "floor_rpm": "Eq. (4) is held below",
            "omega_0_rpm": ONE_SPEED
            if self.one_speed
            else GIVEN
            if not self.scatter
            else IDENTIFIED
            if self.flat_part_seen
            else NOT_SEEN_FLAT,
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
        return [m for m in self.measured if math.isnan(m.time_constant)]

    @property
    def current_max(self) -> float:
        """The largest current measured (A)."""
        return max(max(m.step.current_from, m.step.current_to) for m in self.measured)

    def parameters(self) -> list[Parameter]:
        """k_1 .. k_5, and for rise and fall a_avg and a_1 .. a_6."""
        zero = self.zero.half_width if self.zero else 0.0
        fits: list[tuple[tuple[str, ...], LinearFit, tuple[str, ...]]] = []
        for direction, constants in self.constants.items():
            fits.append(((f"{direction}.a_avg",), constants.average, ("s",)))
            if constants.surface is not None:
                names = tuple(f"{direction}.{name}" for name in A_NAMES)
                fits.append((names, constants.surface, ("s/A", "s", "s/A", "s", "s/A", "s")))
        units = ("N m/A", "N m", "N m/A^2", "N m/A", "N m")
        return [
            Parameter(name, value, half + 0.5 * abs(self.drift.share * value) + zero * (unit == "N m"), unit)
            for name, value, half, unit in zip(K_NAMES, *map(np.ndarray.tolist, self.gain.fit[1:3]), units, strict=True)
        ] + [
            Parameter(name, value, half if self.transients.exponential else None, unit)
            for names, fit, units in fits
            for name, value, half, unit in zip(names, *map(np.ndarray.tolist, fit[1:3]), units, strict=True)
        ]


class ByHand(NamedTuple):
    """The numbers of a brake that may be given by hand."""

    omega_0_rpm: float | None = None  # None: by least squares over the measured speeds
    backlash_deg: float | None = None  # steps do not show it. None: assumed
    knee_A: float = KNEE_A


NOTHING_GIVEN = ByHand()


def identify_steps(steps: Iterable[Step], source: str, given: ByHand = NOTHING_GIVEN) -> Identification:
    """Fit Eqs. (2), (3) and (4), and take what is given by hand.

    Steps at one speed give Eq. (2) and constant time constants.

    InputError where the steps do not determine a number: it names the number and the reason.
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
    if given.omega_0_rpm is None and len(speeds := {found.step.speed_rpm for found in measured}) == 1:
        constants = fit_constant(measured, gain, source)
        return Identification(
            source, len(steps), measured, gain, constants, speeds.pop(), {}, given.backlash_deg, transients, drifted,
            zero,
        )  # fmt: skip
    scatter = {} if given.omega_0_rpm is not None else scatter_by_omega_0(measured, gain, source)
    omega_0 = choose_omega_0(scatter) if given.omega_0_rpm is None else given.omega_0_rpm
    constants = fit_time_constants(measured, gain, omega_0, source)
    return Identification(
        source, len(steps), measured, gain, constants, omega_0, scatter, given.backlash_deg, transients, drifted, zero
    )


@dataclass(frozen=True, eq=False)
class Plausible:
    """What one number of a brake can be: the unit of its column is in doubt otherwise.

    Our choice: the ranges hold any brake that a hand could work against, and of the units that bring a number into its
    range the likely one is that which brings it nearest to the paper's brake.
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
        likely = {unit: value * factor for unit, factor in self.others.items()}
        likely = {unit: there for unit, there in likely.items() if self.low <= there <= self.high}
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
