"""Pictures of worlds: how often each statement holds, what would settle most, and the share against each assumption."""

import textwrap
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from experiments.analysis.findings import STATEMENTS
from experiments.analysis.sheet import (
    BLUE,
    LINE,
    ORANGE,
    QUIET,
    SHADED,
    SMALL,
    STYLE,
    figure_bytes,
    plain,
    sheet,
    title,
)
from experiments.worlds.ranges import Range

BINS = 8  # of a range without choices
RARE = 0.2  # a statement that holds in a smaller share of all worlds is drawn larger
SHOWN = 4  # assumptions that decide a statement most


def label(column: str, one: Range) -> str:
    """An assumption in words."""
    return one.label or column.rpartition(".")[2].replace("_", " ")


def wilson(holding: int | np.ndarray, n: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The 95 % interval of a share (Wilson)."""
    z, p = 1.96, holding / np.maximum(n, 1)
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
    low, high = (middle - half) / (1.0 + z * z / n), (middle + half) / (1.0 + z * z / n)
    return np.minimum(low, p), np.maximum(high, p)  # of a share of 0 or 1 rounding may leave the share outside


def overview(
    holds: np.ndarray, other: Mapping[str, np.ndarray], settled: Sequence[tuple[str, float]], note: str
) -> bytes:
    """PNG: the share of worlds in which each statement holds, and what each assumption would settle.

    other: label -> the verdicts (n, statements) with other bands.
    """
    n = len(holds)
    with matplotlib.rc_context(STYLE):
        note += " Lines: its 95 % interval."
        figure, ((left, right),) = sheet(note, (11.0, 4.6), (3.1, 0.25, 0.45, 0.35), columns=2, between_in=(2.3, 0.0))
        places = np.arange(len(STATEMENTS))
        p = holds.mean(axis=0)
        low, high = wilson(holds.sum(axis=0), n)
        left.barh(places, p, 0.62, color=BLUE, zorder=2)
        left.errorbar(p, places, xerr=(p - low, high - p), fmt="none", ecolor=QUIET, elinewidth=1.0, zorder=3)
        for (name, verdicts), marker in zip(other.items(), ("|", "x"), strict=False):
            left.plot(verdicts.mean(axis=0), places, marker, color=ORANGE, label=name, markersize=7.0, zorder=4)
        left.legend(frameon=False, fontsize=SMALL, loc="lower right")
        names = [textwrap.fill(f"{one.number}  {one.text}", 52) for one in STATEMENTS]
        left.set(xlim=(0.0, 1.0), yticks=places, yticklabels=names)
        left.invert_yaxis()
        left.tick_params(axis="y", labelsize=SMALL, length=0)
        title(left, "Share of worlds in which it holds")
        right.barh(np.arange(len(settled)), [share for _, share in settled], 0.62, color=ORANGE, zorder=2)
        right.set(yticks=np.arange(len(settled)), yticklabels=[name for name, _ in settled], xlim=(0.0, None))
        right.invert_yaxis()
        right.tick_params(axis="y", labelsize=SMALL, length=0)
        title(right, "Share of all doubt that knowing it settles" if settled else "No assumption alone settles any")
        for axes in (left, right):
            plain(axes, grid=False)
            axes.grid(axis="x", color=LINE, linewidth=0.6)
        return figure_bytes(figure, "png")


def decided_by(
    ranges: Mapping[str, Range], shares: np.ndarray, holds: np.ndarray, first: np.ndarray, half: np.ndarray, note: str
) -> bytes:
    """PNG: a row for each statement; the share of worlds in which it holds against the assumptions that decide it."""
    rows = [i for i in range(len(STATEMENTS)) if np.isfinite(first[i]).any()]
    columns = min(SHOWN, len(ranges))
    note += (
        " Drawn: the share of worlds in which the statement holds, with its 95 % interval; dotted: of all worlds. "
        "Above: the assumption, its first-order index and half of that one's 95 % interval."
    )
    with matplotlib.rc_context(STYLE):
        size, margins = (11.0, 1.32 * max(len(rows), 1)), (2.0, 0.2, 0.45, 0.4)
        figure, grid = sheet(note, size, margins, max(len(rows), 1), columns, (0.35, 0.5), inside=True)
        for axes_row, i in zip(grid, rows, strict=False):
            order = np.argsort(-first[i], kind="stable")[:columns]
            for axes, j in zip(axes_row, order, strict=True):
                column = list(ranges)[j]
                _share_against(axes, ranges[column], shares[:, j], holds[:, i])
                index = f"{label(column, ranges[column])}: {first[i, j]:.2f} ± {half[i, j]:.2f}"
                axes.set_title(index, fontsize=SMALL, loc="left", pad=3)
            statement = textwrap.fill(f"{STATEMENTS[i].number}  {STATEMENTS[i].text}", 30)
            axes_row[0].set_ylabel(statement, rotation=0, ha="right", va="center", fontsize=SMALL)
        return figure_bytes(figure, "png")


def _share_against(axes: Axes, one: Range, shares: np.ndarray, holds: np.ndarray) -> None:
    """The share of worlds that hold in each part of a range, with its 95 % interval."""
    parts = len(one.choices) if one.choices is not None else BINS
    place = np.minimum((shares * parts).astype(int), parts - 1)
    n = np.bincount(place, minlength=parts)
    holding = np.bincount(place, weights=holds, minlength=parts)
    p = holding / np.maximum(n, 1)
    low, high = wilson(holding, np.maximum(n, 1))
    middles = (np.arange(parts) + 0.5) / parts
    axes.axhline(holds.mean(), color=QUIET, linewidth=0.8, linestyle=":", zorder=1)
    if one.choices is not None:
        axes.bar(middles, p, 0.5 / parts, color=BLUE, zorder=2)
        axes.vlines(middles, low, high, color=QUIET, linewidth=1.0, zorder=3)
        axes.set_xticks(middles, [str(choice) for choice in one.choices])
    else:
        axes.fill_between(middles, low, high, color=SHADED, zorder=1)
        axes.plot(middles, p, "o-", color=BLUE, markersize=2.5, linewidth=1.2, zorder=2)
        axes.set_xticks((0.0, 0.5, 1.0), [f"{float(f'{one.at(share):.3g}'):g}" for share in (0.0, 0.5, 1.0)])
    top = 1.0 if holds.mean() > RARE or p.max() > 2.0 * RARE else 2.0 * RARE
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, top), yticks=(0.0, 0.5 * top, top))
    axes.tick_params(labelsize=SMALL)
    plain(axes)
