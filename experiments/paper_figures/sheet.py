"""What all remade figures share: a picture before it is drawn, the joints' colours, the small print underneath."""

import textwrap
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.analysis.figures import LINE, QUIET

#: Joint -> colour and line: told apart by the colour-blind (Okabe and Ito's set, C darkened for thin lines) and in
#: print without colour.
JOINT_COLOURS = {"A": "#0072b2", "E": "#d55e00", "B": "#009e73", "C": "#a8508a"}
JOINT_LINES = {"A": "-", "E": (0, (6, 1.5)), "B": (0, (6, 1.5, 1, 1.5)), "C": (0, (1.5, 1.2))}

SMALL, TITLE = 7.0, 9.5  # points
LINE_IN, CHARACTERS_PER_INCH = 0.15, 18.5  # of the small print
CM = 100.0  # cm in a metre: the paper's figures are in cm


class Picture(NamedTuple):
    """One figure before it is drawn."""

    name: str  # of its files, without the ending
    shows: str  # in a few words
    draw: Callable[[], Figure]


class Parameters(Protocol):
    """What a figure was drawn from: a device, or a brake of one."""

    @property
    def name(self) -> str: ...
    @property
    def assumed(self) -> bool: ...


def parameters_of(*sources: Parameters) -> str:
    """A sentence or two: whose numbers these are, and whether they are assumed."""
    assumed = [source.name for source in sources if source.assumed]
    others = [source.name for source in sources if not source.assumed]
    words = f"Assumed parameters: {', '.join(assumed)}." if assumed else ""
    return words + (" " if words and others else "") + (f"Parameters of {', '.join(others)}." if others else "")


def small_print(figure: Figure, text: str) -> float:
    """Write a paragraph at the foot of the figure; its height in inches."""
    width, height = figure.get_size_inches()
    lines = _wrapped(text, width)
    for i, line in enumerate(reversed(lines)):
        figure.text(0.15 / width, (0.1 + LINE_IN * i) / height, line, fontsize=SMALL, color=QUIET, parse_math=False)
    return foot_in(text, width)


def foot_in(text: str, width_in: float) -> float:
    """Height (in) of `small_print` in a figure of a width (in): to choose the figure's height by."""
    return 0.1 + LINE_IN * len(_wrapped(text, width_in))


def _wrapped(text: str, width_in: float) -> list[str]:
    return textwrap.wrap(text, int((width_in - 0.3) * CHARACTERS_PER_INCH))


def panels(
    figure: Figure,
    rows: int,
    columns: int,
    margins_in: Sequence[float],
    between_in: tuple[float, float] = (0.0, 0.0),
    **subplots,
) -> np.ndarray:
    """Axes (rows, columns); margins left, right, bottom, top and the gaps between columns and rows in inches."""
    width, height = figure.get_size_inches()
    left, right, bottom, top = margins_in
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
    return figure.subplots(rows, columns, squeeze=False, gridspec_kw=place, **subplots)


def title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=TITLE, pad=6, parse_math=False)


def plain(axes: Axes, grid: bool = True) -> None:
    """Two spines, short ticks, a faint grid behind."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(length=3)
    axes.set_axisbelow(True)
    if grid:
        axes.grid(color=LINE, linewidth=0.6)


def arrow(axes: Axes, start: Sequence[float], end: Sequence[float], colour: str, width: float = 1.6, **more) -> None:
    """An arrow from start to end in data coordinates."""
    style = {"arrowstyle": "-|>,head_width=0.22,head_length=0.5", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
    properties = style | {"color": colour, "linewidth": width} | more
    axes.annotate("", end, start, arrowprops=properties, annotation_clip=False)
