"""The report on worlds, from their table: shares, what verdicts hang on, how far from the paper, what to measure first.

Its text is report_template.md; a section is left out where its first value is missing.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from experiments.analysis.findings import LITTLE_OF_U, SIMILAR_OF_U, STATEMENTS
from experiments.analysis.report import page
from experiments.analysis.trials_table import csv_bytes
from experiments.numbers import fixed, percent, significant
from experiments.protocol_writer import whole_text
from experiments.worlds.indices import LEAST_EITHER, Indices, effective_counts, find_indices, part_at
from experiments.worlds.pictures import decided_by, overview, wilson
from experiments.worlds.ranges import AssumptionRange, Ranges
from experiments.worlds.table import Verdicts, Worlds, judge, read_worlds

TEMPLATE = Path(__file__).with_name("report_template.md")
BANDS = {"half the bands": 0.5, "twice the bands": 2.0}
NEAREST, PEOPLE = "nearest.toml", "nearest-people.toml"
NOTHING_FIRST = "no assumption alone stands out from chance (more worlds may show one)"
DECIDING = 3  # assumptions that the table names for each statement
SEED = 1  # of the trials drawn anew


class Judgement:
    """A table of worlds, with the verdict of each study."""

    def __init__(self, table: Sequence[str], ranges: Ranges, shares: np.ndarray) -> None:
        """table: the lines of worlds.csv; shares (worlds, assumptions): where worlds lie in the ranges."""
        self.ranges, self.worlds, self.shares = ranges, read_worlds(table), shares
        self.n = len(shares)
        self.studies = self._judged(self.worlds)

    def _judged(self, worlds: Worlds, bands: float = 1.0) -> Verdicts:
        return judge(worlds, [device.name for device in self.ranges.protocol.devices], bands)

    @cached_property
    def holds(self) -> np.ndarray:
        """(worlds, triples, statements)"""
        return self.studies.holds.reshape(self.n, self.worlds.triples, -1)

    @cached_property
    def chance(self) -> Verdicts:
        """The verdicts of the same studies if no controller did anything."""
        groups = self.ranges.operators * len(self.ranges.protocol.paths)
        return self._judged(self.worlds.without_controllers(groups, SEED))

    @cached_property
    def other(self) -> dict[str, np.ndarray]:
        """Whether each statement holds (studies, statements) with other bands."""
        return {name: self._judged(self.worlds, bands).holds for name, bands in BANDS.items()}

    @cached_property
    def indices(self) -> Indices:
        return find_indices(self.ranges.ranges, self.shares, self.holds)

    @cached_property
    def settling(self) -> list[tuple[int, float]]:
        """The assumptions that settle any doubt, by their place, the most first, with the share of it."""
        settled = self.indices.settled(self.holds)
        return [(int(j), float(settled[j])) for j in np.argsort(-settled, kind="stable") if settled[j] > 0.0]

    @cached_property
    def everyone(self) -> Verdicts:
        """A row a world: the trials of all its triples in the same boxes."""
        return self._judged(self.worlds.pooled())

    @cached_property
    def nearest(self) -> int:
        """The place of the world that lacks least, by the first half of its triples, or its only one."""
        return int(np.argmin(self._judged(self.worlds.pooled(slice(max(self.worlds.triples // 2, 1)))).short))

    @cached_property
    def tried_again(self) -> Verdicts:
        """The nearest world alone, by the other half of its triples (by the same one, if it has no other)."""
        rows = slice(self.nearest * self.worlds.triples, (self.nearest + 1) * self.worlds.triples)
        return self._judged(self.worlds.part(rows).pooled(slice(self.worlds.triples // 2, None)))

    def note(self, seed: int) -> str:
        """A sentence on what was run, for report and pictures."""
        triples, ranges = self.worlds.triples, self.ranges
        text = (
            f"{self.n} worlds of the ranges {ranges.name!r}, seed {seed}: under assumptions of its own each, tried by "
            f"{'one triple' if triples == 1 else f'{triples} triples'} of {ranges.operators} simulated people; each "
            "study judged by pooled boxes. Shares are of what was drawn, not of what is likely."
        )
        fixed = (f"{ranges.label(column)} {fixed_range.value}" for column, fixed_range in ranges.fixed.items())
        return f"{text} The same in all: {', '.join(fixed)}." if ranges.fixed else text


def report_files(
    table: Sequence[str], ranges: Ranges, shares: np.ndarray, seed: int
) -> tuple[dict[str, bytes], dict[str, object]]:
    """The files of the report by name, and what the summary says of it. seed: of the run; the others: `Judgement`."""
    found = Judgement(table, ranges, shares)
    note, count = found.note(seed), found.studies.holds.sum(axis=1)
    all_hold = f"{percent(np.mean(count == len(STATEMENTS)), 2)} of the studies"
    at_least = [f"{k} or more in {percent(np.mean(count >= k), 1)}" for k in range(int(count.max()), 3, -1)]
    values = {
        "name": ranges.name,
        "note": note,
        "in_short": _in_short(found),
        "shares": _shares(found),
        "little": percent(LITTLE_OF_U),
        "similar": percent(SIMILAR_OF_U),
        "all_hold": all_hold,
        "at_least": ", ".join(at_least) or "never four",
        "nearest": _nearest(found),
    }
    files = {"overview.png": overview(found.holds, found.chance.holds, found.indices.split, note)}
    if found.worlds.triples > 1:
        values |= {"triples": str(found.worlds.triples), "far": _far(found), "distances": _distances(found)}
    if found.indices.any:
        values |= {
            "split": _split(found),
            "least_either": str(LEAST_EITHER),
            "decided": _decided(found),
            "measure_first": _measure_first(found),
        }
        files |= {
            "decided-by.png": decided_by(ranges, found.shares, found.holds, found.indices, note),
            "indices.csv": _indices_csv(found),
        }
    files |= _nearest_files(found) | {"report.md": page(values, TEMPLATE).encode()}
    return files, {
        "worlds": found.n,
        "all_hold": all_hold,
        "most_hold": f"{count.max()} of {len(STATEMENTS)} statements",
        "measure_first": ranges.labels[found.settling[0][0]] if found.settling else NOTHING_FIRST,
    }


def _table(head: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _in_short(found: Judgement) -> str:
    p = found.holds.mean(axis=(0, 1))
    often, seldom = (
        ", ".join(str(statement.number) for statement, yes in zip(STATEMENTS, which, strict=True) if yes) or "none"
        for which in (p > 0.5, p < 0.1)
    )
    labels = found.ranges.labels
    first = ", ".join(f"{labels[j]} ({percent(share)})" for j, share in found.settling[:DECIDING]) or NOTHING_FIRST
    return (
        f"Statements that hold in more than half of the studies: {often}; in less than a tenth: {seldom}. "
        f"What to measure first, with the share of all doubt that it settles: {first}."
    )


def _shares(found: Judgement) -> str:
    low, high = wilson(*effective_counts(found.holds))
    lines = []
    for i, statement in enumerate(STATEMENTS):
        share = f"**{percent(found.holds[..., i].mean(), 1)}** ({percent(low[i], 1)} to {percent(high[i], 1)})"
        columns = [found.chance.holds, found.studies.depends, np.isnan(found.studies.margins), *found.other.values()]
        lines.append((statement.number, statement.text, share, *(percent(of[:, i].mean(), 1) for of in columns)))
    head = "", "the paper says", "holds in", "by chance", "depends", "cannot tell", *found.other
    return _table(head, lines)


def _split(found: Judgement) -> str:
    split, half_width = found.indices.split, found.indices.half_width
    parts = {"alone": "alone", "interplay": "interplay", "people": "people"}
    if found.worlds.triples == 1:
        parts = {"alone": "alone", "rest": "interplay and people"}
    lines = []
    for i, statement in enumerate(STATEMENTS):
        pairs = [(getattr(split, part)[i], getattr(half_width, part)[i]) for part in parts]
        cells = ["-" if np.isnan(share) else f"{fixed(share, 2)} ± {fixed(half, 2)}" for share, half in pairs]
        lines.append((statement.number, statement.text, *cells))
    return _table(("", "the paper says", *parts.values()), lines)


def _far(found: Judgement) -> str:
    margins = found.everyone.margins
    low, middle, high = (np.nanquantile(margins, q, axis=0) for q in (0.1, 0.5, 0.9))
    everyone = found.everyone.holds.mean(axis=0)
    lines = [
        (
            statement.number, statement.text, percent(found.holds[..., i].mean(), 1), percent(everyone[i], 1),
            f"{fixed(middle[i], 2, '+')} ({fixed(low[i], 2, '+')} to {fixed(high[i], 2, '+')})",
        )
        for i, statement in enumerate(STATEMENTS)
    ]  # fmt: skip
    return _table(("", "the paper says", "three people", "all of a world", "margin of the median world (80 %)"), lines)


def _distances(found: Judgement) -> str:
    """How many statements hold, and what is lacking, in studies and in worlds."""
    half = f"nearest world ({found.nearest + 1}), found by half of its triples: all people of the others"
    cases = {
        "three people, all studies": found.studies,
        "three people, all studies, if no controller did anything": found.chance,
        "all people of a world, all worlds": found.everyone,
        half: found.tried_again,
    }
    lines = [
        (what, _middle_and_ends(of.holds.sum(axis=1), 0), _middle_and_ends(of.short, 2)) for what, of in cases.items()
    ]
    return _table(("", "of the eleven hold", "lacking"), lines)


def _middle_and_ends(values: np.ndarray, digits: int) -> str:
    ends = f" ({values.min():.{digits}f} to {values.max():.{digits}f})" if len(values) > 1 else ""
    return f"{np.median(values):.{digits}f}{ends}"


def _decided(found: Judgement) -> str:
    ranges, indices = list(found.ranges.ranges.values()), found.indices
    lines = []
    for i, statement in enumerate(STATEMENTS):
        first, half = indices.split.first[i], indices.half_width.first[i]
        cells = ["-"] * DECIDING
        for place, j in enumerate(np.argsort(-first, kind="stable")[:DECIDING]):
            if not np.isnan(first[j]):
                text = f"{found.ranges.labels[j]} {fixed(first[j], 2)} ± {fixed(half[j], 2)}"
                where = where_it_holds(ranges[j], found.shares[:, j], found.holds[..., i].mean(axis=1))
                cells[place] = f"{f'**{text}**' if indices.clear[i, j] else text}: {where}"
        lines.append((statement.number, statement.text, *cells))
    return _table(("", "the paper says", "first", "second", "third"), lines)


def where_it_holds(of: AssumptionRange, shares: np.ndarray, holds: np.ndarray) -> str:
    """In what share of the studies a statement holds: with each choice, or in each half of the range."""
    parts = 2 if of.choices is None else len(of.choices)
    place = part_at(shares, parts)
    words = (f"up to {significant(float(of.at(0.5)))}", "above") if of.choices is None else map(str, of.choices)
    of_each = [holds[place == part].mean() if np.any(place == part) else np.nan for part in range(parts)]
    return ", ".join(f"{word} {percent(p, 0 if p >= 0.095 else 1)}" for word, p in zip(words, of_each, strict=True))


def _measure_first(found: Judgement) -> str:
    """A line for each assumption that settles something; the others in a sentence."""
    if not found.settling:
        return f"{NOTHING_FIRST[:1].upper()}{NOTHING_FIRST[1:]}."
    p, lines = found.holds.mean(axis=(0, 1)), []
    for j, share in found.settling:
        settled = np.where(found.indices.clear[:, j], found.indices.split.first[:, j], 0.0) * p * (1.0 - p)
        main = [f"{STATEMENTS[i].number}" for i in np.argsort(-settled, kind="stable")[:3] if settled[i] > 0.0]
        assumption = list(found.ranges.ranges.values())[j]
        about = assumption.settled_by or "-", assumption.source
        lines.append((found.ranges.labels[j], percent(share, 1), ", ".join(main), *about))
    heads = "assumption", "settles of all doubt", "of statements, mainly", "how to settle it", "what it rests on now"
    others = [name for j, name in enumerate(found.ranges.labels) if j not in dict(found.settling)]
    return _table(heads, lines) + (f"\n\nNo index above chance: {', '.join(others)}." if others else "")


def _nearest(found: Judgement) -> str:
    row = found.nearest * found.worlds.triples
    values = found.ranges.values(found.shares[found.nearest].tolist())
    by = (
        f"Found by {found.worlds.triples // 2} of its triples, tried by the others"
        if found.worlds.triples > 1
        else f"The best of {found.n} for its three people: with others it need not be near"
    )
    verdict = found.tried_again
    missing = [
        f"{s.number} ({'one cannot tell' if np.isnan(margin) else f'by {-margin:.2f}'})"
        for s, margin, holds in zip(STATEMENTS, verdict.margins[0], verdict.holds[0], strict=True)
        if not holds
    ]
    lines = [(label, values[column]) for label, column in zip(found.ranges.labels, values, strict=True)]
    return (
        f"World {found.nearest + 1}, seed {int(found.worlds.seeds[row])}. {by}: {int(verdict.holds.sum())} of "
        f"{len(STATEMENTS)} statements hold; missing, in units of the uncontrolled median: "
        f"{', '.join(missing) or 'none'}.\n\n"
        f"Run it, in this folder: `{_command(found.ranges)}`.\n\n{_table(('assumption', 'in this world'), lines)}"
    )


def _nearest_files(found: Judgement) -> dict[str, bytes]:
    """The nearest world as files that `phd study` runs as they are: its protocol, with its devices, and its people."""
    number, ranges = found.nearest + 1, found.ranges
    seed = int(found.worlds.seeds[found.nearest * found.worlds.triples])
    protocol, population = ranges.study(ranges.values(found.shares[found.nearest].tolist()), seed)
    about = f"# World {number} of the ranges {ranges.name!r}, the nearest to the paper:\n#   {_command(ranges)}\n"
    name = f"{protocol.name}, world {number}"
    return {NEAREST: whole_text(protocol, name, about).encode(), PEOPLE: population.text.encode()}


def _command(ranges: Ranges) -> str:
    """The command that runs the nearest world again, in the folder of the report."""
    return f"phd study {NEAREST} --population {PEOPLE} --operators {ranges.operators} --out nearest"


def _indices_csv(found: Judgement) -> bytes:
    lines: list[Sequence[object]] = [
        ("statement", "assumption", "first_order_index", "half_width_95", "limit_of_chance")
    ]
    indices = found.indices
    for i, statement in enumerate(STATEMENTS):
        for j, column in enumerate(found.ranges.ranges):
            numbers = indices.split.first[i, j], indices.half_width.first[i, j], indices.limit[i]
            lines.append((statement.number, column, *("" if np.isnan(x) else f"{x:.4g}" for x in numbers)))
    return csv_bytes(lines)
