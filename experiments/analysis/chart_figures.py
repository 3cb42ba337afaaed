"""The charts of the pages of results, printed: the same as on the screen, as PNG, SVG and PDF."""

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from core.files import InputError
from experiments.analysis.charts import (
    GROUP_SHARE,
    QUARTILE_METHOD,
    WHISKER,
    Chart,
    PlacedBox,
    View,
    coloured,
    controllers_shown,
    disambiguate_codes,
    left_out,
    legend,
    paths_of,
    pooled,
)
from experiments.analysis.colours import ON_LIGHT, colour_places
from experiments.analysis.error_against_force import NAME
from experiments.analysis.force_figure import draw_error_against_force
from experiments.analysis.metrics import DRAWN, FIGURES, JUDGED, Metric
from experiments.analysis.sheet import (
    CHARACTERS_PER_INCH,
    COLUMN_IN,
    HATCHES,
    LETTER_IN,
    LINE,
    LINE_IN,
    MIDDLE,
    PAGE_IN,
    QUIET,
    SMALL,
    STYLE,
    TEXT,
    colour_of,
    figure_bytes,
    legend_at,
    new_figure,
    small_print,
)
from experiments.analysis.trials_table import StudyData, Trials
from experiments.atomic_files import refuse_existing_files, write_new_files
from experiments.progress import Progress, no_progress

FORMATS = ("png", "svg", "pdf")
PAPER = "paper"  # the protocol whose figures these are
#: Markers of the points of the first path, the second, ...
MARKERS = "o^sDv"
TIMEOUT_COLOUR = "#c47400"
LEAST_WIDTH, BOX_IN, HEIGHT = PAGE_IN, 0.24, 4.8  # inches; a box takes so much of the width
LABEL_IN, LABEL_LINE_IN = 10.5 / 72.0, 0.16  # inches: a line of a controller's name, of the small print
TITLE_LETTER_IN = 0.072  # inches: of a title; about
LEFT_IN, RIGHT_IN, BETWEEN_IN, TOP_IN = 0.6, 0.15, 0.7, 0.72
SLANT_DEG = 60.0  # of names that have no room side by side
UNDER_IN = 0.66  # under a row of panels: two lines of names
POINT_PT2, FILL = 14.0, 0.45  # area of a point, points^2; how much of its colour the body of a box has


class Sizes(NamedTuple):
    """The widths of box plots (inches), and the formats of all measures beside each other."""

    single: float
    side_by_side: float
    forms_beside: Sequence[str] = FORMATS
    grows: bool = False  # with the number of controllers, beyond Table I's five


SCREEN, JOURNAL = "screen", "journal"
#: What figures are for.
SIZES = {SCREEN: Sizes(6.4, 20.0, ("png",), grows=True), JOURNAL: Sizes(COLUMN_IN, PAGE_IN)}


def draw_charts(
    shown: Sequence[Chart],
    trials: Trials,
    folder: Path,
    note: str,
    view: View,
    progress: Progress = no_progress,
) -> list[Path]:
    """Draw each chart of these trials as PNG, SVG and PDF; the paths.

    note: protocol and assumptions, on every figure. progress: called with the share that is drawn. InputError before
    anything is written if a file exists.
    """
    files: dict[Path, bytes] = {}
    for chart in shown:
        figure = chart_figure(chart, trials, note, view)
        for form in FORMATS:
            files[folder / f"{chart.name}.{form}"] = figure_bytes(figure, form)
            progress(len(files) / (len(shown) * len(FORMATS)))
    write_new_files(files)
    return list(files)


def chart_figure(chart: Chart, trials: Trials, note: str, view: View) -> Figure:
    """A figure of one chart, with what a reader must know under it."""
    boxes = len(chart.ticks) * GROUP_SHARE / (2.0 * chart.boxes[0].half) if chart.boxes else 0.0
    width = max(LEAST_WIDTH, BOX_IN * boxes)
    texts = (" ".join(legend(chart, view)), left_out(trials, *view.timeouts_on(chart)), note)
    lines = [line for text in texts for line in textwrap.wrap(text, int((width - 0.75) * CHARACTERS_PER_INCH))]
    bottom = (0.75 + LINE_IN * len(lines)) / HEIGHT
    with matplotlib.rc_context(STYLE):
        figure = new_figure(width, HEIGHT)
        axes = figure.add_axes((0.6 / width, bottom, (width - 0.75) / width, 0.88 - bottom))
        draw_chart(axes, chart)
        named = coloured([chart], view)
        dots = [
            Line2D([], [], marker="o", ls="", color=colour_of(controller, view.colours), label=name)
            for controller, name in named.items()
        ]
        if 0 < len(dots) <= len(ON_LIGHT):  # further ones would begin again, and have no room in a row
            legend_at(
                figure, [*dots, *path_handles([chart])], 0.6, 0.1, fontsize=SMALL, handletextpad=0.0, columnspacing=0.8
            )
        small_print(figure, lines, 0.6)
    return figure


def draw_boxplots(
    data: StudyData,
    out_folder: str | Path,
    *,
    timeouts: bool = False,
    pool: Executor | None = None,
    purpose: str = SCREEN,
) -> list[Path]:
    """Draw every metric as PNG, SVG and PDF, and those of the paper in one wide figure and with a row of panels for
    each path; and error against force. Returns the paths.

    Configurations are drawn as `charts.LOOKS` in the order in which the table first names them. Codes of a blind
    session stand under their boxes as they are.
    Our choice: only the paper's figures bear the numbers of its figures ("fig16_path_error").
    timeouts: trials whose time was up are in the boxes; else they are crosses above them, as the caption explains.
    pool: processes that draw as well. purpose: one of `SIZES`.
    InputError before anything is written if a file exists already or there is nothing to draw.
    """
    folder, trials, note = Path(out_folder), disambiguate_codes(data.trials), data.caption
    configurations, colours = tuple(dict.fromkeys(trials["configuration"])), colour_places(data.controllers)
    view = View(configurations, data.labels, timeouts=timeouts, colours=colours)
    if not len(trials):
        raise InputError(f"{folder}: there are no trials, no box plots to draw")
    sizes = SIZES[purpose]
    more = max(1.0, len(controllers_shown(trials, view.names)) / 5.0) if sizes.grows else 1.0
    given = trials, note, view
    calls: list[tuple] = [(draw_error_against_force, given, _paths(folder, NAME, FORMATS))]
    for metric in (*FIGURES, *data.own):
        name = metric.figure if data.protocol == PAPER else metric.figure.partition("_")[2]
        calls.append((draw, (*given, [metric], sizes.single * more), _paths(folder, name, FORMATS)))
    # a page has room for three: of the two sums the one that does not hang on the cut
    wide = [metric for metric in (*JUDGED, *data.own) if sizes.grows or metric is not DRAWN[-1]]
    beside = *given, wide, sizes.side_by_side * more
    calls.append((draw, beside, _paths(folder, "boxplots", sizes.forms_beside)))
    if len(paths := sorted(set(trials["path"].tolist()))) > 1:
        calls.append((draw, (*beside, paths), _paths(folder, "boxplots_by_path", sizes.forms_beside)))
    refuse_existing_files(path for call in calls for path in call[-1])
    files: dict[Path, bytes] = {}
    for of_sheet in _drawn(calls, pool):
        files |= of_sheet
    write_new_files(files)
    return list(files)


def _paths(folder: Path, name: str, forms: Sequence[str]) -> list[Path]:
    return [folder / f"{name}.{form}" for form in forms]


def _drawn(calls: Sequence[tuple], pool: Executor | None) -> Iterator[dict[Path, bytes]]:
    """The files of each sheet: those that no process of the pool has begun are drawn by this one, the last first."""
    waiting = [pool.submit(_sheet, *call) for call in calls] if pool else []
    mine = {i: _sheet(*calls[i]) for i in reversed(range(len(waiting))) if waiting[i].cancel()}
    for i, call in enumerate(calls):
        yield mine[i] if i in mine else waiting[i].result() if waiting else _sheet(*call)


def _sheet(drawing: Callable[..., Figure], given: Sequence[Any], paths: Sequence[Path]) -> dict[Path, bytes]:
    """One figure as its files."""
    figure = drawing(*given)
    return {path: figure_bytes(figure, path.suffix[1:]) for path in paths}


def draw(
    trials: Trials, note: str, view: View, metrics: Sequence[Metric], width_in: float, paths: Sequence[int] = ()
) -> Figure:
    """One figure with a panel for each metric; paths: a row of panels for each of these, of its trials alone."""
    shown = controllers_shown(trials, view.names)
    found = [[pooled(trials, metric, view) for metric in metrics]]
    if paths:
        of_paths = [(f", path {path}", trials[trials["path"] == path]) for path in paths]
        found = [
            [
                pooled(part, metric, view)._replace(title=f"{metric.title}{name}", reach=whole.highest)
                for metric, whole in zip(metrics, found[0], strict=True)
            ]
            for name, part in of_paths
        ]
    every = [chart for row in found for chart in row]
    inside = width_in - LEFT_IN - RIGHT_IN
    each = (inside - BETWEEN_IN * (len(metrics) - 1)) / len(metrics)
    lines_of_names = [name.splitlines() for name in shown.values()]
    names = max(map(len, lines_of_names), default=0)
    longest = LETTER_IN * max((len(line) for lines in lines_of_names for line in lines), default=0)
    slanted = longest > each / max(len(shown), 1)
    # what names need besides two lines
    room = longest * math.sin(math.radians(SLANT_DEG)) - LABEL_IN if slanted else LABEL_IN * max(0, names - 2)
    top = TOP_IN + LABEL_IN * max(title_of(chart, each).count("\n") for chart in every)
    counts = {placed.box.n for chart in every for placed in chart.boxes}
    texts = (_method(counts), left_out(trials, view.timeouts), *note.splitlines())
    lines = [line for text in texts for line in textwrap.wrap(text, int(inside * CHARACTERS_PER_INCH))]
    bottom = UNDER_IN + LABEL_LINE_IN * len(lines) + room
    high = min(4.5, 0.6 * each + 2.6) + room - top - bottom  # of a panel
    step = high + UNDER_IN + room + top - 0.25  # from a row to the one under it
    width, height = width_in, top + high + bottom + step * (len(found) - 1)
    with matplotlib.rc_context(STYLE):
        figure = new_figure(width, height)
        for at, chart in enumerate(every):
            down, across = divmod(at, len(metrics))
            place = (LEFT_IN + across * (each + BETWEEN_IN), height - top - high - down * step, each, high)
            axes = figure.add_axes(tuple(np.divide(place, (width, height, width, height))))
            _draw_panel(axes, chart, show_counts=len(counts) > 1, slanted=slanted)
        handles = [*device_handles(view), *([] if paths else path_handles(every))]
        if handles:
            narrow = (
                {"fontsize": SMALL, "columnspacing": 0.8, "handletextpad": 0.4}
                if width_in < PAGE_IN / 2.0 + 1.0
                else {}
            )
            legend_at(figure, handles, LEFT_IN, 0.12, handlelength=1.4, **narrow)
        small_print(figure, lines, LEFT_IN, line_in=LABEL_LINE_IN)
    return figure


def device_handles(view: View) -> list[Patch]:
    """How the boxes of each device are drawn, for a legend; of one device there is nothing to tell."""
    if len(view.configurations) < 2:
        return []
    handles = [Patch(edgecolor=QUIET, label=name, linewidth=1.2) for name in view.configurations]
    for patch, look in zip(handles, map(view.look, view.configurations), strict=True):
        patch.set(facecolor="white" if look else QUIET, hatch=HATCHES[look])
    return handles


def path_handles(shown: Sequence[Chart]) -> list[Line2D]:
    """The marker of each path, for a legend; of one path there is nothing to tell, and more have no room."""
    paths = paths_of(shown)
    if not 1 < len(paths) <= len(MARKERS):
        return []
    return [
        Line2D([], [], marker=marker_of(path), ls="", mfc="white", mec=QUIET, ms=5.0, label=f"path {path}")
        for path in paths
    ]


def marker_of(path: int) -> str:
    """The marker of a path's points; that of the sixth path is as the first's."""
    return MARKERS[(path - 1) % len(MARKERS)]


def _method(counts: set[int]) -> str:
    """How the boxes are drawn, for the caption; counts: their numbers of trials."""
    if counts == {1}:
        return "1 trial per box: its point alone."
    trials = f"{min(counts)} trials per box" if len(counts) == 1 else "Under each box: the number of its trials"
    return (
        f"{trials}, each a point. Line: median. Box: quartiles (NumPy's '{QUARTILE_METHOD}' method). "
        f"Whiskers: furthest trial within {WHISKER:g} box lengths."
    )


def _draw_panel(axes: Axes, chart: Chart, show_counts: bool, slanted: bool) -> None:
    """One metric's boxes on `axes`: a group for each controller, a box for each configuration."""
    below = 24 if show_counts else 15  # points

    def under(x: float, text: str, points: float, **look: Any) -> None:
        axes.annotate(
            text, (x, 0.0), (0, -points), ("data", "axes fraction"), "offset points", **{"ha": "center"} | look
        )

    draw_chart(axes, chart)
    axes.set(xticks=[])
    for placed in chart.boxes if show_counts else ():
        under(placed.x, f"{placed.box.n}", 4, va="top", fontsize=SMALL, color=QUIET)
    for x, name in chart.ticks:
        if slanted:
            under(x, name, below - 9, ha="right", va="top", rotation=SLANT_DEG, rotation_mode="anchor", fontsize=SMALL)
            continue
        for j, line in enumerate(name.splitlines()):  # line by line: a tick label's lines shift with their letters
            under(x, line, below + 72.0 * LABEL_IN * j, va="baseline")


def draw_chart(axes: Axes, chart: Chart) -> None:
    for placed in chart.boxes:
        if placed.box.n > 1:  # else its point says all
            draw_box(axes, placed, colour_of(placed.controller, chart.colours))
    for controller, look, path in {(p.controller, p.look, p.row and p.row.path): None for p in chart.points}:
        group = [p for p in chart.points if (p.controller, p.look, p.row and p.row.path) == (controller, look, path)]
        colour = colour_of(controller, chart.colours)
        marker = marker_of(path) if path else "o"
        face, edge = ("white", colour) if look else (colour, "white")
        size = max(POINT_PT2 / math.sqrt(max(1.0, len(group) / 20.0)), 4.0)
        shape: dict[str, Any] = {"marker": marker, "edgecolors": edge, "linewidths": 0.6, "zorder": 5}
        axes.scatter([p.x for p in group], [p.y for p in group], size, face, **shape)
    axes.scatter([p.x for p in chart.others], [p.y for p in chart.others], 16.0, QUIET, marker="+", zorder=5)
    above = axes.get_xaxis_transform()
    late = [p.x for p in chart.timeouts]
    axes.scatter(late, [1.02] * len(late), 25.0, TIMEOUT_COLOUR, marker="x", transform=above, clip_on=False)
    if chart.curve:
        axes.plot(*zip(*chart.curve, strict=True), color=TEXT, linewidth=1.2, zorder=6)
    if chart.logarithmic:
        axes.set_yscale("log")
    else:
        axes.set_ylim(1.06 * chart.lowest, 1.06 * chart.highest or (0.0 if chart.lowest else 1.0))
        axes.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axes.set_xlim(*chart.span)
    if chart.ticks:
        axes.set_xticks([x for x, _ in chart.ticks], [text for _, text in chart.ticks], fontsize=MIDDLE)
    axes.set_xlabel(chart.x_title)
    axes.grid(axis="y", color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    title = title_of(chart, axes.get_position().width * axes.figure.get_figure(root=True).get_figwidth())
    axes.set_title(title, loc="left", pad=14)


def title_of(chart: Chart, width_in: float) -> str:
    """The title of a chart with its unit, broken to fit over axes of this width."""
    return textwrap.fill(
        f"{chart.title} ({chart.scale})" if chart.scale else chart.title, max(12, int(width_in / TITLE_LETTER_IN))
    )


def draw_box(axes: Axes, placed: PlacedBox, colour: str) -> None:
    """The box of several trials; their points are drawn over it."""
    box, x, width = placed.box, placed.x, 2.0 * placed.half
    face = "white" if placed.look else shade_of(colour)
    body: dict[str, Any] = {"facecolor": face, "edgecolor": colour, "hatch": HATCHES[placed.look], "linewidth": 1.3}
    axes.bar(x, box.q3 - box.q1, width, box.q1, zorder=3, **body)
    axes.vlines([x, x], [box.low, box.q3], [box.q1, box.high], colors=colour, linewidth=1.2, zorder=2)
    axes.hlines([box.low, box.high], x - width / 4, x + width / 4, colors=colour, linewidth=1.2, zorder=2)
    seen: dict[str, Any] = {"linewidth": 1.6, "path_effects": [withStroke(linewidth=2.8, foreground="white")]}
    axes.hlines(box.median, x - width / 2, x + width / 2, colors=TEXT, zorder=4, **seen)


def shade_of(colour: str) -> tuple[float, float, float]:
    """A colour in which its own points and the median can be seen."""
    red, green, blue = to_rgb(colour)
    return tuple(FILL * part + 1.0 - FILL for part in (red, green, blue))  # type: ignore[return-value]
