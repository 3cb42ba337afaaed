"""A table of samples, read and judged: in which samples each of the paper's statements holds by pooled boxes."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.findings import (
    HOLDS,
    IN_BOXES,
    LEAST_FINISHED,
    STATEMENTS,
    Boxes,
    Finding,
    PooledBox,
    box_findings,
)

NO_CONTROL = 1
CELL = ["sample", "configuration", "controller"]
QUARTILES = (0.25, 0.5, 0.75)
NUMBERS = [statement.number for statement in STATEMENTS]


class Judged(NamedTuple):
    """Whether each statement holds (a column) in each sample (a row), in the study that was run and beside it."""

    holds: pd.DataFrame
    chance: pd.DataFrame  # if no controller did anything
    half_bands: pd.DataFrame  # by half the differences that matter, 15 % and 30 %
    twice_bands: pd.DataFrame
    cannot_tell: pd.DataFrame


def read_trials(table: Path) -> pd.DataFrame:
    """The trials of a run, a row each; NaN: it did not reach the end, or its sample has no trials."""
    return pd.read_csv(table).sort_values(["sample", "configuration", "controller", "participant", "path"])


def judge(trials: pd.DataFrame, configurations: Sequence[str], seed: int) -> Judged:
    """Judge each sample; a statement of which one cannot tell counts as one that does not hold.

    seed: of the trials that are drawn anew (`Judged.chance`).
    """
    findings = _findings(trials, configurations)
    return Judged(
        holds=_holding(findings),
        chance=_holding(_findings(without_controllers(trials, seed), configurations)),
        half_bands=_holding(_findings(trials, configurations, 0.5)),
        twice_bands=_holding(_findings(trials, configurations, 2.0)),
        cannot_tell=_frame([[math.isnan(finding.margin) for finding in found] for found in findings]),
    )


def _holding(findings: Sequence[Sequence[Finding]]) -> pd.DataFrame:
    return _frame([[finding.verdict == HOLDS for finding in found] for found in findings])


def _frame(rows: list[list[bool]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=NUMBERS, dtype=bool)


def _findings(trials: pd.DataFrame, configurations: Sequence[str], bands: float = 1.0) -> list[list[Finding]]:
    """All eleven of each sample, in order."""
    boxes = boxes_of(trials)
    return [box_findings(boxes.get(sample, {}), configurations, bands) for sample in sorted(trials["sample"].unique())]


def boxes_of(trials: pd.DataFrame) -> Mapping[int, Boxes]:
    """The boxes of each sample; none where under 90 % of the trials reached the end."""
    assert QUARTILE_METHOD == "linear"  # as pandas has it
    by_cell = trials.dropna(subset="controller").groupby(CELL)
    enough = by_cell[IN_BOXES[0]].count() / by_cell.size() >= LEAST_FINISHED
    quartiles = by_cell[list(IN_BOXES)].quantile(list(QUARTILES)).unstack()
    boxes: dict[int, dict[tuple[str, str, int], PooledBox]] = {}
    for (sample, configuration, controller), row in zip(quartiles.index, quartiles.to_numpy(), strict=True):
        if enough[sample, configuration, controller]:
            for measure, box in zip(IN_BOXES, row.reshape(len(IN_BOXES), len(QUARTILES)), strict=True):
                boxes.setdefault(sample, {})[measure, configuration, int(controller)] = PooledBox(*box.tolist())
    return boxes


def without_controllers(trials: pd.DataFrame, seed: int) -> pd.DataFrame:
    """The same studies if no controller did anything: each person's trials drawn anew from those without control.

    Within a person, device and path. What the few trials there lack in variance about their geometric mean,
    n / (n - 1), is made up for.
    """
    generator = np.random.default_rng(seed)
    made = trials.copy()
    measures = list(IN_BOXES)
    place = ["sample", "configuration", "participant", "path"]
    uncontrolled = trials[trials["controller"] == NO_CONTROL].groupby(place)
    drawn = uncontrolled.indices
    values = trials.loc[trials["controller"] == NO_CONTROL, measures].to_numpy()
    anew = made[measures].to_numpy(copy=True)
    for key, rows in made.groupby(place).indices.items():
        some = values[drawn[key]]
        middle = np.exp(np.nanmean(np.log(some), axis=0)) if np.isfinite(some).any() else np.nan
        wider = middle * (some / middle) ** math.sqrt(len(some) / max(len(some) - 1, 1))
        anew[rows] = wider[generator.integers(len(some), size=len(rows))]
    made[measures] = anew
    return made


def wilson(holding: pd.Series | float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The 95 % interval of a share by Wilson's formula."""
    z, p = 1.96, np.asarray(holding) / max(n, 1)
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
    low, high = (middle - half) / (1.0 + z * z / n), (middle + half) / (1.0 + z * z / n)
    return np.minimum(low, p), np.maximum(high, p)  # of a share of 0 or 1 rounding may leave the share outside
