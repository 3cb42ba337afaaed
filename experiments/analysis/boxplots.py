"""Box plots of a study, as Figs. 16 to 18 of the paper: each controller, or its code, in each configuration."""

import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from core.files import InputError
from experiments.analysis.figures import (
    CONTROLLER_COLOURS,
    CONTROLLER_LABELS,
    FORMATS,
    LINE,
    QUIET,
    STYLE,
    TEXT,
    figure_bytes,
    new_figure,
)
from experiments.analysis.metrics import METRICS, Metric
from experiments.analysis.trials_table import TrialRow, by_controller, to_compare
from experiments.recording.atomic_files import refuse_existing_files, write_new_files

WHISKER = 1.5  # box lengths
QUARTILE_METHOD = "linear"  # NumPy's name; MATLAB's is "hazen" and differs
PAPER = "paper"  # the protocol whose figures these are
COMBINED_NAME = "boxplots.png"
TIMEOUT_COLOUR = "#c47400"
CODE_COLOUR = QUIET  # one for all: a code has no colour of a controller
LABEL_IN = 10.5 / 72.0  # inches: a line of a controller's name
CAPTION_SIZE, LINE_IN, CHARACTERS_PER_INCH = 7.0, 0.16, 18.5  # of the small print: points, inches, at most


class Box(NamedTuple):
    """What one box shows. Whiskers end at the furthest values within 1.5 box lengths."""

    count: int
    median: float
    q1: float
    q3: float
    low: float  # end of the lower whisker
    high: float  # end of the upper whisker
    outliers: tuple[float, ...]  # beyond the whiskers, rising


def box_statistics(values: Iterable[float]) -> Box:
    """Median, quartiles (NumPy's "linear" method), whiskers and outliers of at least one finite value."""
    data = np.sort(np.asarray(list(values), dtype=float))
    if not len(data) or not np.all(np.isfinite(data)):
        raise ValueError("a box needs at least one value, all finite")
    q1, median, q3 = (float(q) for q in np.quantile(data, (0.25, 0.5, 0.75), method=QUARTILE_METHOD))
    reach = WHISKER * (q3 - q1)
    inside = data[(data >= q1 - reach) & (data <= q3 + reach)]
    low, high = min(float(inside[0]), q1), max(float(inside[-1]), q3)
    outliers = data[(data < low) | (data > high)]
    return Box(len(data), median, q1, q3, low, high, tuple(float(value) for value in outliers))


#: Figs. 16, 17 and 18.
DRAWN = tuple(metric for metric in METRICS if metric.figure)


def file_name(metric: Metric, protocol: str) -> str:
    """Our choice: "fig16_path_error" for the paper's protocol, whose figure it repeats, "path_error" for any other."""
    return metric.figure if protocol == PAPER else metric.figure.partition("_")[2]


def boxes(
    rows: Iterable[TrialRow],
    column: str,
    configurations: Sequence[str],
    scale: float = 1.0,
    timeouts: bool = False,
) -> dict[tuple[int | str, str], Box]:
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
    metrics: Sequence[Metric] = DRAWN,
    labels: Mapping[int, str] = CONTROLLER_LABELS,
    progress: Callable[[float], None] = lambda share: None,
    protocol: str = PAPER,
    timeouts: bool = False,
) -> list[Path]:
    """Draw every metric as PNG, SVG and PDF and all in one wide PNG into `out_folder`; returns the paths.

    note: what was used, as "settled rules, low gain 5 N s/m, parameters assumed"; it stands on every figure.
    configurations: the first is drawn filled, the second open; by default as the table first names them.
    labels: controller -> what stands under its box; codes of a blind session stand under theirs as they are.
    protocol: its name; only the paper's own figures bear the numbers of its figures (`file_name`).
    timeouts: trials whose time was up are in the boxes; else they are crosses above them, and the caption says so.
    progress: called with the share that is drawn; whatever it raises ends the work before anything is written.
    InputError before anything is written if a file exists already or there is nothing to draw.
    """
    folder = Path(out_folder)
    configurations = tuple(configurations or dict.fromkeys(row.configuration for row in rows))
    if not configurations:
        raise InputError(f"{folder}: there are no trials, no box plots to draw")
    paths = [folder / f"{file_name(metric, protocol)}.{form}" for metric in metrics for form in FORMATS]
    paths.append(folder / COMBINED_NAME)
    refuse_existing_files(paths)

    shown = controllers_shown(rows, labels)
    note = "\n".join(filter(None, (left_out(rows, timeouts), note)))
    wider = max(1.0, len(shown) / 5.0)
    with matplotlib.rc_context(STYLE):
        drawn: list[bytes] = []
        for metric in metrics:
            figure = new_figure(6.4 * wider, 4.5 + _label_room(shown))
            _draw(figure, rows, [metric], configurations, note, shown, timeouts)
            for form in FORMATS:
                progress(len(drawn) / len(paths))
                drawn.append(figure_bytes(figure, form))
        progress(len(drawn) / len(paths))
        figure = new_figure(5.0 * wider * len(metrics), 4.5 + _label_room(shown))
        _draw(figure, rows, metrics, configurations, note, shown, timeouts)
        drawn.append(figure_bytes(figure, "png"))
    progress(1.0)
    write_new_files(dict(zip(paths, drawn, strict=True)))
    return paths


def left_out(rows: Iterable[TrialRow], timeouts: bool = False) -> str:
    """How many trials the boxes leave out, and why, as a caption has it; "": none."""
    count = Counter(row.status for row in rows)
    late, excluded = (f"{n} trial{'s' if n != 1 else ''}" for n in (count["timeout"], count["excluded"]))
    parts = []
    if count["timeout"]:
        where = "in the boxes" if timeouts else "crosses above the scale, not in the boxes"
        parts.append(f"{late} timed out: {where}.")
    if count["excluded"]:
        parts.append(f"{excluded} excluded by the experimenter, not shown.")
    return " ".join(parts)


def controllers_shown(rows: Sequence[TrialRow], labels: Mapping[int, str]) -> dict[int | str, str]:
    """Controller or code -> what stands under its box, in order: all that have a label, and every code of the rows."""
    there = {row.controller for row in rows}
    coded = {controller: controller for controller in there if isinstance(controller, str)}
    named = {} if there and len(coded) == len(there) else labels
    return {controller: {**named, **coded}[controller] for controller in sorted({*named, *coded}, key=by_controller)}


def _label_room(shown: Mapping[int | str, str]) -> float:
    """What names of more than two lines need besides, inches."""
    lines = max((len(name.splitlines()) for name in shown.values()), default=0)
    return LABEL_IN * max(0, lines - 2)


def _draw(
    figure: Figure,
    rows: Sequence[TrialRow],
    metrics: Sequence[Metric],
    configurations: Sequence[str],
    note: str,
    shown: Mapping[int | str, str],
    timeouts: bool = False,
) -> None:
    width, height = figure.get_size_inches()
    left, right, between, top = 0.6, 0.15, 0.7, 0.72  # inches
    found = [boxes(rows, metric.name, configurations, metric.scale, timeouts) for metric in metrics]
    counts = {box.count for panel in found for box in panel.values()}
    late = [] if timeouts else [(r.controller, r.configuration) for r in rows if r.status == "timeout"]
    lines = _caption(counts, note, int((width - left - right) * CHARACTERS_PER_INCH))
    bottom = 0.66 + LINE_IN * len(lines) + _label_room(shown)

    each = (width - left - right - between * (len(metrics) - 1)) / len(metrics)
    for i, metric in enumerate(metrics):
        place = (left + i * (each + between), bottom, each, height - top - bottom)
        axes = figure.add_axes(tuple(np.divide(place, (width, height, width, height))))
        draw_panel(axes, found[i], metric, configurations, shown, show_counts=len(counts) > 1)
        _draw_timeouts(axes, late, configurations, list(shown))
    if len(configurations) > 1:
        handles = [
            Patch(facecolor=QUIET if i == 0 else "white", edgecolor=QUIET, label=name, linewidth=1.2)
            for i, name in enumerate(configurations)
        ]
        figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(left / width, 1.0 - 0.12 / height),
            ncols=len(handles),
            frameon=False,
            borderaxespad=0.0,
            borderpad=0.0,
            handlelength=1.4,
        )
    for i, line in enumerate(reversed(lines)):
        figure.text(left / width, (0.12 + LINE_IN * i) / height, line, fontsize=CAPTION_SIZE, color=QUIET)


def _caption(counts: set[int], note: str, characters: int) -> list[str]:
    """What a reader must know about the boxes, in lines of at most `characters`."""
    if len(counts) == 1:
        trials = f"{min(counts)} trials a box."
    else:
        trials = "Under each box: the number of its trials."
    single = "A square: one trial alone. " if 1 in counts else ""
    method = (
        f"{trials} {single}Line: median. Box: quartiles (NumPy's '{QUARTILE_METHOD}' method). "
        f"Whiskers: furthest trial within {WHISKER:g} box lengths. Circles: trials beyond."
    )
    if counts == {1}:
        method = "1 trial a box, drawn as a square."
    return [line for text in (method, *note.splitlines()) for line in textwrap.wrap(text, characters)]


def draw_panel(
    axes: Axes,
    found: dict[tuple[int | str, str], Box],
    metric: Metric,
    configurations: Sequence[str],
    shown: Mapping[int | str, str],
    show_counts: bool = False,
) -> None:
    """One metric's boxes on `axes`: a group for each controller, a box for each configuration."""
    controllers = list(shown)
    width = 0.62 / len(configurations)
    for (controller, configuration), box in found.items():
        x = _place(controller, configuration, configurations, controllers)
        _draw_box(axes, box, x, width, colour_of(controller), filled=configuration == configurations[0])
        if show_counts:
            axes.annotate(
                f"{box.count}", (x, 0.0), (0, -4), ("data", "axes fraction"), "offset points",
                ha="center", va="top", fontsize=CAPTION_SIZE, color=QUIET,
            )  # fmt: skip
    highest = max((max(box.high, *box.outliers, box.q3) for box in found.values()), default=0.0)
    axes.set_ylim(0.0, 1.06 * highest if highest > 0.0 else 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 2.5, 5, 10]))
    axes.set_xlim(-0.6, len(controllers) - 0.4)
    axes.set_xticks([])
    for i, controller in enumerate(controllers):  # line by line: a tick label's lines shift with their letters
        for j, line in enumerate(shown[controller].splitlines()):
            axes.annotate(
                line, (i, 0.0), (0, (-24 if show_counts else -15) - 72.0 * LABEL_IN * j), ("data", "axes fraction"),
                "offset points", ha="center", va="baseline", fontsize=8.0,
            )  # fmt: skip
    axes.tick_params(axis="y", length=3)
    axes.grid(axis="y", color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(f"{metric.title} ({metric.shown_unit})", loc="left", fontsize=10.5, pad=9)


def _place(
    controller: int | str, configuration: str, configurations: Sequence[str], controllers: Sequence[int | str]
) -> float:
    """The middle of a box, along the axis of controllers."""
    apart = 0.62 / len(configurations) + 0.08
    return controllers.index(controller) + (configurations.index(configuration) - (len(configurations) - 1) / 2) * apart


def _draw_timeouts(
    axes: Axes,
    late: Sequence[tuple[int | str, str]],
    configurations: Sequence[str],
    controllers: Sequence[int | str],
) -> None:
    """A cross above the scale for each (controller, configuration), beside each other where there are several."""
    drawn = Counter()
    for controller, configuration in late:
        middle = _place(controller, configuration, configurations, controllers)
        x = middle + 0.06 * ((drawn[controller, configuration] + 1) // 2) * (-1) ** drawn[controller, configuration]
        drawn[controller, configuration] += 1
        axes.plot(
            [x], [1.015], "x", transform=axes.get_xaxis_transform(), clip_on=False,
            markersize=5.0, markeredgewidth=1.3, markeredgecolor=TIMEOUT_COLOUR,
        )  # fmt: skip


def colour_of(controller: int | str) -> str:
    """The colour of a controller: Table I's five, which begin again for further ones; a code has none of its own."""
    if isinstance(controller, str):
        return CODE_COLOUR
    return CONTROLLER_COLOURS[(controller - 1) % len(CONTROLLER_COLOURS) + 1]


def _draw_box(axes: Axes, box: Box, x: float, width: float, colour: str, filled: bool) -> None:
    """Our choice: one trial, whose box would be a line and neither filled nor open, is a square that is."""
    if box.count == 1:
        axes.plot(
            [x], [box.median], "s",
            markersize=7.0, markerfacecolor=colour if filled else "white", markeredgecolor=colour,
            markeredgewidth=1.3, zorder=4,
        )  # fmt: skip
        return
    axes.bar(
        x, box.q3 - box.q1, width, box.q1,
        facecolor=colour if filled else "white", edgecolor=colour, linewidth=1.3, zorder=3,
    )  # fmt: skip
    axes.vlines([x, x], [box.low, box.q3], [box.q1, box.high], colors=colour, linewidth=1.2, zorder=2)
    axes.hlines([box.low, box.high], x - width / 4, x + width / 4, colors=colour, linewidth=1.2, zorder=2)
    axes.hlines(box.median, x - width / 2, x + width / 2, colors=TEXT, linewidth=1.8, zorder=4)
    if box.outliers:
        axes.plot(
            [x] * len(box.outliers), box.outliers, "o",
            markersize=4.0, markerfacecolor="none", markeredgecolor=colour, markeredgewidth=1.1, zorder=3,
        )  # fmt: skip
