"""The error bars of a report: how far measures move when a few trials are simulated otherwise, as tables."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from experiments.analysis.metrics import DRAWN, FIGURES

SUBSTEPS, ASIDE_M = 10, 1e-6
STEP, HAND = "step of a tenth", "hand 1 um aside"
READ = (
    "Trials of one simulated operator's first block again, from the same start, with the same operator and noise, and "
    "one thing changed; the controller decides once a millisecond as before. Absolute change of a measure: median / "
    f"largest (the largest share of the measure itself). *{STEP}*: the error of the integration. *{HAND}*: how sure a "
    "single trial can be at all, an encoder's step being 20 um; where it moves a trial about as far as the step does, "
    "brakes that switch at 1 kHz carry any difference on, and no finer step settles it. The brakes' row: what lag and "
    "backlash are worth. Every measure: simulation_errors.csv."
)


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
    of = {(one.controller, one.change, one.measure): one for one in moved}
    heads = [f"{metric.short} ({metric.shown_unit})" for metric in FIGURES]
    lines = [f"| controller | changed | {' | '.join(heads)} |", "|---" * (2 + len(heads)) + "|"]
    for controller, change in dict.fromkeys(cell[:2] for cell in of):
        cells = []
        for metric in FIGURES:
            one = of.get((controller, change, metric.name))
            share = f" ({100.0 * one.worst_share:.2g} %)" if one and one.worst_share is not None else ""
            cells.append(f"{metric.scale * one.median:.1g} / {metric.scale * one.worst:.1g}{share}" if one else "")
        name = names.get(controller, f"controller {controller}")
        lines.append(f"| {name} | {change} | {' | '.join(cells)} |")
    return "\n".join(lines)


def error_sentence(moved: Sequence[Moved]) -> str:
    """The error bar of a table: what a tenth of the step does at most, to a median and to a single trial."""
    parts = []
    for metric in DRAWN:
        of_step = [one for one in moved if one.change == STEP and one.measure == metric.name]
        if of_step:
            median, worst = (
                metric.scale * max(of_it) for of_it in zip(*((m.median, m.worst) for m in of_step), strict=True)
            )
            parts.append(f"{metric.short} {median:.1g} ({worst:.1g}) {metric.shown_unit}")
    if not parts:
        return ""
    trials = sum(one.trials for one in moved if one.change == STEP and one.measure == DRAWN[0].name)
    return (
        f"Error bar of the simulation, in a sample of {trials} trials, worst controller, median (single) trial: "
        f"{', '.join(parts)}."
    )
