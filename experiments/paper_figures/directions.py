"""Fig. 1: the directions in which brakes cannot push the tip, as the sketch and over the workspace of a device.

A brake pushes along its force line, g_i, in the sense that opposes the motion; several together reach every direction
between the outermost of them. Our reading of the figure: the range of unachievable directions is the full turn without
that span. No passive device does better than 180 degrees. Of n force lines (whose angles modulo 180 degrees leave gaps
d_k of 180 degrees in all) a velocity leaves the span without one gap: it is 180 degrees + d_k, and of all directions
of velocity a share d_k / 180 degrees meets that gap. A gap between force lines is also the angle between neighbouring
SDOF paths.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Wedge
from matplotlib.patheffects import withStroke

from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.workspace import Array, arm_pose
from experiments.analysis.figures import QUIET, TEXT, new_figure
from experiments.paper_figures.sheet import (
    CM,
    SMALL,
    arrow,
    foot_in,
    panels,
    parameters_of,
    plain,
    small_print,
    title,
)
from experiments.paper_figures.workspace import Workspace, draw_outline, height_for, in_cm, workspace_of

HALF_TURN = math.pi
LEAST_DEG, MOST_DEG, LEVEL_DEG = 220.0, 320.0, 10.0  # of the maps' common scale; beyond it: the end's colour
LABEL_APART_M = 0.045


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
    """Angles (..., n) of the force lines of the brakes at many tips: A, B along the distal links, E, C base to tip."""
    angles = []
    for joint in braked:
        arm = mechanism.arm_1 if joint in JOINTS[:2] else mechanism.arm_2
        pose = arm_pose(arm, x, y)
        along = pose.e2 if joint in "AB" else (pose.e1[0] + pose.e2[0], pose.e1[1] + pose.e2[1])
        angles.append(np.arctan2(along[1], along[0]))
    return np.stack(angles, axis=-1)


def draw_sketch() -> Figure:
    """Fig. 1 (a) and (b)."""
    figure = new_figure(6.4, 3.8)
    foot = small_print(
        figure,
        "Dark: directions in which the brakes cannot push while the tip moves along v, although a passive device "
        "could. Light: they would add energy, no passive device can push there. White: any force, by brakes together.",
    )
    axes = panels(figure, 1, 2, (0.15, 0.15, foot + 0.1, 0.4), (0.2, 0.0))[0]
    for place, count in ((axes[0], 2), (axes[1], 4)):
        lines = HALF_TURN * (np.arange(count) + 0.5) / count
        _draw_directions(place, lines)
    title(axes[0], "(a) Two actuators")
    title(axes[1], "(b) Four actuators, evenly spaced")
    return figure


def _draw_directions(axes: Axes, lines: Array) -> None:
    low, high = achievable_span(list(lines), 0.0)
    axes.add_patch(Wedge((0, 0), 1.0, -90, 90, facecolor="#e7ebef", edgecolor="none"))
    for begin, end in ((90.0, 180.0 + math.degrees(low)), (180.0 + math.degrees(high), 270.0)):
        axes.add_patch(Wedge((0, 0), 1.0, begin, end, facecolor="#aeb8c2", edgecolor="none"))
    for i, line in enumerate(sorted(line + HALF_TURN if math.cos(line) > 0.0 else line for line in lines)):
        c, s = math.cos(line), math.sin(line)
        axes.plot([0, -0.4 * c], [0, -0.4 * s], color=QUIET, linewidth=0.8, linestyle=(0, (3, 3)))
        arrow(axes, (0, 0), (0.86 * c, 0.86 * s), "#0072b2", 2.0)
        axes.text(1.11 * c, 1.11 * s, f"$F_{i + 1}$", ha="center", va="center")
    arrow(axes, (0, 0), (0.8, 0), TEXT, 2.0)
    axes.text(0.88, 0.0, "$v$", ha="center", va="center", fontsize=11)
    axes.plot(0, 0, "o", color=TEXT, markersize=5)
    total = 360.0 - math.degrees(high - low)
    axes.text(0.5, -0.5, f"unachievable:\n{total:g}°", ha="center", va="center", linespacing=1.4, fontsize=8.0)
    axes.set_xlim(-1.22, 1.05)
    axes.set_ylim(-1.15, 1.15)
    axes.set_aspect("equal")
    axes.axis("off")


def draw_maps(devices: Sequence[Device]) -> Figure:
    """Fig. 1 over the workspace: for each device the worst and the mean range over all directions of velocity."""
    text = (
        f"{parameters_of(*devices)} Range of directions in which all brakes together cannot push the tip; no passive "
        "device has less than 180°. In the worst case its excess over 180° is the widest angle between neighbouring "
        "SDOF paths; the mean is over all directions of velocity. Grey: the limit set by the hard stops."
    )
    workspaces = [workspace_of(device.mechanism) for device in devices]
    width, sides, between, above = 7.4, (0.6, 1.0), (0.3, 0.85), 0.4
    each = 0.5 * (width - sum(sides) - between[0])
    heights = [height_for(workspace, each, bases=False) for workspace in workspaces]
    foot = foot_in(text, width) + 0.5
    inner = max(heights) * len(devices) + between[1] * (len(devices) - 1)
    figure = new_figure(width, foot + inner + above)
    small_print(figure, text)
    grid = panels(figure, len(devices), 2, (*sides, foot, above), between)
    levels = np.arange(LEAST_DEG, MOST_DEG + 1.0, LEVEL_DEG)
    filled = None
    for row, device, workspace in zip(grid, devices, workspaces, strict=True):
        x, y = np.meshgrid(workspace.x, workspace.y)
        lines = force_lines(device.mechanism, device.braked, x, y)
        kinds = (("worst velocity", worst_unachievable), ("mean over velocities", mean_unachievable))
        for axes, (kind, measure) in zip(row, kinds, strict=True):
            filled = _draw_map(axes, workspace, np.degrees(measure(lines)), levels)
            title(axes, f"{device.name}, {kind}")
        row[1].set_ylabel("")
    height = figure.get_figheight()
    bar = figure.add_axes((1.0 - 0.75 / width, foot / height, 0.15 / width, inner / height - 0.25 / height))
    figure.colorbar(filled, cax=bar, ticks=levels)
    bar.set_yticks(levels, [f"{level:g}°" for level in levels])
    bar.set_title("unachievable", fontsize=8.0, pad=6)
    bar.tick_params(length=0)
    return figure


def _draw_map(axes: Axes, workspace: Workspace, degrees: Array, levels: Array):
    x, y = CM * workspace.x, CM * workspace.y
    shown = np.ma.masked_invalid(degrees)
    filled = axes.contourf(x, y, shown, levels=levels, cmap="cividis_r", extend="both")
    drawn = axes.contour(x, y, shown, levels=levels, colors=["white"], linewidths=[0.5])
    inside = axes.contourf(x, y, workspace.room, levels=[0.0, 1e3], colors="none")
    outline = PathPatch(inside.get_paths()[0], facecolor="none", edgecolor="none", transform=axes.transData)
    axes.add_patch(outline)
    filled.set_clip_path(outline)
    drawn.set_clip_path(outline)
    _label_levels(axes, workspace, degrees, levels)
    draw_outline(axes, workspace)
    in_cm(axes, workspace, bases=False)
    plain(axes, grid=False)
    return filled


def _label_levels(axes: Axes, workspace: Workspace, degrees: Array, levels: Array) -> None:
    """Name the contours where they cross the column of the grid through the workspace's home, not too near together."""
    column = int(np.argmin(np.abs(workspace.x - workspace.home[0])))
    value = np.where(workspace.room[:, column] > 0.0, degrees[:, column], np.nan)
    last = -math.inf
    for k in range(len(value) - 1):
        for level in levels:
            if (value[k] - level) * (value[k + 1] - level) <= 0.0 and workspace.y[k] > last + LABEL_APART_M:
                last = workspace.y[k]
                place = (CM * workspace.x[column], CM * last)
                axes.text(
                    *place, f"{level:g}°", fontsize=SMALL, ha="center", va="center",
                    path_effects=[withStroke(linewidth=2.0, foreground="white")],
                )  # fmt: skip
