"""Fig. 11: the handle released from rest under a constant force, with each brake locked in turn and with none.

The paper's torsional spring is known only as of constant force. Our choice: a force of constant magnitude towards a
fixed anchor, its direction taken anew every millisecond (a force prescribed in time, as the paper's measured one was).
The brakes have the full model, Eqs. (1)-(4) and the backlash; the locked one has had its full current for long before
the release.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from core.device import Device
from core.mechanism import JOINTS
from core.simulator.hand import new_hand
from core.simulator.simulation import Grid, Schedule, Simulation
from core.workspace import Array
from experiments.analysis.sheet import BLUE, CM, ORANGE, PAGE_IN, QUIET, TEXT, heading, plain, sheet, title
from experiments.numbers import place_cm
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import Workspace, brake_angles, draw_outline, sdof_path, workspace_of

FORCE_N = 8.0
HOLD_S, RELEASE_S, STEP_S = 2.0, 0.45, 1e-3
#: m from the workspace's home, for arms of 0.6 m (others in proportion): where the handle is released, and the anchor.
STARTS_M = ((-0.12, -0.10), (-0.02, 0.02), (-0.15, 0.06))
ANCHOR_M = (0.50, 0.05)
ARM_M = 0.6
#: Of each place of release.
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": TEXT, "linestyle": "-"},
    {"color": BLUE, "linestyle": (0, (6, 1.5))},
    {"color": ORANGE, "linestyle": (0, (1.5, 1.2))},
)


class Release(NamedTuple):
    """One release: the brake locked ("" for none), and the motion from the release on."""

    locked: str
    time: Array  # (n,) s
    tip: Array  # (n, 2) m


def release(device: Device, start: tuple[float, float], anchor: tuple[float, float], locked: str) -> Release:
    """Release the handle at a tip (m), pulled towards the anchor (m). locked: joint of the locked brake, or ""."""
    currents = np.zeros((1, 4))
    if locked:
        currents[0, JOINTS.index(locked)] = device.brakes.current_max[JOINTS.index(locked)]
    hand = new_hand()
    simulation = Simulation(device, start, fidelity="mr", hand=hand)
    held, n, at_once = round(HOLD_S / STEP_S), round(RELEASE_S / STEP_S), np.zeros(1)
    simulation.rows(held, Schedule(at_once, currents), Grid(0, -1, 1, STEP_S))
    rows, tip = [], np.array(start)
    for k in range(n + 1):
        pull = np.array(anchor) - tip
        hand.forces[0] = FORCE_N * pull / math.hypot(*pull)
        rows.append(simulation.rows(1, Schedule(at_once, currents), Grid(held + k, -1, 1, STEP_S))[0])
        tip = simulation.body["tip"][0, :2].copy()
    table = np.array(rows)
    return Release(locked, table[:, 0] - HOLD_S, table[:, 1:3])


def places(workspace: Workspace) -> tuple[list[tuple[float, float]], tuple[float, float]]:
    """The places where the handle is released, clear of the stops, and the anchor; all m."""
    arms = workspace.mechanism.arm_1, workspace.mechanism.arm_2
    scale = min(arm.length_1 + arm.length_2 for arm in arms) / ARM_M
    (hx, hy), starts = workspace.home, []
    clear = 0.15 * workspace.room_at(hx, hy)
    for dx, dy in STARTS_M:
        share = scale
        while workspace.room_at(hx + share * dx, hy + share * dy) < clear:
            share *= 0.8
        starts.append((hx + share * dx, hy + share * dy))
    return starts, (hx + scale * ANCHOR_M[0], hy + scale * ANCHOR_M[1])


def draw_releases(device: Device) -> Figure:
    """Fig. 11, the simulation's output, for one device."""
    workspace = workspace_of(device.mechanism)
    starts, anchor = places(workspace)
    locks = ("", *device.braked)
    text = (
        f"{parameters_of(device)} Simulation only (integrator event, full brake model with backlash). Our choice: "
        f"{FORCE_N:g} N towards an anchor at {place_cm(anchor)}; the handle is let go at "
        "rest at three places (circles), the locked brake at full current for long before, the others off. Thin: the "
        "SDOF path of the locked brake through each place; the tip may leave it by the backlash, some mm. Grey: the "
        "limit set by the hard stops."
    )
    size = PAGE_IN, 4.75
    figure, grid = sheet(
        text, size, (0.65, 0.15, 0.5, 0.95), (3, len(locks)), (0.16, 0.45), inside=True, height_ratios=(1.5, 1, 1)
    )
    motions = [[release(device, start, anchor, locked) for start in starts] for locked in locks]
    _same_frame(grid[0], np.concatenate([motion.tip for column in motions for motion in column]))
    for (paths, *moved), locked, releases in zip(grid.T, locks, motions, strict=True):
        title(paths, f"{device.labels[locked]} locked" if locked else "None locked")
        _draw_paths(paths, workspace, releases)
        for axis, axes in enumerate(moved):
            for motion, look in zip(releases, LOOKS, strict=True):
                axes.plot(motion.time, CM * (motion.tip[:, axis] - motion.tip[0, axis]), linewidth=1.4, **look)
    for row, label in zip(grid, ("y (cm)", "x moved (cm)", "y moved (cm)"), strict=True):
        row[0].set_ylabel(label)
        for axes in row:
            plain(axes)
            axes.tick_params(labelleft=axes is row[0])
    for row in grid[1:]:
        low, high = min(axes.get_ylim()[0] for axes in row), max(axes.get_ylim()[1] for axes in row)
        for axes in row:
            axes.set(xlim=(0.0, RELEASE_S), ylim=(low, high), xticks=[0.0, 0.2, 0.4])
    for upper, middle, lower in grid.T:
        upper.set_xlabel("x (cm)", labelpad=1)
        middle.tick_params(labelbottom=False)
        lower.set_xlabel("Time (s)")
    handles = [
        Line2D([], [], linewidth=1.4, label=f"from {place_cm(start)}", **look)
        for start, look in zip(starts, LOOKS, strict=True)
    ]
    heading(figure, f"Spring release, {device.name}", handles, handlelength=2.8)
    figure.align_ylabels(grid[:, 0])
    return figure


def _same_frame(row: np.ndarray, tips: Array) -> None:
    """Give all panels of a row the same limits, cm, with equal scales, around all tips (n, 2), m."""
    place = row[0].get_position()
    width, height = row[0].get_figure().get_size_inches()
    shape = place.height * height / (place.width * width)
    low, high = CM * tips.min(axis=0) - 3.0, CM * tips.max(axis=0) + 3.0
    across = max(high[0] - low[0], (high[1] - low[1]) / shape)
    (x, y), half = 0.5 * (low + high), 0.5 * across
    for axes in row:
        axes.set(xlim=(x - half, x + half), ylim=(y - half * shape, y + half * shape), autoscale_on=False)


def _draw_paths(axes: Axes, workspace: Workspace, releases: list[Release]) -> None:
    draw_outline(axes, workspace)
    for motion, look in zip(releases, LOOKS, strict=True):
        if motion.locked:
            theta = brake_angles(workspace.mechanism, motion.tip[0, 0], motion.tip[0, 1])
            circle = sdof_path(workspace, motion.locked, float(theta[JOINTS.index(motion.locked)]))
            axes.plot(CM * circle[:, 0], CM * circle[:, 1], color=QUIET, linewidth=0.6)
        axes.plot(CM * motion.tip[:, 0], CM * motion.tip[:, 1], linewidth=1.8, **look)
        axes.plot(*(CM * motion.tip[0]), "o", color=TEXT, markerfacecolor="white", markersize=5, zorder=5)
