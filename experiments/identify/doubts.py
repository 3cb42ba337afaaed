"""What measured steps show that Eqs. (2) and (3) do not have: a zero offset, a dead time, a drift over the session.

Each test takes the chance that a bench without the fault shows as much (`CHANCE`); what is found is taken out of the
steps where that can be done, and named with its likely cause.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from core.files import InputError
from experiments.identify.linear import LinearFit, fit_linear, variance_by_group
from experiments.identify.step_response import Measured, Step, Transient, measure, window_of
from experiments.numbers import significant

CHANCE = 1e-4  # of a false alarm. Our choice
SMALLEST = 1e-3  # of a transient's height: our choice, less is of no consequence to a time constant
#: Ends of stretches after the step, in time constants, over which residuals are averaged.
STRETCHES = (0.0, 0.15, 0.4, 0.8, 1.5, 3.0)
FEW = 2 * (len(STRETCHES) - 1)  # fewer steps do not show whether what is left after them has a shape
LATEST = 3.0  # typical time constants: a longer dead time is not looked for
WITH_SPEED = 0.7  # rank correlation from which a drift may be the speed's


class Zero(NamedTuple):
    """What the torque sensor reads without torque, with the half-width of its 95 % interval, N m."""

    value: float
    half_width: float

    @property
    def warnings(self) -> list[str]:
        """The offset as a warning; none where it is too small to matter."""
        if abs(self.value) <= 2.0 * self.half_width:  # our choice: a chance of some 1e-4 as well
            return []
        return [f"torque_N_m: without torque the sensor reads {significant(self.value, 3)} N m, which was taken off"]


def one_way(steps: Sequence[Step], where: str) -> tuple[list[Step], Zero | None]:
    """The steps as if the shaft had always turned one way, without the sensor's zero. None: it turned one way only.

    Turned the other way (a speed below 0), the brake's torque changes its sign, and the sensor's zero does not.
    """
    ends = [float(np.mean(step.torque[3 * len(step.t) // 4 :])) for step in steps]
    largest = max(range(len(steps)), key=lambda i: abs(ends[i]))
    if ends[largest] * steps[largest].speed_rpm < 0.0:
        raise InputError(
            f"{where}: torque_N_m is {significant(ends[largest], 3)} N m at {steps[largest].speed_rpm:g} rpm, and a "
            "brake's torque has the sign of the speed: the sensor counts the other way, turn the sign of torque_N_m"
        )
    if all(step.speed_rpm > 0.0 for step in steps):
        return list(steps), None
    both: dict[tuple[float, float, float], dict[bool, list[float]]] = {}
    for step, end in zip(steps, ends, strict=True):
        key = step.current_from, step.current_to, abs(step.speed_rpm)
        both.setdefault(key, {}).setdefault(step.speed_rpm > 0.0, []).append(end)
    pairs = {key: 0.5 * (np.mean(of[True]) + np.mean(of[False])) for key, of in both.items() if len(of) == 2}
    if len(pairs) < 3:
        raise InputError(
            f"{where}: speed_rpm: {len(pairs)} steps are there both ways, between the same currents at one speed and "
            "at minus that speed; it takes three to tell the torque sensor's zero"
        )
    values, ones = np.array(list(pairs.values())), np.ones((len(pairs), 1))
    groups = np.unique([speed for _, _, speed in pairs], return_inverse=True)[1]
    fit = fit_linear(ones, values, 1.0 / variance_by_group(ones, values, groups)[groups])
    zero = Zero(float(fit.values[0]), float(fit.half_widths[0]))
    turned = []
    for step in steps:
        way = math.copysign(1.0, step.speed_rpm)
        turned.append(replace(step, speed_rpm=abs(step.speed_rpm), torque=way * (step.torque - zero.value)))
    return turned, zero


def misfit(found: Sequence[Measured], dead_s: float) -> float:
    """The probability of residuals like these after the steps if every torque follows Eq. (3).

    By Hotelling's T-squared of their means over `STRETCHES`, step by step, each times the height of its transient.
    """
    rows = []
    for measured in found:
        if math.isnan(measured.time_constant):
            continue
        transient = Transient(measured.step, window_of(measured.time_constant, measured.typical), dead_s)
        log = math.log(measured.time_constant)
        height, _ = transient.fitted(log)
        rest = transient.torque - height * transient.decay(log)
        stretch = np.searchsorted(STRETCHES, transient.times.mean(axis=1) / measured.time_constant, side="right") - 1
        counts = np.bincount(stretch, minlength=len(STRETCHES))[:-1]
        if counts.all():
            rows.append(height * np.bincount(stretch, rest, len(STRETCHES))[:-1] / counts)
            rows[-1] = np.append(rows[-1], height * height)
    n, p = len(rows), len(STRETCHES) - 1
    if n < FEW:
        return 1.0
    means, squares = np.array(rows)[:, :p], np.array(rows)[:, p]
    mean = means.mean(axis=0)
    if np.max(np.abs(mean)) < SMALLEST * squares.mean():
        return 1.0
    t_squared = n * mean @ np.linalg.pinv(np.cov(means.T)) @ mean
    return float(stats.f.sf(t_squared * (n - p) / (p * (n - 1)), p, n - p))


def dead_time(found: Sequence[Measured]) -> float:
    """The time (s) after which all transients together follow Eq. (3) best."""
    clear = [measured for measured in found if not math.isnan(measured.time_constant)]

    def missed(log: float, transient: Transient) -> float:
        return -transient.fitted(log)[1]

    def unexplained(dead_s: float) -> float:
        total = 0.0
        for measured in clear:
            transient = Transient(measured.step, window_of(measured.time_constant, measured.typical), dead_s)
            near = math.log(measured.time_constant) + np.array([-0.7, 0.7])
            total += minimize_scalar(missed, args=(transient,), bounds=near, method="bounded").fun
        return total

    most = LATEST * min(measured.typical for measured in clear)
    return float(minimize_scalar(unexplained, bounds=(0.0, most), method="bounded", options={"xatol": 1e-3 * most}).x)


def chance_of_dead_time(found: Sequence[Measured], dead_s: float) -> float:
    """The probability that so few steps look this late by chance, by Student's t.

    What Eq. (3) leaves of each is compared with what it would leave of a transient of that height, `dead_s` late.
    """
    left, expected = [], []
    for measured in found:
        if math.isnan(measured.time_constant):
            continue
        window, log = window_of(measured.time_constant, measured.typical), math.log(measured.time_constant)
        prompt, late = Transient(measured.step, window, 0.0), Transient(measured.step, window, dead_s)
        bounds = log + np.array([-0.7, 0.7])
        best = float(minimize_scalar(lambda at, of: -of.fitted(at)[1], args=(late,), bounds=bounds, method="bounded").x)
        fitted = np.column_stack([prompt.decay(log), prompt.decay(log + 0.01) - prompt.decay(log - 0.01)])
        both = np.column_stack([prompt.torque, late.decay(best)])
        torque, shape = (both - fitted @ np.linalg.lstsq(fitted, both, rcond=None)[0]).T
        size = float(np.linalg.norm(shape))
        left.append(float(torque @ shape) / size)
        expected.append(late.fitted(best)[0] * size)
    if len(left) < 2:
        return 1.0
    u, v = np.array(left), np.array(expected)
    share = float(u @ v / (v @ v))
    error = math.sqrt(float(np.sum((u - share * v) ** 2)) / (len(u) - 1) / float(v @ v))
    return float(2.0 * stats.t.sf(abs(share) / error, len(u) - 1))


class Transients(NamedTuple):
    """The measured steps, and whether their transients follow Eq. (3)."""

    measured: list[Measured]
    dead_s: float  # dead time that was taken out of them
    exponential: bool  # whether they then follow Eq. (3)
    few: bool = False  # too few steps to test it, but for a dead time

    @property
    def reach(self) -> str:
        """Under which condition the intervals hold, as a sentence."""
        test = ", which so few steps cannot show" if self.few else ""
        return f"the intervals hold if the brake follows Eqs. (2) to (4){test}"

    @property
    def warnings(self) -> list[str]:
        """What was found, as sentences."""
        if not self.exponential:
            return [
                "t_s: after the steps the torque does not follow Eq. (3), with or without a dead time: a coil or "
                "supply that brings the current late, or more than one time constant, is likely; the intervals of the "
                "time constants are withheld"
            ]
        if not self.dead_s:
            return []
        return [
            f"t_s: the torque begins to change {significant(1e3 * self.dead_s, 2)} ms after t_s = 0: a dead time of "
            "supply or sensor, or a clock that starts early, is likely; the time constants are fitted from there "
            "on, and the brake file, which has no dead time, answers as much sooner"
        ]


def measure_transients(steps: Sequence[Step], where: str) -> Transients:
    """Measure the steps; where the transients have a dead time, take it out."""
    measured = measure(steps, where)
    is_few = sum(not math.isnan(one.time_constant) for one in measured) < FEW
    if not is_few and misfit(measured, 0.0) > CHANCE:
        return Transients(measured, 0.0, True)
    dead_s = dead_time(measured)
    if is_few and chance_of_dead_time(measured, dead_s) > CHANCE:
        return Transients(measured, 0.0, True, True)
    late = measure(steps, where, dead_s)
    if misfit(late, dead_s) > CHANCE:
        return Transients(late, dead_s, True, is_few)
    return Transients(measured, 0.0, False)


class Drift(NamedTuple):
    """The change of the torque over a session."""

    share: float = 0.0  # from its first step to its last; 0: none is seen
    with_speed: bool = False  # whether the speed was raised, or lowered, along the session

    @property
    def warnings(self) -> list[str]:
        """What was found, as sentences."""
        if not self.share:
            return []
        speed = ", or torque that depends on the speed, which changed along the session," * self.with_speed
        return [
            f"torque_N_m: from the first step to the last the torque changes by {100.0 * self.share:+.1f} %, which "
            f"Eq. (2) does not have: a brake that warms up{speed} is likely; the numbers are those of the middle of "
            "the session, and the intervals of k hold its beginning and end"
        ]


def drift(found: Sequence[Measured], design: np.ndarray, gain: LinearFit) -> Drift:
    """Test whether the torques of single steps change along the session, beside Eq. (2); design (n, 4): of `gain`."""
    repeats = [len(measured.repeated_torques) for measured in found]
    torques = np.concatenate([measured.repeated_torques for measured in found])
    when = np.concatenate([measured.places for measured in found]) - 0.5
    rows = np.repeat(design, repeats, axis=0)
    speeds = np.repeat([measured.step.speed_rpm for measured in found], repeats)
    groups = np.unique(speeds, return_inverse=True)[1]
    both = np.column_stack([rows, when * (rows @ gain.coefficients)])
    variances = variance_by_group(both, torques, groups)
    fit = fit_linear(both, torques, 1.0 / variances[groups])
    share, half = float(fit.values[-1]), float(fit.half_widths[-1])
    freedom = len(torques) - both.shape[1]
    reach = stats.t.ppf(1.0 - CHANCE / 2.0, freedom) / stats.t.ppf(0.975, freedom)
    if abs(share) <= max(reach * half, SMALLEST):
        return Drift()
    with_speed = len(variances) > 1 and abs(stats.spearmanr(when, speeds).statistic) > WITH_SPEED
    return Drift(share, bool(with_speed))


def without_drift(found: Sequence[Measured], share: float) -> list[Measured]:
    """The steps with the torques that they would have had in the middle of the session."""
    return [
        measured._replace(
            steady_torque=measured.steady_torque / (1.0 + share * (float(np.mean(measured.places)) - 0.5)),
            repeated_torques=[
                torque / (1.0 + share * (place - 0.5))
                for torque, place in zip(measured.repeated_torques, measured.places, strict=True)
            ],
        )
        for measured in found
    ]
