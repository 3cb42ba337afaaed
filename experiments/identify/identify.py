"""`phd identify`: from measured current steps to a brake file, with intervals, residuals and Figs. 6 to 8.

The file's provenance names what was identified, what was given by hand, and what the steps do not show and is assumed:
the largest current, the knee, the backlash, the floor (a quarter of the lowest measured speed: our choice, the paper
sets none), and omega_0 where no two measured speeds lie in the flat part of Eq. (4). A device with such a brake is
shown as assumed. Numbers that are hardly in the units of their columns are taken as they are, with a warning.
"""

import contextlib
import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from core.device_file import BrakeFile, parse_brake
from core.files import InputError, StrangeInput
from experiments.atomic_files import refuse_existing_files, write_new_files
from experiments.identify.fit import A_NAMES, K_NAMES
from experiments.identify.identification import GIVEN, IDENTIFIED, ByHand, Identification, identify_steps
from experiments.identify.step_response import read_steps
from experiments.progress import Progress, no_progress

#: Our choice: Eq. (4) is extrapolated below the lowest measured speed by this factor, then held.
BELOW_MEASURED = 0.25
DIGITS = 6  # significant, of the numbers in the file
BACKLASH_DEG = 0.75  # assumed where none is given


def identify(
    steps_path: Path,
    out: Path | None,
    name: str | None,
    figures: Path | None,
    given: ByHand,
    progress: Progress = no_progress,
) -> tuple[Identification, BrakeFile, list[Path]]:
    """Read the steps, fit, and write the brake file (out) and the figures (a folder), both or neither.

    Returns the fit, the brake and the files of the figures.
    InputError, and nothing written, if a file exists already or the steps do not determine a number.
    """
    if out is not None:
        refuse_existing_files([out])
        if not out.absolute().parent.is_dir():
            raise InputError(f"{out}: cannot be created (its folder does not exist)")
    steps = read_steps(steps_path)
    progress(0.4)
    found = identify_steps(steps, steps_path.name, given)
    text = brake_text(found, (out or steps_path).stem if name is None else name)
    progress(0.6)
    drawn: dict[Path, bytes] = {}
    if figures is not None:
        from experiments.identify.figures import draw_identification  # matplotlib takes a second to load

        drawn = draw_identification(found, figures)
    write_new_files({**drawn, out: text.encode()} if out else drawn)
    return found, _brake(text, str(out or steps_path)), list(drawn)


def _brake(text: str, where: str) -> BrakeFile:
    """Parse a brake file that was just made, without warnings: `Identification.doubtful` has them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StrangeInput)
        return parse_brake(text, where)


def brake_text(found: Identification, name: str) -> str:
    """The brake file, which `core.device_file` reads; InputError where the fit is no brake that can exist."""
    lowest = min(measured.step.speed_rpm for measured in found.measured)
    text = _brake_text(found, name, lowest * BELOW_MEASURED)
    with contextlib.suppress(InputError):
        _brake(text, found.source)
        return text
    text = _brake_text(found, name, lowest)  # extrapolated, a time constant may turn negative
    try:
        _brake(text, f"{found.source}: the fit is no brake that can exist: the brake file")
    except InputError as error:
        raise InputError("; ".join([str(error), *found.doubtful.values()])) from None
    return text


def _brake_text(found: Identification, name: str, floor_rpm: float) -> str:
    rows = {row.name: row for row in found.parameters()}
    value = {key: float(f"{row.value:.{DIGITS}g}") for key, row in rows.items()}
    k1, k2, k3, k4 = (value[key] for key in K_NAMES[:4])
    knee = found.gain.knee
    value["k_5"] = round(k1 * knee + k2 - (k3 * knee + k4) * knee, 9)  # continuous, as rounded
    given = found.keys(GIVEN)
    source = {"omega_0_rpm": "identified: where the time constants scatter least"}
    source |= dict.fromkeys(given, GIVEN) | {key: f"assumed: {why}" for key, why in found.assumed.items()}
    provenance = f"identified from {found.source}: {', '.join(found.keys(IDENTIFIED))}"
    provenance += f"; given: {', '.join(given)}" if given else ""
    provenance += f"; assumed: {', '.join(found.assumed)}" if found.assumed else ""
    if found.doubtful:
        provenance += f"; doubtful units: {', '.join(found.doubtful)}"

    def line(key: str) -> str:
        number = f"{value[key]!r},"
        why = {"k_5": ": K is continuous at the knee", "k_2": with_zero(found)}.get(key, "")
        return f"    {number:16}# {key.partition('.')[2] or key} {rows[key].spread}{why}"

    def number(key: str, value: float) -> str:
        return f"{key} = {value!r}".ljust(24) + f"# {source[key]}"

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
        number("knee_A", knee),
        number("omega_0_rpm", found.omega_0_rpm),
        number("floor_rpm", floor_rpm),
        number("backlash_deg", BACKLASH_DEG if found.backlash_deg is None else float(found.backlash_deg)),
    ]
    for direction, constants in found.constants.items():
        average = f"{direction}.a_avg"
        below = [f"    0.0, 0.0, 0.0, 0.0, 0.0, {value[average]!r},    # not seen: a_avg at every speed"]
        lines += [
            "",
            f"[{direction}]                  # Eq. (4), s",
            f"a_avg_s = {value[average]!r}".ljust(24) + f"# {rows[average].spread}",
            "a = [",
            *(below if constants.surface is None else (line(f"{direction}.{key}") for key in A_NAMES)),
            "]",
        ]
    return "\n".join(lines) + "\n"


def with_zero(found: Identification) -> str:
    """The part of k_2 that is not the brake's drag, as the end of a remark."""
    return ", with the sensor's zero, which steps one way alone do not show" if found.zero is None else ""


def summary_of_fit(found: Identification) -> dict[str, Any]:
    """The identification as JSON holds it: numbers with intervals, omega_0, what is assumed, residuals by step."""
    residual = {
        measured.step.key: float(r)
        for fits in found.constants.values()
        for part, fit in ((fits.at_average, fits.average), (fits.at_surface, fits.surface))
        if fit is not None
        for measured, r in zip(part, fit.residuals, strict=True)
    }  # of its time constant, s
    used = np.array([residual[measured.step.key] for measured in found.measured if measured.step.key in residual])
    return {
        "source": found.source,
        "steps": found.steps,
        "averaged_steps": len(found.measured),
        "parameters": [
            row._asdict() | dict(zip(("low", "high"), row.interval or (None, None), strict=True))
            for row in found.parameters()
        ],
        "dead_time_s": found.transients.dead_s,
        "follows_eq_3": found.transients.exponential,
        "drift_share": found.drift.share,
        "sensor_zero_N_m": found.zero._asdict() if found.zero else None,
        "omega_0_rpm": found.omega_0_rpm,
        "omega_0_by": found.omega_0_by,
        "identified": found.keys(IDENTIFIED),
        "given": found.keys(GIVEN),
        "assumed": found.assumed,
        "warnings": found.warnings,
        "scatter_by_omega_0": [{"omega_0_rpm": key, "scatter": value} for key, value in found.scatter.items()],
        "torque_residual_rms_N_m": float(np.sqrt(np.mean(found.gain.fit.residuals**2))),
        "time_constant_residual_rms_s": float(np.sqrt(np.mean(used**2))),
        "set_aside": [str(measured.step) for measured in found.set_aside],
        "residuals": [
            {
                "current_from_A": measured.step.current_from,
                "current_to_A": measured.step.current_to,
                "speed_rpm": measured.step.speed_rpm,
                "repeats": measured.step.repeats,
                "torque_N_m": measured.steady_torque,
                "torque_residual_N_m": float(torque_residual),
                "time_constant_s": None if math.isnan(measured.time_constant) else measured.time_constant,
                "time_constant_residual_s": residual.get(measured.step.key),
            }
            for measured, torque_residual in zip(found.measured, found.gain.fit.residuals, strict=True)
        ],
    }
