"""Figs. 6 to 8 of the paper from measured steps: torque gain, time constants, and the surfaces fitted to them."""

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from experiments.analysis.sheet import (
    BLUE,
    MIDDLE,
    ORANGE,
    PAGE_IN,
    QUIET,
    STYLE,
    TEXT,
    figure_bytes,
    heading,
    plain,
    plain_3d,
    sheet,
    title,
)
from experiments.atomic_files import refuse_existing_files
from experiments.identify.fit import surface_row, torque_change
from experiments.identify.identification import Identification
from experiments.numbers import significant

FORMS = ("png", "pdf")
FITTED, MEASURED = BLUE, ORANGE
SHADES = "viridis"
DIRECTION_WORDS = {"rise": "rising", "fall": "falling"}
#: Steps whose torque changes by less than this share of the largest change are drawn small: ripple blurs them.
CLEAR_CHANGE = 0.25


def draw_identification(found: Identification, folder: Path) -> dict[Path, bytes]:
    """The figures as files of a folder, not yet written; InputError if one exists."""
    drawn = {"fig06_torque_gain": draw_torque_gain(found)}
    for direction in () if found.one_speed else found.constants:  # at one speed there is no surface
        words = DIRECTION_WORDS[direction]
        drawn[f"fig07_{words}_time_constant"] = draw_time_constants(found, direction)
        drawn[f"fig08_{words}_time_constant_fit"] = draw_surface(found, direction)
    files = {folder / f"{name}.{form}": (figure, form) for name, figure in drawn.items() for form in FORMS}
    refuse_existing_files(files)
    return {path: figure_bytes(figure, form) for path, (figure, form) in files.items()}


@matplotlib.rc_context(STYLE)
def draw_torque_gain(found: Identification) -> Figure:
    """Fig. 6: steady torque of each averaged step, its mean at each current, and Eq. (2); residuals below."""
    numbers = ", ".join(
        f"{row.name} {significant(row.value, 4)} ± {significant(row.half_width or 0.0, 1)}"
        for row in found.parameters()[:5]
    )
    text = f"{_origin(found)} {numbers} (half-widths of 95 % intervals)."
    figure, [[top], [below]] = sheet(
        text, (PAGE_IN, 5.4), (0.7, 0.2, 0.5, 0.4), (2, 1), (0.0, 0.2), height_ratios=(2.8, 1), sharex=True
    )
    plain(top)
    plain(below)
    title(top, "Torque gain")
    current = np.array([measured.step.current_to for measured in found.measured])
    torque = np.array([measured.steady_torque for measured in found.measured])
    _, slowness = np.unique([measured.step.speed_rpm for measured in found.measured], return_inverse=True)
    side = 0.006 * found.current_max  # steps at one current side by side, slowest to the left
    beside = current + side * (slowness - slowness.max() / 2)
    shade = np.log2([measured.step.speed_rpm for measured in found.measured])
    dots: dict[str, Any] = {"s": 11, "c": shade, "cmap": SHADES, "linewidths": 0, "zorder": 3}
    square: dict[str, Any] = {"ms": 9, "mfc": "none", "mec": TEXT}
    line = np.linspace(0.0, found.current_max, 300)
    top.plot(line, [found.gain.at(i) for i in line.tolist()], color=FITTED, label="Eq. (2)")
    top.scatter(beside, torque, **dots)
    for value in np.unique(current):
        top.plot(value, torque[current == value].mean(), "s", mew=1.0, zorder=4, **square)
    top.plot([], [], "s", label="mean at that current", **square)
    top.plot([], [], "o", ms=4, color=QUIET, mew=0, label="one averaged step, dark: slow, light: fast")
    top.legend(frameon=False, loc="upper left", fontsize=MIDDLE)
    top.set(ylabel="Steady torque (N m)", ylim=(min(0.0, torque.min()), None))
    below.axhline(0.0, color=FITTED, linewidth=1.0)
    below.scatter(beside, found.gain.fit.residuals, **dots)
    below.set(xlabel="Current (A)", ylabel="Residual (N m)")
    return figure


@matplotlib.rc_context(STYLE)
def draw_time_constants(found: Identification, direction: str) -> Figure:
    """Fig. 7: time constants of one direction over current stepped to and speed, as measured."""
    aside = [measured for measured in found.set_aside if measured.direction == direction]
    more = f" Not drawn: {len(aside)} without a clear transient." if aside else ""
    text = f"Dots: time constants of averaged steps, Eq. (3).{more}"
    figure, axes, points, currents, logs = _surface_figure(found, direction, "measured", text)
    x, y = np.meshgrid(currents, logs)
    z = np.array([[points.get((c, w), math.nan) for c in currents] for w in logs])  # a hole where nothing is known
    axes.plot_surface(
        x, y, z, rstride=1, cstride=1, cmap=SHADES, vmin=0.0, vmax=np.nanmax(z), alpha=0.75,
        edgecolor="white", linewidth=0.5, zorder=1,
    )  # fmt: skip
    axes.scatter(x, y, z, s=12, color=TEXT, depthshade=False, zorder=2)
    return figure


@matplotlib.rc_context(STYLE)
def draw_surface(found: Identification, direction: str) -> Figure:
    """Fig. 8: Eq. (4) as fitted to one direction, with the measured time constants."""
    fits = found.constants[direction]
    assert fits.surface is not None
    rms = np.sqrt(np.mean(np.concatenate([fits.surface.residuals, fits.average.residuals]) ** 2)) * 1e3
    half_ms = significant(fits.average.half_widths[0] * 1e3, 1)
    interval = f" ± {half_ms} ms (95 %)" if found.transients.exponential else " ms"
    text = (
        f"a_avg {significant(fits.average.values[0] * 1e3, 4)}{interval} from omega_0 = {found.omega_0_rpm:g} rpm "
        "on. Dots: measured, with their distance from the fit, small where the torque changes little; "
        f"rms residual {significant(rms, 2)} ms."
    )
    figure, axes, _, currents, logs = _surface_figure(found, direction, "Eq. (4)", text)
    every = [*fits.at_surface, *fits.at_average]
    edge = math.log2(found.omega_0_rpm)
    i = np.linspace(currents[0], currents[-1], 11)
    slow, fast = np.linspace(logs[0], edge, 21), np.linspace(edge, max(logs[-1], edge), 7)
    below = np.array([[np.dot(surface_row(c, 2.0**w), fits.surface.coefficients) for c in i] for w in slow]) * 1e3
    above = np.full((len(fast), len(i)), fits.average.values[0] * 1e3)
    top = max(below.max(), above.max())
    for w, z in ((slow, below), (fast, above)):
        x, y = np.meshgrid(i, w)
        axes.plot_surface(
            x, y, z, cmap=SHADES, vmin=0.0, vmax=top, alpha=0.75, rcount=30, ccount=30,
            edgecolor="white", linewidth=0.3, zorder=1,
        )  # fmt: skip
    changes = [abs(torque_change(measured.step, found.gain)) for measured in every]
    fitted = [*fits.surface.fitted, *fits.average.fitted]
    for measured, change, value in zip(every, changes, fitted, strict=True):
        size = 8 if change < CLEAR_CHANGE * max(changes) else 16
        at, speed, ms = measured.step.current_to, math.log2(measured.step.speed_rpm), measured.time_constant * 1e3
        axes.plot([at, at], [speed, speed], [value * 1e3, ms], color=MEASURED, linewidth=1.0, zorder=2)
        axes.scatter(at, speed, ms, s=size, color=MEASURED, depthshade=False, zorder=3)
    return figure


def _surface_figure(
    found: Identification, direction: str, words: str, text: str
) -> tuple[Figure, Any, dict[tuple[float, float], float], list[float], list[float]]:
    """A figure with three axes: current (A), log2 of the speed labelled in rpm, time constant (ms).

    Returns figure, axes, mean time constants by (current, log2 of speed), the currents and the logs of the speeds.
    """
    projection = {"projection": "3d", "computed_zorder": False}  # dots over surfaces, also those just below
    size, margins = (PAGE_IN, 5.6), (0.2, 0.2, 0.0, 0.1)
    figure, [[axes]] = sheet(f"{_origin(found)} {text}", size, margins, subplot_kw=projection)
    axes.set_box_aspect((4, 4, 3), zoom=0.92)
    fits = found.constants[direction]
    groups: dict[tuple[float, float], list[float]] = {}
    for measured in (*fits.at_surface, *fits.at_average):
        place = measured.step.current_to, math.log2(measured.step.speed_rpm)
        groups.setdefault(place, []).append(1e3 * measured.time_constant)
    points = {place: float(np.mean(values)) for place, values in sorted(groups.items())}
    currents, logs = (sorted(set(values)) for values in zip(*points, strict=True))
    axes.set(xlabel="Current stepped to (A)", zlabel="Time constant (ms)", xticks=currents)
    axes.set_ylabel("Speed (rpm)", labelpad=6)
    axes.set_yticks(logs, [f"{2.0**w:g}" for w in logs])
    axes.set_zlim(0.0, 1.05 * max(points.values()))
    axes.tick_params(labelsize=8)
    plain_3d(axes)
    heading(figure, f"Time constant, {DIRECTION_WORDS[direction]} current, {words}")
    return figure, axes, points, currents, logs


def _origin(found: Identification) -> str:
    """Where the numbers come from, a sentence."""
    return f"{found.source}: {found.steps} steps averaged to {len(found.measured)}."
