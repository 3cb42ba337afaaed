"""Fig. 12: the field of desired directions around the line y = 40 cm."""

import numpy as np
from matplotlib.figure import Figure

from core.control.rule_sets import SETTLED
from core.control.velocity_field import BLEND_WIDTH, Field, field_at, new_memory
from core.path import line
from core.workspace import Array
from experiments.analysis.figures import TEXT, new_figure
from experiments.paper_figures.sheet import CM, arrow, panels, plain, small_print, title

PATH_Y_M, HALF_WIDTH_M, HALF_HEIGHT_M = 0.40, 0.14, 0.10
APART_M = 0.02  # between arrows
PUSH_N = 5.0  # hand force along the path, towards +x


def field_towards_right(x: float, y: float) -> Field:
    """The field of the line y = 40 cm at a tip (m), for a hand that pushes towards +x."""
    path = line((-HALF_WIDTH_M, PATH_Y_M), (HALF_WIDTH_M, PATH_Y_M))
    return field_at(path, new_memory(), x, y, 0.0, 0.0, PUSH_N, 0.0, BLEND_WIDTH, SETTLED)


def desired_directions() -> tuple[Array, Array]:
    """Tips (n, 2), m, on a grid, and the unit vectors beta (n, 2) there."""
    columns = np.arange(-HALF_WIDTH_M, HALF_WIDTH_M + 0.5 * APART_M, APART_M)
    rows = np.arange(PATH_Y_M - HALF_HEIGHT_M, PATH_Y_M + HALF_HEIGHT_M + 0.25 * APART_M, 0.5 * APART_M)
    tips = np.array([(x, y) for x in columns for y in rows])
    fields = [field_towards_right(float(x), float(y)) for x, y in tips]
    return tips, np.array([(field.beta_x, field.beta_y) for field in fields])


def draw_velocity_field() -> Figure:
    """Fig. 12."""
    figure = new_figure(6.4, 5.3)
    foot = small_print(
        figure,
        "Directions only. Shaded: the 5 cm boundary, within which the direction is blended linearly (its angle) from "
        "straight to the path to along it. The sense along the path is that of the hand force, here to the right.",
    )
    axes = panels(figure, 1, 1, (0.6, 0.5, foot + 0.5, 0.75))[0, 0]
    plain(axes, grid=False)
    low, high = CM * (PATH_Y_M - BLEND_WIDTH), CM * (PATH_Y_M + BLEND_WIDTH)
    axes.axhspan(low, high, color="#e7ebef", linewidth=0)
    axes.axhline(CM * PATH_Y_M, color="#d55e00", linewidth=2.0, zorder=3)
    tips, beta = desired_directions()
    axes.quiver(
        CM * tips[:, 0], CM * tips[:, 1], beta[:, 0], beta[:, 1], angles="xy", scale_units="xy", scale=1.0 / 0.9,
        pivot="mid", width=0.0026, headwidth=4.5, headlength=5.5, headaxislength=5.0, color=TEXT, zorder=4,
    )  # fmt: skip
    axes.set_xlim(-CM * HALF_WIDTH_M - 1.5, CM * HALF_WIDTH_M + 1.5)
    axes.set_ylim(CM * (PATH_Y_M - HALF_HEIGHT_M) - 1.0, CM * (PATH_Y_M + HALF_HEIGHT_M) + 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel("x (cm)")
    axes.set_ylabel("y (cm)")
    title(axes, "Velocity field of the path y = 40 cm")
    top = CM * (PATH_Y_M + HALF_HEIGHT_M) + 2.6
    arrow(axes, (6.5, top), (10.0, top), "#0072b2")
    axes.text(10.5, top, "hand force", va="center", color="#0072b2")
    axes.text(CM * HALF_WIDTH_M + 1.8, CM * PATH_Y_M, "path", color="#d55e00", va="center")
    axes.set_yticks(np.arange(30.0, 51.0, 5.0))
    return figure
