"""Box plots of a study, as Figs. 16 to 18 of the paper: each controller, or its code, in each configuration."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from core.files import InputError
from experiments.analysis.chart_figures import FORMATS, HATCHES, draw_chart
from experiments.analysis.charts import QUARTILE_METHOD, WHISKER, Chart, View, controllers_shown, left_out, pooled
from experiments.analysis.metrics import BY_NAME, DRAWN, FIGURES, Metric
from experiments.analysis.sheet import (
    CHARACTERS_PER_INCH,
    QUIET,
    SMALL,
    STYLE,
    figure_bytes,
    legend_at,
    new_figure,
    small_print,
)
from experiments.analysis.trials_table import Controller, TrialRow
from experiments.recording.atomic_files import refuse_existing_files, write_new_files

PAPER = "paper"  # the protocol whose figures these are
LABEL_IN, LINE_IN = 10.5 / 72.0, 0.16  # inches: a line of a controller's name, of the small print
LEFT_IN, RIGHT_IN, BETWEEN_IN, TOP_IN = 0.6, 0.15, 0.7, 0.72
#: Controller -> its name under a box; Table I of the paper.
CONTROLLER_LABELS: dict[Controller, str] = {
    1: "None",
    2: "SDOF",
    3: "SDOF,\ngap",
    4: "Proportional,\nhigh gain",
    5: "Proportional,\nlow gain",
}


def draw_boxplots(
    rows: Sequence[TrialRow],
    out_folder: str | Path,
    note: str,
    metrics: Sequence[Metric] = FIGURES,
    labels: Mapping[Controller, str] = CONTROLLER_LABELS,
    protocol: str = PAPER,
    timeouts: bool = False,
    pool: Executor | None = None,
) -> list[Path]:
    """Draw every metric as PNG, SVG and PDF, and those of the paper in one wide PNG; returns the paths.

    note: what was used, as "settled rules, low gain 5 N s/m, parameters assumed"; it stands on every figure.
    Configurations are drawn as `charts.LOOKS` in the order in which the table first names them.
    labels: controller -> what stands under its box; codes of a blind session stand under theirs as they are.
    protocol: its name. Our choice: only the paper's figures bear the numbers of its figures ("fig16_path_error").
    timeouts: trials whose time was up are in the boxes; else they are crosses above them, as the caption explains.
    pool: processes that draw as well.
    InputError before anything is written if a file exists already or there is nothing to draw.
    """
    folder = Path(out_folder)
    view = View(tuple(dict.fromkeys(row.configuration for row in rows)), labels, timeouts=timeouts)
    if not rows:
        raise InputError(f"{folder}: there are no trials, no box plots to draw")
    sheets = []
    for metric in metrics:
        name = metric.figure if protocol == PAPER else metric.figure.partition("_")[2]
        sheets.append(([metric], 6.4, [folder / f"{name}.{form}" for form in FORMATS]))
    papers = [metric for metric in metrics if metric in DRAWN]
    sheets.append((papers, 5.0 * len(papers), [folder / "boxplots.png"]))
    paths = [path for _, _, of_it in sheets for path in of_it]
    refuse_existing_files(paths)
    calls = [
        (rows, [metric.name for metric in shown], width, note, view, [path.suffix[1:] for path in of_it])
        for shown, width, of_it in sheets
    ]
    drawn: dict[Path, bytes] = {}
    for (_, _, of_it), forms in zip(sheets, _drawn(calls, pool), strict=True):
        drawn |= zip(of_it, forms, strict=True)
    write_new_files(drawn)
    return paths


def _drawn(calls: Sequence[tuple], pool: Executor | None) -> Iterator[list[bytes]]:
    """The files of each sheet: those that no process of the pool has begun are drawn by this one, the last first."""
    waiting = [pool.submit(_sheet, *call) for call in calls] if pool else []
    mine = {i: _sheet(*calls[i]) for i in reversed(range(len(waiting))) if waiting[i].cancel()}
    for i, call in enumerate(calls):
        yield mine[i] if i in mine else waiting[i].result() if waiting else _sheet(*call)


def _sheet(
    rows: Sequence[TrialRow], names: Sequence[str], width: float, note: str, view: View, formats: Sequence[str]
) -> list[bytes]:
    """One figure as the bytes of its files; names: of the metrics."""
    figure = draw(rows, [BY_NAME[name] for name in names], width, note, view)
    return [figure_bytes(figure, form) for form in formats]


def draw(rows: Sequence[TrialRow], metrics: Sequence[Metric], width_in: float, note: str, view: View) -> Figure:
    """One figure with a panel for each metric; more than five controllers make it wider."""
    shown = controllers_shown(rows, view.names)
    names = max((len(name.splitlines()) for name in shown.values()), default=0)
    room = LABEL_IN * max(0, names - 2)  # what names of more than two lines need besides
    width, height = width_in * max(1.0, len(shown) / 5.0), 4.5 + room
    inside = width - LEFT_IN - RIGHT_IN
    found = [pooled(rows, metric, view) for metric in metrics]
    counts = {placed.box.n for chart in found for placed in chart.boxes}
    texts = (_method(counts), left_out(rows, view.timeouts), *note.splitlines())
    lines = [line for text in texts for line in textwrap.wrap(text, int(inside * CHARACTERS_PER_INCH))]
    bottom = 0.66 + LINE_IN * len(lines) + room
    each = (inside - BETWEEN_IN * (len(metrics) - 1)) / len(metrics)
    with matplotlib.rc_context(STYLE):
        figure = new_figure(width, height)
        for i, chart in enumerate(found):
            place = (LEFT_IN + i * (each + BETWEEN_IN), bottom, each, height - TOP_IN - bottom)
            axes = figure.add_axes(tuple(np.divide(place, (width, height, width, height))))
            _draw_panel(axes, chart, show_counts=len(counts) > 1)
        if len(view.configurations) > 1:
            handles = [Patch(edgecolor=QUIET, label=name, linewidth=1.2) for name in view.configurations]
            for patch, look in zip(handles, map(view.look, view.configurations), strict=True):
                patch.set(facecolor="white" if look else QUIET, hatch=HATCHES[look])
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


def _draw_panel(axes: Axes, chart: Chart, show_counts: bool) -> None:
    """One metric's boxes on `axes`: a group for each controller, a box for each configuration."""

    def under(x: float, text: str, points: float, **look: Any) -> None:
        axes.annotate(text, (x, 0.0), (0, -points), ("data", "axes fraction"), "offset points", ha="center", **look)

    draw_chart(axes, chart)
    axes.set(xticks=[])
    for placed in chart.boxes if show_counts else ():
        under(placed.x, f"{placed.box.n}", 4, va="top", fontsize=SMALL, color=QUIET)
    for x, name in chart.ticks:
        for j, line in enumerate(name.splitlines()):  # line by line: a tick label's lines shift with their letters
            under(x, line, (24 if show_counts else 15) + 72.0 * LABEL_IN * j, va="baseline", fontsize=8.0)
