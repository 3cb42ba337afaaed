"""The report on worlds, from their table: shares, what decides, what to measure first, the world nearest the paper.

Which assumption decides a statement: first-order indices from the worlds at hand (RBD-FAST, by SALib). The index of an
assumption is the share of a verdict's variance (it holds or not, over all worlds) that goes when the assumption is
known: Var(E[verdict | assumption]) / Var(verdict). What no assumption alone explains is their interplay, and the chance
of which three people took part.
"""

import csv
import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from experiments.analysis.findings import CONTROLLER, LITTLE_OF_U, SIMILAR_OF_U, STATEMENTS, PooledBox, box_findings
from experiments.analysis.metrics import BY_NAME
from experiments.analysis.sheet import (
    BLUE,
    BROWN,
    LINE,
    ORANGE,
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
from experiments.analysis.trials_table import csv_bytes
from experiments.numbers import fixed, percent, significant
from experiments.protocol_writer import whole_text
from experiments.worlds.ranges import Range, Ranges, Value, problem

BANDS = {"half the bands": 0.5, "twice the bands": 2.0}
NEAREST, PEOPLE = "nearest.toml", "nearest-people.toml"
NOTHING_FIRST = "no assumption alone stands out from chance (more worlds may show one)"
DECIDING = 3  # assumptions that the table names for each statement
SEED = 1  # of the bootstrap behind the intervals
LEAST_EITHER = 30  # worlds in which it holds, and in which it does not: fewer give no index worth the name
BINS = 8  # of a range without choices
RARE = 0.2  # a statement that holds in a smaller share of all worlds is drawn larger
SHOWN = 3  # assumptions that decide a statement most


class Worlds(NamedTuple):
    """A table of worlds, read."""

    seeds: np.ndarray  # (n,)
    share_done: np.ndarray  # (n,)
    margins: np.ndarray  # (n, statements); nan: one cannot tell
    cells: list[tuple[str, str, int]]  # measure, configuration, controller
    quartiles: np.ndarray  # (n, cells, 3); nan: no box

    @property
    def holds(self) -> np.ndarray:
        """(n, statements)"""
        return np.nan_to_num(self.margins, nan=-1.0) >= 0.0

    def boxes(self, world: int) -> dict[tuple[str, str, int], PooledBox]:
        """Of the world in this row."""
        rows = zip(self.cells, self.quartiles[world].tolist(), strict=True)
        return {cell: PooledBox(*row) for cell, row in rows if not math.isnan(row[0])}


def read_worlds(table: Path) -> Worlds:
    """The numbers of worlds.csv."""
    with table.open(newline="", encoding="utf-8") as stream:
        lines = csv.reader(stream)
        header = next(lines)
        margins = [header.index(f"margin_{statement.number}") for statement in STATEMENTS]
        boxes = [i for i, name in enumerate(header) if name.count(":") == 3]
        wanted = [header.index("seed"), header.index("share_done"), *margins, *boxes]
        numbers = np.array([[float(line[i] or "nan") for i in wanted] for line in lines])
    names = [header[i].split(":") for i in boxes[::3]]
    cells = [(measure, device, int(controller)) for measure, device, controller, _ in names]
    k = 2 + len(margins)
    return Worlds(numbers[:, 0], numbers[:, 1], numbers[:, 2:k], cells, numbers[:, k:].reshape(len(numbers), -1, 3))


class Indices(NamedTuple):
    """Of every statement (rows) and assumption (columns); nan where nearly all worlds agree."""

    first: np.ndarray
    half_width: np.ndarray  # of the 95 % interval

    @property
    def clear(self) -> np.ndarray:
        """Those that are above chance: beyond their own half-width."""
        return np.nan_to_num(self.first) > np.nan_to_num(self.half_width, nan=np.inf)


def indices(ranges: Mapping[str, Range], shares: np.ndarray, holds: np.ndarray) -> Indices:
    """shares (n, assumptions): where the worlds lie in the ranges; holds (n, statements): whether each holds."""
    from SALib.analyze import rbd_fast  # here: it takes seconds

    first = np.full((holds.shape[1], shares.shape[1]), np.nan)
    half_width = first.copy()
    for row, verdicts in enumerate(holds.T.astype(float)):
        if shares.shape[1] and LEAST_EITHER <= verdicts.sum() <= len(verdicts) - LEAST_EITHER:
            found = rbd_fast.analyze(problem(ranges), shares, verdicts, seed=SEED)
            first[row], half_width[row] = np.maximum(found["S1"], 0.0), found["S1_conf"]
    return Indices(first, half_width)


def settled(found: Indices, holds: np.ndarray) -> np.ndarray:
    """How much of all doubt each assumption would settle (0 .. 1), by the indices that are above chance.

    Doubt: the variance of a verdict, p (1 - p), summed over the statements.
    """
    p = holds.mean(axis=0)
    doubt = p * (1.0 - p)
    of_each = np.where(found.clear, found.first, 0.0) * doubt[:, np.newaxis]
    return of_each.sum(axis=0) / max(float(doubt.sum()), 1e-12)


def report_files(table: Path, ranges: Ranges, seed: int) -> tuple[dict[str, bytes], dict[str, object]]:
    """The files of the report by name, and what the summary says of it."""
    worlds = read_worlds(table)
    n, shares = len(worlds.seeds), ranges.drawn(len(worlds.seeds), seed)
    holds = worlds.holds
    other = {name: judged_again(worlds, ranges, bands) for name, bands in BANDS.items()}
    found = indices(ranges.ranges, shares, holds)
    doubt = settled(found, holds)
    order = np.argsort(-doubt, kind="stable")
    names = [label(column, one) for column, one in ranges.ranges.items()]
    settling = [(names[j], float(doubt[j])) for j in order if doubt[j] > 0.0]
    note = (
        f"{n} worlds of the ranges {ranges.name!r}, seed {seed}: each a study of {ranges.operators} simulated people "
        "under assumptions of its own, judged by pooled boxes. Shares are of the worlds drawn, not of what is likely."
    )
    if ranges.fixed:
        fixed = (f"{label(column, one)} {one.value}" for column, one in ranges.fixed.items())
        note += f" The same in all: {', '.join(fixed)}."
    nearest = nearest_world(worlds)
    parts = [
        f"# Worlds: {ranges.name}",
        note
        + " The people are simulated: read it as what this model says. A statement of which one cannot tell (too few "
        "trials reached the end) counts as one that does not hold. The rules: docs/judging.md.",
        _in_short(holds, nearest, settling),
        "![shares of worlds](overview.png)",
        "## In how many worlds each statement holds",
        _shares(worlds, other),
        f"Bands: a difference counts from {percent(LITTLE_OF_U)} of the uncontrolled box on, similar is within "
        f"{percent(SIMILAR_OF_U)}; the last columns halve and double both.",
        "## Jointly",
        _jointly(holds),
    ]
    files: dict[str, bytes] = {}
    if ranges.ranges:
        parts += [
            "## What decides each",
            _decided(found, ranges, names, shares, holds),
            "The number: share of the verdict's variance that goes when the assumption alone is known (first-order "
            "index, RBD-FAST); in brackets the half-width of its 95 % interval; bold: above chance. The rest is "
            "interplay, and which people took part. After it: in how many of the worlds with each choice, or with the "
            "lower and the upper half of the range, the statement holds. -: it holds, or does not, in fewer than "
            f"{LEAST_EITHER} worlds, too few for an index.",
            "![share of worlds against each assumption](decided-by.png)",
            "## What to measure first",
            _measure_first(ranges, names, doubt, order[: len(settling)], found, holds),
        ]
        files["decided-by.png"] = decided_by(ranges.ranges, shares, holds, *found, note)
        files["indices.csv"] = _indices_csv(ranges, found)
    values = ranges.values(shares[nearest].tolist())
    parts += ["## The nearest world to the paper", _nearest(worlds, nearest, ranges, values)]
    files |= nearest_files(ranges, values, nearest + 1, int(worlds.seeds[nearest]))
    files |= {
        "report.md": ("\n\n".join(parts) + "\n").encode(),
        "overview.png": overview(holds, other, settling, note),
        "jointly.csv": _jointly_csv(holds),
    }
    most = int(holds.sum(axis=1).max())
    return files, {
        "all_hold": f"{percent(holds.all(axis=1).mean(), 2)} of the worlds",
        "most_hold": f"{most} of {len(STATEMENTS)} statements, in world {nearest + 1}",
        "measure_first": names[order[0]] if doubt.any() else NOTHING_FIRST,
    }


def nearest_files(ranges: Ranges, values: Mapping[str, Value], number: int, seed: int) -> dict[str, bytes]:
    """A world as files that `phd study` runs as they are: its protocol, with its devices, and its population."""
    protocol, population = ranges.study(values, seed)
    name = f"{protocol.name}, world {number}"
    about = f"# World {number} of the ranges {ranges.name!r}, the nearest to the paper:\n#   {_command(ranges)}\n"
    return {NEAREST: whole_text(protocol, name, about).encode(), PEOPLE: population.text.encode()}


def _command(ranges: Ranges) -> str:
    """What runs the nearest world again, in the folder of the report."""
    return f"phd study {NEAREST} --population {PEOPLE} --operators {ranges.operators} --out nearest"


def judged_again(worlds: Worlds, ranges: Ranges, bands: float) -> np.ndarray:
    """Whether each statement holds (n, statements) with bands so many times as wide."""
    devices = [device.name for device in ranges.protocol.devices]
    found = [box_findings(worlds.boxes(i), devices, bands) for i in range(len(worlds.seeds))]
    return np.array([[one.margin >= 0.0 for one in of_world] for of_world in found])


def nearest_world(worlds: Worlds) -> int:
    """The row of the world in which most statements hold, and among these miss the others by least.

    A statement of which one cannot tell is missed by one uncontrolled median.
    """
    missed = np.minimum(np.nan_to_num(worlds.margins, nan=-1.0), 0.0).sum(axis=1)
    return int(np.lexsort((-missed, -worlds.holds.sum(axis=1)))[0])


def _table(head: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _shares(worlds: Worlds, other: dict[str, np.ndarray]) -> str:
    n, holds = len(worlds.seeds), worlds.holds
    lines = []
    for i, statement in enumerate(STATEMENTS):
        low, high = wilson(int(holds[:, i].sum()), n)
        unclear = np.isnan(worlds.margins[:, i]).mean()
        again = [percent(verdicts[:, i].mean(), 1) for verdicts in other.values()]
        share = f"**{percent(holds[:, i].mean(), 1)}** ({percent(float(low), 1)} to {percent(float(high), 1)})"
        lines.append((statement.number, statement.text, share, percent(unclear, 1), *again))
    return _table(("", "the paper says", "holds in", "cannot tell", *other), lines)


def _in_short(holds: np.ndarray, nearest: int, settles: Sequence[tuple[str, float]]) -> str:
    p = holds.mean(axis=0)
    often, seldom = (
        ", ".join(str(one.number) for one, yes in zip(STATEMENTS, which, strict=True) if yes) or "none"
        for which in (p > 0.5, p < 0.1)
    )
    first = ", ".join(f"{name} ({percent(share)})" for name, share in settles[:DECIDING]) or NOTHING_FIRST
    return (
        f"**In short.** Statements that hold in more than half of the worlds: {often}; in less than a tenth: {seldom}. "
        f"All eleven hold in {percent(holds.all(axis=1).mean(), 2)}; at most {holds.sum(axis=1).max()} do, in world "
        f"{nearest + 1}. What to measure first, with the share of all doubt that it settles: {first}."
    )


def _jointly(holds: np.ndarray) -> str:
    count = holds.sum(axis=1)
    at_least = ", ".join(f"{k} or more {percent(np.mean(count >= k), 1)}" for k in range(int(count.max()), 3, -1))
    at_least = at_least or "never four"
    but_one = []
    for i, statement in enumerate(STATEMENTS):
        others = np.delete(holds, i, axis=1).all(axis=1)
        if others.any():
            of_these = percent(holds[others, i].mean())
            but_one.append(f"{statement.number}: {percent(others.mean(), 2)}, and it in {of_these} of these")
    without = "; ".join(but_one) or "none: in no world do any ten hold"
    return (
        f"All eleven hold in **{percent(holds.all(axis=1).mean(), 2)}** of the worlds. "
        f"Of the eleven hold: {at_least}.\n\n"
        f"All but one, by the one left out: {without}. Each pair: jointly.csv."
    )


def _decided(found: Indices, ranges: Ranges, names: Sequence[str], shares: np.ndarray, holds: np.ndarray) -> str:
    assumed = list(ranges.ranges.values())
    lines = []
    for i, statement in enumerate(STATEMENTS):
        if not np.isfinite(found.first[i]).any():
            lines.append((statement.number, statement.text, *["-"] * (DECIDING + 1)))
            continue
        order = np.argsort(-found.first[i], kind="stable")[:DECIDING]
        cells = []
        for j in order:
            text = f"{names[j]} {found.first[i, j]:.2f} ({found.half_width[i, j]:.2f})"
            text = f"**{text}**" if found.clear[i, j] else text
            cells.append(f"{text}: {where_it_holds(assumed[j], shares[:, j], holds[:, i])}")
        cells += ["-"] * (DECIDING - len(cells))
        rest = f"{max(1.0 - found.first[i, found.clear[i]].sum(), 0.0):.2f}"
        lines.append((statement.number, statement.text, *cells, rest))
    return _table(("", "the paper says", "first", "second", "third", "all that no one alone explains"), lines)


def where_it_holds(one: Range, shares: np.ndarray, holds: np.ndarray) -> str:
    """In how many worlds a statement holds: with each choice, or in each half of the range."""
    parts = 2 if one.choices is None else len(one.choices)
    place = np.minimum((shares * parts).astype(int), parts - 1)
    words = (f"up to {significant(float(one.at(0.5)))}", "above") if one.choices is None else map(str, one.choices)
    return ", ".join(f"{word} {_share(holds[place == part])}" for part, word in enumerate(words))


def _share(holds: np.ndarray) -> str:
    p = 100.0 * float(np.mean(holds)) if len(holds) else math.nan
    return f"{p:.0f} %" if p >= 9.5 else f"{p:.1f} %"


def _measure_first(
    ranges: Ranges, names: Sequence[str], doubt: np.ndarray, order: np.ndarray, found: Indices, holds: np.ndarray
) -> str:
    """A line for each assumption that settles something; the others in a sentence."""
    if not len(order):
        return f"{NOTHING_FIRST[:1].upper()}{NOTHING_FIRST[1:]}."
    others = ", ".join(name for j, name in enumerate(names) if j not in order)
    rest = f"\n\nNo index above chance: {others}." if others else ""
    p = holds.mean(axis=0)
    lines = []
    for j in order:
        of_it = np.where(found.clear[:, j], found.first[:, j], 0.0) * p * (1.0 - p)
        main = [f"{STATEMENTS[i].number}" for i in np.argsort(-of_it, kind="stable")[:3] if of_it[i] > 0.0]
        one = list(ranges.ranges.values())[j]
        lines.append((names[j], percent(doubt[j], 1), ", ".join(main), one.settled_by or "-", one.source))
    heads = "assumption", "settles of all doubt", "of statements, mainly", "how to settle it", "what it rests on now"
    return _table(heads, lines) + rest


def _nearest(worlds: Worlds, row: int, ranges: Ranges, values: Mapping[str, Value]) -> str:
    margins = worlds.margins[row]
    held = int(worlds.holds[row].sum())
    missing = [
        f"{s.number} (by {-m:.2f})" if not math.isnan(m) else f"{s.number} (one cannot tell)"
        for s, m in zip(STATEMENTS, margins, strict=True)
        if not m >= 0.0
    ]
    boxes = worlds.boxes(row)
    lines = []
    for measure, device, controller in worlds.cells:
        metric, box = BY_NAME[measure], boxes.get((measure, device, controller))
        q1, median, q3 = (f"{metric.scale * q:.2f}" for q in box) if box else ("-", "-", "-")
        size = f"{median} ({q1} to {q3}) {metric.shown_unit}"
        lines.append((metric.title, device, CONTROLLER[controller], size))
    assumed = [(label(column, one), values[column]) for column, one in ranges.ranges.items()]
    missed = f"missing: {', '.join(missing)}, in units of the uncontrolled median" if missing else "none is missing"
    return (
        f"World {row + 1}, seed {int(worlds.seeds[row])}: {held} of {len(STATEMENTS)} statements hold; {missed}.\n\n"
        f"Run it again, in this folder: `{_command(ranges)}`.\n\n"
        f"{_table(('assumption', 'in this world'), assumed)}\n\n"
        f"{_table(('measure', 'device', 'controller', 'median (quartiles)'), lines)}"
    )


def _indices_csv(ranges: Ranges, found: Indices) -> bytes:
    lines: list[Sequence[object]] = [("statement", "assumption", "first_order_index", "half_width_95")]
    for i, statement in enumerate(STATEMENTS):
        for j, column in enumerate(ranges.ranges):
            pair = found.first[i, j], found.half_width[i, j]
            lines.append((statement.number, column, *("" if np.isnan(x) else f"{x:.4g}" for x in pair)))
    return csv_bytes(lines)


def _jointly_csv(holds: np.ndarray) -> bytes:
    """Share of worlds in which both of two statements hold."""
    both = holds.astype(float).T @ holds / len(holds)
    numbers = [statement.number for statement in STATEMENTS]
    lines = [(number, *(f"{x:.4f}" for x in row)) for number, row in zip(numbers, both, strict=True)]
    return csv_bytes([("statement", *numbers), *lines])


# -------------------------------------------------------------------------------------------------------- the pictures


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
        figure, ((upper,), (lower,)) = sheet(note, (PAGE_IN, 8.4), (3.1, 0.15, 0.45, 0.35), 2, 1, (0.0, 0.75))
        places = np.arange(len(STATEMENTS))
        p = holds.mean(axis=0)
        low, high = wilson(holds.sum(axis=0), n)
        upper.barh(places, p, 0.62, color=PALE, zorder=2)
        upper.errorbar(p, places, xerr=(p - low, high - p), fmt="none", ecolor=TEXT, elinewidth=1.0, zorder=3)
        for (name, verdicts), marker in zip(other.items(), ("|", "x"), strict=False):
            upper.plot(verdicts.mean(axis=0), places, marker, color=BROWN, label=name, markersize=7.0, zorder=4)
        upper.legend(frameon=False, fontsize=SMALL, loc="lower right")
        names = [textwrap.fill(f"{one.number}  {one.text}", 50) for one in STATEMENTS]
        upper.set(xlim=(0.0, 1.0), yticks=places, yticklabels=names)
        upper.invert_yaxis()
        upper.tick_params(axis="y", labelsize=SMALL, length=0)
        title(upper, "Share of worlds in which it holds")
        lower.barh(np.arange(len(settled)), [share for _, share in settled], 0.62, color=ORANGE, zorder=2)
        lower.set(yticks=np.arange(len(settled)), yticklabels=[name for name, _ in settled], xlim=(0.0, None))
        lower.invert_yaxis()
        lower.tick_params(axis="y", labelsize=SMALL, length=0)
        title(lower, "Share of all doubt that knowing it settles" if settled else "No assumption alone settles any")
        for axes in (upper, lower):
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
        " Drawn: the share of worlds in which the statement holds, with its 95 % interval (shaded); dotted: of "
        "all worlds. Above: the assumption, its first-order index and half of that one's 95 % interval."
    )
    with matplotlib.rc_context(STYLE):
        size, margins = (PAGE_IN, 1.35 * max(len(rows), 1)), (1.75, 0.15, 0.45, 0.4)
        figure, grid = sheet(note, size, margins, max(len(rows), 1), columns, (0.3, 0.6), inside=True)
        for axes_row, i in zip(grid, rows, strict=False):
            order = np.argsort(-first[i], kind="stable")[:columns]
            for axes, j in zip(axes_row, order, strict=True):
                column = list(ranges)[j]
                _share_against(axes, ranges[column], shares[:, j], holds[:, i])
                index = f"{label(column, ranges[column])}\n{fixed(first[i, j], 2)} ± {fixed(half[i, j], 2)}"
                axes.set_title(index, fontsize=SMALL, loc="left", pad=3)
            statement = textwrap.fill(f"{STATEMENTS[i].number}  {STATEMENTS[i].text}", 26)
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
        axes.fill_between(middles, low, high, color=BLUE, alpha=0.25, linewidth=0.0, zorder=1)
        axes.plot(middles, p, "o-", color=BLUE, markersize=2.5, linewidth=1.2, zorder=2)
        axes.set_xticks((0.0, 0.5, 1.0), [significant(float(one.at(share))) for share in (0.0, 0.5, 1.0)])
    top = 1.0 if holds.mean() > RARE or p.max() > 2.0 * RARE else 2.0 * RARE
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, top), yticks=(0.0, 0.5 * top, top))
    axes.tick_params(labelsize=SMALL)
    plain(axes)
