"""Figs. 13 and 14: how SDOF and proportional velocity control choose a brake, drawn from what the kernels return."""

import itertools
import math
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Wedge

from core.control.proportional import force_direction, in_beta, influence, priority
from core.control.rule_sets import SETTLED
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import BLEND_WIDTH, Field, desired_direction, field_at, new_memory
from core.device import Device
from core.linkage import tip_force_map
from core.mechanism import JOINTS
from core.path import line
from core.workspace import Array
from experiments.analysis.figures import QUIET, TEXT, new_figure
from experiments.paper_figures.sheet import JOINT_COLOURS, arrow, panels, parameters_of, small_print, title
from experiments.paper_figures.workspace import workspace_of

PATH, DESIRED, VELOCITY = "#1c2228", "#b07d00", "#0072b2"


class SdofChoice(NamedTuple):
    """A tip beside a path, and what SDOF control makes of it."""

    tip: tuple[float, float]  # m
    alpha: float  # rad, direction of the path
    field: Field
    directions: dict[str, tuple[float, float]]  # local SDOF path of each brake, one of its two senses
    senses: dict[str, float]  # +1 or -1 where valid in that sense, else 0
    selected: str  # letter of the brake, empty if none is valid


def sdof_choice(device: Device, tip: tuple[float, float], alpha: float, distance: float) -> SdofChoice:
    """The choice for a tip (m) at a signed distance (m, left positive) from a path in direction alpha (rad)."""
    t = math.cos(alpha), math.sin(alpha)
    foot = tip[0] + distance * t[1], tip[1] - distance * t[0]
    path = line(foot, (foot[0] + 0.1 * t[0], foot[1] + 0.1 * t[1]))
    field = field_at(path, new_memory(), *tip, 0.0, 0.0, 5.0 * t[0], 5.0 * t[1], BLEND_WIDTH, SETTLED)
    g = np.zeros((4, 2))
    tip_force_map(device.mechanism, *tip, g)
    directions = {joint: sdof_direction(*g[JOINTS.index(joint)]) for joint in device.braked}
    senses = {joint: valid_sense(*p, field, SETTLED.span_rounding) for joint, p in directions.items()}
    chosen = nearest_valid_brake(device.brakes, g, field, SETTLED)
    return SdofChoice(tip, alpha, field, directions, senses, JOINTS[chosen] if chosen >= 0 else "")


def clearest_choice(device: Device) -> SdofChoice:
    """Of a set of tips and paths the one that is best to read: two valid brakes if it can be, lines well apart."""
    workspace = workspace_of(device.mechanism)
    home = workspace.home
    best, clearest = -math.inf, None
    for dx, dy in itertools.product((-0.08, -0.05, -0.02, 0.0, 0.02, 0.05, 0.08), (-0.06, -0.03, 0.0)):
        tip = home[0] + dx, home[1] + dy
        if workspace.room_at(*map(np.array, tip)) <= 0.0:
            continue
        for alpha_deg, distance in itertools.product(range(15, 51, 5), (-0.030, -0.026, -0.022, -0.018)):
            choice = sdof_choice(device, tip, math.radians(alpha_deg), distance)
            score = _clearness(choice)
            if score > best:
                best, clearest = score, choice
    assert clearest is not None
    return clearest


def _clearness(choice: SdofChoice) -> float:
    """Smallest angle (rad) between any two arrows of the picture, less a penalty for other than two valid brakes."""
    field = choice.field
    drawn = ((field.t_x, field.t_y), (field.n_x, field.n_y), (field.beta_x, field.beta_y))
    angles = [math.atan2(y, x) for x, y in drawn]
    angles.append(angles[0] + math.pi)
    for x, y in choice.directions.values():
        angles += [math.atan2(y, x), math.atan2(-y, -x)]
    sorted_angles = np.sort(np.mod(angles, 2.0 * math.pi))
    apart = np.diff(sorted_angles, append=sorted_angles[0] + 2.0 * math.pi).min()
    valid = sum(sense != 0.0 for sense in choice.senses.values())
    return float(apart) - 10.0 * abs(valid - 2) - (0.0 if choice.selected else 100.0)


def _polar(radius: float, angle: float) -> tuple[float, float]:
    return radius * math.cos(angle), radius * math.sin(angle)


def _beside(axes: Axes, text: str, at: tuple[float, float], colour: str = TEXT, **more) -> None:
    axes.text(*at, text, ha="center", va="center", color=colour, **more)


def draw_sdof_choice(device: Device) -> Figure:
    """Fig. 13, at a tip of the device."""
    choice = clearest_choice(device)
    field = choice.field
    figure = new_figure(6.0, 5.9)
    foot = small_print(
        figure,
        f"{parameters_of(device)} Tip at ({100 * choice.tip[0]:.1f}, {100 * choice.tip[1]:.1f}) cm, "
        f"{100 * field.distance:.1f} cm from a path at α = {math.degrees(choice.alpha):.0f}°. Lines p: the local SDOF "
        "path of each brake, at right angles to its force. Valid (solid, with arrow): within the 90° from the path's "
        "direction t to n, towards the path (shaded). Selected: the valid one nearest the desired velocity.",
    )
    axes = panels(figure, 1, 1, (0.1, 0.1, foot + 0.1, 0.4))[0, 0]
    title(axes, f"SDOF velocity control, {device.name}")
    t, n = math.atan2(field.t_y, field.t_x), math.atan2(field.n_y, field.n_x)
    beta = math.atan2(field.beta_y, field.beta_x)
    span = math.remainder(n - t, 2.0 * math.pi)
    begin, end = sorted((math.degrees(t), math.degrees(t + span)))
    axes.add_patch(Wedge((0, 0), 1.0, begin, end, facecolor="#e7ebef", edgecolor="none"))
    # the path, at its distance: one unit is 5 cm, the boundary
    away = field.distance / BLEND_WIDTH
    ends = [(away * field.n_x + s * field.t_x, away * field.n_y + s * field.t_y) for s in (-1.25, 0.8)]
    axes.plot(*zip(*ends, strict=True), color=PATH, linewidth=2.4, zorder=2)
    along, beside = -0.55, 0.07
    place = (
        away * field.n_x + along * field.t_x + beside * field.n_x,
        away * field.n_y + along * field.t_y + beside * field.n_y,
    )
    axes.text(
        *place, "desired path", rotation=math.degrees(t), rotation_mode="anchor", ha="center", va="bottom", zorder=4,
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"},
    )  # fmt: skip
    _draw_alpha(axes, ends[0], choice.alpha)
    for angle, letter in ((t, "t"), (n, "n")):
        arrow(axes, (0, 0), _polar(0.62, angle), QUIET, 1.2)
        _beside(axes, f"${letter}$", _polar(0.69, angle), QUIET)
    for joint, p in choice.directions.items():
        _draw_sdof_line(axes, joint, p, choice.senses[joint], joint == choice.selected)
    arrow(axes, (0, 0), _polar(0.85, beta), DESIRED, 2.6)
    _beside(axes, r"$v_{des}$", _polar(0.94, beta), DESIRED, fontsize=11)
    axes.plot([0, 0.4], [0, 0], color=QUIET, linewidth=0.8, linestyle=(0, (2, 2)))
    low, high = sorted((0.0, math.degrees(beta)))
    axes.add_patch(Arc((0, 0), 0.6, 0.6, theta1=low, theta2=high, color=DESIRED, linewidth=1.2))
    _beside(axes, r"$\beta$", _polar(0.37, 0.3 * beta), DESIRED)
    axes.plot(0, 0, "o", color=TEXT, markersize=7, zorder=8)
    axes.set_xlim(-1.35, 1.35)
    axes.set_ylim(-1.22, 1.22)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure


def _draw_alpha(axes: Axes, corner: tuple[float, float], alpha: float) -> None:
    axes.plot([corner[0], corner[0] + 0.45], [corner[1]] * 2, color=QUIET, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.add_patch(Arc(corner, 0.6, 0.6, theta1=0.0, theta2=math.degrees(alpha), color=PATH, linewidth=1.2))
    x, y = _polar(0.37, 0.5 * alpha)
    _beside(axes, r"$\alpha$", (corner[0] + x, corner[1] + y))


def _draw_sdof_line(axes: Axes, joint: str, p: tuple[float, float], sense: float, selected: bool) -> None:
    colour = JOINT_COLOURS[joint]
    dashed = {"color": colour, "linewidth": 1.2, "linestyle": (0, (4, 3)), "zorder": 3}
    if sense == 0.0:
        axes.plot([-p[0], p[0]], [-p[1], p[1]], **dashed)
        up = p if p[1] > 0.0 else (-p[0], -p[1])
        _beside(axes, f"$p_{joint}$", (1.08 * up[0], 1.08 * up[1]), colour)
        return
    x, y = sense * p[0], sense * p[1]
    axes.plot([-x, 0], [-y, 0], **dashed)
    arrow(axes, (0, 0), (x, y), colour, 2.6 if selected else 1.6)
    word = "selected" if selected else "valid"
    _beside(axes, f"$p_{joint}$\n{word}", (1.14 * x, 1.12 * y), colour, linespacing=1.1)


class Forces(NamedTuple):
    """The example of Fig. 14: five brakes pulling on a moving tip."""

    field: Field
    v: tuple[float, float]  # m/s
    v_beta: tuple[float, float]  # m/s, along and across beta
    directions: Array  # (5, 2), unit vectors, Eq. (13)
    influence: Array  # (2, 5), H of Eq. (14)
    ranks: list[int]  # 3: taken first ... 0: never
    selected: int  # place of the brake that is actuated, 0 .. 4


EXAMPLE_BETA_DEG = 20.0
EXAMPLE_VELOCITY_DEG = 40.0  # from beta
#: Force directions from beta, degrees, in the order of the columns of Eq. (14); our choice of angles.
EXAMPLE_FORCES_DEG = (-66.0, -90.0, -135.0, 180.0, 148.0)


def five_forces() -> Forces:
    """The five forces of Fig. 14 through the kernels of proportional control."""
    n = (-math.sin(math.radians(EXAMPLE_BETA_DEG)), math.cos(math.radians(EXAMPLE_BETA_DEG)))
    t = (n[1], -n[0])
    field = Field(0.0, *t, *n, *desired_direction(0.0, *n, *t, BLEND_WIDTH))
    v = _polar(0.1, math.radians(EXAMPLE_BETA_DEG + EXAMPLE_VELOCITY_DEG))
    v_beta = in_beta(*v, field)
    directions, columns, ranks = [], [], []
    for degrees in EXAMPLE_FORCES_DEG:
        g = _polar(4.0, math.radians(EXAMPLE_BETA_DEG + degrees))
        sense = math.copysign(1.0, g[0] * v[0] + g[1] * v[1])
        force = force_direction(*g, sense)
        column = influence(*in_beta(*force, field), *v_beta, SETTLED.no_effect, SETTLED.along_beta)
        directions.append(force)
        columns.append(column)
        ranks.append(priority(*column))
    along = [in_beta(*force, field)[0] for force in directions]
    selected = max(range(len(ranks)), key=lambda i: (ranks[i], along[i]))
    return Forces(field, v, v_beta, np.array(directions), np.array(columns).T, ranks, selected)


def draw_five_forces() -> Figure:
    """Fig. 14, with the example of Eq. (14)."""
    example = five_forces()
    figure = new_figure(6.0, 6.1)
    foot = small_print(
        figure,
        "Schematic; directions, H and the choice are what the controller's functions return. Dotted: the normal to v; "
        "a brake's force lies on its far side from v. Beside each force its column of H, Eq. (14): does it increase "
        "(1), decrease (−1) or leave (0) the size of the component of v along and across the desired velocity. Taken "
        "first: [1 −1], then [0 −1], then [−1 −1]; others never.",
    )
    axes = panels(figure, 1, 1, (0.1, 0.1, foot + 0.1, 0.4))[0, 0]
    title(axes, "Proportional velocity control")
    bx, by = example.field.beta_x, example.field.beta_y
    beta = math.atan2(by, bx)
    direction = math.atan2(example.v[1], example.v[0])
    for angle, letter in ((beta, r"$x_\beta$"), (beta + 0.5 * math.pi, r"$y_\beta$")):
        axes.plot([-0.35 * math.cos(angle), 0], [-0.35 * math.sin(angle), 0], color=QUIET, linewidth=0.8)
        arrow(axes, (0, 0), _polar(1.12, angle), QUIET, 1.0)
        _beside(axes, letter, _polar(1.2, angle), QUIET)
    across = direction + 0.5 * math.pi
    axes.plot(
        *zip(_polar(1.1, across), _polar(-1.1, across), strict=True), color=TEXT, linewidth=1.3,
        linestyle=(0, (1, 2)),
    )  # fmt: skip
    scale = 0.85 / math.hypot(*example.v)
    tip_v = (scale * example.v[0], scale * example.v[1])
    on_x = (scale * example.v_beta[0] * bx, scale * example.v_beta[0] * by)
    on_y = (tip_v[0] - on_x[0], tip_v[1] - on_x[1])
    arrow(axes, (0, 0), (0.95 * bx, 0.95 * by), DESIRED, 3.4)
    _beside(axes, r"$v_{des}$", (0.9 * bx + 0.05, 0.9 * by - 0.11), DESIRED, fontsize=11)
    for foot_point, letter, shift in ((on_x, r"$v_{\beta x}$", (0.02, -0.1)), (on_y, r"$v_{\beta y}$", (-0.13, 0.0))):
        axes.plot(*zip(tip_v, foot_point, strict=True), color=VELOCITY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=2)
        arrow(axes, (0, 0), foot_point, VELOCITY, 1.4)
        _beside(axes, letter, (foot_point[0] + shift[0], foot_point[1] + shift[1]), VELOCITY, fontsize=10)
    arrow(axes, (0, 0), tip_v, VELOCITY, 2.6)
    _beside(axes, "$v$", _polar(0.93, direction), VELOCITY, fontsize=12)
    for i, force in enumerate(example.directions):
        chosen = i == example.selected
        colour = "#d55e00" if chosen else TEXT if example.ranks[i] else QUIET
        arrow(axes, (0, 0), (0.8 * force[0], 0.8 * force[1]), colour, 2.6 if chosen else 1.6)
        h_x, h_y = example.influence[:, i]
        word = {3: "selected" if chosen else "first", 2: "second", 1: "third", 0: "never"}[example.ranks[i]]
        place = (1.08 * force[0], 1.02 * force[1] - (0.06 if force[1] < -0.5 else 0.0))
        _beside(axes, f"$F_{i + 1}$  $[{h_x}\\ {h_y}]^T$\n{word}", place, colour, linespacing=1.3)
    axes.plot(0, 0, "o", color=TEXT, markersize=7, zorder=8)
    axes.set_xlim(-1.42, 1.32)
    axes.set_ylim(-1.25, 1.25)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure
