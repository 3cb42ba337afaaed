"""Box plots of a study, as Figs. 16 to 18 of the paper: each controller, or its code, in each configuration."""

import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from core.files import InputError
from experiments.analysis.charts import QUARTILE_METHOD, WHISKER, Box, box_statistics, controllers_shown, left_out
from experiments.analysis.metrics import DRAWN, FIGURES, Metric
from experiments.analysis.sheet import (
    CHARACTERS_PER_INCH,
    LINE,
    QUIET,
    SMALL,
    STYLE,
    TEXT,
    figure_bytes,
    legend_at,
    new_figure,
    small_print,
)
from experiments.analysis.trials_table import TrialRow, by_controller, to_compare
from experiments.recording.atomic_files import refuse_existing_files, write_new_files

FORMATS = ("png", "svg", "pdf")
PAPER = "paper"  # the protocol whose figures these are
LABEL_IN, LINE_IN = 10.5 / 72.0, 0.16  # inches: a line of a controller's name, of the small print
LEFT_IN, RIGHT_IN, BETWEEN_IN, TOP_IN = 0.6, 0.15, 0.7, 0.72
#: Controller -> its name under a box; Table I of the paper.
CONTROLLER_LABELS = {
    1: "None",
    2: "SDOF",
    3: "SDOF,\ngap",
    4: "Proportional,\nhigh gain",
    5: "Proportional,\nlow gain",
}
#: Of Table I's five, again from the first for further ones. The screen's palette, darker where it would fade on white
#: paper; place and label tell them apart without colour. A code has no colour of a controller.
CONTROLLER_COLOURS = ("#6f7b87", "#d98200", "#c9a11a", "#2f7fc4", "#6cb0e6")
TIMEOUT_COLOUR = "#c47400"


Boxes = dict[tuple[int | str, str], Box]  # by controller and configuration


def boxes(
    rows: Iterable[TrialRow], column: str, configurations: Sequence[str], scale: float = 1.0, timeouts: bool = False
) -> Boxes:
    """(controller, configuration) -> its box, over all participants and segments; none where there is no value.

    timeouts: trials whose time was up are in the boxes as well, each with the value that it has.
    """
    groups: dict[tuple[int | str, str], list[float]] = {}
    for row in to_compare(rows, timeouts):
        value = getattr(row, column)
        if value is not None and row.configuration in configurations:
            groups.setdefault((row.controller, row.configuration), []).append(scale * value)
    return {key: box_statistics(groups[key]) for key in sorted(groups, key=in_order)}


def in_order(key: tuple[int | str, str]) -> tuple:
    """Sorts (controller, configuration)."""
    return by_controller(key[0]), key[1]


def draw_boxplots(
    rows: Sequence[TrialRow],
    out_folder: str | Path,
    note: str,
    configurations: Sequence[str] | None = None,
    metrics: Sequence[Metric] = FIGURES,
    labels: Mapping[int, str] = CONTROLLER_LABELS,
    progress: Callable[[float], None] = lambda share: None,
    protocol: str = PAPER,
    timeouts: bool = False,
) -> list[Path]:
    """Draw every metric as PNG, SVG and PDF, and those of the paper in one wide PNG; returns the paths.

    note: what was used, as "settled rules, low gain 5 N s/m, parameters assumed"; it stands on every figure.
    configurations: the first is drawn filled, the second open; by default as the table first names them.
    labels: controller -> what stands under its box; codes of a blind session stand under theirs as they are.
    protocol: its name. Our choice: only the paper's figures bear the numbers of its figures ("fig16_path_error").
    timeouts: trials whose time was up are in the boxes; else they are crosses above them, as the caption explains.
    progress: called with the share that is drawn; whatever it raises ends the work before anything is written.
    InputError before anything is written if a file exists already or there is nothing to draw.
    """
    folder = Path(out_folder)
    configurations = tuple(configurations or dict.fromkeys(row.configuration for row in rows))
    if not configurations:
        raise InputError(f"{folder}: there are no trials, no box plots to draw")
    sheets = []
    for metric in metrics:
        name = metric.figure if protocol == PAPER else metric.figure.partition("_")[2]
        sheets.append(([metric], 6.4, [folder / f"{name}.{form}" for form in FORMATS]))
    papers = [metric for metric in metrics if metric in DRAWN]
    sheets.append((papers, 5.0 * len(papers), [folder / "boxplots.png"]))
    paths = [path for _, _, of_it in sheets for path in of_it]
    refuse_existing_files(paths)
    drawn: dict[Path, bytes] = {}
    for shown, width, of_it in sheets:
        figure = draw(rows, shown, width, note, configurations, labels, timeouts)
        for path in of_it:
            progress(len(drawn) / len(paths))
            drawn[path] = figure_bytes(figure, path.suffix[1:])
    progress(1.0)
    write_new_files(drawn)
    return paths


def draw(
    rows: Sequence[TrialRow],
    metrics: Sequence[Metric],
    width_in: float,
    note: str,
    configurations: Sequence[str],
    labels: Mapping[int, str],
    timeouts: bool = False,
) -> Figure:
    """One figure with a panel for each metric; more than five controllers make it wider."""
    shown = controllers_shown(rows, labels)
    names = max((len(name.splitlines()) for name in shown.values()), default=0)
    room = LABEL_IN * max(0, names - 2)  # what names of more than two lines need besides
    width, height = width_in * max(1.0, len(shown) / 5.0), 4.5 + room
    inside = width - LEFT_IN - RIGHT_IN
    found = [boxes(rows, metric.name, configurations, metric.scale, timeouts) for metric in metrics]
    counts = {box.count for panel in found for box in panel.values()}
    late = Counter((row.controller, row.configuration) for row in rows if row.status == "timeout" and not timeouts)
    texts = (_method(counts), left_out(rows, timeouts), *note.splitlines())
    lines = [line for text in texts for line in textwrap.wrap(text, int(inside * CHARACTERS_PER_INCH))]
    bottom = 0.66 + LINE_IN * len(lines) + room
    each = (inside - BETWEEN_IN * (len(metrics) - 1)) / len(metrics)
    with matplotlib.rc_context(STYLE):
        figure = new_figure(width, height)
        for i, metric in enumerate(metrics):
            place = (LEFT_IN + i * (each + BETWEEN_IN), bottom, each, height - TOP_IN - bottom)
            axes = figure.add_axes(tuple(np.divide(place, (width, height, width, height))))
            _draw_panel(axes, found[i], late, metric, configurations, shown, show_counts=len(counts) > 1)
        if len(configurations) > 1:
            handles = [
                Patch(facecolor="white" if i else QUIET, edgecolor=QUIET, label=name, linewidth=1.2)
                for i, name in enumerate(configurations)
            ]
            legend_at(figure, handles, LEFT_IN, 0.12, handlelength=1.4)
        small_print(figure, lines, LEFT_IN, line_in=LINE_IN)
    return figure


def _method(counts: set[int]) -> str:
    """What a reader must know about the boxes, which hold these numbers of trials."""
    if counts == {1}:
        return "1 trial a box, drawn as a square."
    trials = f"{min(counts)} trials a box." if len(counts) == 1 else "Under each box: the number of its trials."
    single = "A square: one trial alone. " if 1 in counts else ""
    return (
        f"{trials} {single}Line: median. Box: quartiles (NumPy's '{QUARTILE_METHOD}' method). "
        f"Whiskers: furthest trial within {WHISKER:g} box lengths. Circles: trials beyond."
    )


def _draw_panel(
    axes: Axes,
    found: Boxes,
    late: Mapping[tuple[int | str, str], int],
    metric: Metric,
    configurations: Sequence[str],
    shown: Mapping[int | str, str],
    show_counts: bool,
) -> None:
    """One metric's boxes on `axes`: a group for each controller, a box for each configuration.

    late: how many trials timed out, each a cross above the scale, beside each other where there are several.
    """

    def under(x: float, text: str, points: float, **look) -> None:
        axes.annotate(text, (x, 0.0), (0, -points), ("data", "axes fraction"), "offset points", ha="center", **look)

    def place(controller: int | str, configuration: str) -> float:
        """The middle of a box, along the axis of controllers."""
        from_middle = configurations.index(configuration) - (len(configurations) - 1) / 2
        return controllers.index(controller) + from_middle * (width + 0.08)

    controllers = list(shown)
    width = 0.62 / len(configurations)
    for (controller, configuration), box in found.items():
        x = place(controller, configuration)
        draw_box(axes, box, x, width, colour_of(controller), filled=configuration == configurations[0])
        if show_counts:
            under(x, f"{box.count}", 4, va="top", fontsize=SMALL, color=QUIET)
    for cell, count in late.items():
        for n in range(count):
            axes.plot(
                [place(*cell) + 0.06 * ((n + 1) // 2) * (-1) ** n], [1.015], "x", clip_on=False, markersize=5.0,
                markeredgewidth=1.3, markeredgecolor=TIMEOUT_COLOUR, transform=axes.get_xaxis_transform(),
            )  # fmt: skip
    for i, name in enumerate(shown.values()):
        for j, line in enumerate(name.splitlines()):  # line by line: a tick label's lines shift with their letters
            under(i, line, (24 if show_counts else 15) + 72.0 * LABEL_IN * j, va="baseline", fontsize=8.0)
    highest = max((max(box.high, *box.outliers, box.q3) for box in found.values()), default=0.0)
    axes.set(xlim=(-0.6, len(controllers) - 0.4), xticks=[], ylim=(0.0, 1.06 * highest if highest > 0.0 else 1.0))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axes.tick_params(axis="y", length=3)
    axes.grid(axis="y", color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(f"{metric.title} ({metric.shown_unit})", loc="left", fontsize=10.5, pad=9)


def colour_of(controller: int | str) -> str:
    """Table I's five colours, which begin again for further controllers; a code has none of its own."""
    return QUIET if isinstance(controller, str) else CONTROLLER_COLOURS[(controller - 1) % len(CONTROLLER_COLOURS)]


def draw_box(axes: Axes, box: Box, x: float, width: float, colour: str, filled: bool) -> None:
    """Our choice: one trial, whose box would be a line and neither filled nor open, is a square that is."""
    face = colour if filled else "white"
    if box.count == 1:
        look = {"markerfacecolor": face, "markeredgecolor": colour, "markeredgewidth": 1.3, "zorder": 4}
        axes.plot([x], [box.median], "s", markersize=7.0, **look)
        return
    axes.bar(x, box.q3 - box.q1, width, box.q1, facecolor=face, edgecolor=colour, linewidth=1.3, zorder=3)
    axes.vlines([x, x], [box.low, box.q3], [box.q1, box.high], colors=colour, linewidth=1.2, zorder=2)
    axes.hlines([box.low, box.high], x - width / 4, x + width / 4, colors=colour, linewidth=1.2, zorder=2)
    axes.hlines(box.median, x - width / 2, x + width / 2, colors=TEXT, linewidth=1.8, zorder=4)
    if box.outliers:
        look = {"markerfacecolor": "none", "markeredgecolor": colour, "markeredgewidth": 1.1, "zorder": 3}
        axes.plot([x] * len(box.outliers), box.outliers, "o", markersize=4.0, **look)
