"""What a sweep says: how each key that it varies moves each measure, and how its controllers rank.

A person's score is the mean of that person's trials, those that reached the end.
"""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from scipy.stats import rankdata

from experiments.analysis.metrics import BY_NAME, Metric
from experiments.analysis.sheet import BLUE, PAGE_IN, STYLE, figure_bytes, sheet, title
from experiments.numbers import significant

PANEL_IN = 1.5
SEED = "seed"
ALWAYS = ("population", "configuration", "rules", "kind")
RANKED = tuple(
    BY_NAME[name]
    for name in (
        "path_error_m", "hand_energy_per_metre_J_m", "acceleration_exact_dft_sum", "mean_tip_force_N", "chatter_per_s",
        "switches_per_s", "steerable_share", "push_held_share",
    )
)  # fmt: skip
ALL = "all"
MOST = 20  # controllers of a sweep that are ranked: more are values of a parameter, which `effects` shows


def read_sweep(path: Path, numbers: Sequence[str]) -> pd.DataFrame:
    """sweep.csv: the measures as numbers, NaN where a trial has none; everything else as the text that it is."""
    columns = pd.read_csv(path, nrows=0).columns
    texts = {name: str for name in columns if name not in numbers}
    return pd.read_csv(path, dtype=texts, keep_default_na=False, na_values={name: [""] for name in numbers})


def _scores(trials: pd.DataFrame, by: str, measures: Sequence[Metric]) -> pd.DataFrame:
    """The mean of each person's trials, a row for each value of `by` and person; another seed draws other people."""
    person = [name for name in ("population", SEED, "participant") if name in trials and name != by]
    done = trials[trials["status"] == "done"]
    means = done.groupby([by, *person], sort=False)[[metric.name for metric in measures]].mean()
    return means * [metric.scale for metric in measures]


def medians(trials: pd.DataFrame, varied: Sequence[str], measures: Sequence[Metric]) -> pd.DataFrame:
    """The median of each measure over the trials that reached the end, in its unit, a row a device, path, controller
    and value of each key that the sweep varies.
    """
    keys = [key for key in (*ALWAYS, *varied) if key not in ("kind", SEED) and trials[key].nunique() > 1]
    keys = list(dict.fromkeys(["configuration", "path", "controller_name", *keys]))
    cells = trials[trials["status"] == "done"].groupby(keys, sort=False)
    found = cells[[metric.name for metric in measures]].median()
    found.insert(0, "trials", cells.size())
    return found.reset_index()


def effects(
    trials: pd.DataFrame, varied: Sequence[str], parameters: Sequence[str], measures: Sequence[Metric]
) -> pd.DataFrame:
    """The mean of the people's scores at each value of each key, and how far it is from that at the key's first value.

    varied: the seed and assumptions that are not the same in all rows; parameters: of all controllers, a key for each
    kind that has it ("gap_m of sdof"). Left out: keys of one value, measures without a value somewhere.
    """
    keys = [(key, key, trials) for key in (*ALWAYS, *varied)]
    for kind, own in trials.groupby("kind", sort=False):
        keys += [(f"{key} of {kind}", key, own) for key in parameters]
    units = {metric.name: metric.shown_unit for metric in measures}
    found = [pd.DataFrame(columns=["key", "value", "measure", "unit", "mean", "difference"])]
    for key, column, some in keys:
        if some[column].nunique() > 1:
            means = _scores(some, column, measures).groupby(level=column, sort=False).mean()
            means = means.reindex(some[column].unique()).dropna(axis="columns")
            effect = means.melt(var_name="measure", value_name="mean", ignore_index=False)
            effect["difference"] = effect["mean"] - effect.groupby("measure")["mean"].transform("first")
            effect = effect.reset_index(names="value").assign(key=key, unit=effect["measure"].map(units).to_numpy())
            found.append(effect[found[0].columns])
    return pd.concat(found[1:] or found, ignore_index=True)


def moves_most(found: pd.DataFrame, measures: Sequence[Metric]) -> list[str]:
    """For each measure the key that moves it most, a sentence each."""
    sentences = []
    for metric in measures:
        here = found[found["measure"] == metric.name]
        if len(here):
            key = here.groupby("key", sort=False)["mean"].agg(np.ptp).idxmax()
            means = here[here["key"] == key].set_index("value")["mean"]
            unit = f" {metric.shown_unit}" if metric.shown_unit else ""
            least, most = f"{significant(means.min())}{unit}", f"{significant(means.max())}{unit}"
            sentences.append(f"{metric.short}: {key}, from {least} at {means.idxmin()} to {most} at {means.idxmax()}")
    return sentences


def ranks(trials: pd.DataFrame, varied: Sequence[str]) -> pd.DataFrame:
    """Every controller by every measure, over all trials and at each value of each key; none for one or many.

    value: the median of the people's scores, in the shown unit. rank: of the values, 1 is best. rank_low, rank_high:
    between them half of the people rank it, each by their own scores.
    """
    if not 2 <= trials["controller_name"].nunique() <= MOST:
        return pd.DataFrame()
    parts = [(ALL, trials)]
    for key in (*ALWAYS, *varied):
        if key not in ("kind", SEED) and trials[key].nunique() > 1:
            parts += [(f"{key} {value}", some) for value, some in trials.groupby(key, sort=False)]
    found = [_ranked(where, some, metric) for where, some in parts for metric in RANKED]
    return pd.concat(found, ignore_index=True)


def _ranked(where: str, trials: pd.DataFrame, metric: Metric) -> pd.DataFrame:
    scores = _scores(trials, "controller_name", [metric])[metric.name].unstack("controller_name", sort=False)
    scores = scores.dropna(axis="columns", how="all")
    sign = -1.0 if metric.better == "higher" else 1.0
    values = scores.median()
    of_each = pd.DataFrame(rankdata(sign * scores, axis=1, nan_policy="omit"), columns=scores.columns)
    low, high = of_each.quantile(0.25, interpolation="lower"), of_each.quantile(0.75, interpolation="higher")
    reached = (trials["status"] == "done").groupby(trials["controller_name"]).mean()
    return pd.DataFrame(
        {
            "where": where, "measure": metric.name, "unit": metric.shown_unit, "controller": values.index,
            "people": scores.count(), "reached": reached[values.index], "value": values,
            "rank": rankdata(sign * values), "rank_low": low, "rank_high": high,
        }
    )  # fmt: skip


def rank_sentences(found: pd.DataFrame) -> list[str]:
    """The ranks over all trials, a sentence for each measure."""
    sentences = []
    for metric in RANKED if len(found) else ():
        here = found[(found["where"] == ALL) & (found["measure"] == metric.name)].sort_values("rank", kind="stable")
        entries = [f"{row.rank:g} {row.controller} ({significant(row.value)})" for row in here.itertuples()]
        if entries:
            sentences.append(f"{metric.short}: {'; '.join(entries)}")
    return sentences


def draw_effects(found: pd.DataFrame, measures: Sequence[Metric], name: str) -> bytes:
    """PNG: the mean at each value, a column a key and a row a measure."""
    keys, shown = list(found["key"].unique()), [metric for metric in measures if metric.name in set(found["measure"])]
    note = (
        f"Sweep {name}. Mean of the simulated operators, each the mean over everything else that the sweep varies. "
        "Trials that did not reach the end are left out."
    )
    size = max(PAGE_IN, 1.1 + (PANEL_IN + 0.25) * len(keys)), (PANEL_IN + 0.35) * len(shown)
    with matplotlib.rc_context(STYLE):
        shape, gaps = (len(shown), len(keys)), (0.25, 0.35)
        figure, grid = sheet(note, size, (0.8, 0.35, 0.6, 0.35), shape, gaps, inside=True, sharex="col", sharey="row")
        for row, metric in zip(grid, shown, strict=True):
            row[0].set_ylabel(f"{metric.short}\n({metric.shown_unit})" if metric.shown_unit else metric.short)
            for axes, key in zip(row, keys, strict=True):
                here = found[(found["key"] == key) & (found["measure"] == metric.name)]
                axes.plot(range(len(here)), here["mean"], "o-", color=BLUE, markersize=3, linewidth=1.0)
                if len(here):
                    axes.set_xticks(range(len(here)), here["value"], rotation=30, ha="right")
                axes.margins(x=0.2)
        for axes, key in zip(grid[0], keys, strict=True):
            title(axes, key)
        return figure_bytes(figure, "png")
