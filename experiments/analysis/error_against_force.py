"""Error against force: what each controller gains in accuracy, and what it costs in force and smoothness.

A mark is a controller on a device: the medians and quartiles of the boxes of path error and mean tip force, and the
median DFT of acceleration as its area. The screen and the printed figure draw the same marks, with the error on a
logarithmic axis, each line of which halves it.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from experiments.analysis.charts import Box, View, boxes, controllers_shown, disambiguate_codes
from experiments.analysis.metrics import DRAWN
from experiments.analysis.trials_table import Controller, Trials

NAME: Final = "error_against_force"  # of its files
TITLE: Final = "Error against force"
ERROR, FORCE, SMOOTHNESS = DRAWN
LEAST_SHARE = 0.12  # of the largest diameter: of a circle that would be smaller, or has no smoothness
ROOM = 1.25  # of a logarithmic axis beyond the quartiles, as a factor
Rectangle = tuple[float, float, float, float]  # left, bottom, right, top


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


def name_places(
    sizes: Sequence[tuple[float, float]],
    centres: Sequence[Sequence[tuple[float, float, float]]],
    taken: Sequence[Rectangle],
    page: Rectangle,
) -> list[tuple[float, float]]:
    """Where the names of controllers stand: their lower left corners, each by one of its own circles.

    sizes: width and height of each name. centres: x, y and radius of the circles of each. taken: what is drawn
    already. Our choice: of the places around the circles that which covers least, the first of equals.
    """
    found: list[tuple[float, float]] = []
    blocked = list(taken)
    for (width, height), circles in zip(sizes, centres, strict=True):
        best, least = (0.0, 0.0), math.inf
        around = [_places_around(circle, width, height) for circle in circles]
        for left, bottom in itertools.chain.from_iterable(zip(*around, strict=True)):  # the nearest of all come first
            own = left, bottom, left + width, bottom + height
            outside = width * height - _shared(own, page)
            covered = sum(_shared(own, other) for other in blocked) + 10.0 * outside
            if covered < least - 1e-9:
                best, least = (left, bottom), covered
        found.append(best)
        blocked.append((*best, best[0] + width, best[1] + height))
    return found


def _places_around(circle: tuple[float, float, float], width: float, height: float) -> list[tuple[float, float]]:
    """Lower left corners of a name around a circle, the best first."""
    x, y, radius = circle
    off = radius + 0.4 * height
    right, left, above, under = x + off, x - off - width, y + 0.35 * off, y - 0.35 * off - height
    beside = [(right, above), (left, above), (right, under), (left, under)]
    middle = x - 0.5 * width
    far = [(right + off, above + 1.65 * off), (left - off, above + 1.65 * off)]
    far += [(right + off, under - 1.65 * off), (left - off, under - 1.65 * off)]
    return [*beside, (middle, y + off), (middle, y - off - height), *far]


def _shared(a: Rectangle, b: Rectangle) -> float:
    """The area that two rectangles have in common."""
    wide, high = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    return wide * high if wide > 0.0 and high > 0.0 else 0.0


def drawn_rectangles(
    centre: tuple[float, float, float], ends: tuple[tuple[float, float], tuple[float, float]], line: float
) -> list[Rectangle]:
    """What a mark covers: its circle (x, y, radius) and the lines of its quartiles, from and to in x and in y."""
    (x, y, radius), ((left, right), (bottom, top)) = centre, ends
    return [
        (x - radius, y - radius, x + radius, y + radius),
        (left, y - line, right, y + line),
        (x - line, bottom, x + line, top),
    ]


def by_controller(marks: Sequence[Mark]) -> dict[Controller, list[int]]:
    """Controller -> the places of its marks."""
    found: dict[Controller, list[int]] = {}
    for at, mark in enumerate(marks):
        found.setdefault(mark.controller, []).append(at)
    return found


def between(first: tuple[float, float], second: tuple[float, float]) -> list[Rectangle]:
    """Small rectangles along the line that joins two marks, for names to keep clear of."""
    steps = np.linspace(0.0, 1.0, 12)
    points = np.outer(1.0 - steps, first) + np.outer(steps, second)
    return [(float(x) - 1.0, float(y) - 1.0, float(x) + 1.0, float(y) + 1.0) for x, y in points]
