"""The pictures of a run's samples: in which share each statement holds, and how that goes over what decides it."""

import textwrap

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from experiments.analysis.findings import STATEMENTS
from experiments.analysis.sheet import (
    BLUE,
    BROWN,
    LINE,
    PAGE_IN,
    PALE,
    QUIET,
    SMALL,
    STYLE,
    TEXT,
    figure_bytes,
    plain,
    sheet,
    title,
)
from experiments.numbers import fixed, significant
from experiments.sensitivity.indices import Indices
from experiments.sensitivity.judged import wilson
from experiments.sensitivity.ranges import AssumptionRange, Ranges

PARTS = 8  # of a range without choices
RARE = 0.2  # a statement that holds in a smaller share of all samples is drawn larger
SHOWN = 3  # ranges that decide a statement most
TEXTS = {statement.number: statement.text for statement in STATEMENTS}


def overview(share: pd.DataFrame, chance: pd.Series, note: str) -> bytes:
    """PNG: the share of samples in which each statement holds, with its interval, and by chance.

    share: columns share, low, high, a row a statement.
    """
    with matplotlib.rc_context(STYLE):
        figure, ((axes,),) = sheet(f"{note} Lines: 95 % intervals.", (PAGE_IN, 4.4), (3.1, 0.15, 0.65, 0.35))
        places = np.arange(len(share))
        axes.barh(places, share["share"], 0.62, color=PALE, zorder=2)
        ends = (share["share"] - share["low"], share["high"] - share["share"])
        axes.errorbar(share["share"], places, xerr=ends, fmt="none", ecolor=TEXT, elinewidth=1.0, zorder=3)
        label = "Without any working controller"
        axes.plot(chance, places, "|", color=BROWN, label=label, markersize=11.0, zorder=4)
        title(axes, "Share of samples in which each statement holds (%)")
        names = [textwrap.fill(f"{number}  {TEXTS[number]}", 50) for number in share.index]
        axes.set(xlim=(0.0, 1.0), yticks=places, yticklabels=names)
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
        axes.invert_yaxis()
        axes.tick_params(axis="y", labelsize=SMALL, length=0)
        axes.legend(frameon=False, fontsize=SMALL, loc="upper left", bbox_to_anchor=(0.0, -0.06))
        plain(axes, grid=False)
        axes.grid(axis="x", color=LINE, linewidth=0.6)
        return figure_bytes(figure, "png")


def decided_by(ranges: Ranges, shares: np.ndarray, holds: pd.DataFrame, found: Indices, note: str) -> bytes:
    """PNG: a row a statement; the share of samples in which it holds over the ranges that decide it most.

    shares (samples, ranges); holds: a column a statement.
    """
    first = found.first.dropna(how="all")
    columns = min(SHOWN, len(ranges.ranges))
    note += (
        " Drawn: the share of samples in which the statement holds, with its 95 % interval (shaded); dotted: of all. "
        "Above: the range, its first-order index and half of that one's 95 % interval."
    )
    with matplotlib.rc_context(STYLE):
        size, margins = (PAGE_IN, 1.35 * len(first)), (1.75, 0.15, 0.45, 0.4)
        figure, grid = sheet(note, size, margins, (len(first), columns), (0.3, 0.6), inside=True)
        for axes_row, (number, of_statement) in zip(grid, first.iterrows(), strict=True):
            for axes, column in zip(axes_row, of_statement.nlargest(columns).index, strict=True):
                of_range = shares[:, list(ranges.ranges).index(column)]
                _share_over(axes, ranges.ranges[column], of_range, holds[number].to_numpy())
                index = f"{fixed(of_statement[column], 2)} ± {fixed(found.half_width.loc[number, column], 2)}"
                axes.set_title(f"{ranges.label(column)}\n{index}", fontsize=SMALL, loc="left", pad=3)
            statement = textwrap.fill(f"{number}  {TEXTS[number]}", 26)
            axes_row[0].set_ylabel(statement, rotation=0, ha="right", va="center", fontsize=SMALL)
        return figure_bytes(figure, "png")


def _share_over(axes: Axes, of: AssumptionRange, shares: np.ndarray, holds: np.ndarray) -> None:
    """The share of samples that hold in each part of a range, with its 95 % interval."""
    parts = PARTS if of.choices is None else len(of.choices)
    by_part = pd.Series(holds).groupby(np.minimum((shares * parts).astype(int), parts - 1))
    tried, p = by_part.mean().index.to_numpy(), by_part.mean().to_numpy()
    low, high = np.array([wilson(part.sum(), len(part)) for _, part in by_part]).T
    middles = (tried + 0.5) / parts
    axes.axhline(holds.mean(), color=QUIET, linewidth=0.8, linestyle=":", zorder=1)
    if of.choices is not None:
        axes.bar(middles, p, 0.5 / parts, color=BLUE, zorder=2)
        axes.vlines(middles, low, high, color=QUIET, linewidth=1.0, zorder=3)
        axes.set_xticks(middles, [str(of.choices[part]) for part in tried])
    else:
        axes.fill_between(middles, low, high, color=BLUE, alpha=0.25, linewidth=0.0, zorder=1)
        axes.plot(middles, p, "o-", color=BLUE, markersize=2.5, linewidth=1.2, zorder=2)
        axes.set_xticks((0.0, 0.5, 1.0), [significant(float(of.at(share))) for share in (0.0, 0.5, 1.0)])
    top = 1.0 if holds.mean() > RARE or p.max() > 2.0 * RARE else 2.0 * RARE
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, top), yticks=(0.0, 0.5 * top, top))
    axes.tick_params(labelsize=SMALL)
    plain(axes)
