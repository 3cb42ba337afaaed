"""Fits of Eq. (2), the torque gain, and Eq. (4), the time constants, to measured steps.

InputError where the steps do not determine a number: the sentence names it, and what was measured.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from core.files import InputError
from experiments.identify.linear import (
    Array,
    LinearFit,
    fit_linear,
    undetermined,
    variance_by_group,
    weights_with_ripple,
)
from experiments.identify.step_response import FALL, REACH, RISE, Measured, Step

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
    open_at = {omega_0: _open_numbers(found, omega_0) for omega_0 in speeds}
    best = min(speeds, key=open_at.__getitem__)
    if open_at[best]:
        fit_time_constants(found, gain, best, where)  # refuses
    usable = [m for m in found if not math.isnan(m.time_constant)]
    trust = np.array([abs(torque_change(m.step, gain)) / math.sqrt(m.typical) for m in usable])
    values = np.array([m.time_constant for m in usable]) * trust
    all_speeds = np.array([m.step.speed_rpm for m in usable])
    _, groups, counts = np.unique(all_speeds, return_inverse=True, return_counts=True)
    rising = np.array([[m.step.rising] for m in usable])
    surface = np.array([[0.0, *surface_row(m.step.current_to, m.step.speed_rpm)] for m in usable])
    scatter = {}
    for omega_0 in (speed for speed in speeds if not open_at[speed]):
        rows = np.where(all_speeds[:, None] >= omega_0, [1.0, *[0.0] * 6], surface)  # times (a_avg, a_1 .. a_6)
        design = np.hstack([np.where(rising, rows, 0.0), np.where(rising, 0.0, rows)]) * trust[:, None]
        variance = variance_by_group(design, values, groups) + PERFECT**2 * float(np.median(values**2))
        scatter[omega_0] = math.exp(0.5 * float(np.average(np.log(variance), weights=counts)))
    least = min(scatter.values())
    return {omega_0: value / least for omega_0, value in scatter.items()}


def _open_numbers(found: Sequence[Measured], omega_0: float) -> int:
    """How many numbers of Eq. (4) the steps leave open with this omega_0 (rpm), of the first side that lacks any."""
    sides = [_sides(found, direction, omega_0) for direction in (RISE, FALL)]
    return sum(len(fast.open or slow.open) for fast, slow in sides)


def choose_omega_0(scatter: dict[float, float]) -> float:
    """omega_0 (rpm) by `scatter_by_omega_0`, least squares over the speeds; the paper chose it by eye, from Fig. 7."""
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
