"""The pictures of worlds: in how many each statement holds, what that hangs on, and how it goes over a range."""

import textwrap

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from experiments.analysis.findings import STATEMENTS
from experiments.analysis.sheet import (
    BLUE,
    BROWN,
    LINE,
    ORANGE,
    PAGE_IN,
    PALE,
    QUIET,
    SHADED,
    SMALL,
    STYLE,
    TEXT,
    figure_bytes,
    plain,
    sheet,
    title,
)
from experiments.numbers import fixed, significant
from experiments.worlds.indices import Indices, Split, effective_counts, part_at, parts_of
from experiments.worlds.ranges import AssumptionRange, Ranges

RARE = 0.2  # a statement that holds in a smaller share of all studies is drawn larger
SHOWN = 3  # assumptions that decide a statement most
NO_CONTROLLER = "if no controller did anything"
PARTS = {"alone": ("assumptions alone", BLUE), "interplay": ("interplay", ORANGE), "people": ("people", PALE)}
PARTS_OF_ONE = {"alone": ("assumptions alone", BLUE), "rest": ("interplay and people", SHADED)}


def wilson(holding: int | np.ndarray, n: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The 95 % interval of a share by Wilson's formula; the numbers need not be whole."""
    z, p = 1.96, holding / np.maximum(n, 1)
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
    low, high = (middle - half) / (1.0 + z * z / n), (middle + half) / (1.0 + z * z / n)
    return np.minimum(low, p), np.maximum(high, p)  # of a share of 0 or 1 rounding may leave the share outside


def overview(holds: np.ndarray, chance: np.ndarray, of: Split, note: str) -> bytes:
    """PNG: the share of studies in which each statement holds, and what its verdict hangs on.

    holds (worlds, triples, statements); chance (studies, statements): whether each holds if no controller did anything.
    """
    with matplotlib.rc_context(STYLE):
        note += " Lines: 95 % intervals."
        figure, ((upper,), (lower,)) = sheet(note, (PAGE_IN, 8.4), (3.1, 0.15, 0.65, 0.35), (2, 1), (0.0, 0.85))
        places = np.arange(len(STATEMENTS))
        p, (low, high) = holds.mean(axis=(0, 1)), wilson(*effective_counts(holds))
        upper.barh(places, p, 0.62, color=PALE, zorder=2)
        upper.errorbar(p, places, xerr=(p - low, high - p), fmt="none", ecolor=TEXT, elinewidth=1.0, zorder=3)
        upper.plot(chance.mean(axis=0), places, "|", color=BROWN, label=NO_CONTROLLER, markersize=11.0, zorder=4)
        title(upper, "Share of studies in which it holds")
        before = np.zeros(len(STATEMENTS))
        for part, (name, colour) in (PARTS if np.isfinite(of.people).any() else PARTS_OF_ONE).items():
            share = np.nan_to_num(np.maximum(getattr(of, part), 0.0))
            lower.barh(places, share, 0.62, before, color=colour, label=name, zorder=2)
            before += share
        title(lower, "What its verdict hangs on: share of the variance")
        names = [textwrap.fill(f"{statement.number}  {statement.text}", 50) for statement in STATEMENTS]
        for axes in (upper, lower):
            axes.set(xlim=(0.0, 1.0), yticks=places, yticklabels=names)
            axes.invert_yaxis()
            axes.tick_params(axis="y", labelsize=SMALL, length=0)
            axes.legend(frameon=False, fontsize=SMALL, loc="upper left", bbox_to_anchor=(0.0, -0.06), ncols=3)
            plain(axes, grid=False)
            axes.grid(axis="x", color=LINE, linewidth=0.6)
        return figure_bytes(figure, "png")


def decided_by(ranges: Ranges, shares: np.ndarray, holds: np.ndarray, found: Indices, note: str) -> bytes:
    """PNG: a row for each statement; the share of studies in which it holds against the assumptions that decide it.

    shares (worlds, assumptions); holds (worlds, triples, statements).
    """
    first, half = found.split.first, found.half_width.first
    rows = [i for i in range(len(STATEMENTS)) if np.isfinite(first[i]).any()]
    columns = min(SHOWN, len(ranges.ranges))
    note += (
        " Drawn: the share of studies in which the statement holds, with its 95 % interval (shaded); dotted: of all. "
        "Above: the assumption, its first-order index and half of that one's 95 % interval."
    )
    with matplotlib.rc_context(STYLE):
        size, margins = (PAGE_IN, 1.35 * max(len(rows), 1)), (1.75, 0.15, 0.45, 0.4)
        figure, grid = sheet(note, size, margins, (max(len(rows), 1), columns), (0.3, 0.6), inside=True)
        for axes_row, i in zip(grid, rows, strict=False):
            for axes, j in zip(axes_row, np.argsort(-first[i], kind="stable")[:columns], strict=True):
                column = list(ranges.ranges)[j]
                _share_against(axes, ranges.ranges[column], shares[:, j], holds[..., i : i + 1])
                index = f"{ranges.label(column)}\n{fixed(first[i, j], 2)} ± {fixed(half[i, j], 2)}"
                axes.set_title(index, fontsize=SMALL, loc="left", pad=3)
            statement = textwrap.fill(f"{STATEMENTS[i].number}  {STATEMENTS[i].text}", 26)
            axes_row[0].set_ylabel(statement, rotation=0, ha="right", va="center", fontsize=SMALL)
        return figure_bytes(figure, "png")


def _share_against(axes: Axes, assumption: AssumptionRange, shares: np.ndarray, holds: np.ndarray) -> None:
    """The share of studies (worlds, triples, 1) that hold in each part of a range, with its 95 % interval."""
    parts = parts_of(assumption)
    place = part_at(shares, parts)
    tried = [part for part in range(parts) if np.any(place == part)]
    p = np.array([holds[place == part].mean() for part in tried])
    low, high = np.array([wilson(*effective_counts(holds[place == part])) for part in tried])[..., 0].T
    middles = (np.array(tried) + 0.5) / parts
    axes.axhline(holds.mean(), color=QUIET, linewidth=0.8, linestyle=":", zorder=1)
    if assumption.choices is not None:
        axes.bar(middles, p, 0.5 / parts, color=BLUE, zorder=2)
        axes.vlines(middles, low, high, color=QUIET, linewidth=1.0, zorder=3)
        axes.set_xticks(middles, [str(assumption.choices[part]) for part in tried])
    else:
        axes.fill_between(middles, low, high, color=BLUE, alpha=0.25, linewidth=0.0, zorder=1)
        axes.plot(middles, p, "o-", color=BLUE, markersize=2.5, linewidth=1.2, zorder=2)
        axes.set_xticks((0.0, 0.5, 1.0), [significant(float(assumption.at(share))) for share in (0.0, 0.5, 1.0)])
    top = 1.0 if holds.mean() > RARE or p.max() > 2.0 * RARE else 2.0 * RARE
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, top), yticks=(0.0, 0.5 * top, top))
    axes.tick_params(labelsize=SMALL)
    plain(axes)
