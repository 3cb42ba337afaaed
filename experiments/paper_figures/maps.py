"""Maps over the workspace: what the brakes of a display can do wherever the tip is, whichever way it moves.

A moving tip, direction e: brake i pushes along -sign(g_i . e) g_i with a torque from K(0) to K(current_max), and all
together have a zonotope of forces. Across the motion, to its left n, it reaches from -sum max(-c_i torque) to
sum max(c_i torque), c_i = -sign(g_i . e) g_i . n. Mapped is the lesser of both sides, 0 where one has nothing: what the
brakes can show at right angles to the motion to whichever side it is wanted. Along the force line of one brake the
others must push to both sides. One other cannot, so two brakes have nothing in some direction everywhere; more can
where their lines leave no gap of 90 degrees or more, apart from what the drag without current takes.

Over e each side is a sum of pieces of sines with positive sum, so its least value lies at the end of a piece: where e
is along a force line or at right angles to a row. So `worst_across` is exact, not a search.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from core.device import Device
from core.workspace import Array, brake_rows, tip_motion
from experiments.analysis.sheet import CM, MIDDLE, PAGE_IN, SMALL, plain, sheet, title
from experiments.numbers import percent, significant
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import Workspace, draw_outline, in_cm, workspace_of

LABEL_APART_M = 0.06
DIRECTIONS = 180  # of motion, over half a turn: what brakes do to one they do to its opposite
USUAL = 0.98  # share of the workspace that the scale covers; beyond it: the end's colour


class Pushes(NamedTuple):
    """What n brakes do at many tips, each (n, 2, ...) or (n,)."""

    rows: Array  # 1/m
    pull: Array  # for each N m at the tip: force (the rows themselves), or acceleration
    low: Array  # N m, without current
    high: Array  # N m, at the largest


class Map(NamedTuple):
    """One map: for each device two values at every tip, over all directions of motion."""

    title: str
    unit: str
    text: str
    kinds: tuple[str, str]  # of the two
    values: Callable[[Device, Array, Array], tuple[Array, Array]]  # at x and y, m
    levels: Array | None = None  # of the common scale; None: by the values
    colours: str = "cividis"


def pushes_of(device: Device, x: Array, y: Array, as_acceleration: bool = False) -> Pushes:
    """The brakes of a device at tips (m)."""
    rows = brake_rows(device.mechanism, x, y)[device.brakes.present > 0.0]
    files = [device.brake_files[joint] for joint in device.braked]
    low = np.array([brake.torque_gain(0.0) for brake in files])
    high = np.array([brake.torque_gain(brake.current_max_A) for brake in files])
    pull = rows
    if as_acceleration:
        tips = np.column_stack((x.ravel(), y.ravel()))
        mass = tip_motion(device.mechanism, tips, np.zeros_like(tips)).mass
        inverse = np.array([[mass[1, 1], -mass[0, 1]], [-mass[0, 1], mass[0, 0]]])
        inverse /= mass[0, 0] * mass[1, 1] - mass[0, 1] ** 2
        pull = np.einsum("ijn,kjn->kin", inverse, rows.reshape(len(rows), 2, -1)).reshape(rows.shape)
    return Pushes(rows, pull, low, high)


def least_across(pushes: Pushes, direction: Array, senses: Array | None = None) -> Array:
    """The most (...) that the brakes can show across a motion in a direction (2, ...), on the side where it is less.

    Only the direction counts, not its length. senses (n, ...): in which each joint turns; None: as the motion has it.
    """
    unit = direction / np.hypot(direction[0], direction[1])
    if senses is None:
        senses = np.sign(np.einsum("ki...,i...->k...", pushes.rows, unit))
    push = -senses * np.einsum("ki...,i...->k...", pushes.pull, np.array([-unit[1], unit[0]]))
    shape = (-1,) + (1,) * (push.ndim - 1)
    low, high = pushes.low.reshape(shape), pushes.high.reshape(shape)
    sides = [np.where(side > 0.0, high, low) * side for side in (push, -push)]
    return np.asarray(np.maximum(np.minimum(sides[0].sum(axis=0), sides[1].sum(axis=0)), 0.0))


def worst_across(pushes: Pushes) -> Array:
    """The minimum (...) of `least_across` over all directions of motion, exactly."""
    values = [least_across(pushes, pull) for pull in pushes.pull]
    for k, row in enumerate(pushes.rows):
        along = np.array([-row[1], row[0]])  # joint k stands still: just before, and just after
        senses = np.sign(np.einsum("ki...,i...->k...", pushes.rows, along))
        for sense in (-1.0, 1.0):
            senses[k] = sense
            values.append(least_across(pushes, along, senses))
    return np.asarray(np.min(values, axis=0))


def mean_across(pushes: Pushes) -> Array:
    """The mean (...) of `least_across` over the directions of motion."""
    total = np.zeros(pushes.rows.shape[2:])
    for angle in math.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        c, s = math.cos(angle), math.sin(angle)
        total += least_across(pushes, np.stack([np.full_like(total, c), np.full_like(total, s)]))
    return total / DIRECTIONS


def _across(as_acceleration: bool, device: Device, x: Array, y: Array) -> tuple[Array, Array]:
    pushes = pushes_of(device, x, y, as_acceleration)
    return worst_across(pushes), mean_across(pushes)


_KINDS = "least", "mean"
MAPS = {
    "force": Map(
        "Force", "N",
        "The force that all brakes together can exert at right angles to the motion, to the side on which they have "
        "less. Left: the least over all directions of motion, and in what share of the workspace it is zero. Right: "
        "the mean over all directions, and its median over the workspace.",
        _KINDS, partial(_across, False),
    ),
    "steerability": Map(
        "Acceleration", "m/s²",
        "The acceleration that all brakes together can give a free tip at right angles to its motion, to the side on "
        "which they have less. Left: the least over all directions of motion, and in what share of the workspace it is "
        "zero. Right: the mean over all directions, and its median over the workspace. An arc of radius r at a speed v "
        "needs v²/r: at 0.1 m/s 1 m/s² is a radius of 1 cm.",
        _KINDS, partial(_across, True),
    ),
}  # fmt: skip


def draw_map(shown: Map, devices: Sequence[Device]) -> Figure:
    """A row of two maps for each device; above each the median over its workspace, or how much of it has nothing."""
    text = f"{parameters_of(*devices)} {shown.text} Outline: the limit set by the hard stops."
    workspaces = [workspace_of(device.mechanism) for device in devices]
    values = [
        shown.values(device, *np.meshgrid(workspace.x, workspace.y))
        for device, workspace in zip(devices, workspaces, strict=True)
    ]
    width, margins, between, rows = PAGE_IN, (0.6, 1.0, 0.5, 0.4), (0.3, 0.85), len(devices)
    each = 0.5 * (width - margins[0] - margins[1] - between[0])
    inner = max(workspace.height_in(each, bases=False) for workspace in workspaces) * rows + between[1] * (rows - 1)
    figure, grid = sheet(text, (width, inner), margins, (rows, 2), between, inside=True)
    levels = np.empty(0) if shown.levels is None else shown.levels
    if not len(levels):
        every = [value[w.room > 0.0] for pair, w in zip(values, workspaces, strict=True) for value in pair]
        most = float(np.nanquantile(np.concatenate(every), USUAL))
        levels = np.asarray(MaxNLocator(10).tick_values(0.0, most))
    for row, device, workspace, pair in zip(grid, devices, workspaces, values, strict=True):
        for axes, kind, value in zip(row, shown.kinds, pair, strict=True):
            filled = _draw_values(axes, workspace, value, shown, levels)
            inside = value[workspace.room > 0.0]
            none = float(np.mean(inside == 0.0))
            middle = _with_unit(significant(float(np.nanmedian(inside))), shown.unit)
            title(axes, f"{device.name}, {kind}: {f'zero in {percent(none)}' if none else middle}")
        row[1].set_ylabel("")
    height = figure.get_figheight()
    bottom = 1.0 - (margins[3] + inner) / height
    bar = figure.add_axes((1.0 - 0.75 / width, bottom, 0.15 / width, (inner - 0.25) / height))
    figure.colorbar(filled, cax=bar, ticks=levels)
    bar.set_yticks(levels, [_with_unit(f"{level:g}", shown.unit) for level in levels])
    bar.set_title(shown.title, fontsize=MIDDLE, pad=6)
    bar.tick_params(length=0)
    return figure


def _with_unit(number: str, unit: str) -> str:
    return f"{number}{unit}" if unit == "°" else f"{number} {unit}"


def _draw_values(axes: Axes, workspace: Workspace, values: Array, shown: Map, levels: Array) -> ContourSet:
    x, y = CM * workspace.x, CM * workspace.y
    known = np.ma.masked_invalid(values)
    filled = axes.contourf(x, y, known, levels=levels, cmap=shown.colours, extend="both")
    drawn = axes.contour(x, y, known, levels=levels, colors=["white"], linewidths=[0.5])
    inside = axes.contourf(x, y, workspace.room, levels=[0.0, 1e3], colors="none")
    outline = PathPatch(inside.get_paths()[0], facecolor="none", edgecolor="none", transform=axes.transData)
    axes.add_patch(outline)
    filled.set_clip_path(outline)
    drawn.set_clip_path(outline)
    _label_levels(axes, workspace, values, levels, shown.unit)
    draw_outline(axes, workspace)
    in_cm(axes, workspace, bases=False)
    plain(axes, grid=False)
    return filled


def _label_levels(axes: Axes, workspace: Workspace, values: Array, levels: Array, unit: str) -> None:
    """Name the contours where they cross the column of the grid through the workspace's home, not too near together."""
    column = int(np.argmin(np.abs(workspace.x - workspace.home[0])))
    value = np.where(workspace.room[:, column] > 0.0, values[:, column], np.nan)
    white, last = withStroke(linewidth=2.0, foreground="white"), -math.inf
    for k in range(len(value) - 1):
        for level in levels:
            crosses = np.minimum(value[k], value[k + 1]) < level <= np.maximum(value[k], value[k + 1])
            if crosses and workspace.y[k] > last + LABEL_APART_M:
                last = workspace.y[k]
                words = f"{level:g}°" if unit == "°" else f"{level:g}"
                axes.text(
                    CM * workspace.x[column], CM * last, words, fontsize=SMALL, ha="center", va="center",
                    path_effects=[white],
                )  # fmt: skip
