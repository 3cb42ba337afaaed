"""Figs. 12 to 14: the desired directions around a path, and how SDOF and proportional velocity control choose a brake.

Drawn from what the controllers' own functions return.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Wedge

from core.control.proportional import force_direction, in_beta, influence, priority
from core.control.rule_sets import SETTLED
from core.control.sdof import nearest_valid_brake, sdof_direction, valid_sense
from core.control.velocity_field import Field, Seen, desired_direction, field_at, new_memory
from core.device import Device
from core.linkage import tip_force_map
from core.mechanism import JOINTS
from core.path import BLEND_WIDTH_M, line
from core.workspace import Array
from experiments.analysis.sheet import (
    BLUE,
    CM,
    ORANGE,
    PAGE_IN,
    QUIET,
    SHADED,
    TEXT,
    TITLE,
    Place,
    arrow,
    plain,
    sheet,
    title,
)
from experiments.numbers import place_cm
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import JOINT_COLOURS, workspace_of

PATH_Y_M, HALF_WIDTH_M, HALF_HEIGHT_M = 0.40, 0.14, 0.10
APART_M = 0.02  # between arrows
PUSH_N = 5.0  # hand force along the path
DESIRED = TEXT
TURN = 2.0 * math.pi


def draw_velocity_field() -> Figure:
    """Fig. 12: the field of the line y = 40 cm for a hand that pushes towards +x."""
    text = (
        "Directions only. Shaded: the 5 cm boundary, within which the direction is blended linearly (its angle) from "
        "straight to the path to along it. The sense along the path is that of the hand force, here to the right."
    )
    figure, [[axes]] = sheet(text, (PAGE_IN, 5.6), (0.6, 0.5, 0.5, 0.75))
    plain(axes, grid=False)
    axes.axhspan(CM * (PATH_Y_M - BLEND_WIDTH_M), CM * (PATH_Y_M + BLEND_WIDTH_M), color=SHADED, linewidth=0)
    axes.axhline(CM * PATH_Y_M, color=ORANGE, linewidth=2.0, zorder=3)
    path = line((-HALF_WIDTH_M, PATH_Y_M), (HALF_WIDTH_M, PATH_Y_M))
    columns = np.arange(-HALF_WIDTH_M, HALF_WIDTH_M + 0.5 * APART_M, APART_M)
    rows = np.arange(PATH_Y_M - HALF_HEIGHT_M, PATH_Y_M + HALF_HEIGHT_M + 0.25 * APART_M, 0.5 * APART_M)
    tips = [(float(x), float(y)) for x in columns for y in rows]
    fields = [field_at(path, new_memory(), Seen(*tip, 0.0, 0.0, PUSH_N, 0.0), SETTLED) for tip in tips]
    beta = np.array([(field.beta_x, field.beta_y) for field in fields])
    axes.quiver(
        *(CM * np.array(tips).T), *beta.T, angles="xy", scale_units="xy", scale=1.0 / 0.9, pivot="mid", width=0.0026,
        headwidth=4.5, headlength=5.5, headaxislength=5.0, color=TEXT, zorder=4,
    )  # fmt: skip
    low, high = CM * (PATH_Y_M - HALF_HEIGHT_M), CM * (PATH_Y_M + HALF_HEIGHT_M)
    axes.set(xlim=(-CM * HALF_WIDTH_M - 1.5, CM * HALF_WIDTH_M + 1.5), ylim=(low - 1.0, high + 1.0), aspect="equal")
    axes.set(xlabel="x (cm)", ylabel="y (cm)", yticks=np.arange(30.0, 51.0, 5.0))
    title(axes, "Velocity field of the path y = 40 cm")
    arrow(axes, (6.5, high + 2.6), (10.0, high + 2.6), BLUE)
    axes.text(10.5, high + 2.6, "hand force", va="center", color=BLUE)
    axes.text(CM * HALF_WIDTH_M + 1.8, CM * PATH_Y_M, "path", color=ORANGE, va="center")
    return figure


class SdofChoice(NamedTuple):
    """A tip beside a path, and the brake that SDOF control chooses there."""

    tip: tuple[float, float]  # m
    alpha: float  # rad, direction of the path
    field: Field
    directions: dict[str, tuple[float, float]]  # local SDOF path of each brake, one of its two senses
    senses: dict[str, float]  # +1 or -1 where valid in that sense, else 0
    selected: str  # letter of the brake, empty if none is valid


def sdof_choice(device: Device, tip: tuple[float, float], alpha: float, distance: float) -> SdofChoice:
    """The choice for a tip (m) at a signed distance (m, left positive) from a line of direction alpha (rad)."""
    t = math.cos(alpha), math.sin(alpha)
    foot = tip[0] + distance * t[1], tip[1] - distance * t[0]
    path = line(foot, (foot[0] + 0.1 * t[0], foot[1] + 0.1 * t[1]))
    seen = Seen(*tip, 0.0, 0.0, PUSH_N * t[0], PUSH_N * t[1])
    field = field_at(path, new_memory(), seen, SETTLED)
    g = np.zeros((4, 2))
    tip_force_map(device.mechanism, *tip, g)
    directions = {joint: sdof_direction(*g[JOINTS.index(joint)]) for joint in device.braked}
    senses = {joint: valid_sense(*p, field, SETTLED.span_rounding) for joint, p in directions.items()}
    chosen = nearest_valid_brake(device.brakes, g, field, SETTLED)
    return SdofChoice(tip, alpha, field, directions, senses, JOINTS[chosen] if chosen >= 0 else "")


def clearest_choice(device: Device) -> SdofChoice:
    """The clearest choice among some tips and paths: if possible two valid brakes, and lines well apart."""
    workspace = workspace_of(device.mechanism)
    shifts = itertools.product((-0.08, -0.05, -0.02, 0.0, 0.02, 0.05, 0.08), (-0.06, -0.03, 0.0))
    tips = [(workspace.home[0] + dx, workspace.home[1] + dy) for dx, dy in shifts]
    paths = list(itertools.product(range(15, 51, 5), (-0.030, -0.026, -0.022, -0.018)))
    choices = (
        sdof_choice(device, tip, math.radians(alpha_deg), distance)
        for tip in tips if workspace.room_at(*tip) > 0.0
        for alpha_deg, distance in paths
    )  # fmt: skip
    return max(choices, key=_clearness)


def _clearness(choice: SdofChoice) -> float:
    """Smallest angle (rad) between any two arrows of the picture, less a penalty for other than two valid brakes."""
    field = choice.field
    drawn = [(field.t_x, field.t_y), (field.n_x, field.n_y), (field.beta_x, field.beta_y), (-field.t_x, -field.t_y)]
    drawn += [(sense * x, sense * y) for x, y in choice.directions.values() for sense in (1.0, -1.0)]
    angles = np.sort(np.mod([math.atan2(y, x) for x, y in drawn], TURN))
    apart = np.diff(angles, append=angles[0] + TURN).min()
    valid = sum(sense != 0.0 for sense in choice.senses.values())
    return float(apart) - 10.0 * abs(valid - 2) - (0.0 if choice.selected else 100.0)


def _polar(radius: float, angle: float) -> tuple[float, float]:
    return radius * math.cos(angle), radius * math.sin(angle)


def _beside(axes: Axes, text: str, place: Place, colour: str = TEXT, **more: Any) -> None:
    axes.text(place[0], place[1], text, ha="center", va="center", color=colour, **more)


def _schematic(text: str, height_in: float, words: str) -> tuple[Figure, Axes]:
    """A sheet with one drawing, without scales; words: its title."""
    figure, [[axes]] = sheet(text, (PAGE_IN, height_in), (0.1, 0.1, 0.1, 0.4))
    title(axes, words)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, axes


def draw_sdof_choice(device: Device) -> Figure:
    """Fig. 13, at a tip of the device."""
    choice = clearest_choice(device)
    field = choice.field
    text = (
        f"{parameters_of(device)} Tip at {place_cm(choice.tip, 1)}, "
        f"{100 * field.distance:.1f} cm from a path at α = {math.degrees(choice.alpha):.0f}°. Lines p: the local SDOF "
        "path of each brake, at right angles to its force. Valid (solid, with arrow): within the 90° from the path's "
        "direction t to n, towards the path (shaded). Selected: the valid one nearest the desired velocity."
    )
    figure, axes = _schematic(text, 5.9, f"SDOF velocity control, {device.name}")
    t, n = math.atan2(field.t_y, field.t_x), math.atan2(field.n_y, field.n_x)
    beta = math.atan2(field.beta_y, field.beta_x)
    span = math.remainder(n - t, TURN)
    begin, end = sorted((math.degrees(t), math.degrees(t + span)))
    axes.add_patch(Wedge((0, 0), 1.0, begin, end, facecolor=SHADED, edgecolor="none"))
    _draw_path(axes, field, t, choice.alpha)
    for angle, letter in ((t, "t"), (n, "n")):
        arrow(axes, (0, 0), _polar(0.62, angle), QUIET, 1.2)
        _beside(axes, f"${letter}$", _polar(0.69, angle), QUIET)
    for joint, p in choice.directions.items():
        _draw_sdof_line(axes, joint, device.labels[joint], p, choice.senses[joint], joint == choice.selected)
    arrow(axes, (0, 0), _polar(0.85, beta), DESIRED, 2.6)
    _beside(axes, r"$v_{des}$", _polar(0.94, beta), DESIRED, fontsize=TITLE)
    axes.plot([0, 0.4], [0, 0], color=QUIET, linewidth=0.8, linestyle=(0, (2, 2)))
    low, high = sorted((0.0, math.degrees(beta)))
    axes.add_patch(Arc((0, 0), 0.6, 0.6, theta1=low, theta2=high, color=DESIRED, linewidth=1.2))
    _beside(axes, r"$\beta$", _polar(0.37, 0.3 * beta), DESIRED)
    axes.plot(0, 0, "o", color=TEXT, markersize=7, zorder=8)
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.22, 1.22))
    return figure


def _draw_path(axes: Axes, field: Field, t: float, alpha: float) -> None:
    """The path at its distance (one unit is 5 cm, the boundary) and its angle alpha."""
    away = field.distance / BLEND_WIDTH_M
    along, across = np.array([field.t_x, field.t_y]), np.array([field.n_x, field.n_y])
    corner, far = (away * across + s * along for s in (-1.25, 0.8))
    axes.plot(*zip(corner, far, strict=True), color=TEXT, linewidth=2.4, zorder=2)
    x, y = away * across - 0.92 * along + 0.07 * across
    axes.text(
        x, y, "desired path", rotation=math.degrees(t),
        rotation_mode="anchor", ha="center", va="bottom", zorder=4,
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"},
    )  # fmt: skip
    axes.plot([corner[0], corner[0] + 0.45], [corner[1]] * 2, color=QUIET, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.add_patch(Arc(tuple(corner), 0.6, 0.6, theta1=0.0, theta2=math.degrees(alpha), color=TEXT, linewidth=1.2))
    _beside(axes, r"$\alpha$", corner + _polar(0.37, 0.5 * alpha))


def _draw_sdof_line(axes: Axes, joint: str, label: str, p: tuple[float, float], sense: float, selected: bool) -> None:
    colour = JOINT_COLOURS[joint]
    dashed: dict[str, Any] = {"color": colour, "linewidth": 1.2, "linestyle": (0, (4, 3)), "zorder": 3}
    if sense == 0.0:
        axes.plot([-p[0], p[0]], [-p[1], p[1]], **dashed)
        up = 1.08 * math.copysign(1.0, p[1])
        _beside(axes, f"$p_{{{label}}}$", (up * p[0], up * p[1]), colour)
        return
    x, y = sense * p[0], sense * p[1]
    axes.plot([-x, 0], [-y, 0], **dashed)
    arrow(axes, (0, 0), (x, y), colour, 2.6 if selected else 1.6)
    word = "selected" if selected else "valid"
    _beside(axes, f"$p_{{{label}}}$\n{word}", (1.14 * x, 1.12 * y), colour, linespacing=1.1)


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
    """The five forces of Fig. 14 through the functions of proportional control."""
    n = (-math.sin(math.radians(EXAMPLE_BETA_DEG)), math.cos(math.radians(EXAMPLE_BETA_DEG)))
    t = (n[1], -n[0])
    field = Field(0.0, *t, *n, *desired_direction(0.0, *n, *t, BLEND_WIDTH_M))
    v = _polar(0.1, math.radians(EXAMPLE_BETA_DEG + EXAMPLE_VELOCITY_DEG))
    v_beta = in_beta(*v, field)
    pulls = [_polar(4.0, math.radians(EXAMPLE_BETA_DEG + degrees)) for degrees in EXAMPLE_FORCES_DEG]
    directions = [force_direction(*g, math.copysign(1.0, g[0] * v[0] + g[1] * v[1])) for g in pulls]
    in_field = [in_beta(*force, field) for force in directions]
    columns = [influence(*force, *v_beta, SETTLED.no_effect, SETTLED.along_beta) for force in in_field]
    ranks = [priority(*column) for column in columns]
    selected = max(range(len(ranks)), key=lambda i: (ranks[i], in_field[i][0]))
    return Forces(field, v, v_beta, np.array(directions), np.array(columns).T, ranks, selected)


def draw_five_forces() -> Figure:
    """Fig. 14, with the example of Eq. (14)."""
    example = five_forces()
    text = (
        "Schematic; directions, H and the choice are what the controller's functions return. Dotted: the normal to v; "
        "a brake's force lies on its far side from v. Beside each force its column of H, Eq. (14): does it increase "
        "(1), decrease (−1) or leave (0) the size of the component of v along and across the desired velocity. Taken "
        "first: [1 −1], then [0 −1], then [−1 −1]; others never."
    )
    figure, axes = _schematic(text, 6.1, "Proportional velocity control")
    along = np.array([example.field.beta_x, example.field.beta_y])
    beta, direction = math.atan2(along[1], along[0]), math.atan2(example.v[1], example.v[0])
    for angle, letter in ((beta, r"$x_\beta$"), (beta + 0.5 * math.pi, r"$y_\beta$")):
        axes.plot(*zip(_polar(-0.35, angle), (0, 0), strict=True), color=QUIET, linewidth=0.8)
        arrow(axes, (0, 0), _polar(1.12, angle), QUIET, 1.0)
        _beside(axes, letter, _polar(1.2, angle), QUIET)
    across = direction + 0.5 * math.pi
    normal = zip(_polar(1.1, across), _polar(-1.1, across), strict=True)
    axes.plot(*normal, color=TEXT, linewidth=1.3, linestyle=(0, (1, 2)))
    scale = 0.85 / math.hypot(*example.v)
    tip_v = scale * np.array(example.v)
    on_x = scale * example.v_beta[0] * along
    arrow(axes, (0, 0), 0.95 * along, DESIRED, 3.4)
    _beside(axes, r"$v_{des}$", 0.9 * along + (0.05, -0.11), DESIRED, fontsize=TITLE)
    parts = ((on_x, r"$v_{\beta x}$", (0.02, -0.1)), (tip_v - on_x, r"$v_{\beta y}$", (-0.13, 0.0)))
    for part, letter, shift in parts:
        axes.plot(*zip(tip_v, part, strict=True), color=BLUE, linewidth=0.9, linestyle=(0, (4, 3)), zorder=2)
        arrow(axes, (0, 0), part, BLUE, 1.4)
        _beside(axes, letter, part + shift, BLUE, fontsize=TITLE)
    arrow(axes, (0, 0), tip_v, BLUE, 2.6)
    _beside(axes, "$v$", _polar(0.93, direction), BLUE, fontsize=TITLE)
    for i, force in enumerate(example.directions):
        chosen = i == example.selected
        colour = ORANGE if chosen else TEXT if example.ranks[i] else QUIET
        arrow(axes, (0, 0), 0.8 * force, colour, 2.6 if chosen else 1.6)
        h_x, h_y = example.influence[:, i]
        word = {3: "selected" if chosen else "first", 2: "second", 1: "third", 0: "never"}[example.ranks[i]]
        place = (1.08 * force[0], 1.02 * force[1] - (0.06 if force[1] < -0.5 else 0.0))
        _beside(axes, f"$F_{i + 1}$  $[{h_x}\\ {h_y}]^T$\n{word}", place, colour, linespacing=1.3)
    axes.plot(0, 0, "o", color=TEXT, markersize=7, zorder=8)
    axes.set(xlim=(-1.42, 1.32), ylim=(-1.25, 1.25))
    return figure
