"""Figures for print: their look, axes laid out in inches, small print at the foot, and the same bytes each time."""

import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.analysis.colours import ON_LIGHT

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

TEXT, QUIET, LINE = "#1c2228", "#5b6672", "#d9dee4"
BLUE, ORANGE, BROWN, PALE, GREY = ON_LIGHT.blue, ON_LIGHT.orange, ON_LIGHT.warm, ON_LIGHT.pale, ON_LIGHT.grey
SHADED = "#e7ebef"
COLUMN_IN, PAGE_IN = 3.5, 7.0  # widths of a figure in a journal
SMALL, MIDDLE, TITLE = 7.0, 8.0, 9.0  # points: what journals ask for at these widths, and no other
LINE_IN, CHARACTERS_PER_INCH = 0.15, 18.5  # of the small print
LETTER_IN = 0.059  # inches: of a letter of small text; about
#: The bodies of the first device, the second, ..: as `charts.LOOKS`.
HATCHES = ("", "", "/////", ".....")
CM = 100.0  # cm in a metre: the paper's figures are in cm
PNG_DPI = 200

Place = Sequence[float] | np.ndarray  # x and y

STYLE: "dict[RcKeyType, Any]" = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": MIDDLE,
    "axes.titlesize": TITLE,
    "axes.labelsize": MIDDLE,
    "figure.titlesize": TITLE,
    "legend.fontsize": MIDDLE,
    "xtick.labelsize": MIDDLE,
    "ytick.labelsize": MIDDLE,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": TEXT,
    "axes.linewidth": 0.8,
    "text.color": TEXT,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "svg.hashsalt": "phd",  # else SVG names its clip paths at random
    "svg.fonttype": "none",  # text stays text, which publishers ask for and can still be searched
    "pdf.fonttype": 42,
}
#: What each format would otherwise stamp with the time of drawing.
_NO_DATE: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure without a window; draw on it inside `matplotlib.rc_context(STYLE)`."""
    figure = Figure(figsize=(width_in, height_in), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, form: str) -> bytes:
    """The figure as "png", "svg" or "pdf"; the same figure gives the same bytes."""
    sink = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(sink, format=form, dpi=PNG_DPI, metadata=_NO_DATE[form])
    return sink.getvalue()


def sheet(
    text: str,
    size_in: tuple[float, float],
    margins_in: tuple[float, float, float, float],
    grid: tuple[int, int] = (1, 1),
    between_in: tuple[float, float] = (0.0, 0.0),
    inside: bool = False,
    **subplots: Any,
) -> tuple[Figure, np.ndarray]:
    """A figure with `text` as small print at its foot, and its axes, a grid of (rows, columns).

    size_in: width and height of the figure; if `inside`, the height is that of the axes with the gaps between them.
    margins_in: left, right, from the small print up to the axes, top. between_in: gaps between columns and rows.
    """
    (width, height), (left, right, bottom, top), (rows, columns) = size_in, margins_in, grid
    lines = textwrap.wrap(text, int((width - 0.3) * CHARACTERS_PER_INCH))
    bottom += 0.1 + LINE_IN * len(lines)
    height += bottom + top if inside else 0.0
    figure = new_figure(width, height)
    small_print(figure, lines, 0.15, 0.1)
    each_width = (width - left - right - between_in[0] * (columns - 1)) / columns
    each_height = (height - bottom - top - between_in[1] * (rows - 1)) / rows
    place = {
        "left": left / width,
        "right": 1.0 - right / width,
        "bottom": bottom / height,
        "top": 1.0 - top / height,
        "wspace": between_in[0] / each_width,
        "hspace": between_in[1] / each_height,
    }
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw=place, **subplots)


def small_print(
    figure: Figure, lines: Sequence[str], left_in: float, bottom_in: float = 0.12, line_in: float = LINE_IN
) -> None:
    """Lines of small text, one under the other; the last stands `bottom_in` above the bottom of the figure."""
    width, height = figure.get_size_inches()
    for i, line in enumerate(reversed(lines)):
        place = left_in / width, (bottom_in + line_in * i) / height
        figure.text(*place, line, fontsize=SMALL, color=QUIET, parse_math=False)


def title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=TITLE, pad=6, parse_math=False)


def plain(axes: Axes, grid: bool = True) -> None:
    """Two spines, short ticks, a faint grid behind."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(length=3)
    axes.set_axisbelow(True)
    if grid:
        axes.grid(color=LINE, linewidth=0.6)


def legend_at(figure: Figure, handles: Sequence[Any], left_in: float, top_in: float, **more: Any) -> None:
    """A legend in one row; its upper left corner is `left_in` and `top_in` from that of the figure."""
    width, height = figure.get_size_inches()
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(left_in / width, 1.0 - top_in / height),
        ncols=len(handles), frameon=False, borderpad=0.0, borderaxespad=0.0, **more,
    )  # fmt: skip


def plain_3d(axes: Any) -> None:
    """White walls, faint grids, seen from the side of large numbers."""
    axes.view_init(elev=24, azim=35)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color("white")
        axis._axinfo["grid"].update(color=LINE, linewidth=0.6)


def colour_of(controller: int | str, places: Mapping[int | str, int]) -> str:
    """The controller's own colour; a code of a blind session has none."""
    place = places.get(controller)
    return QUIET if place is None else ON_LIGHT[place]


def heading(figure: Figure, words: str, handles: Sequence[Any] = (), **legend: Any) -> None:
    """The heading of a figure of several panels, and under it the legend of them all, if there is one."""
    width, height = figure.get_size_inches()
    figure.text(0.65 / width, 1.0 - 0.28 / height, words, fontsize=TITLE, parse_math=False)
    if handles:
        legend_at(figure, handles, 0.65, 0.36, columnspacing=1.5, **legend)


def arrow(axes: Axes, start: Place, end: Place, colour: str, width: float = 1.6) -> None:
    """An arrow from start to end in data coordinates."""
    style = {"arrowstyle": "-|>,head_width=0.22,head_length=0.5", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
    properties = style | {"color": colour, "linewidth": width}
    axes.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops=properties, annotation_clip=False)
