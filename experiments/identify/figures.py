"""Figs. 6 to 8 of the paper from measured steps: torque gain, time constants, and the surfaces fitted to them."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from experiments.analysis.sheet import LINE, QUIET, STYLE, TEXT, figure_bytes, new_figure
from experiments.identify.fit import gain_row, surface_row, torque_change
from experiments.identify.identification import Identification
from experiments.identify.step_response import Measured
from experiments.recording.atomic_files import refuse_existing_files

FORMS = ("png", "pdf")
FITTED, MEASURED = "#2f7fc4", "#d98200"
SHADES = "viridis"
CAPTION_SIZE = 7.0
DIRECTION_WORDS = {"rise": "rising", "fall": "falling"}
#: Steps whose torque changes by less than this share of the largest change are drawn small: ripple blurs them.
CLEAR_CHANGE = 0.25


def draw_identification(found: Identification, folder: Path) -> dict[Path, bytes]:
    """The figures as files of a folder, not yet written; InputError if one exists."""
    drawn: dict[str, Figure] = {}
    with matplotlib.rc_context(STYLE):
        drawn["fig06_torque_gain"] = draw_torque_gain(found)
        for direction in found.constants:
            words = DIRECTION_WORDS[direction]
            drawn[f"fig07_{words}_time_constant"] = draw_time_constants(found, direction)
            drawn[f"fig08_{words}_time_constant_fit"] = draw_surface(found, direction)
    paths = {name: [folder / f"{name}.{form}" for form in FORMS] for name in drawn}
    refuse_existing_files(path for group in paths.values() for path in group)
    return {
        path: figure_bytes(figure, form)
        for name, figure in drawn.items()
        for path, form in zip(paths[name], FORMS, strict=True)
    }


def draw_torque_gain(found: Identification) -> Figure:
    """Fig. 6: steady torque of each averaged step, its mean at each current, and Eq. (2); residuals below."""
    figure = new_figure(5.4, 5.0)
    top = figure.add_axes((0.14, 0.45, 0.82, 0.47))
    below = figure.add_axes((0.14, 0.23, 0.82, 0.17), sharex=top)
    current = np.array([one.step.current_to for one in found.measured])
    torque = np.array([one.steady_torque for one in found.measured])
    shade = _speed_shades(found.measured)
    side = 0.006 * found.current_max  # steps at one current side by side, slowest to the left
    places = sorted({one.step.speed_rpm for one in found.measured})
    shift = np.array([side * (places.index(one.step.speed_rpm) - (len(places) - 1) / 2) for one in found.measured])
    line = np.linspace(0.0, found.current_max, 300)
    top.plot(line, [np.dot(gain_row(i), found.gain.coefficients) for i in line], color=FITTED, label="Eq. (2)")
    top.scatter(current + shift, torque, s=11, c=shade, cmap=SHADES, linewidths=0, zorder=3)
    for value in sorted(set(current)):
        top.plot(value, torque[current == value].mean(), "s", ms=9, mfc="none", mec=TEXT, mew=1.0, zorder=4)
    top.plot([], [], "s", ms=9, mfc="none", mec=TEXT, label="mean at that current")
    top.plot([], [], "o", ms=4, color=QUIET, mew=0, label="one averaged step, dark: slow, light: fast")
    top.legend(frameon=False, loc="upper left", fontsize=8)
    top.set_ylabel("Steady torque (N m)")
    top.set_ylim(bottom=min(0.0, torque.min()))
    top.tick_params(labelbottom=False)
    below.axhline(0.0, color=FITTED, linewidth=1.0)
    below.scatter(current + shift, found.gain.residuals, s=11, c=shade, cmap=SHADES, linewidths=0, zorder=3)
    below.set_ylabel("Residual (N m)")
    below.set_xlabel("Current (A)")
    for axes in (top, below):
        axes.grid(color=LINE, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    each = zip(found.gain.values, found.gain.half_widths, strict=True)
    words = [f"$k_{i}$ {value:.4g} ± {half:.1g}" for i, (value, half) in enumerate(each, 1)]
    lines = [
        "   ".join(words[:3]),
        "   ".join(words[3:]) + " (half-widths of 95 % intervals)",
        _origin(found),
    ]
    _title(figure, "Torque gain", 0.14)
    _caption(figure, lines, 0.14)
    return figure


def draw_time_constants(found: Identification, direction: str) -> Figure:
    """Fig. 7: time constants of one direction over current stepped to and speed, as measured."""
    figure, axes = _room(found, direction, f"Time constant, {DIRECTION_WORDS[direction]} current, measured")
    points = _grid_means(_with_constant(found, direction))
    currents, logs = (sorted(set(values)) for values in zip(*points, strict=True))
    x, y = np.meshgrid(currents, logs)
    z = np.array([[points.get((c, w), math.nan) for c in currents] for w in logs])  # a hole where nothing is known
    axes.plot_surface(
        x, y, z, rstride=1, cstride=1, cmap=SHADES, vmin=0.0, vmax=np.nanmax(z), alpha=0.75,
        edgecolor="white", linewidth=0.5, zorder=1,
    )  # fmt: skip
    axes.scatter(x, y, z, s=12, color=TEXT, depthshade=False, zorder=2)
    aside = [one for one in found.set_aside if one.direction == direction]
    more = f" Not drawn: {len(aside)} without a clear transient." if aside else ""
    _caption(figure, [f"Dots: time constants of averaged steps, Eq. (3).{more}", _origin(found)], 0.06)
    return figure


def draw_surface(found: Identification, direction: str) -> Figure:
    """Fig. 8: Eq. (4) as fitted to one direction, with the measured time constants."""
    figure, axes = _room(found, direction, f"Time constant, {DIRECTION_WORDS[direction]} current, Eq. (4)")
    fits = found.constants[direction]
    edge = math.log2(found.omega_0_rpm)
    every = _with_constant(found, direction)
    currents = sorted({one.step.current_to for one in every})
    logs = sorted({math.log2(one.step.speed_rpm) for one in every})
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
    changes = {one.step.key: abs(torque_change(one.step, found.gain)) for one in every}
    clear = CLEAR_CHANGE * max(changes.values())
    fitted = [*fits.surface.fitted, *fits.average.fitted]
    for one, value in zip(every, fitted, strict=True):
        small = changes[one.step.key] < clear
        x, y, z = one.step.current_to, math.log2(one.step.speed_rpm), one.time_constant * 1e3
        axes.plot([x, x], [y, y], [value * 1e3, z], color=MEASURED, linewidth=1.0, zorder=2)
        axes.scatter(x, y, z, s=8 if small else 16, color=MEASURED, depthshade=False, zorder=3)
    rms = np.sqrt(np.mean(np.concatenate([fits.surface.residuals, fits.average.residuals]) ** 2)) * 1e3
    average = f"{fits.average.values[0] * 1e3:.4g} ± {fits.average.half_widths[0] * 1e3:.1g} ms"
    text = (
        f"$a_{{avg}}$ {average} (95 %) from $ω_0$ = {found.omega_0_rpm:g} rpm on. Dots: measured, with their distance "
        f"from the fit, small where the torque changes little; rms residual {rms:.2g} ms."
    )
    _caption(figure, [*textwrap.wrap(text, 88), _origin(found)], 0.06)
    return figure


def _room(found: Identification, direction: str, title: str):
    """A figure with three axes: current (A), log2 of the speed shown as rpm, time constant (ms); alike in 7 and 8."""
    import mpl_toolkits.mplot3d  # noqa: F401  (makes the projection known)

    figure = new_figure(5.4, 4.9)
    with matplotlib.rc_context({"grid.color": LINE, "grid.linewidth": 0.6}):
        axes = figure.add_axes((0.05, 0.11, 0.92, 0.88), projection="3d")
    axes.computed_zorder = False  # dots over surfaces, also those just below
    axes.set_box_aspect((4, 4, 3), zoom=0.92)
    every = _with_constant(found, direction)
    logs = sorted({math.log2(one.step.speed_rpm) for one in every})
    axes.set_xlabel("Current stepped to (A)")
    axes.set_ylabel("Speed (rpm)", labelpad=6)
    axes.set_zlabel("Time constant (ms)")
    axes.set_yticks(logs, [f"{2.0**w:g}" for w in logs])
    axes.set_xticks(sorted({one.step.current_to for one in every}))
    axes.set_zlim(0.0, 1.05e3 * max(_grid_means(every, 1.0).values()))
    axes.view_init(elev=24, azim=35)
    axes.tick_params(labelsize=8)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor(LINE)
    _title(figure, title, 0.06)
    return figure, axes


def _with_constant(found: Identification, direction: str) -> list[Measured]:
    fits = found.constants[direction]
    return [*fits.at_surface, *fits.at_average]


def _grid_means(measured: Sequence[Measured], scale: float = 1e3) -> dict[tuple[float, float], float]:
    """(current stepped to, log2 of the speed in rpm) -> mean time constant in ms (s with scale 1)."""
    groups: dict[tuple[float, float], list[float]] = {}
    for one in measured:
        place = one.step.current_to, math.log2(one.step.speed_rpm)
        groups.setdefault(place, []).append(scale * one.time_constant)
    return {place: float(np.mean(values)) for place, values in sorted(groups.items())}


def _speed_shades(measured: Sequence[Measured]) -> np.ndarray:
    return np.log2([one.step.speed_rpm for one in measured])


def _origin(found: Identification) -> str:
    return f"{found.source}: {found.steps} steps averaged to {len(found.measured)}."


def _title(figure: Figure, text: str, left: float) -> None:
    figure.text(left, 0.955, text, fontsize=11, color=TEXT)


def _caption(figure: Figure, lines: Sequence[str], left: float) -> None:
    for k, text in enumerate(reversed(lines)):
        figure.text(left, 0.025 + 0.035 * k, text, fontsize=CAPTION_SIZE, color=QUIET)
