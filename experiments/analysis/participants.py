"""The participant as the unit of every comparison: one score for each of their cells, and intervals over people.

Trials of one person are no independent observations; people are. So each participant's trials in a cell
(configuration, controller) become one score, and intervals and tests count participants. Which trials count, the
caller decides (`trials_table.to_compare`), as in the box plots.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from experiments.analysis.trials_table import COUNTED, TrialRow

#: The paper's two, by device name.
PAPER_CONFIGURATIONS = ("three-brake", "four-brake")
#: With fewer, no 95 % interval exists that assumes no distribution (2 / 2^5 > 5 %), nor can a signed-rank test reach
#: 5 %.
LEAST_PEOPLE = 6
LEVEL = 0.95
#: The warning of every report below `LEAST_PEOPLE`; {} is the number in words.
TOO_FEW = "{} too few to claim any of this for others; read it as a description."
_WORDS = ("Nobody is", "One person is", "Two people are", "Three people are", "Four people are", "Five people are")

Cell = tuple[str, str, int | str]  # participant, configuration, controller
Scores = dict[Cell, float]


def too_few(people: int) -> str:
    """The sentence that refuses to claim anything for others; empty if there are enough people."""
    return TOO_FEW.format(_WORDS[people]) if people < LEAST_PEOPLE else ""


def values_by_cell(rows: Iterable[TrialRow], column: str) -> dict[Cell, list[float]]:
    """The values of a column by participant, configuration and controller, in the order of the rows."""
    cells: dict[Cell, list[float]] = {}
    for row in rows:
        value = getattr(row, column)
        if value is not None:
            cells.setdefault((row.participant, row.configuration, row.controller), []).append(float(value))
    return cells


def scores(rows: Iterable[TrialRow], column: str, average: Callable = np.mean) -> Scores:
    """Each participant's average of a column in each cell; no entry where there is nothing to average."""
    return {cell: float(average(values)) for cell, values in values_by_cell(rows, column).items()}


def spreads(rows: Iterable[TrialRow], column: str) -> Scores:
    """How far each participant's trials lie from the middle of their box, on average.

    The middle is the median of all participants' trials of that configuration and controller, the line in the box
    plot; so the score holds both the spread within a person and the person's own distance (Brown and Forsythe).
    """
    cells = values_by_cell(rows, column)
    boxes = {cell[1:]: [v for other, of in cells.items() if other[1:] == cell[1:] for v in of] for cell in cells}
    middles = {box: np.median(values) for box, values in boxes.items()}
    return {cell: float(np.mean(np.abs(np.array(values) - middles[cell[1:]]))) for cell, values in cells.items()}


def finished_share(rows: Iterable[TrialRow]) -> dict[tuple[str, int | str], float]:
    """(configuration, controller) -> share of its counted trials that reached the end of the path."""
    ends: dict[tuple[str, int | str], list[bool]] = {}
    for row in rows:
        if row.status in COUNTED:
            ends.setdefault((row.configuration, row.controller), []).append(row.status == "done")
    return {cell: float(np.mean(done)) for cell, done in ends.items()}


def people_of(rows: Iterable[TrialRow]) -> tuple[str, ...]:
    """The participants, in the order of the rows."""
    return tuple(dict.fromkeys(row.participant for row in rows))


def configurations_of(rows: Iterable[TrialRow]) -> tuple[str, ...]:
    """The configurations: the paper's two first, then any others by name (participants meet them in any order)."""
    found = {row.configuration for row in rows}
    return (*(name for name in PAPER_CONFIGURATIONS if name in found), *sorted(found.difference(PAPER_CONFIGURATIONS)))


class Interval(NamedTuple):
    """The middle of some values, one a participant, and where that of people like them lies."""

    people: int
    middle: float
    low: float  # -inf and inf: these people are too few for an interval
    high: float

    @property
    def is_bounded(self) -> bool:
        """Whether there is an interval: of one person there is none."""
        return math.isfinite(self.low) and math.isfinite(self.high)


def mean_interval(values: Sequence[float] | np.ndarray) -> Interval:
    """The mean and its 95 % interval by Student's t: takes the values as normal, holds for two people as for many.

    Fewer people only widen it: the root mean square of its half-widths over all subsets of m of these people is
    t(m - 1) s / sqrt(m), with s the standard deviation of them all, and that falls with every person more.
    """
    from scipy.special import stdtrit  # here: an app that starts has no time for it

    data = np.asarray(values, dtype=float)
    n, middle = len(data), float(np.mean(data))
    if n < 2:
        return Interval(n, middle, -math.inf, math.inf)
    half = float(stdtrit(n - 1, 0.5 * (1.0 + LEVEL)) * np.std(data, ddof=1) / math.sqrt(n))
    return Interval(n, middle, middle - half, middle + half)
