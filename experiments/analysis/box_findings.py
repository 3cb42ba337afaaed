"""The paper's eleven statements judged as the paper judges them: on box plots of all trials pooled.

A box holds the trials of everyone (in the paper, three people) with one controller on one device, by the measure of
Fig. 16, 17 or 18. Statements and their claims are those of `findings`, which judges the same trials within each
participant. The rules stand in docs/judging.md (our choice: the paper draws boxes and states no rule). U is the size of
the uncontrolled box on the first side's device: its median, or its length (q3 - q1) where lengths are compared. Several
controllers on one side count by the mean of their medians. A rule's margin, in units of U, is not under 0 where the
rule is met; a statement's margin is the least of its claims on all devices.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.findings import (
    AT_MOST,
    BELOW,
    CANNOT_TELL,
    CONTROLLER,
    FAILS,
    HOLDS,
    LEAST_FINISHED,
    STATEMENTS,
    Claim,
    Statement,
    named,
)
from experiments.analysis.metrics import BY_NAME, DRAWN
from experiments.analysis.statistics import configurations_of, finished_share
from experiments.analysis.trials_table import TrialRow, to_compare

LITTLE, SIMILAR = 0.15, 0.30  # of U
MEASURES = tuple(metric.name for metric in DRAWN)


class PooledBox(NamedTuple):
    """Quartiles of the pooled trials of a controller on a device, in the measure's unit."""

    q1: float
    median: float
    q3: float


Boxes = Mapping[tuple[str, str, int], PooledBox]  # by measure, configuration and controller


class Compared(NamedTuple):
    """One claim on one device (or between two)."""

    claim: Claim
    measure: str
    where: tuple[str, str]  # device of the first side, of the second
    margin: float  # of the rule, in units of U; nan: a box is missing


class BoxFinding(NamedTuple):
    """A statement's verdict by boxes."""

    statement: Statement
    verdict: str  # HOLDS, FAILS, CANNOT_TELL
    margin: float  # the least of its claims, in units of U; nan: one cannot tell
    sentence: str


def pooled_boxes(rows: Sequence[TrialRow], timeouts: bool = False) -> dict[tuple[str, str, int], PooledBox]:
    """The boxes of a study; none where under 90 % of the trials reached the end. timeouts: those count as well."""
    finished = finished_share(rows)
    values: dict[tuple[str, str, int], list[float]] = {}
    for row in to_compare(rows, timeouts):
        if isinstance(row.controller, int) and finished[row.configuration, row.controller] >= LEAST_FINISHED:
            for measure in MEASURES:
                if (value := getattr(row, measure)) is not None:
                    values.setdefault((measure, row.configuration, row.controller), []).append(value)
    return {
        cell: PooledBox(*np.quantile(of_it, (0.25, 0.5, 0.75), method=QUARTILE_METHOD).tolist())
        for cell, of_it in values.items()
    }


def box_findings(boxes: Boxes, configurations: Sequence[str], bands: float = 1.0) -> list[BoxFinding]:
    """All eleven. bands: factor on 15 % and 30 %, to see what hangs on them."""
    found = []
    for statement in STATEMENTS:
        compared = [
            Compared(claim, measure, place, _margin(claim, measure, place, boxes, bands))
            for claim in statement.claims
            for measure in claim.measures
            if measure in MEASURES
            for place in claim.places(configurations)
        ]
        decisive = min(compared, key=lambda one: (not math.isnan(one.margin), one.margin), default=None)
        if decisive is None or math.isnan(decisive.margin):
            why = _why_missing(decisive, boxes) if decisive else "No trials."
            found.append(BoxFinding(statement, CANNOT_TELL, math.nan, why))
        else:
            verdict = HOLDS if decisive.margin >= 0.0 else FAILS
            found.append(BoxFinding(statement, verdict, decisive.margin, _sentence(decisive, boxes, bands)))
    return found


def box_findings_of(rows: Sequence[TrialRow], timeouts: bool = False) -> list[BoxFinding]:
    """All eleven, of a study's trials."""
    return box_findings(pooled_boxes(rows, timeouts), configurations_of(rows))


def _margin(claim: Claim, measure: str, where: tuple[str, str], boxes: Boxes, bands: float) -> float:
    """By how much a claim is met (not under 0) or missed, in units of U; nan without all its boxes, or with U = 0."""
    try:
        first, second = ([boxes[measure, at, k] for k in side] for at, side in claim.sides(where))
        uncontrolled = _size(claim, boxes[measure, where[0], 1])
    except KeyError:
        return math.nan
    if not uncontrolled > 0.0:
        return math.nan
    sizes = [np.mean([_size(claim, box) for box in side]) for side in (first, second)]
    more = float(sizes[0] - sizes[1]) / uncontrolled
    band = bands * _band(claim)
    if claim.kind == AT_MOST:
        return band - more
    if claim.kind != BELOW:
        return band - abs(more)
    if not claim.clear:
        return -more - band
    (one,), (other,) = first, second
    apart = min(other.q1 - one.median, other.median - one.q3) / uncontrolled
    return min(-more - band, apart)


def _size(claim: Claim, box: PooledBox) -> float:
    return box.q3 - box.q1 if claim.spread else box.median


def _band(claim: Claim) -> float:
    """Share of U."""
    return LITTLE if claim.kind in (BELOW, AT_MOST) or claim.little else SIMILAR


def _why_missing(one: Compared, boxes: Boxes) -> str:
    for at, side in (*one.claim.sides(one.where), (one.where[0], (1,))):
        for controller in side:
            if (one.measure, at, controller) not in boxes:
                return f"No box of {CONTROLLER[controller]!r} on {at}, or too few of its trials reached the end."
    return f"{BY_NAME[one.measure].title} without control has no size on {one.where[0]}."


def _sentence(one: Compared, boxes: Boxes, bands: float) -> str:
    """The comparison that decides, in numbers, and what was needed."""
    claim, metric = one.claim, BY_NAME[one.measure]
    texts = []
    for at, side in claim.sides(one.where):
        of_side = [boxes[one.measure, at, k] for k in side]
        low, middle, high = (metric.scale * float(np.mean(column)) for column in zip(*of_side, strict=True))
        number = f"{high - low:.2f}" if claim.spread else f"{middle:.2f} ({low:.2f} to {high:.2f})"
        texts.append(f"{at if claim.devices else named(side)} {number}")
    what = f"{'length of the box, ' if claim.spread else ''}{metric.title.lower()}"
    who = named(claim.first) if claim.devices else one.where[0]
    band = bands * _band(claim)
    needed = {BELOW: f"lower by {band:.0%}", AT_MOST: f"at most {band:.0%} more"}.get(claim.kind, f"within {band:.0%}")
    clear = ", neither median in the other's box" if claim.clear else ""
    size = "length" if claim.spread else "median"
    text = f"{what}, {who}: {texts[0]} {metric.shown_unit} against {texts[1]} {metric.shown_unit}"
    return f"{text[:1].upper()}{text[1:]}; needed: {needed} of the uncontrolled {size}{clear}."
