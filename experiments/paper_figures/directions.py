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
from matplotlib.patches import Wedge

from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.workspace import Array, brake_rows
from experiments.analysis.sheet import (
    BLUE,
    MIDDLE,
    PAGE_IN,
    QUIET,
    SHADED,
    TEXT,
    TITLE,
    arrow,
    sheet,
    title,
)
from experiments.paper_figures.maps import Map

HALF_TURN = math.pi


def gaps(lines: npt.ArrayLike) -> Array:
    """Gaps (..., n) between neighbouring force lines at angles (..., n), rad; they sum to pi."""
    angles = np.sort(np.mod(np.asarray(lines, dtype=float), HALF_TURN), axis=-1)
    return np.diff(angles, axis=-1, append=angles[..., :1] + HALF_TURN)


def worst_unachievable(lines: npt.ArrayLike) -> Array:
    """Range (...) of unachievable force directions, rad, for the velocity that leaves the largest one."""
    return HALF_TURN + gaps(lines).max(axis=-1)


def mean_unachievable(lines: npt.ArrayLike) -> Array:
    """Range (...) of unachievable force directions, rad, averaged over all directions of velocity."""
    return HALF_TURN + (gaps(lines) ** 2).sum(axis=-1) / HALF_TURN


def achievable_span(lines: Sequence[float], velocity: float) -> tuple[float, float]:
    """The outermost force directions (low, high), rad, measured from the opposite of a velocity's direction (rad)."""
    angles = [math.remainder(line - velocity, HALF_TURN) for line in lines]  # a line has two ends: the nearer one
    return min(angles), max(angles)


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
