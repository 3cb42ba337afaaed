"""Fig. 11: a constant-force spring on the handle, released from rest, each brake locked in turn and none.

The paper's torsional spring is known only as of constant force. Our choice: a force of constant magnitude towards a
fixed anchor, its direction taken anew every millisecond (a force prescribed in time, as the paper's measured one was);
brakes by the full model, Eqs. (1)-(4) and the backlash, the locked one at full current for long before the release.
"""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.simulator.hand import new_hand
from core.simulator.simulation import Simulation
from core.workspace import Array
from experiments.analysis.figures import QUIET, TEXT, new_figure
from experiments.paper_figures.sheet import CM, foot_in, panels, parameters_of, plain, small_print, title
from experiments.paper_figures.workspace import Workspace, draw_outline, joint_angles, sdof_path, workspace_of

FORCE_N = 8.0
HOLD_S, RELEASE_S, STEP_S = 2.0, 0.45, 1e-3
#: m from the workspace's home, for arms of 0.6 m (others in proportion): where the handle is released, and the anchor.
STARTS_M = ((-0.12, -0.10), (-0.02, 0.02), (-0.15, 0.06))
ANCHOR_M = (0.50, 0.05)
ARM_M = 0.6
START_COLOURS = ("#1c2228", "#2f7fc4", "#d98200")
START_LINES = ("-", (0, (6, 1.5)), (0, (1.5, 1.2)))


class Release(NamedTuple):
    """One release: the brake locked ("" for none), and the motion from the release on."""

    locked: str
    time: Array  # (n,) s
    tip: Array  # (n, 2) m


def release(device: Device, start: tuple[float, float], anchor: tuple[float, float], locked: str) -> Release:
    """Let go at a tip (m), pulled towards the anchor (m), after the locked brake has had its full current for long."""
    currents = np.zeros((1, 4))
    if locked:
        currents[0, JOINTS.index(locked)] = device.brakes.current_max[JOINTS.index(locked)]
    hand = new_hand()
    simulation = Simulation(device, start, fidelity="mr", hand=hand)
    held, n, at_once = round(HOLD_S / STEP_S), round(RELEASE_S / STEP_S), np.zeros(1)
    simulation.rows(held, STEP_S, 1, at_once, currents)
    rows, tip = [], np.array(start)
    for k in range(n + 1):
        pull = np.array(anchor) - tip
        hand.forces[0] = FORCE_N * pull / math.hypot(*pull)
        rows.append(simulation.rows(1, STEP_S, 1, at_once, currents, held + k)[0])
        tip = simulation.state["tip"][0, :2].copy()
    table = np.array(rows)
    return Release(locked, table[:, 0] - HOLD_S, table[:, 1:3])


def places(workspace: Workspace) -> tuple[list[tuple[float, float]], tuple[float, float]]:
    """Where the handle is released (clear of the stops), and the anchor, m."""
    scale = _reach(workspace.mechanism) / ARM_M
    (hx, hy), starts = workspace.home, []
    clear = 0.15 * float(workspace.room_at(np.array(hx), np.array(hy)))
    for dx, dy in STARTS_M:
        share = scale
        while workspace.room_at(np.array(hx + share * dx), np.array(hy + share * dy)) < clear:
            share *= 0.8
        starts.append((hx + share * dx, hy + share * dy))
    return starts, (hx + scale * ANCHOR_M[0], hy + scale * ANCHOR_M[1])


def _reach(mechanism: Mechanism) -> float:
    return min(arm.length_1 + arm.length_2 for arm in (mechanism.arm_1, mechanism.arm_2))


def draw_releases(device: Device) -> Figure:
    """Fig. 11, the simulation's output, for one device."""
    workspace = workspace_of(device.mechanism)
    starts, anchor = places(workspace)
    locks = ("", *device.braked)
    text = (
        f"{parameters_of(device)} Simulation only (integrator event, full brake model with backlash). Our choice: "
        f"{FORCE_N:g} N towards an anchor at ({CM * anchor[0]:.0f}, {CM * anchor[1]:.0f}) cm; the handle is let go at "
        "rest at three places (circles), the locked brake at full current for long before, the others off. Thin: the "
        "SDOF path of the locked brake through each place; the tip may leave it by the backlash, some mm. Grey: the "
        "limit set by the hard stops."
    )
    width, sides = max(1.0 + 1.62 * len(locks), 6.4), (0.65, 0.15)  # at least the legend's width
    foot = foot_in(text, width) + 0.5
    figure = new_figure(width, foot + 5.7)
    small_print(figure, text)
    grid = panels(figure, 3, len(locks), (*sides, foot, 0.95), (0.16, 0.42), height_ratios=(1.5, 1, 1))
    motions = [[release(device, start, anchor, locked) for start in starts] for locked in locks]
    tips = np.concatenate([motion.tip for column in motions for motion in column])
    _same_frame(grid[0], tips)
    for column, locked, releases in zip(grid.T, locks, motions, strict=True):
        title(column[0], f"{locked} locked" if locked else "none locked")
        _draw_paths(column[0], workspace, releases)
        for axes, axis in zip(column[1:], (0, 1), strict=True):
            for motion, colour, line in zip(releases, START_COLOURS, START_LINES, strict=True):
                moved = CM * (motion.tip[:, axis] - motion.tip[0, axis])
                axes.plot(motion.time, moved, color=colour, linestyle=line, linewidth=1.4)
    _share_scales(grid)
    for axes in grid.flat:
        plain(axes)
    grid[0, 0].set_ylabel("y (cm)")
    grid[1, 0].set_ylabel("x moved (cm)")
    grid[2, 0].set_ylabel("y moved (cm)")
    for axes in grid[:, 1:].flat:
        axes.tick_params(labelleft=False)
    for axes in grid[1]:
        axes.tick_params(labelbottom=False)
    for axes in grid[0]:
        axes.set_xlabel("x (cm)", labelpad=1)
    for axes in grid[2]:
        axes.set_xlabel("time (s)")
    handles = [
        Line2D(
            [],
            [],
            color=colour,
            linestyle=line,
            linewidth=1.4,
            label=f"from ({CM * x:.0f}, {CM * y:.0f}) cm".replace("-", "−"),
        )
        for (x, y), colour, line in zip(starts, START_COLOURS, START_LINES, strict=True)
    ]
    height = figure.get_figheight()
    left = sides[0] / width
    figure.text(left, 1.0 - 0.28 / height, f"Spring release, {device.name}", fontsize=10.5, parse_math=False)
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(left, 1.0 - 0.36 / height), ncols=3, frameon=False,
        handlelength=2.8, borderpad=0.0, borderaxespad=0.0, columnspacing=1.5,
    )  # fmt: skip
    figure.align_ylabels(grid[:, 0])
    return figure


def _same_frame(row: np.ndarray, tips: Array) -> None:
    """The same centimetres in all panels of tip paths, equal both ways, around all motions."""
    place = row[0].get_position()
    width, height = row[0].get_figure().get_size_inches()
    shape = place.height * height / (place.width * width)
    low, high = CM * tips.min(axis=0) - 3.0, CM * tips.max(axis=0) + 3.0
    across = max(high[0] - low[0], (high[1] - low[1]) / shape)
    middle = 0.5 * (low + high)
    for axes in row:
        axes.set_xlim(middle[0] - 0.5 * across, middle[0] + 0.5 * across)
        axes.set_ylim(middle[1] - 0.5 * across * shape, middle[1] + 0.5 * across * shape)
        axes.set_autoscale_on(False)


def _draw_paths(axes: Axes, workspace: Workspace, releases: list[Release]) -> None:
    draw_outline(axes, workspace)
    for motion, colour, line in zip(releases, START_COLOURS, START_LINES, strict=True):
        if motion.locked:
            theta = joint_angles(workspace.mechanism, motion.tip[0, 0], motion.tip[0, 1])
            circle = sdof_path(workspace, motion.locked, float(theta[JOINTS.index(motion.locked)]))
            axes.plot(CM * circle[:, 0], CM * circle[:, 1], color=QUIET, linewidth=0.6)
        axes.plot(CM * motion.tip[:, 0], CM * motion.tip[:, 1], color=colour, linestyle=line, linewidth=1.8)
        axes.plot(*(CM * motion.tip[0]), "o", color=TEXT, markerfacecolor="white", markersize=5, zorder=5)


def _share_scales(grid: np.ndarray) -> None:
    """One scale for all displacements along x, one for all along y."""
    for row in grid[1:]:
        low, high = min(axes.get_ylim()[0] for axes in row), max(axes.get_ylim()[1] for axes in row)
        for axes in row:
            axes.set_ylim(low, high)
            axes.set_xlim(0.0, RELEASE_S)
            axes.set_xticks([0.0, 0.2, 0.4])
