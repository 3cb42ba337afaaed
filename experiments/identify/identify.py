"""`phd identify`: from measured current steps to a brake file, with intervals, residuals and Figs. 6 to 8.

What the steps do not show is called assumed in the file: the largest current, the knee, the backlash, the floor (a
quarter of the lowest measured speed: our choice, the paper sets none), and omega_0 where no two measured speeds lie in
the flat part of Eq. (4). Numbers that are hardly in the units of their columns are taken as they are, with a warning.
"""

import contextlib
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core.brake_file import BrakeFile, parse_brake
from core.errors import InputError
from experiments.identify.fit import (
    A_NAMES,
    K_NAMES,
    KNEE_A,
    TimeConstants,
    choose_omega_0,
    fit_time_constants,
    fit_torque_gain,
    scatter_by_omega_0,
)
from experiments.identify.least_squares import LinearFit
from experiments.identify.step_response import FALL, RISE, Measured, measure
from experiments.identify.steps import Step, read_steps
from experiments.identify.units import doubtful_units
from experiments.recording.atomic_files import give_new_name, written_beside

#: Our choice: Eq. (4) is extrapolated below the lowest measured speed by this factor, then held.
BELOW_MEASURED = 0.25
DIGITS = 6  # significant, of the numbers in the file
BACKLASH_DEG = 0.75  # assumed where none is given


class Parameter(NamedTuple):
    """One number with its 95 % interval, value -+ half_width."""

    name: str
    value: float
    half_width: float
    unit: str


@dataclass(frozen=True)
class Identification:
    """A brake as its steps tell it."""

    source: str  # the file's name
    steps: int
    measured: list[Measured]  # averaged steps
    gain: LinearFit
    constants: dict[str, TimeConstants]  # by direction
    omega_0_rpm: float
    scatter: dict[float, float]  # omega_0 (rpm) -> scatter relative to the least; empty where it was given

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
        return "assumed: the highest measured speed, no faster step shows where the time constants level off"

    @property
    def doubtful(self) -> dict[str, str]:
        """Column of the steps -> why its numbers are hardly in its unit."""
        return doubtful_units(self.measured, self.omega_0_rpm if self.scatter and self.flat_part_seen else None)

    @property
    def warnings(self) -> list[str]:
        """What whoever reads the numbers must know."""
        unseen = [f"omega_0_rpm = {self.omega_0_rpm:g} is {self.omega_0_by}"]
        return [*self.doubtful.values(), *([] if self.flat_part_seen or not self.scatter else unseen)]

    def assumed(self, backlash_deg: float | None) -> dict[str, str]:
        """Key of the brake file -> why, for each number that the steps do not show. backlash_deg: None: not given."""
        assumed = {
            "current_max_A": "the largest that was measured",
            "knee_A": "as in the paper",
            "floor_rpm": "Eq. (4) is held below",
        }
        if self.scatter and not self.flat_part_seen:
            assumed["omega_0_rpm"] = "the highest measured speed, no faster step shows where time constants level off"
        if backlash_deg is None:
            assumed["backlash_deg"] = "steps do not show it"
        return assumed

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
        k_units = ("N m/A", "N m", "N m/A^2", "N m/A", "N m")
        a_units = ("s/A", "s", "s/A", "s", "s/A", "s")
        rows = [_rows(K_NAMES, self.gain, k_units)]
        for direction, fits in self.constants.items():
            rows.append(_rows([f"{direction}.a_avg"], fits.average, ["s"]))
            rows.append(_rows([f"{direction}.{name}" for name in A_NAMES], fits.surface, a_units))
        return [row for part in rows for row in part]

    def residuals(self) -> dict[tuple[float, float, float], tuple[float, float | None]]:
        """Step -> residual of its steady torque (N m), and of its time constant (s), None where there is none."""
        torque = {one.step.key: float(r) for one, r in zip(self.measured, self.gain.residuals, strict=True)}
        constant: dict[tuple[float, float, float], float] = {}
        for fits in self.constants.values():
            for part, fit in ((fits.at_average, fits.average), (fits.at_surface, fits.surface)):
                constant |= {one.step.key: float(r) for one, r in zip(part, fit.residuals, strict=True)}
        return {key: (torque[key], constant.get(key)) for key in torque}


def identify_steps(steps: Iterable[Step], source: str, omega_0_rpm: float | None = None) -> Identification:
    """Fit Eqs. (2), (3) and (4); omega_0 by least squares over the measured speeds unless it is given.

    InputError where the steps cannot tell a number, with which and why.
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
    return Identification(source, len(steps), measured, gain, constants, omega_0, scatter)


def brake_text(found: Identification, name: str, backlash_deg: float | None = None) -> str:
    """The brake file, which `core.brake_file` reads; InputError where the fit is no brake that can exist."""
    lowest = min(one.step.speed_rpm for one in found.measured)
    text = _brake_text(found, name, backlash_deg, lowest * BELOW_MEASURED)
    with contextlib.suppress(InputError):
        parse_brake(text, found.source)
        return text
    text = _brake_text(found, name, backlash_deg, lowest)  # extrapolated, a time constant may turn negative
    try:
        parse_brake(text, f"{found.source}: the fit is no brake that can exist: the brake file")
    except InputError as error:
        raise InputError("; ".join([str(error), *found.doubtful.values()])) from None
    return text


def identify(
    steps_path: Path,
    out: Path,
    name: str | None = None,
    figures: Path | None = None,
    omega_0_rpm: float | None = None,
    backlash_deg: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Identification, BrakeFile, list[Path]]:
    """Read the steps, fit, and write the brake file and, into a folder, the figures; all or nothing.

    InputError, and nothing written, if a file exists already or the steps cannot tell a number.
    """
    if out.exists():
        raise InputError(f"{out}: exists already and is never overwritten")
    if not out.absolute().parent.is_dir():
        raise InputError(f"{out}: cannot be created (its folder does not exist)")
    steps = read_steps(steps_path)
    progress(0.4)
    found = identify_steps(steps, steps_path.name, omega_0_rpm)
    text = brake_text(found, out.stem if name is None else name, backlash_deg)
    progress(0.6)
    drawn: dict[Path, bytes] = {}
    if figures is not None:
        from experiments.identify.figures import draw_identification  # matplotlib takes a second to load

        drawn = draw_identification(found, figures)
    written = []
    try:
        with written_beside(out, text.encode()) as partial:
            for path, data in drawn.items():
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("xb") as file:
                    written.append(path)
                    file.write(data)
            give_new_name(partial, out)
    except BaseException as error:
        for path in written:
            path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            place = error.filename or out
            raise InputError(f"{place}: cannot be written ({(error.strerror or str(error)).lower()})") from None
        raise
    return found, parse_brake(text, str(out)), written


def summary(found: Identification, backlash_deg: float | None = None) -> dict[str, Any]:
    """Everything there is to say, for JSON: numbers with intervals, omega_0, what is assumed, residuals by step."""
    residuals = found.residuals()
    constants = np.array([r for _, r in residuals.values() if r is not None])
    return {
        "source": found.source,
        "steps": found.steps,
        "averaged_steps": len(found.measured),
        "parameters": [
            row._asdict() | {"low": row.value - row.half_width, "high": row.value + row.half_width}
            for row in found.parameters()
        ],
        "omega_0_rpm": found.omega_0_rpm,
        "omega_0_by": found.omega_0_by,
        "assumed": found.assumed(backlash_deg),
        "warnings": found.warnings,
        "scatter_by_omega_0": [{"omega_0_rpm": key, "scatter": value} for key, value in found.scatter.items()],
        "torque_residual_rms_N_m": float(np.sqrt(np.mean(found.gain.residuals**2))),
        "time_constant_residual_rms_s": float(np.sqrt(np.mean(constants**2))),
        "set_aside": [str(one.step) for one in found.set_aside],
        "residuals": [
            {
                "current_from_A": one.step.current_from,
                "current_to_A": one.step.current_to,
                "speed_rpm": one.step.speed_rpm,
                "repeats": one.step.repeats,
                "torque_N_m": one.steady_torque,
                "torque_residual_N_m": residuals[one.step.key][0],
                "time_constant_s": None if math.isnan(one.time_constant) else one.time_constant,
                "time_constant_residual_s": residuals[one.step.key][1],
            }
            for one in found.measured
        ],
    }


def _rows(names: Iterable[str], fit: LinearFit, units: Iterable[str]) -> list[Parameter]:
    return [
        Parameter(name, float(value), float(half), unit)
        for name, value, half, unit in zip(names, fit.values, fit.half_widths, units, strict=True)
    ]


def _brake_text(found: Identification, name: str, backlash_deg: float | None, floor_rpm: float) -> str:
    rows = {row.name: row for row in found.parameters()}
    value = {key: float(f"{row.value:.{DIGITS}g}") for key, row in rows.items()}
    k1, k2, k3, k4 = (value[key] for key in K_NAMES[:4])
    value["k_5"] = round(k1 * KNEE_A + k2 - (k3 * KNEE_A + k4) * KNEE_A, 9)  # continuous, as rounded

    def line(key: str) -> str:
        number = f"{value[key]!r},"
        return f"    {number:16}# {key.partition('.')[2] or key} +- {rows[key].half_width:.2g} {rows[key].unit}"

    assumed = found.assumed(backlash_deg)
    how = {"backlash_deg": "given"}
    how["omega_0_rpm"] = "where the time constants scatter least" if found.scatter else "given"
    how |= {key: f"assumed: {why}" for key, why in assumed.items()}
    provenance = f"identified from {found.source}; assumed: {', '.join(assumed)}"
    if found.doubtful:
        provenance += f"; doubtful units: {', '.join(found.doubtful)}"

    def number(key: str, value: float) -> str:
        return f"{key} = {value!r}".ljust(24) + f"# {how[key]}"

    lines = [
        "# Fitted by phd identify: value +- half-width of its 95 % interval.",
        f"# {found.steps} current steps, repeats averaged to {len(found.measured)}.",
        *(f"# Warning: {warning}" for warning in found.warnings),
        f"name = {json.dumps(name, ensure_ascii=False)}",
        f"provenance = {json.dumps(provenance, ensure_ascii=False)}",
        number("current_max_A", found.current_max),
        "k = [                   # Eq. (2), N m",
        *map(line, K_NAMES),
        "]",
        number("knee_A", KNEE_A),
        number("omega_0_rpm", found.omega_0_rpm),
        number("floor_rpm", floor_rpm),
        number("backlash_deg", BACKLASH_DEG if backlash_deg is None else float(backlash_deg)),
    ]
    for direction in found.constants:
        lines += ["", f"[{direction}]                  # Eq. (4), s", f"a_avg_s = {value[f'{direction}.a_avg']!r}"]
        lines[-1] = f"{lines[-1]:24}# +- {rows[f'{direction}.a_avg'].half_width:.2g} s"
        lines += ["a = [", *(line(f"{direction}.{key}") for key in A_NAMES), "]"]
    return "\n".join(lines) + "\n"
