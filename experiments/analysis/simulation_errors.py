"""How sure the numbers of a study are: how far its measures move when trials are simulated otherwise.

`experiments.study.unrecorded` runs the trials; here are the table and the sentence that a report makes of them.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from experiments.analysis.metrics import DRAWN, FIGURES, Metric
from experiments.analysis.report_sentences import name_of
from experiments.analysis.report_tables import markdown_table, with_unit
from experiments.numbers import significant

STEP, HAND = "step of a tenth", "hand 1 um aside"  # changes; a third one is the model of the brakes


class Moved(NamedTuple):
    """How far one measure of one controller's trials moves by one change, in the measure's unit."""

    controller: int
    change: str
    measure: str
    trials: int
    median: float
    worst: float
    worst_share: float | None  # of the measure itself; None where that is zero


def error_table(moved: Sequence[Moved], names: Mapping[int, str]) -> str:
    """A line for each controller and change, with the measures of the figures, as Markdown."""
    by_measure = {(move.controller, move.change, move.measure): move for move in moved}
    lines = []
    for controller, change in dict.fromkeys(key[:2] for key in by_measure):
        cells = [_error_cell(by_measure.get((controller, change, metric.name)), metric) for metric in FIGURES]
        lines.append((name_of(controller, names), change, *cells))
    return markdown_table(("controller", "changed", *map(with_unit, FIGURES)), lines)


def _error_cell(move: Moved | None, metric: Metric) -> str:
    """ "median / largest (largest share)"."""
    if move is None:
        return ""
    median, worst = (significant(metric.scale * size, 1) for size in (move.median, move.worst))
    share = "" if move.worst_share is None else f" ({significant(100.0 * move.worst_share, 2)} %)"
    return f"{median} / {worst}{share}"


def error_sentence(moved: Sequence[Moved]) -> str:
    """The error bar under a table: what a tenth of the step does at most, to a median and to a single trial."""
    by_step = [move for move in moved if move.change == STEP]
    bars = []
    for metric in DRAWN:
        moves = [move for move in by_step if move.measure == metric.name]
        if moves:
            median, worst = max(move.median for move in moves), max(move.worst for move in moves)
            numbers = f"{significant(metric.scale * median, 1)} ({significant(metric.scale * worst, 1)})"
            bars.append(f"{metric.short} {numbers} {metric.shown_unit}")
    if not bars:
        return ""
    trials = sum(move.trials for move in by_step if move.measure == DRAWN[0].name)
    return (
        f"Error bar of the simulation, in a sample of {trials} trials, worst controller, median (single) trial: "
        f"{', '.join(bars)}."
    )
