"""The report on a run's samples: in which share each statement holds, what decides it, what contradicts what.

Its text is report_template.md; a section is left out where its first value is missing.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.analysis.findings import LITTLE_OF_U, SIMILAR_OF_U, STATEMENTS
from experiments.analysis.report import page
from experiments.numbers import fixed, percent, significant
from experiments.sensitivity.indices import Indices, dependent_pairs, find_indices
from experiments.sensitivity.judged import Judged, judge, read_trials, wilson
from experiments.sensitivity.pictures import decided_by, overview
from experiments.sensitivity.ranges import AssumptionRange, Ranges

TEMPLATE = Path(__file__).with_name("report_template.md")
DECIDING = 3  # ranges that the table names for each statement
TEXTS = {statement.number: statement.text for statement in STATEMENTS}


class Judgement:
    """The samples of a run with their verdicts."""

    def __init__(self, table: Path, ranges: Ranges, shares: np.ndarray, seed: int) -> None:
        """shares (samples, ranges): where the samples lie in the ranges."""
        self.ranges, self.shares, self.n = ranges, shares, len(shares)
        self.trials = read_trials(table)
        devices = [device.name for device in ranges.protocol.devices]
        self.judged: Judged = judge(self.trials, devices, seed)

    @property
    def holds(self) -> pd.DataFrame:
        return self.judged.holds

    @cached_property
    def indices(self) -> Indices:
        return find_indices(self.ranges.ranges, self.shares, self.holds)

    @cached_property
    def share(self) -> pd.DataFrame:
        """By statement: in which share of the samples it holds, and the 95 % interval of that."""
        low, high = wilson(self.holds.sum(), self.n)
        return pd.DataFrame({"share": self.holds.mean(), "low": low, "high": high})

    def where_it_holds(self, number: int, column: str) -> str:
        """In what share of the samples a statement holds: with each choice, or in each half of the range."""
        of = self.ranges.ranges[column]
        place = part_at(self.shares[:, list(self.ranges.ranges).index(column)], 2 if of.choices is None else None, of)
        words = (f"up to {significant(float(of.at(0.5)))}", "above") if of.choices is None else map(str, of.choices)
        by_part = self.holds[number].groupby(place).mean()
        return ", ".join(
            f"{word} {percent(by_part[part], 0 if by_part[part] >= 0.095 else 1)}"
            for part, word in enumerate(words)
            if part in by_part
        )


def part_at(shares: np.ndarray, parts: int | None, of: AssumptionRange) -> np.ndarray:
    """The part in which each sample lies, by its share (n,) of the range; parts: None: its choices."""
    count = parts or len(of.choices or ())
    return np.minimum((shares * count).astype(int), count - 1)


def report_files(
    table: Path, ranges: Ranges, shares: np.ndarray, seed: int
) -> tuple[dict[str, bytes], dict[str, object]]:
    """The files of the report by name, and what the summary says of it. Arguments: as `Judgement`'s."""
    found = Judgement(table, ranges, shares, seed)
    note = (
        f"{found.n} samples of the ranges {ranges.name!r}, seed {seed}: a study of {ranges.operators} simulated "
        "operators each, with its own values for what the paper does not give, judged by pooled boxes. Shares are of "
        "what was drawn, not of what is likely."
    )
    if ranges.fixed:
        fixed_values = ", ".join(f"{ranges.label(column)} {of.value}" for column, of in ranges.fixed.items())
        note += f" The same in all: {fixed_values}."
    count = found.holds.sum(axis=1)
    settled = found.indices.settled(found.holds)
    values = {
        "name": ranges.name,
        "note": note,
        "shares": _shares(found),
        "little": percent(LITTLE_OF_U),
        "similar": percent(SIMILAR_OF_U),
        "at_least": ", ".join(
            f"{k} or more in {percent((count >= k).mean(), 1)}" for k in range(int(count.max()), 2, -1)
        ),
        "decided": _decided(found),
        "pairs": _pairs(found),
        "measure_first": _measure_first(found, settled),
    }
    files = {
        "report.md": page(values, TEMPLATE).encode(),
        "overview.png": overview(found.share, found.judged.chance.mean(), note),
        "samples.csv": _samples(found).to_csv(index=False, lineterminator="\n").encode(),
        "indices.csv": _indices_table(found.indices).to_csv(index=False, lineterminator="\n").encode(),
    }
    if found.indices.first.notna().any(axis=None):
        files["decided-by.png"] = decided_by(ranges, found.shares, found.holds, found.indices, note)
    first = settled.index[0] if len(settled) and settled.iloc[0] > 0.0 else None
    return files, {
        "samples": found.n,
        "most_hold": f"{int(count.max())} of {len(STATEMENTS)} statements",
        "measure_first": ranges.label(first) if first else "nothing stands out (more samples may show something)",
    }


def _table(head: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _shares(found: Judgement) -> str:
    beside = {
        "by chance": found.judged.chance,
        "cannot tell": found.judged.cannot_tell,
        "half the bands": found.judged.half_bands,
        "twice the bands": found.judged.twice_bands,
    }
    lines = [
        (
            number, TEXTS[number], f"**{percent(share, 1)}** ({percent(low, 1)} to {percent(high, 1)})",
            *(percent(of[number].mean(), 1) for of in beside.values()),
        )
        for number, share, low, high in found.share.itertuples()
    ]  # fmt: skip
    return _table(("", "the paper says", "holds in (95 %)", *beside), lines)


def _decided(found: Judgement) -> str:
    first, half, counts = found.indices.first, found.indices.half_width, found.indices.counts
    lines = []
    for number, of_statement in first.iterrows():
        cells = []
        for column, index in of_statement.dropna().nlargest(DECIDING).items():
            text = f"{found.ranges.label(column)} {fixed(index, 2)} ± {fixed(half.loc[number, column], 2)}"
            text = f"**{text}**" if counts.loc[number, column] else text
            cells.append(f"{text}: {found.where_it_holds(number, column)}")
        alone = "-" if of_statement.isna().all() else fixed(of_statement.where(counts.loc[number], 0.0).sum(), 2)
        lines.append((number, TEXTS[number], alone, *cells, *["-"] * (DECIDING - len(cells))))
    return _table(("", "the paper says", "all that count", "first", "second", "third"), lines)


def _pairs(found: Judgement) -> str:
    lines = [
        (f"{a} and {b}", both, fixed(expected, 1), TEXTS[a], TEXTS[b])
        for a, b, both, expected in dependent_pairs(found.holds)
    ]
    return _table(("", "together in", "if independent", "the first says", "the second says"), lines) if lines else ""


def _measure_first(found: Judgement, settled: pd.Series) -> str:
    """A line for each range that settles something; the others in a sentence."""
    p, lines = found.holds.mean(), []
    for column, share in settled[settled > 0.0].items():
        of_each = found.indices.first[column].where(found.indices.counts[column], 0.0) * p * (1.0 - p)
        main = ", ".join(str(number) for number, value in of_each.nlargest(3).items() if value > 0.0)
        about = found.ranges.ranges[column]
        lines.append((found.ranges.label(column), percent(share, 1), main, about.settled_by or "-", about.source))
    others = ", ".join(found.ranges.label(column) for column in settled[settled == 0.0].index)
    if not lines:
        return "No range stands out from the dummies."
    head = "not printed", "settles of all doubt", "of statements, mainly", "how to settle it", "what it rests on now"
    return _table(head, lines) + (f"\n\nNo index stands out: {others}." if others else "")


def _samples(found: Judgement) -> pd.DataFrame:
    """A row a sample: its values, and 1 for each statement that holds."""
    drawn = pd.DataFrame([found.ranges.values(row) for row in found.shares.tolist()])
    verdicts = found.holds.astype(int).add_prefix("statement_")
    return pd.concat([pd.Series(range(1, found.n + 1), name="sample"), drawn, verdicts], axis=1)


def _indices_table(indices: Indices) -> pd.DataFrame:
    long = indices.first.rename_axis("statement").melt(
        ignore_index=False, var_name="range", value_name="first_order_index"
    )
    half = indices.half_width.melt(value_name="half_width_95")["half_width_95"]
    table = long.reset_index().assign(half_width_95=half, dummy=lambda t: t["statement"].map(indices.dummy))
    return table.round(4)
