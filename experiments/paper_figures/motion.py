"""The simulated handle in motion: Fig. 11, and beyond the paper the guard of obstacles and a passive master.

Release: a constant-force spring on the handle, released from rest, each brake locked in turn and none. The paper's
torsional spring is known only as of constant force. Our choice: a force of constant magnitude towards a fixed anchor,
its direction taken anew every millisecond (a force prescribed in time, as the paper's measured one was); brakes by the
full model, Eqs. (1)-(4) and the backlash, the locked one at full current for long before the release.

Stopping distance, what a designer buys a brake by: the guard's bound (`core.control.guard`) over the speed of the
handle, for several pushes that go on all the while, and beside it what the simulator does with a handle that is pushed
straight on, in its worst direction.

Passive master, the paper's future work: a hand on a spring goes into a wall that a delayed slave touches, and holds
there. The brakes show the slave's force by the controller `reflect`; for comparison, a motor would exert it as it is.
The energy that each puts in is the work of its force on the tip.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from core import tick_log as log
from core.control.controllers import make_preset
from core.control.guard import Around, Guard, least_held, make_around, stopping_distance, tick_at
from core.device import Device
from core.mechanism import JOINTS
from core.path import Segment
from core.simulator.hand import new_hand, spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.simulation import Grid, Schedule, Simulation
from core.simulator.stick_slip import FREE, STILL
from core.tick_log import TICK_S
from core.workspace import Array
from experiments.analysis.sheet import (
    BLUE,
    BROWN,
    CM,
    ORANGE,
    PAGE_IN,
    QUIET,
    SHADED,
    TEXT,
    TITLE,
    legend_at,
    plain,
    sheet,
    title,
)
from experiments.numbers import place_cm
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import Workspace, brake_angles, draw_outline, sdof_path, workspace_of
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules
from experiments.slave import Slave
from experiments.trial.trial import Conditions, SimulatedTrial


def _heading(figure: Figure, words: str, handles: Sequence[Any], **legend: Any) -> None:
    """Write the heading of the figure, and under it the legend of all its panels."""
    width, height = figure.get_size_inches()
    figure.text(0.65 / width, 1.0 - 0.28 / height, words, fontsize=TITLE, parse_math=False)
    legend_at(figure, handles, 0.65, 0.36, columnspacing=1.5, **legend)


# ---------------------------------------------------------------------------------------------- spring release, Fig. 11

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
    """Let go at a tip (m), pulled towards the anchor (m), after the locked brake has had its full current for long."""
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
        tip = simulation.state["tip"][0, :2].copy()
    table = np.array(rows)
    return Release(locked, table[:, 0] - HOLD_S, table[:, 1:3])


def places(workspace: Workspace) -> tuple[list[tuple[float, float]], tuple[float, float]]:
    """Where the handle is released (clear of the stops), and the anchor, m."""
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
        title(paths, f"{device.labels[locked]} locked" if locked else "none locked")
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
        lower.set_xlabel("time (s)")
    handles = [
        Line2D([], [], linewidth=1.4, label=f"from {place_cm(start)}", **look)
        for start, look in zip(starts, LOOKS, strict=True)
    ]
    _heading(figure, f"Spring release, {device.name}", handles, handlelength=2.8)
    figure.align_ylabels(grid[:, 0])
    return figure


def _same_frame(row: np.ndarray, tips: Array) -> None:
    """The same centimetres in all panels of tip paths, equal both ways, around all motions."""
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


# ---------------------------------------------------------------------------------------------------- stopping distance

PUSHES_N = {2.0: BLUE, 10.0: BROWN, 18.0: ORANGE}  # the least is not 0: without a push a play is never turned through
SPEEDS_M_S = np.linspace(0.0, 0.6, 13)
STARTING_M_S = 1e-6  # in place of 0: a handle at rest has no direction
SIMULATED_M_S = (0.0, 0.2, 0.4, 0.6)
ANGLES = np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)
MOST_M = 0.15
STOPPED_S = 0.5


def bounds(device: Device, tip: tuple[float, float], push: float, play: bool) -> Array:
    """The guard's bound (m) at each of `SPEEDS_M_S`, in the worst direction of the motion; infinite: it has none."""
    if not play:
        device = replace(device, brakes=device.brakes._replace(play=np.zeros(4)))
    around = make_around(Around(guard=Guard(push_N=push)), device)[0]
    found = [
        max(stopping_distance(around, tick_at(device, tip, (v * math.cos(a), v * math.sin(a)))) for a in ANGLES)
        for v in np.maximum(SPEEDS_M_S, STARTING_M_S)
    ]
    return np.array(found)


def simulated_way(device: Device, tip: tuple[float, float], push: float, speed: float) -> float:
    """How far (m) the simulated handle comes from `speed` (m/s), pushed on in its direction; of all, the worst one."""
    ways = []
    for angle in ANGLES:
        along = np.array([math.cos(angle), math.sin(angle)])
        simulated = pushed(device, tip, play=True)
        simulated.state["tip"][0, 2:] = speed * along
        simulated.state["held"][0] = FREE if speed else STILL
        simulated.hand.grips["held"][0] = push * along
        furthest = 0.0
        for n in range(round(STOPPED_S / 1e-3)):
            simulated.move(simulated.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(tip, simulated.tip))
        ways.append(furthest)
    return max(ways)


def pushed(device: Device, tip: tuple[float, float], play: bool) -> SimulatedDevice:
    """At rest at `tip` (m), brakes off."""
    simulated = SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    if not play:
        simulated.brakes["play"][0] = 0.0
    simulated.settle(np.zeros(4), 0.0)
    return simulated


def draw_stopping(device: Device) -> Figure:
    """Stopping distance over speed, with the play of the brakes and without."""
    workspace = workspace_of(device.mechanism)
    tip = (float(workspace.home[0]), float(workspace.home[1]))
    held = least_held(device.mechanism, device.brakes, np.array([tip]))
    text = (
        f"{parameters_of(device)} Handle at {place_cm(tip)}, where a full lock "
        f"holds {held:.0f} N in any direction: a push of more cannot be stopped. Lines: upper bound of the guard for "
        "a hand that does whatever it wants with no more than that push, brakes off until now, in the worst direction "
        "of its motion; a line ends where the guard cannot be sure any more. Circles: the simulated handle, pushed "
        "straight on, in its worst direction, with the play."
    )
    figure, [axes] = sheet(text, (PAGE_IN, 3.9), (0.65, 0.25, 0.5, 0.95), (1, 2), (0.6, 0.0), sharey=True)
    for panel, play, words in ((axes[0], True, "With the play of the brakes"), (axes[1], False, "Without play")):
        for push, colour in PUSHES_N.items():
            if push >= held:
                continue
            way = 1e3 * bounds(device, tip, push, play)
            panel.plot(SPEEDS_M_S, np.where(np.isfinite(way), way, np.nan), color=colour, label=f"push {push:g} N")
            if play:
                circles = [1e3 * simulated_way(device, tip, push, speed) for speed in SIMULATED_M_S]
                panel.plot(SIMULATED_M_S, circles, "o", color=colour, markersize=4, mfc="white", clip_on=False)
        panel.set(xlabel="speed of the handle (m/s)", xlim=(0.0, SPEEDS_M_S[-1]), ylim=(0.0, 1e3 * MOST_M))
        plain(panel)
        title(panel, words)
    axes[0].set_ylabel("stopping distance (mm)")
    _heading(figure, f"Stopping distance, {device.name}", axes[0].get_legend_handles_labels()[0])
    return figure


# ------------------------------------------------------------------------------------------------------- passive master

DELAYS_S = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
SHOWN_DELAY_S = 0.05
DURATION_S, RISE_S = 2.5, 0.6  # the hand reaches its target after the rise
REACH_M = 0.03  # of the start before the wall, and of the hand's target behind it; less where there is less room
#: Our choice: a hand that holds on.
HAND_N_M, HAND_N_S_M, HAND_MOST_N, HAND_KG = 400.0, 10.0, 40.0, 1.0


class Course(NamedTuple):
    """One contact with the wall; ticks (n,)."""

    rows: Array  # (n, tick_log.WIDTH)
    depth: Array  # of the tip behind the wall, m
    slave: Array  # likewise
    wanted: Array  # force away from the wall that the slave sends, N
    exerted: Array  # force away from the wall on the tip, of brakes or motor, N
    put_in_J: float  # the most energy that brakes or motor have put in, up to any tick

    @property
    def share(self) -> float:
        """Of the wanted force that was exerted."""
        return float(np.sum(self.exerted) / np.sum(self.wanted))


def reach_in(workspace: Workspace) -> float:
    """How far (m) the handle goes before and behind the wall, which stands in the middle of the workspace."""
    return min(REACH_M, 0.4 * workspace.room_at(*workspace.home))


def contact(device: Device, workspace: Workspace, delay_s: float, motor: bool) -> Course:
    """The hand goes from before the wall into it; the slave's force is shown by the brakes, or by a motor instead."""
    x, wall = map(float, workspace.home)
    slave = Slave(wall_at_m=(x, wall), wall_normal=(0.0, -1.0), delay_s=delay_s)
    reach = reach_in(workspace)
    start = x, wall - reach
    stiffness, damping = (HAND_N_M, 0.0, HAND_N_M), (HAND_N_S_M, 0.0, HAND_N_S_M)
    hand = spring_hand(stiffness, damping, HAND_MOST_N, HAND_KG, start)
    preset = make_preset("", "none", {}) if motor else make_preset("", "reflect", {})
    way = Segment(start_m=start, end_m=(x, wall + 1.0))  # never reached
    planned = PlannedTrial(1, 1, device.name, 1, 1, 1)
    trial = SimulatedTrial(
        SimulatedDevice(device, start, hand), planned, Conditions(way, preset, "settled", TrialRules(slave=slave))
    )
    trial.arguments().run["phase"][0] = log.MOVE
    rows = np.empty((round(DURATION_S / TICK_S), log.WIDTH))
    for k in range(len(rows)):
        risen = min(k * TICK_S / RISE_S, 1.0)
        trial.aim(x, start[1] + reach * (1.0 - math.cos(math.pi * risen)))
        trial.run(rows[k : k + 1])
        if motor:
            hand.grips["held"][0] = rows[k, log.WANTED_FX : log.WANTED_FY + 1]
    wanted = rows[:, log.WANTED_FX : log.WANTED_FY + 1]
    exerted = wanted if motor else rows[:, log.SHOWN_FX : log.SHOWN_FY + 1]
    moved = np.diff(rows[:, log.TIP_X : log.TIP_Y + 1], axis=0)
    put_in = np.cumsum(np.sum(exerted[:-1] * moved, axis=1))
    return Course(
        rows, rows[:, log.TIP_Y] - wall, rows[:, log.SLAVE_Y] - wall, -wanted[:, 1], -exerted[:, 1],
        float(max(put_in.max(), 0.0)),
    )  # fmt: skip


def draw_passive_master(device: Device) -> Figure:
    """A contact at one delay, and over the delay what brakes and motor put in and how much of the force they show."""
    workspace = workspace_of(device.mechanism)
    text = (
        f"{parameters_of(device)} Simulation only; hand, slave and wall are our choice. A hand (spring of "
        f"{HAND_N_M:g} N/m, at most {HAND_MOST_N:g} N) goes {1e3 * reach_in(workspace):.0f} mm into a wall that a "
        "slave touches, and holds there. Brakes: controller `reflect`, full brake model. Motor: exerts the force that "
        "arrives as it is, brakes off. Shaded: behind the wall. Put in: "
        "the most that the work of their forces on the tip came to at any time."
    )
    figure, [[course, energy, share]] = sheet(text, (PAGE_IN, 3.9), (0.65, 0.2, 0.5, 0.95), (1, 3), (0.6, 0.0))
    found = {m: [contact(device, workspace, delay, m) for delay in DELAYS_S] for m in (False, True)}
    delays = 1e3 * np.array(DELAYS_S)
    looks = {False: ("brakes", BLUE, "o-"), True: ("motor", ORANGE, "s-")}
    at = DELAYS_S.index(SHOWN_DELAY_S)
    for motor, (name, colour, look) in looks.items():
        shown = found[motor][at]
        t = shown.rows[:, log.T]
        course.plot(t, 1e3 * shown.depth, color=colour, linewidth=1.6, label=f"handle, {name}")
        course.plot(t, 1e3 * shown.slave, color=colour, linewidth=0.9, linestyle=(0, (4, 2)), label=f"slave, {name}")
        energy.plot(delays, [c.put_in_J for c in found[motor]], look, color=colour, markersize=4)
        share.plot(delays, [100.0 * c.share for c in found[motor]], look, color=colour, markersize=4)
    low, high = course.get_ylim()
    course.axhspan(0.0, high, color=SHADED, linewidth=0.0, zorder=0)
    course.set(ylim=(low, high), xlabel="time (s)", ylabel="behind the wall (mm)", xlim=(0.0, DURATION_S))
    energy.set(xlabel="delay, each way (ms)", ylabel="energy put in (J)")
    share.set(xlabel="delay, each way (ms)", ylabel="of the force sent (%)", ylim=(0.0, 108.0))
    titles = f"{1e3 * SHOWN_DELAY_S:g} ms each way", "Energy put in", "Force exerted"
    for axes, words in zip((course, energy, share), titles, strict=True):
        plain(axes)
        title(axes, words)
    _heading(figure, f"Passive master, {device.name}", course.get_legend_handles_labels()[0])
    return figure
