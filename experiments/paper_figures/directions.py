"""Fig. 1: the directions in which brakes cannot push the tip, as the sketch and over the workspace of a device.

A brake pushes along its force line, g_i, in the sense that opposes the motion; several together reach every direction
between the outermost of them. Our reading of the figure: the range of unachievable directions is the full turn without
that span. No passive device does better than 180 degrees. Of n force lines (whose angles modulo 180 degrees leave gaps
d_k of 180 degrees in all) a velocity leaves the span without one gap: it is 180 degrees + d_k, and of all directions
of velocity a share d_k / 180 degrees meets that gap. A gap between force lines is also the angle between neighbouring
SDOF paths.

What that argues, as numbers: the shipped displays side by side, all with the same brake. Fewer or less evenly spread
force lines leave wider gaps between them, so a full lock holds less, and SDOF control finds no valid brake more often.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from core import tick_log
from core.device import Device, build_device, load_device, shipped_devices
from core.mechanism import JOINTS, Mechanism
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import TICK_S
from core.workspace import Array, brake_rows, held_in_any_direction
from experiments.analysis.metrics import trial_metrics
from experiments.analysis.sheet import (
    BLUE,
    MIDDLE,
    PAGE_IN,
    QUIET,
    SHADED,
    TEXT,
    TITLE,
    arrow,
    plain,
    sheet,
    title,
)
from experiments.numbers import fixed
from experiments.paper_figures.brake import WHITE
from experiments.paper_figures.maps import Map
from experiments.plan import PlannedTrial
from experiments.protocol import PAPER, Protocol, load_protocol, middle_of_first
from experiments.recording.schema import recording_of
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

HALF_TURN = math.pi


def gaps(lines: npt.ArrayLike) -> Array:
    """Gaps (..., n) between neighbouring force lines at angles (..., n), rad; they sum to pi."""
    angles = np.sort(np.mod(np.asarray(lines, dtype=float), HALF_TURN), axis=-1)
    return np.diff(angles, axis=-1, append=angles[..., :1] + HALF_TURN)


def worst_unachievable(lines: npt.ArrayLike) -> Array:
    """Range (...) of unachievable force directions, rad, for the velocity that leaves the largest one."""
    return HALF_TURN + gaps(lines).max(axis=-1)


def mean_unachievable(lines: npt.ArrayLike) -> Array:
    """The same, mean over all directions of velocity."""
    return HALF_TURN + (gaps(lines) ** 2).sum(axis=-1) / HALF_TURN


def achievable_span(lines: Sequence[float], velocity: float) -> tuple[float, float]:
    """The outermost force directions (low, high), rad, for a velocity in a direction (rad), seen from its opposite."""
    away = [math.remainder(line - velocity - HALF_TURN, 2.0 * HALF_TURN) for line in lines]
    away = [a if abs(a) <= 0.5 * HALF_TURN else a - math.copysign(HALF_TURN, a) for a in away]
    return min(away), max(away)


def force_lines(mechanism: Mechanism, braked: str, x: Array, y: Array) -> Array:
    """Angles (..., n) of the force lines of the brakes at many tips."""
    rows = brake_rows(mechanism, x, y)[[JOINTS.index(joint) for joint in braked]]
    return np.asarray(np.moveaxis(np.arctan2(rows[:, 1], rows[:, 0]), 0, -1))


def draw_sketch() -> Figure:
    """Fig. 1 (a) and (b)."""
    text = (
        "Dark: directions in which the brakes cannot push while the tip moves along v, although a passive device "
        "could. Light: they would add energy, no passive device can push there. White: any force, by brakes together."
    )
    figure, [row] = sheet(text, (PAGE_IN, 4.1), (0.15, 0.15, 0.1, 0.4), (1, 2), between_in=(0.2, 0.0))
    words = ("(a) Two actuators", "(b) Four actuators, evenly spaced")
    for axes, count, label in zip(row, (2, 4), words, strict=True):
        _draw_directions(axes, HALF_TURN * (np.arange(count) + 0.5) / count)
        title(axes, label)
    return figure


def _draw_directions(axes: Axes, lines: Array) -> None:
    low, high = achievable_span(list(lines), 0.0)
    axes.add_patch(Wedge((0, 0), 1.0, -90, 90, facecolor=SHADED, edgecolor="none"))
    for begin, end in ((90.0, 180.0 + math.degrees(low)), (180.0 + math.degrees(high), 270.0)):
        axes.add_patch(Wedge((0, 0), 1.0, begin, end, facecolor="#aeb8c2", edgecolor="none"))
    for i, line in enumerate(sorted(line + HALF_TURN if math.cos(line) > 0.0 else line for line in lines)):
        c, s = math.cos(line), math.sin(line)
        axes.plot([0, -0.4 * c], [0, -0.4 * s], color=QUIET, linewidth=0.8, linestyle=(0, (3, 3)))
        arrow(axes, (0, 0), (0.86 * c, 0.86 * s), BLUE, 2.0)
        axes.text(1.11 * c, 1.11 * s, f"$F_{i + 1}$", ha="center", va="center")
    arrow(axes, (0, 0), (0.8, 0), TEXT, 2.0)
    axes.text(0.88, 0.0, "$v$", ha="center", va="center", fontsize=TITLE)
    axes.plot(0, 0, "o", color=TEXT, markersize=5)
    total = 360.0 - math.degrees(high - low)
    axes.text(0.5, -0.5, f"unachievable:\n{total:g}°", ha="center", va="center", linespacing=1.4, fontsize=MIDDLE)
    axes.set(xlim=(-1.22, 1.05), ylim=(-1.15, 1.15), aspect="equal")
    axes.axis("off")


def _unachievable(device: Device, x: Array, y: Array) -> tuple[Array, Array]:
    lines = force_lines(device.mechanism, device.braked, x, y)
    return np.degrees(worst_unachievable(lines)), np.degrees(mean_unachievable(lines))


#: Fig. 1 over the workspace.
UNACHIEVABLE = Map(
    "unachievable",
    "°",
    "Range of directions in which all brakes together cannot push the tip; no passive device has less than 180°. In "
    "the worst case its excess over 180° is the widest angle between neighbouring SDOF paths; the mean is over all "
    "directions of velocity.",
    ("worst velocity", "mean over velocities"),
    _unachievable,
    np.arange(220.0, 321.0, 10.0),
    "cividis_r",
)


# ------------------------------------------------------------------------------------------------ the displays compared

BRAKE = "mrb-2107-3"  # the paper's, on every display
PEOPLE, REPETITIONS = 3, 3  # as in the paper
SPACING_M = 0.002  # between the places of a segment
LONGEST_TRIAL_S = 62.0  # with the times out of the paper's protocol


class Display(NamedTuple):
    """One display in numbers: (n,) places of the segments, (m,) trials."""

    device: Device
    widest_gap: Array  # (n,) rad, between neighbouring force lines
    holds: Array  # (n,) N, what a full lock holds in any direction
    path_error: Array  # (m,) m, under SDOF control
    unreachable: Array  # (m,) share of the ticks in which SDOF control had no valid brake


def displays() -> list[Device]:
    """The shipped devices, fewest brakes first, each with `BRAKE` wherever it has a brake."""
    text = load_device("three-brake").brake_texts[BRAKE]
    found = [load_device(name) for name in shipped_devices()]
    found = [build_device(device.text, dict.fromkeys(device.brake_texts, text), device.name) for device in found]
    return sorted(found, key=lambda device: (len(device.braked), device.name))


def measure_display(device: Device, protocol: Protocol) -> Display:
    """A display along the protocol's paths, and in the hands of the same people as any other."""
    paths = [build_path(path, "path") for path in protocol.paths.values()]
    places = np.array([point_at(path, s)[:2] for path in paths for s in np.arange(0.0, path.length, SPACING_M)])
    rows = brake_rows(device.mechanism, *places.T)[device.brakes.present > 0.0]
    brake = next(iter(device.brake_files.values()))
    torque = np.full(len(rows), brake.torque_gain(brake.current_max_A))
    lines = force_lines(device.mechanism, device.braked, *places.T)
    found = [trial for number in range(PEOPLE) for trial in sdof_trials(device, protocol, number)]
    return Display(device, gaps(lines).max(axis=-1), held_in_any_direction(rows, torque), *np.array(found).T)


def sdof_trials(device: Device, protocol: Protocol, number: int) -> Iterator[tuple[float, float]]:
    """Path error (m) and unreachable share of each trial of a simulated operator under SDOF control."""
    preset = next(preset for preset in protocol.controllers.values() if preset.kind == "sdof")
    person = load_population().draw(np.random.default_rng(np.random.SeedSequence([protocol.seed, number])))
    rows = np.empty((round(LONGEST_TRIAL_S / TICK_S), tick_log.WIDTH))
    simulation = SimulatedDevice(device, middle_of_first(protocol.paths))
    for repetition in range(REPETITIONS):
        for segment, path in protocol.paths.items():
            key = [protocol.seed, number, segment, repetition]  # the same noise on every display
            generator = np.random.default_rng(np.random.SeedSequence(key))
            planned = PlannedTrial(1, 1, device.name, 1, segment, repetition)
            trial = SimulatedTrial(
                simulation, planned, Conditions(path, preset, protocol.rules, protocol.trial), person, generator
            )
            metrics = trial_metrics(recording_of(rows[: trial.run(rows)], device.braked), trial.path)
            yield metrics["path_error_m"] or math.nan, metrics["unreachable_share"] or 0.0


def draw_displays() -> Figure:
    """The comparison: a row for each display."""
    protocol = load_protocol(PAPER)
    found = [measure_display(device, protocol) for device in displays()]
    text = (
        f"Assumed parameters: every device, the brake {BRAKE} on all of them, the two segments, the simulated "
        f"operators ({PEOPLE} people, {REPETITIONS} trials on each segment, SDOF without gap, {protocol.rules} rules). "
        "Left: range along the segments, worst value as text. Right: each trial a circle, median (path error) or mean "
        "(share of ticks with a felt hand and no valid brake) as text."
    )
    size = PAGE_IN, 1.8 + 0.5 * len(found)
    figure, [axes] = sheet(text, size, (1.0, 0.15, 0.5, 0.55), (1, 4), between_in=(0.2, 0.0))
    panels: tuple[tuple[str, str, list[np.ndarray], Callable[[np.ndarray], float]], ...] = (
        ("Widest gap\nof force lines", "°", [np.degrees(display.widest_gap) for display in found], np.max),
        ("A full lock\nholds", "N", [display.holds for display in found], np.min),
        ("SDOF\npath error", "mm", [1e3 * display.path_error for display in found], np.median),
        ("SDOF,\nno valid brake", "%", [1e2 * display.unreachable for display in found], np.mean),
    )
    for place, (panel, (words, unit, values, one_number)) in enumerate(zip(axes, panels, strict=True)):
        plain(panel)
        title(panel, words)
        for row, series in enumerate(values):
            if place < 2:
                panel.plot([series.min(), series.max()], [row, row], "-|", color=BLUE, linewidth=2.0, markersize=9)
            else:
                panel.plot(series, np.full(len(series), row), "o", color=BLUE, markersize=4, alpha=0.5, mew=0.0)
            number = fixed(one_number(series), 1 if unit in ("mm", "%") else 0)
            shown = f"{number}°" if unit == "°" else f"{number} {unit}"
            beside = panel.get_yaxis_transform()
            panel.text(1.0, row + 0.4, shown, transform=beside, ha="right", va="center", bbox=WHITE)
        panel.set(ylim=(len(found) - 0.35, -0.5), xlabel=unit, xlim=(0.0, 1.1 * max(series.max() for series in values)))
        names = [display.device.name for display in found] if place == 0 else []
        panel.set_yticks(range(len(found)), names or [""] * len(found))
    return figure
