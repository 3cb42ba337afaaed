"""What a sweep says: each key that it varies against each measure of the figures, and which key moves which most."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from scipy import stats

from experiments.analysis.metrics import FIGURES, Metric
from experiments.analysis.sheet import BLUE, PAGE_IN, STYLE, figure_bytes, sheet, title
from experiments.analysis.trials_table import csv_bytes
from experiments.numbers import significant

LEVEL = 0.95
PANEL_IN = 1.5
SEED = "seed"
ALWAYS = ("population", "configuration", "rules", "kind")

Row = dict[str, str]  # of sweep.csv
Person = tuple[str, str, str]  # population, seed, number


class Effect(NamedTuple):
    """A measure at each value of a key: the mean of the people, each of them the mean over everything else."""

    key: str  # "gap_m of sdof": a parameter of a controller is a key for each kind that has it
    measure: Metric
    values: tuple[str, ...]  # in the order of the table
    means: np.ndarray  # in the measure's shown unit
    half: np.ndarray  # half of the interval that holds the mean of all such people (Student's t); NaN of one person

    @property
    def moved(self) -> float:
        """Between the largest and the smallest mean."""
        return float(np.ptp(self.means))

    @property
    def words(self) -> str:
        low, high = int(self.means.argmin()), int(self.means.argmax())
        unit = f" {self.measure.shown_unit}" if self.measure.shown_unit else ""
        least, most = significant(self.means[low]), significant(self.means[high])
        return f"{self.key}, from {least}{unit} at {self.values[low]} to {most}{unit} at {self.values[high]}"


def person_in(row: Row) -> Person:
    """Who moved the handle in a row: another seed draws other people."""
    return row["population"], row.get(SEED, ""), row["operator"]


def effects(
    rows: Sequence[Row], varied: Sequence[str], parameters: Sequence[str], measures: Sequence[Metric]
) -> list[Effect]:
    """Every key with more than one value against every measure that has a value at each of them.

    varied: the seed and assumptions that are not the same in all rows; parameters: of all controllers. Trials that did
    not reach the end are left out.
    """
    done = [row for row in rows if row["status"] == "done"]
    keys = [(key, key, done) for key in (*ALWAYS, *varied)]
    for kind in dict.fromkeys(row["kind"] for row in done):
        own = [row for row in done if row["kind"] == kind]
        keys += [(f"{key} of {kind}", key, own) for key in parameters]
    found = (_effect(name, column, some, metric) for name, column, some in keys for metric in measures)
    return [effect for effect in found if effect is not None]


def _effect(name: str, column: str, rows: Sequence[Row], measure: Metric) -> Effect | None:
    values = tuple(dict.fromkeys(row[column] for row in rows))
    if len(values) < 2:
        return None
    means, half = np.full(len(values), math.nan), np.full(len(values), math.nan)
    for place, value in enumerate(values):
        people: dict[Person, list[float]] = {}
        for row in rows:
            if row[column] == value and row[measure.name]:
                people.setdefault(person_in(row), []).append(measure.scale * float(row[measure.name]))
        each = [float(np.mean(some)) for some in people.values()]
        if each:
            means[place] = np.mean(each)
        if len(each) > 1:
            quantile = stats.t.ppf(0.5 + 0.5 * LEVEL, len(each) - 1)
            half[place] = quantile * np.std(each, ddof=1) / math.sqrt(len(each))
    return Effect(name, measure, values, means, half) if np.isfinite(means).all() else None


def moves_most(found: Sequence[Effect]) -> list[str]:
    """For each measure the key that moves it most, a sentence each."""
    sentences = []
    for measure in _measures_of(found):
        here = [effect for effect in found if effect.measure is measure]
        sentences.append(f"{measure.short}: {max(here, key=lambda effect: effect.moved).words}")
    return sentences


def _measures_of(found: Sequence[Effect]) -> list[Metric]:
    """The measures that have an effect: those of the figures in their order, then those of one's own."""
    by_name = {effect.measure.name: effect.measure for effect in found}
    own = [measure for measure in by_name.values() if measure not in FIGURES]
    return [*(measure for measure in FIGURES if measure.name in by_name), *own]


def effect_files(found: Sequence[Effect], name: str) -> dict[str, bytes]:
    """File name -> content: the effects drawn, a column a key and a row a measure, and as a table."""
    keys = list(dict.fromkeys(effect.key for effect in found))
    measures = _measures_of(found)
    note = (
        f"Sweep {name}. Mean of the simulated people, each the mean over everything else that the sweep varies, with "
        f"the {100 * LEVEL:.0f} % interval of that mean (Student's t). Trials that did not reach the end are left out."
    )
    size = max(PAGE_IN, 1.1 + (PANEL_IN + 0.25) * len(keys)), (PANEL_IN + 0.35) * len(measures)
    with matplotlib.rc_context(STYLE):
        shape, gaps = (len(measures), len(keys)), (0.25, 0.35)
        figure, grid = sheet(note, size, (0.8, 0.35, 0.6, 0.35), shape, gaps, inside=True, sharex="col", sharey="row")
        for effect in found:
            axes = grid[measures.index(effect.measure), keys.index(effect.key)]
            places = range(len(effect.values))
            axes.errorbar(places, effect.means, effect.half, fmt="o-", color=BLUE, markersize=3, linewidth=1.0)
            axes.set_xticks(places, effect.values, rotation=30, ha="right")
            axes.margins(x=0.2)
        for row, measure in zip(grid, measures, strict=True):
            row[0].set_ylabel(f"{measure.short}\n({measure.shown_unit})" if measure.shown_unit else measure.short)
        for axes, key in zip(grid[0], keys, strict=True):
            title(axes, key)
        drawn = figure_bytes(figure, "png")
    lines: list[tuple] = [("key", "value", "measure", "unit", "mean", "low", "high")]
    for effect in found:
        for value, mean, half in zip(effect.values, effect.means, effect.half, strict=True):
            ends = ("", "") if math.isnan(half) else (mean - half, mean + half)
            lines.append((effect.key, value, effect.measure.name, effect.measure.shown_unit, mean, *ends))
    return {"effects.png": drawn, "effects.csv": csv_bytes(lines)}
