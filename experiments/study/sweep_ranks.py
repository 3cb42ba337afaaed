"""Which controller of a sweep does best by which measure: ranks with intervals, ties, and the front of the possible.

A person's score is the mean of that person's trials, a controller's value the median of the people. Intervals are of
people drawn again, within each population and seed. A controller is said to be better than another where it is so
under every seed and in all but 2.5 % of the draws; two of which neither is better are a tie. Trials that did not reach
the end are left out and counted.
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from core.control.controllers import PARAMETERS
from experiments.analysis.metrics import BY_NAME, Metric
from experiments.analysis.sheet import BLUE, GREY, PAGE_IN, SMALL, STYLE, figure_bytes, plain, sheet, title
from experiments.analysis.trials_table import csv_bytes
from experiments.numbers import significant
from experiments.study.sweep_effects import ALWAYS, SEED, Person, Row, person_in

#: Accuracy, effort and smoothness, which the front is made of; then what explains them.
FRONT = tuple(BY_NAME[name] for name in ("path_error_m", "hand_energy_per_metre_J_m", "acceleration_exact_dft_sum"))
RANKED = (
    *FRONT,
    *(BY_NAME[name] for name in ("mean_tip_force_N", "chatter_per_s", "switches_per_s", "steerable_share")),
    BY_NAME["push_held_share"],
)
ALL = "all"
MOST = 20  # controllers of a sweep that are ranked: more are values of a parameter, which `sweep_effects` draws
MOST_ROWS = 3  # of the figure
DRAWS, SURE = 1000, 0.975


class Rank(NamedTuple):
    """One controller by one measure, in a part of the trials."""

    where: str  # "all", or a key and its value: "configuration pter"
    measure: Metric
    controller: str
    people: int
    reached: float  # share of the trials that reached the end
    value: float  # in the measure's shown unit, as `low` and `high`, the 95 % interval
    low: float
    high: float
    rank: int
    rank_low: int  # 95 % interval
    rank_high: int
    of_seeds: tuple[int, ...]  # its rank under each seed
    first: int  # 1 + those that are better
    last: int  # number of controllers less those that it is better than

    @property
    def place(self) -> str:
        return str(self.first) if self.first == self.last else f"{self.first} to {self.last}"


def ranks(rows: Sequence[Row], varied: Sequence[str]) -> list[Rank]:
    """Every controller by every measure, over all trials and at each value of each key; none for one or many.

    varied: the seed and assumptions that are not the same in all rows.
    """
    controllers = list(dict.fromkeys(row["controller_name"] for row in rows))
    if not 2 <= len(controllers) <= MOST:
        return []
    parts = {ALL: list(rows)}
    for key in (*ALWAYS, *varied):
        values = dict.fromkeys(row[key] for row in rows)
        if key not in ("kind", SEED, *PARAMETERS) and len(values) > 1:
            parts |= {f"{key} {value}": [row for row in rows if row[key] == value] for value in values}
    return [rank for where, some in parts.items() for m in RANKED for rank in _ranked(where, some, m, controllers)]


def _ranked(where: str, rows: Sequence[Row], measure: Metric, controllers: Sequence[str]) -> list[Rank]:
    """The controllers by one measure, in a part of the trials; none where fewer than two have a value."""
    people = list(dict.fromkeys(map(person_in, rows)))
    scores, reached = _scores(rows, measure, people, controllers)
    kept = [k for k in range(len(controllers)) if np.isfinite(scores[:, k]).any()]
    if len(kept) < 2:
        return []
    scores = scores[:, kept]
    of_seeds = [scores[[person[1] == seed for person in people]] for seed in dict.fromkeys(p[1] for p in people)]
    value, *by_seed = (np.nanmedian(some, axis=0) for some in (scores, *of_seeds))
    drawn = _drawn(scores, people)
    sign = -1.0 if measure.better == "higher" else 1.0  # the least is the best
    is_better = np.all([sign * median[:, None] < sign * median for median in (value, *by_seed)], axis=0)
    is_better &= np.mean(sign * drawn[:, :, None] < sign * drawn[:, None, :], axis=0) >= SURE
    low, high = np.nanquantile(drawn, (1.0 - SURE, SURE), axis=0)
    rank_low, rank_high = np.quantile(_order(sign * drawn), (1.0 - SURE, SURE), axis=0, method="nearest")
    rank, ranks_by_seed = _order(sign * value), _order(sign * np.array(by_seed))
    return [
        Rank(
            where, measure, controllers[k], int(np.isfinite(scores[:, j]).sum()), float(reached[k]),
            float(value[j]), float(low[j]), float(high[j]), int(rank[j]), int(rank_low[j]), int(rank_high[j]),
            tuple(map(int, ranks_by_seed[:, j])), 1 + int(is_better[:, j].sum()), len(kept) - int(is_better[j].sum()),
        )
        for j, k in enumerate(kept)
    ]  # fmt: skip


def _scores(
    rows: Sequence[Row], measure: Metric, people: Sequence[Person], controllers: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Each person's mean (people, controllers), NaN where there is none; the share of trials that reached the end."""
    scores, reached = np.full((len(people), len(controllers)), np.nan), np.zeros(len(controllers))
    for k, name in enumerate(controllers):
        tried = [row for row in rows if row["controller_name"] == name]
        done = [row for row in tried if row["status"] == "done"]
        reached[k] = len(done) / max(len(tried), 1)
        values: dict[Person, list[float]] = {}
        for row in done:
            if row[measure.name]:
                values.setdefault(person_in(row), []).append(float(row[measure.name]))
        for person, of_person in values.items():
            scores[people.index(person), k] = measure.scale * np.mean(of_person)
    return scores, reached


def _drawn(score: np.ndarray, people: Sequence[Person]) -> np.ndarray:
    """Medians (draws, controllers) of people (n, controllers) drawn again, each population and seed by itself."""
    rng, chosen = np.random.default_rng(1), np.empty((DRAWS, len(people)), dtype=int)
    for group in dict.fromkeys(person[:2] for person in people):
        members = np.array([n for n, person in enumerate(people) if person[:2] == group])
        chosen[:, members] = rng.choice(members, (DRAWS, len(members)))
    median = np.nanmedian if np.isnan(score).any() else np.median  # it is the slower one
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a draw of people none of whom reached the end has no value
        return np.asarray(median(score[chosen], axis=1))


def _order(values: np.ndarray) -> np.ndarray:
    """Ranks from 1 along the last axis, the least first."""
    return values.argsort(axis=-1, kind="stable").argsort(axis=-1, kind="stable") + 1


def front(found: Sequence[Rank], where: str = ALL) -> list[str]:
    """Controllers of which no other is better in one of `FRONT` and as good in the others."""
    values: dict[str, list[float]] = {}
    for rank in found:
        if rank.where == where and rank.measure in FRONT:
            values.setdefault(rank.controller, []).append(rank.value)
    whole = {name: np.array(value) for name, value in values.items() if len(value) == len(FRONT)}
    return [
        name
        for name, value in whole.items()
        if not any(np.all(other <= value) and np.any(other < value) for other in whole.values())
    ]


def rank_sentences(found: Sequence[Rank]) -> list[str]:
    """The ranks over all trials, a sentence for each measure, and the front."""
    sentences = []
    for measure in RANKED:
        here = sorted((r for r in found if r.where == ALL and r.measure is measure), key=lambda rank: rank.rank)
        if here:
            entries = (f"{r.place} {r.controller} ({significant(r.value)})" for r in here)
            sentences.append(f"{measure.short}: {'; '.join(entries)}")
    return [*sentences, f"front: {'; '.join(front(found))}"] if found else []


def rank_files(found: Sequence[Rank], name: str) -> dict[str, bytes]:
    """File name -> content: the ranks as a table, and the front drawn."""
    header = ("where", "measure", "unit", "controller", "people", "reached", "value", "low", "high", "rank", "rank_low",
              "rank_high", "rank_by_seed", "place")  # fmt: skip
    lines = (
        (r.where, r.measure.name, r.measure.shown_unit, r.controller, r.people, r.reached, r.value, r.low, r.high,
         r.rank, r.rank_low, r.rank_high, " ".join(map(str, r.of_seeds)), r.place)
        for r in found
    )  # fmt: skip
    return {"ranks.csv": csv_bytes([header, *lines]), "front.png": _draw_front(found, name)}


def _draw_front(found: Sequence[Rank], name: str) -> bytes:
    """Path error against effort and against smoothness, each controller a number; a row for each assumption's value."""
    names = list(dict.fromkeys(rank.controller for rank in found))
    rows = [part for part in dict.fromkeys(rank.where for rank in found) if part.split()[0] not in (ALL, *ALWAYS)]
    rows = rows if 2 <= len(rows) <= MOST_ROWS else [ALL]
    note = (
        f"Sweep {name}. Medians of the simulated people with 95 % intervals. Blue: no other controller is better in "
        "one of the three measures and as good in the others. Below and to the left is better."
    )
    with matplotlib.rc_context(STYLE):
        size, margins = (PAGE_IN, 2.3 * len(rows) + 1.3), (0.65, 1.85, 0.55, 0.35)
        figure, grid = sheet(note, size, margins, (len(rows), 2), (0.65, 0.65), sharex=True, sharey="col")
        for line, where in zip(grid, rows, strict=True):
            best = front(found, where)
            for panel, measure in zip(line, FRONT[1:], strict=True):
                _draw_panel(panel, found, (where, measure), {name: BLUE if name in best else GREY for name in names})
        for place, controller in enumerate(names):
            at = 1.0 - 1.7 / size[0], 1.0 - (0.45 + 0.19 * place) / size[1]
            figure.text(*at, f"{place + 1}  {controller}", parse_math=False)
        return figure_bytes(figure, "png")


def _draw_panel(axes: Axes, found: Sequence[Rank], what: tuple[str, Metric], colours: dict[str, str]) -> None:
    where, across = what
    at = {(rank.measure.name, rank.controller): rank for rank in found if rank.where == where}
    for number, (name, colour) in enumerate(colours.items(), start=1):
        x, y = at.get((FRONT[0].name, name)), at.get((across.name, name))
        if x is None or y is None:
            continue
        errors = [[x.value - x.low], [x.high - x.value]], [[y.value - y.low], [y.high - y.value]]
        axes.errorbar(x.value, y.value, errors[1], errors[0], color=colour, linewidth=0.8, zorder=2)
        axes.plot(x.value, y.value, "o", color="white", markeredgecolor=colour, markersize=9, zorder=3)
        axes.text(x.value, y.value, str(number), ha="center", va="center", color=colour, fontsize=SMALL, zorder=4)
    axes.set(xscale="log", yscale="log", xlabel=f"{FRONT[0].short} ({FRONT[0].shown_unit})")
    axes.set_ylabel(f"{across.short} ({across.shown_unit})")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    plain(axes)
    title(axes, where)
