"""Error against force: what each controller gains in accuracy, and what it costs in force and smoothness.

A mark is a controller on a device: the medians and quartiles of the boxes of path error and mean tip force, and the
median DFT of acceleration as its area. The screen and the printed figure draw the same marks, with the error on a
logarithmic axis, each line of which halves it.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from experiments.analysis.charts import Box, View, boxes, controllers_shown, disambiguate_codes
from experiments.analysis.metrics import DRAWN
from experiments.analysis.trials_table import Controller, Trials

NAME: Final = "error_against_force"  # of its files
TITLE: Final = "Error against force"
ERROR, FORCE, SMOOTHNESS = DRAWN
LEAST_SHARE = 0.12  # of the largest diameter: of a circle that would be smaller, or has no smoothness
ROOM = 1.25  # of a logarithmic axis beyond the quartiles, as a factor


class Mark(NamedTuple):
    """A controller on a device."""

    controller: Controller
    configuration: str
    look: int  # as `charts.LOOKS`
    error: Box  # mm
    force: Box  # N
    smoothness: float  # median DFT of acceleration, m/s^2; NaN: not measured

    @property
    def text(self) -> str:
        """Its numbers, each with its unit."""
        parts = [
            f"{metric.short} {box.median:.3g} ({box.q1:.3g} to {box.q3:.3g}) {metric.shown_unit}"
            for metric, box in ((ERROR, self.error), (FORCE, self.force))
        ]
        if math.isfinite(self.smoothness):
            parts.append(f"{SMOOTHNESS.short} {self.smoothness:.3g} {SMOOTHNESS.shown_unit}")
        return f"{self.configuration}, median (quartiles) of {self.error.n}: {', '.join(parts)}"


def marks_of(trials: Trials, view: View) -> list[Mark]:
    """The mark of each controller on each device whose median error is above 0, controller by controller."""
    trials = disambiguate_codes(trials[trials["configuration"].isin(view.configurations)])
    error, force, smoothness = (boxes(trials, m, view.configurations, view.timeouts) for m in DRAWN)
    return [
        Mark(
            controller, device, view.look(device), error[cell], force[cell],
            smoothness[cell].median if cell in smoothness else math.nan,
        )
        for controller in controllers_shown(trials, view.names)
        for device in view.configurations
        if (cell := (controller, device)) in error and cell in force and error[cell].median > 0.0
    ]  # fmt: skip


def joined(marks: Sequence[Mark]) -> list[tuple[Mark, Mark]]:
    """Marks of a controller that follow each other: a dotted line joins its devices."""
    return [(first, second) for first, second in pairwise(marks) if first.controller == second.controller]


def ranges(marks: Sequence[Mark]) -> tuple[tuple[float, float], tuple[float, float]]:
    """The ends of both axes: of force (N), and of error (mm), whose ends are both above 0."""
    low, high = min(mark.force.q1 for mark in marks), max(mark.force.q3 for mark in marks)
    beside = 0.08 * (high - low) or 0.1 * high or 1.0
    least = min(max(mark.error.q1, 0.25 * mark.error.median) for mark in marks)
    most = max(mark.error.q3 for mark in marks)
    return (low - beside, high + beside), (least / ROOM, most * ROOM)


def halvings(low: float, high: float) -> list[float]:
    """The lines of the axis of error: the powers of two within these ends, mm."""
    return [2.0**power for power in range(math.ceil(math.log2(low)), math.floor(math.log2(high)) + 1)]


def diameter(mark_smoothness: float, largest: float) -> float:
    """A circle's diameter as a share of the largest: its area is proportional to the DFT of acceleration."""
    share = math.sqrt(mark_smoothness / largest) if largest > 0.0 and math.isfinite(mark_smoothness) else 0.0
    return max(share, LEAST_SHARE)


def largest_smoothness(marks: Iterable[Mark]) -> float:
    """0: none was measured."""
    return max((mark.smoothness for mark in marks if math.isfinite(mark.smoothness)), default=0.0)


def shown_sizes(largest: float) -> list[float]:
    """Up to three round values of smoothness for the legend, none above the largest."""
    if not largest > 0.0:
        return []
    found: list[float] = []
    for share in (0.05, 0.3, 1.0):
        digit = 10.0 ** math.floor(math.log10(share * largest))
        found.append(digit * max(d for d in (1.0, 2.0, 5.0) if d * digit <= share * largest * (1.0 + 1e-9)))
    return list(dict.fromkeys(found))
