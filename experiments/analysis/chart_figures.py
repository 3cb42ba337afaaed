"""The charts of the pages of results, printed: what is seen on the screen as PNG, SVG and PDF."""

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from experiments.analysis.charts import GROUP_SHARE, Box, Chart, View, coloured, left_out, legend
from experiments.analysis.sheet import (
    CHARACTERS_PER_INCH,
    LINE,
    LINE_IN,
    QUIET,
    STYLE,
    TEXT,
    figure_bytes,
    legend_at,
    new_figure,
    small_print,
)
from experiments.analysis.trials_table import TrialRow
from experiments.recording.atomic_files import write_new_files

FORMATS = ("png", "svg", "pdf")
#: Of Table I's five, again from the first for further ones. The screen's palette, darker where it would fade on white
#: paper; place and label tell them apart without colour. A code has no colour of a controller.
CONTROLLER_COLOURS = ("#6f7b87", "#d98200", "#c9a11a", "#2f7fc4", "#6cb0e6")
TIMEOUT_COLOUR = "#c47400"
LEAST_WIDTH, BOX_IN, HEIGHT = 6.4, 0.24, 4.8  # inches; a box takes so much of the width


def draw_charts(
    shown: Sequence[Chart],
    rows: Sequence[TrialRow],
    folder: Path,
    note: str,
    view: View,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Path]:
    """Each chart of these rows as PNG, SVG and PDF; the paths. note: what was used, it stands on every figure.

    progress: called with the share that is drawn. InputError before anything is written if a file exists.
    """
    files: dict[Path, bytes] = {}
    for chart in shown:
        figure = chart_figure(chart, rows, note, view)
        for form in FORMATS:
            files[folder / f"{chart.name}.{form}"] = figure_bytes(figure, form)
            progress(len(files) / (len(shown) * len(FORMATS)))
    write_new_files(files)
    return list(files)


def chart_figure(chart: Chart, rows: Sequence[TrialRow], note: str, view: View) -> Figure:
    """A figure of one chart, with what a reader must know under it."""
    boxes = len(chart.ticks) * GROUP_SHARE / (2.0 * chart.boxes[0].half) if chart.boxes else 0.0
    width = max(LEAST_WIDTH, BOX_IN * boxes)
    texts = (" ".join(legend(chart, view)), left_out(rows, *view.timeouts_on(chart)), note)
    lines = [line for text in texts for line in textwrap.wrap(text, int((width - 0.75) * CHARACTERS_PER_INCH))]
    bottom = (0.75 + LINE_IN * len(lines)) / HEIGHT
    with matplotlib.rc_context(STYLE):
        figure = new_figure(width, HEIGHT)
        axes = figure.add_axes((0.6 / width, bottom, (width - 0.75) / width, 0.88 - bottom))
        draw_chart(axes, chart, view.logarithmic)
        named = coloured([chart], view)
        dots = [Line2D([], [], marker="o", ls="", color=colour_of(one), label=name) for one, name in named.items()]
        if 0 < len(dots) <= len(CONTROLLER_COLOURS):  # further ones would begin again, and have no room in a row
            legend_at(figure, dots, 0.6, 0.1, fontsize=7.0, handletextpad=0.0, columnspacing=0.8)
        small_print(figure, lines, 0.6)
    return figure


def draw_chart(axes: Axes, chart: Chart, logarithmic: bool = False) -> None:
    """One chart on `axes`."""
    for at in chart.boxes:
        box = at.box._replace(outliers=()) if chart.points else at.box  # they are among the points
        draw_box(axes, box, at.x, 2.0 * at.half, colour_of(at.controller), at.look)
    for controller, look in {(point.controller, point.look): None for point in chart.points}:
        of_it = [p for p in chart.points if (p.controller, p.look) == (controller, look)]
        colour = colour_of(controller)
        face = colour if look == 0 and not chart.boxes else "white"  # else boxes would swallow it
        axes.scatter([p.x for p in of_it], [p.y for p in of_it], 9.0, face, edgecolors=colour, linewidths=0.8, zorder=5)
    axes.scatter([p.x for p in chart.others], [p.y for p in chart.others], 16.0, QUIET, marker="+", zorder=5)
    above = axes.get_xaxis_transform()
    late = [p.x for p in chart.timeouts]
    axes.scatter(late, [1.02] * len(late), 25.0, TIMEOUT_COLOUR, marker="x", transform=above, clip_on=False)
    if chart.curve:
        axes.plot(*zip(*chart.curve, strict=True), color=TEXT, linewidth=1.2, zorder=6)
    if logarithmic:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0.0, 1.06 * chart.highest or 1.0)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axes.set_xlim(*chart.span)
    if chart.ticks:
        axes.set_xticks([x for x, _ in chart.ticks], [text for _, text in chart.ticks], fontsize=8.0)
    axes.set_xlabel(chart.x_title)
    axes.grid(axis="y", color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(f"{chart.title} ({chart.unit})", loc="left", fontsize=10.5, pad=14)


def colour_of(controller: int | str) -> str:
    """Table I's five colours, which begin again for further controllers; a code has none of its own."""
    return QUIET if isinstance(controller, str) else CONTROLLER_COLOURS[(controller - 1) % len(CONTROLLER_COLOURS)]


#: As `charts.LOOKS`.
HATCHES = ("", "", "/////", ".....")


def draw_box(axes: Axes, box: Box, x: float, width: float, colour: str, look: int) -> None:
    """Our choice: one trial, whose box would be a line and neither filled nor open, is a square that is."""
    face = "white" if look else colour
    mark: dict[str, Any]
    if box.n == 1:
        mark = {"markerfacecolor": face, "markeredgecolor": colour, "markeredgewidth": 1.3, "zorder": 4}
        axes.plot([x], [box.median], "s", markersize=7.0, **mark)
        return
    body: dict[str, Any] = {"facecolor": face, "edgecolor": colour, "hatch": HATCHES[look], "linewidth": 1.3}
    axes.bar(x, box.q3 - box.q1, width, box.q1, zorder=3, **body)
    axes.vlines([x, x], [box.low, box.q3], [box.q1, box.high], colors=colour, linewidth=1.2, zorder=2)
    axes.hlines([box.low, box.high], x - width / 4, x + width / 4, colors=colour, linewidth=1.2, zorder=2)
    axes.hlines(box.median, x - width / 2, x + width / 2, colors=TEXT, linewidth=1.8, zorder=4)
    if box.outliers:
        mark = {"markerfacecolor": "none", "markeredgecolor": colour, "markeredgewidth": 1.1, "zorder": 3}
        axes.plot([x] * len(box.outliers), box.outliers, "o", markersize=4.0, **mark)
