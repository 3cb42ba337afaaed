"""Figs. 4 and 5: the paths that single locked brakes leave (SDOF paths), over the workspace within the hard stops."""

import math
from typing import Any, NamedTuple

import numpy as np
from contourpy import contour_generator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from core.device import Device
from core.mechanism import JOINTS, Mechanism
from core.workspace import Array, arm_pose, free_tips, in_turn_of, joint_angles, sines
from experiments.analysis.colours import ON_LIGHT
from experiments.analysis.sheet import CM, MIDDLE, PAGE_IN, QUIET, TEXT, legend_at, plain, sheet, title
from experiments.paper_figures.brake import parameters_of

#: Joint -> colour and line; a print without colour tells the lines apart.
JOINT_COLOURS = dict(zip("AEBC", ON_LIGHT.joints, strict=True))
JOINT_LINES = {"A": "-", "E": (0, (6, 1.5)), "B": (0, (6, 1.5, 1, 1.5)), "C": (0, (1.5, 1.2))}
GRID = 301  # points each way of a map: 2 to 3 mm
CIRCLE_POINTS = 2881  # of an SDOF path: 1/8 degree apart
SPACING_DEG = 15.0  # between the locked angles of neighbouring SDOF paths
PAD_M = 0.03  # around a workspace
BELOW_BASES_M = 0.075  # of a plot that shows the bases
HOME_PULL = 0.05  # 1/m; among tips equally far from the stops the one in front of the bases is home
Y_UNIT_M = 0.1  # y > 0 counts as a stop too: this far above it, no other stop is further away


class Workspace(NamedTuple):
    """The tips within the hard stops: those on one side of the singular positions (the larger part)."""

    mechanism: Mechanism
    side: float  # sign of the sine from distal link ED to CD
    x: Array  # (n,) m
    y: Array  # (n,) m
    room: Array  # (n, n), > 0 inside; rows are y
    home: tuple[float, float]  # m, the tip furthest from all stops, in front of the bases
    tips: Array  # (m, 2) m, spread over it, however thin it is

    def room_at(self, x: float, y: float) -> float:
        """`room` of one tip."""
        return float(room(self.mechanism, self.side, np.array(x), np.array(y)))

    def bottom(self, bases: bool) -> float:
        """y (m) of the lower edge of a plot, with the bases or without."""
        arms = self.mechanism.arm_1, self.mechanism.arm_2
        return float(min([self.y[0], *(arm.base_y - BELOW_BASES_M for arm in arms if bases)]))

    def height_in(self, width_in: float, bases: bool = True) -> float:
        """Height of a plot with equal axes, of its width."""
        return float(width_in * (self.y[-1] - self.bottom(bases)) / (self.x[-1] - self.x[0]))


def brake_angles(mechanism: Mechanism, x: Array, y: Array) -> Array:
    """Angles (4, ...), rad, on which the brakes act: of their joints, or of their couplings, up to whole turns."""
    angles = joint_angles(mechanism, x, y)
    coupled = [i for i in range(4) if mechanism.coupled >> i & 1]
    angles[coupled] = np.tensordot(mechanism.combination[coupled], angles[[0, 2]], axes=1)
    return angles


def room(mechanism: Mechanism, side: float, x: Array, y: Array) -> Array:
    """How far tips are from the nearest stop, in units of sine (theta stops: rad; y: 10 cm); negative outside."""
    elbow_1, elbow_2, between = map(np.nan_to_num, sines(mechanism, x, y))
    least = np.minimum(np.minimum(np.abs(elbow_1), np.abs(elbow_2)), side * between) - mechanism.margin
    least = np.minimum(least, y / Y_UNIT_M)
    if mechanism.has_theta_stops:
        stops = zip(joint_angles(mechanism, x, y), mechanism.theta_low, mechanism.theta_high, strict=True)
        for theta, low, high in stops:
            if math.isfinite(low):
                theta = in_turn_of(theta, low, high)
                least = np.minimum(least, np.nan_to_num(np.minimum(theta - low, high - theta), nan=-1.0))
    return least


def workspace_of(mechanism: Mechanism) -> Workspace:
    """The workspace of a mechanism, on a grid of `GRID` by `GRID` tips."""
    tips = free_tips(mechanism)
    between = sines(mechanism, *tips.T)[2]
    side = 1.0 if np.count_nonzero(between > 0.0) * 2 >= len(tips) else -1.0
    tips = tips[between * side > 0.0]
    x, y = np.linspace(tips.min(axis=0) - PAD_M, tips.max(axis=0) + PAD_M, GRID).T
    off_centre = np.abs(tips[:, 0] - 0.5 * (mechanism.arm_1.base_x + mechanism.arm_2.base_x))
    home = tips[np.argmax(room(mechanism, side, *tips.T) - HOME_PULL * off_centre)]
    return Workspace(mechanism, side, x, y, room(mechanism, side, *np.meshgrid(x, y)), (home[0], home[1]), tips)


def sdof_path(workspace: Workspace, joint: str, angle: float) -> Array:
    """Tips (n, 2), m, at which the brake of `joint` has an angle (rad), in the order of travel; NaN: outside the stops.

    With A or B locked the tip turns about elbow E or C, with E or C locked about base A or B. With a coupling locked:
    a contour of its angle.
    """
    mechanism = workspace.mechanism
    if mechanism.coupled >> JOINTS.index(joint) & 1:
        turned = brake_angles(mechanism, *np.meshgrid(workspace.x, workspace.y))[JOINTS.index(joint)] - angle
        off = turned - 2.0 * math.pi * np.round(turned / (2.0 * math.pi))
        near = (workspace.room > 0.0) & (np.abs(off) < 0.5 * math.pi)
        lines = contour_generator(workspace.x, workspace.y, np.ma.masked_where(~near, off)).lines(0.0)
        return np.concatenate([*(part for line in lines for part in (line, [[np.nan, np.nan]])), np.empty((0, 2))])
    arm = mechanism.arm_1 if joint in "AE" else mechanism.arm_2
    cx, cy, radius = arm.base_x, arm.base_y, arm.length_2
    if joint in "AB":
        cx, cy = cx + arm.length_1 * math.cos(angle), cy + arm.length_1 * math.sin(angle)
    else:
        proximal, distal = arm.length_1, arm.length_2
        radius = math.sqrt(proximal**2 + distal**2 + 2.0 * proximal * distal * math.cos(angle))
    turn = np.linspace(-math.pi, math.pi, CIRCLE_POINTS) - 0.5 * math.pi  # begins behind the bases
    x, y = cx + radius * np.cos(turn), cy + radius * np.sin(turn)
    off = joint_angles(mechanism, x, y)[JOINTS.index(joint)] - angle
    on_path = np.abs(np.sin(0.5 * off)) < 1e-6  # the other elbow solution lies on the same circle
    on_path &= room(mechanism, workspace.side, x, y) > 0.0
    return np.where(on_path[:, None], np.column_stack((x, y)), np.nan)


def sdof_family(workspace: Workspace, joint: str, spacing: float) -> list[Array]:
    """The SDOF paths of a joint at all multiples of `spacing` (rad) that it takes in the workspace."""
    theta = brake_angles(workspace.mechanism, *workspace.tips.T)[JOINTS.index(joint)]
    numbers = range(math.ceil(theta.min() / spacing), math.floor(theta.max() / spacing) + 1)
    paths = (sdof_path(workspace, joint, k * spacing) for k in numbers)
    return [path for path in paths if np.any(np.isfinite(path))]


def draw_outline(axes: Axes, workspace: Workspace) -> None:
    """The hard stops' limit of the workspace, in cm."""
    axes.contour(CM * workspace.x, CM * workspace.y, workspace.room, levels=[0.0], colors=[QUIET], linewidths=[1.0])


def in_cm(axes: Axes, workspace: Workspace, bases: bool = True) -> None:
    """Equal axes in cm around a workspace, and around the bases where they are shown."""
    x, y = CM * workspace.x, CM * workspace.y
    axes.set(xlim=(x[0], x[-1]), ylim=(CM * workspace.bottom(bases), y[-1]), aspect="equal")
    axes.set(xlabel="x (cm)", ylabel="y (cm)")


def _draw_linkage(axes: Axes, mechanism: Mechanism, tip: tuple[float, float]) -> None:
    """The links with the tip somewhere (m), in cm."""
    for arm, base, elbow in ((mechanism.arm_1, "A", "E"), (mechanism.arm_2, "B", "C")):
        pose = arm_pose(arm, np.array(tip[0]), np.array(tip[1]))
        at = np.array([[arm.base_x, arm.base_y], [arm.base_x + pose.e1[0], arm.base_y + pose.e1[1]], tip]) * CM
        axes.plot(at[:, 0], at[:, 1], "-", color=TEXT, linewidth=2.2, alpha=0.75, zorder=5, solid_capstyle="round")
        axes.plot(at[:, 0], at[:, 1], "o", color=TEXT, markersize=5, markerfacecolor="white", zorder=6)
        if not mechanism.coaxial:
            _letter(axes, base, at[0], (-12 if base == "A" else 12, -2))
        elif base == "A":
            _letter(axes, "A, B", at[0], (0, -11))
        _letter(axes, elbow, at[1], (-11 * arm.side, 2))
    _letter(axes, "D", CM * np.array(tip), (0, 12))


def _letter(axes: Axes, letter: str, at: Array, offset: tuple[float, float]) -> None:
    box = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none"}
    axes.annotate(letter, tuple(at), offset, textcoords="offset points", ha="center", va="center", zorder=7, bbox=box)


def draw_sdof_paths(device: Device) -> Figure:
    """Figs. 4 and 5 for any device."""
    workspace = workspace_of(device.mechanism)
    text = (
        f"{parameters_of(device)} Each line: the tip's path with one brake locked, every {SPACING_DEG:g}° of its "
        "angle. Grey: the limit set by the hard stops. Black: the linkage, tip D."
    )
    left, right = 0.6, 0.15
    size = PAGE_IN, workspace.height_in(PAGE_IN - left - right)
    figure, [[axes]] = sheet(text, size, (left, right, 0.5, 0.6), inside=True)
    plain(axes, grid=False)
    handles = []
    for joint in device.braked:
        look: dict[str, Any] = {"color": JOINT_COLOURS[joint], "linestyle": JOINT_LINES[joint]}
        for path in sdof_family(workspace, joint, math.radians(SPACING_DEG)):
            axes.plot(CM * path[:, 0], CM * path[:, 1], linewidth=1.0, **look)
        about = f", about {dict(A='E', B='C', E='A', C='B')[joint]}" if device.labels[joint] == joint else ""
        handles.append(Line2D([], [], linewidth=1.6, label=f"{device.labels[joint]} locked{about}", **look))
    draw_outline(axes, workspace)
    _draw_linkage(axes, device.mechanism, workspace.home)
    in_cm(axes, workspace)
    title(axes, f"SDOF paths, {device.name}")
    legend_at(figure, handles, left, 0.1, handlelength=2.4, columnspacing=1.0, fontsize=MIDDLE)
    return figure
