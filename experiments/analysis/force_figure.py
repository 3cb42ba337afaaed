"""Error against force, printed: as `error_against_force` has it, the same on the screen."""

import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from experiments.analysis.charts import View, left_out
from experiments.analysis.error_against_force import (
    ERROR,
    FORCE,
    SMOOTHNESS,
    TITLE,
    Mark,
    diameter,
    halvings,
    joined,
    largest_smoothness,
    marks_of,
    ranges,
    shown_sizes,
)
from experiments.analysis.sheet import (
    CHARACTERS_PER_INCH,
    HATCHES,
    LINE,
    LINE_IN,
    MIDDLE,
    PAGE_IN,
    QUIET,
    SMALL,
    STYLE,
    colour_of,
    new_figure,
    small_print,
)
from experiments.analysis.trials_table import Trials

CIRCLE_PT = 17.0  # the largest diameter
KEY_IN, KEY_CHARACTERS = 2.1, 25  # wide, the key; letters in a line of it


def draw_error_against_force(trials: Trials, note: str, view: View) -> Figure:
    """Median and quartiles of each controller on each device; smoothness is the area of its circle."""
    marks = marks_of(trials, view)
    counts = sorted({mark.error.n for mark in marks})
    often = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}" if counts else "no"
    several = "; a dotted line joins the devices" if len(view.configurations) > 1 else ""
    how = f"Medians and quartiles of {often} trials{several}. Each horizontal line halves the error."
    texts = (how, left_out(trials, view.timeouts), *note.splitlines())
    lines = [line for text in texts for line in textwrap.wrap(text, int((PAGE_IN - 0.75) * CHARACTERS_PER_INCH))]
    height, bottom, right = 4.9, 0.7 + LINE_IN * len(lines), KEY_IN
    with matplotlib.rc_context(STYLE):
        figure = new_figure(PAGE_IN, height)
        place = 0.6, bottom, PAGE_IN - 0.6 - right, height - bottom - 0.45
        axes = figure.add_axes(tuple(np.divide(place, (PAGE_IN, height, PAGE_IN, height))))
        axes.set_title(TITLE, loc="left", pad=10)
        axes.set(xlabel=f"{FORCE.title} ({FORCE.shown_unit})", ylabel=f"{ERROR.title} ({ERROR.shown_unit})")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", color=LINE, linewidth=0.6)
        axes.set_axisbelow(True)
        if marks:
            _draw_marks(axes, marks, view)
        _key_of_marks(figure, marks, view, PAGE_IN - right + 0.25)
        small_print(figure, lines, 0.6)
    return figure


def _draw_marks(axes: Axes, marks: Sequence[Mark], view: View) -> None:
    across, up = ranges(marks)
    axes.set(xlim=across, ylim=up, yscale="log")
    axes.set_yticks(halvings(*up), [f"{value:g}" for value in halvings(*up)])
    axes.yaxis.set_minor_locator(NullLocator())
    largest = largest_smoothness(marks)
    for first, second in joined(marks):
        ends = zip(*((mark.force.median, mark.error.median) for mark in (first, second)), strict=True)
        axes.plot(*ends, ":", color=colour_of(first.controller, view.colours), lw=1.3, zorder=3)
    for mark in marks:
        colour, size = colour_of(mark.controller, view.colours), CIRCLE_PT * diameter(mark.smoothness, largest)
        error, force = mark.error, mark.force
        axes.hlines(error.median, force.q1, force.q3, colour, lw=1.0, zorder=2)
        axes.vlines(force.median, max(error.q1, up[0]), error.q3, colour, lw=1.0, zorder=2)
        face = "white" if mark.look else colour
        body: dict[str, Any] = {"edgecolors": colour, "linewidths": 1.4, "hatch": HATCHES[mark.look]}
        axes.scatter([force.median], [error.median], size**2, face, zorder=4, **body)


def _key_of_marks(figure: Figure, marks: Sequence[Mark], view: View, left_in: float) -> None:
    """Controllers, devices, the sizes of circles, and where it is best, one under the other."""
    width, height = figure.get_size_inches()

    def words(text: str, down_in: float, **look: Any) -> None:
        look = {"fontsize": MIDDLE, "parse_math": False} | look
        figure.text(left_in / width, 1.0 - down_in / height, text, va="baseline", **look)

    def circle(across: float, down_in: float, size: float, face: str, edge: str = QUIET) -> None:
        place = [left_in / width + across / width], [1.0 - (down_in - 0.04) / height]
        figure.add_artist(Line2D(*place, marker="o", ls="", ms=size, mew=1.2, mfc=face, mec=edge))

    down = 0.4
    for controller in dict.fromkeys(mark.controller for mark in marks):
        colour = colour_of(controller, view.colours)
        circle(0.12, down, 8.0, colour, colour)
        words(f"       {textwrap.shorten(view.name(controller), KEY_CHARACTERS, placeholder='…')}", down)
        down += 0.22
    down += 0.18 if marks else 0.0
    if len(view.configurations) > 1:
        words("Device", down, weight="bold")
        for device in view.configurations[: len(HATCHES)]:
            down += 0.22
            circle(0.12, down, 8.0, "white" if view.look(device) else QUIET)
            words(f"       {device}", down)
        down += 0.35
    if largest := largest_smoothness(marks):
        words("Smoothness", down, weight="bold")
        words(f"{SMOOTHNESS.title},", down + 0.17, color=QUIET, fontsize=SMALL)
        words(f"{SMOOTHNESS.shown_unit}; small is smooth", down + 0.31, color=QUIET, fontsize=SMALL)
        down += 0.31
        for value in shown_sizes(largest):
            down += 0.26
            circle(0.12, down, CIRCLE_PT * diameter(value, largest), "white")
            words(f"        {value:g}", down)
        down += 0.38
    words("Best: low and left", down, weight="bold")
    words("little error for little force", down + 0.17, color=QUIET, fontsize=SMALL)
