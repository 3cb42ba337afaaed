"""The paper's eleven statements (Sections V-B and VI), judged by boxes and within each participant.

Rules: docs/your-own-experiment.md. A statement is split into claims, a claim into comparisons: one a device.
Each gives one piece of evidence, a difference, first minus second, in units of U, the uncontrolled size on the
first side's device, with the interval in which it lies. A claim is met where the whole interval meets it, not met where
no part of it does; else one cannot tell. Smoothness is judged by two sums, which treat the cut at the end of `move`
differently; where they give two verdicts, the verdict says so.

By boxes, as the paper judges (our choice: it draws boxes and states no rule): a box holds the trials of everyone (three
people in the paper) with one controller on one device. The difference is that of their medians, or of their lengths
(q3 - q1) where the spread is compared, and has no interval: it is what a reader of the figure sees.

Within each participant: each gives one difference of the means of their own trials (for the spread: of their trials'
mean distance from the middle of the box). What counts is the mean participant, with Student's interval, which takes the
differences as normal: few people cannot show whether they are. U is then the participants' mean without control, taken
as known.

Several controllers on one side count by their mean. Our choices: "SDOF" reduces path error if it does without and with
gap; "proportional" against "SDOF" overall is the mean of the two gains against the mean of the two gaps; what four
brakes gain is judged over the four controllers that brake.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from core.control.controllers import Preset
from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.metrics import BY_NAME, JUDGED
from experiments.analysis.statistics import (
    PAPER_CONFIGURATIONS,
    Interval,
    configurations_of,
    finished_share,
    mean_interval,
    people_of,
    scores,
    spreads,
)
from experiments.analysis.trials_table import Trials, to_compare
from experiments.numbers import percent, significant

BELOW, SIMILAR, AT_MOST = "below", "similar", "at most"
LITTLE_OF_U, SIMILAR_OF_U = 0.15, 0.30  # the least difference that matters; where the paper says "similar"
MOST_SHARE = 2.0  # of U: a larger difference is not given in percent of it, since U is then tiny. Our choice
LEAST_FINISHED = 0.9  # share of the trials of each controller compared
HOLDS, FAILS, CANNOT_TELL = "holds", "does not hold", "cannot tell"
DEPENDS = "depends on how the cut is treated"
#: Statement -> share of triples of simulated people in which it holds by boxes though all five controllers are none,
#: least and most of two populations (1,000 triples of 30 people of each). On 10: the devices differ.
CHANCE = dict.fromkeys(range(1, 12), (0.0, 0.0)) | {
    3: (0.0, 0.01), 6: (0.61, 0.87), 8: (0.99, 0.99), 10: (0.07, 0.48),
}  # fmt: skip
#: What judges the statements: the measures of Figs. 16 to 18, the last with and without the ramp that the cut leaves.
#: The exact acceleration is none of them, a real device has no accelerometer.
IN_BOXES = tuple(metric.name for metric in JUDGED)
ERROR, FORCE, *SUMS = IN_BOXES
SMOOTHNESS = "smoothness"  # stands for each of SUMS in turn
CONTROLLER = {1: "no control", 2: "SDOF", 3: "SDOF with gap", 4: "proportional high gain", 5: "proportional low gain"}
GROUP = {(2, 3): "SDOF, both", (4, 5): "proportional, both", (2, 3, 4, 5): "all controllers"}
Controllers = tuple[int, ...]  # several: their mean
Place = tuple[str, str]  # device of the first side, of the second


def names_of(controllers: Controllers) -> str:
    """The name of a controller, or of several that count by their mean."""
    return CONTROLLER[controllers[0]] if len(controllers) == 1 else GROUP[controllers]


class Claim(NamedTuple):
    """One thing to compare: `first` with `second`."""

    kind: str  # BELOW, SIMILAR, AT_MOST
    measure: str  # ERROR, FORCE, SMOOTHNESS
    first: Controllers
    second: Controllers
    spread: bool = False  # compare how far trials lie from each other, not the trials
    little: bool = False  # "little change": a smaller difference matters than where two are "similar"
    clear: bool = False  # "significantly": by boxes neither median may lie in the other box
    devices: bool = False  # first on the three-brake device, second on the four-brake one; else each device in turn

    @property
    def matters(self) -> float:
        """The least difference that matters, in units of U."""
        return SIMILAR_OF_U if self.kind == SIMILAR and not self.little else LITTLE_OF_U

    def places(self, configurations: Sequence[str]) -> list[Place]:
        """Each place of the comparison: the device of `first`, and that of `second`."""
        return [PAPER_CONFIGURATIONS] if self.devices else [(name, name) for name in configurations]

    def cells(self, place: Place) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
        """The cells (device, controller) of either side of the comparison at a place."""
        return [(place[0], k) for k in self.first], [(place[1], k) for k in self.second]


class Statement(NamedTuple):
    """One of the paper's statements."""

    number: int
    text: str
    claims: tuple[Claim, ...]


def _claims(
    kind: str, measure: str, *pairs: tuple[int | Controllers, int | Controllers], **more: bool
) -> tuple[Claim, ...]:
    """A claim for each pair of controllers, or of groups of them."""
    both = ((side if isinstance(side, tuple) else (side,) for side in pair) for pair in pairs)
    return tuple(Claim(kind, measure, first, second, **more) for first, second in both)


_ALL = (2, 3, 4, 5)  # the controllers that brake
STATEMENTS = (
    Statement(
        1, "SDOF control (without and with gap) reduces path error", _claims(BELOW, ERROR, (2, 1), (3, 1), clear=True)
    ),
    Statement(
        2, "Proportional control reduces path error at either gain", _claims(BELOW, ERROR, (4, 1), (5, 1), clear=True)
    ),
    Statement(
        3,
        "SDOF with gap is the most consistent in accuracy",
        _claims(BELOW, ERROR, (3, 1), (3, 2), (3, 4), (3, 5), spread=True),
    ),
    Statement(4, "The gap makes SDOF smoother", _claims(BELOW, SMOOTHNESS, (3, 2))),
    Statement(5, "The gap lowers the force of SDOF", _claims(BELOW, FORCE, (3, 2))),
    Statement(6, "The gap costs a negligible amount of accuracy", _claims(AT_MOST, ERROR, (3, 2))),
    Statement(
        7,
        "The low gain lowers force and is smoother, with little change in accuracy",
        _claims(BELOW, FORCE, (5, 4), clear=True)
        + _claims(BELOW, SMOOTHNESS, (5, 4), clear=True)
        + _claims(SIMILAR, ERROR, (5, 4), little=True),
    ),
    Statement(
        8,
        "Low-gain proportional control is about as light and smooth as none",
        _claims(SIMILAR, FORCE, (5, 1)) + _claims(SIMILAR, SMOOTHNESS, (5, 1)),
    ),
    Statement(
        9,
        "Proportional control is lighter and smoother than SDOF",
        _claims(BELOW, FORCE, ((4, 5), (2, 3))) + _claims(BELOW, SMOOTHNESS, ((4, 5), (2, 3))),
    ),
    Statement(
        10,
        "Four brakes gain nothing over three, and their uncontrolled error spreads wider",
        _claims(AT_MOST, ERROR, (_ALL, _ALL), devices=True)
        + _claims(AT_MOST, FORCE, (_ALL, _ALL), devices=True)
        + _claims(AT_MOST, SMOOTHNESS, (_ALL, _ALL), devices=True)
        + _claims(BELOW, ERROR, (1, 1), spread=True, devices=True),
    ),
    Statement(
        11,
        "All controllers improve accuracy by a similar amount",
        _claims(BELOW, ERROR, *((k, 1) for k in _ALL))
        + _claims(SIMILAR, ERROR, *((j, k) for k in _ALL for j in _ALL if k < j)),
    ),
)


def why_no_findings(controllers: Mapping[int, Preset], coded: bool = False) -> str:
    """Why the statements cannot be tested with these controllers, as a sentence; empty if they are those of Table I.

    Some of Table I's are enough (the rest is then not tried); their gap and gains may be other numbers, in their order.
    """
    if coded:
        return "The controllers are coded, the session is blind: nothing is compared until the key is opened."
    kinds = {1: "none", 2: "sdof", 3: "sdof", 4: "proportional", 5: "proportional"}
    gain = {number: preset.value("gain_N_s_m") for number, preset in controllers.items()}
    same = all(
        preset.kind == kinds.get(number) and (preset.value("gap_m") > 0.0) == (number == 3)
        for number, preset in controllers.items()
    )
    if same and gain.get(5, 0.0) < gain.get(4, float("inf")):
        return ""
    return "The controllers are not those of the paper's Table I, so its statements are not tested."


class Evidence(NamedTuple):
    """One claim at one place: first minus second, in units of U."""

    claim: Claim
    measure: str  # its column
    place: Place
    matters: float  # the least difference that matters
    why: str = ""  # there is nothing to compare
    unit: float = math.nan  # U, in the measure's unit
    found: Interval | None = None  # by boxes without an interval: both ends are the difference
    apart: float = math.inf  # by boxes, where it must be clear: by how much the medians are outside the other box

    @property
    def margin(self) -> float:
        """By how much the whole interval meets the claim (not under 0) or does not; nan: nothing to compare."""
        if self.found is None:
            return math.nan
        furthest = max(self.found.high, -self.found.low) if self.claim.kind == SIMILAR else self.found.high
        return min(self.limit - furthest, self.apart)

    @property
    def answer(self) -> bool | None:
        """Whether the claim is met: the whole interval meets it (True), no part does (False), or one cannot tell."""
        if self.found is None:
            return None
        nearest = max(self.found.low, -self.found.high) if self.claim.kind == SIMILAR else self.found.low
        return True if self.margin >= 0.0 else False if nearest > self.limit or self.apart < 0.0 else None

    @property
    def limit(self) -> float:
        """The largest difference (of similar ones: either way) that meets the claim."""
        return -self.matters if self.claim.kind == BELOW else self.matters

    @property
    def text(self) -> str:
        """The comparison in words: measure, sides, place, difference and interval."""
        metric, claim = BY_NAME[self.measure], self.claim
        against = names_of(claim.first) + ("" if claim.devices else f" against {names_of(claim.second)}")
        where = " against ".join(dict.fromkeys(self.place))
        measured = f"spread of {metric.short}" if claim.spread else metric.short
        about = f"{measured[:1].upper()}{measured[1:]}, {against}, {where}"
        if self.found is None:
            return f"{about} ({self.why})"
        _, middle, low, high = self.found
        interval = f" ({self._in_unit(low)} to {self._in_unit(high)})" if math.isfinite(low) and low < high else ""
        share = f", {percent(middle, 0, '+')} of" if abs(middle) <= MOST_SHARE else "; for comparison,"
        size = significant(metric.scale * self.unit)
        without = f"the {self.statistic} without control, {size} {metric.shown_unit}"
        return f"{about}: {self._in_unit(middle)} {metric.shown_unit}{interval}{share} {without}"

    def _in_unit(self, share: float) -> str:
        """A difference, given in units of U, as a number in the unit in which its measure is shown."""
        text = significant(BY_NAME[self.measure].scale * share * self.unit)
        return text if text.startswith("-") else f"+{text}"

    @property
    def statistic(self) -> str:
        """What is compared, by its name; boxes have no interval of people."""
        return "mean" if self.found and self.found.people else "length of the box" if self.claim.spread else "median"

    @property
    def judged(self) -> str:
        """The numbers, what was needed, and why that is not met."""
        if self.found is None:
            return self.text
        needed = f"{self._in_unit(self.limit)} {BY_NAME[self.measure].shown_unit}"
        needed = f"within ±{needed[1:]}" if self.claim.kind == SIMILAR else f"{needed} or lower"
        text = f"{self.text}; needed: {needed} ({percent(self.matters)})"
        if self.answer:
            return text
        if self.answer is None:
            return text + (
                ", but the interval is too wide" if self.found.is_bounded else ", but one participant has no interval"
            )
        if self.claim.kind == BELOW and max(self.found.high, -self.found.low) <= self.matters:
            return text + ": smaller than matters"
        return text + (": a median lies in the other box" if self.margin == self.apart else "")


class Finding(NamedTuple):
    """A statement's verdict, and the evidence for it."""

    statement: Statement
    verdict: str  # HOLDS, FAILS, CANNOT_TELL; DEPENDS where the two sums give two verdicts
    sentence: str
    margins: tuple[float, float]  # by either sum: the least of its comparisons, in units of U; nan: one is missing
    evidence: tuple[Evidence, ...]

    @property
    def margin(self) -> float:
        """The lesser by the two sums."""
        return math.nan if math.isnan(sum(self.margins)) else min(self.margins)


Compare = Callable[[Claim, str, Place], Evidence]  # a claim, by the measure of this column, at a place


def _finding(statement: Statement, compare: Compare, configurations: Sequence[str]) -> Finding:
    by_sum = []
    for total in SUMS if any(claim.measure == SMOOTHNESS for claim in statement.claims) else SUMS[:1]:
        evidence = tuple(
            compare(claim, total if claim.measure == SMOOTHNESS else claim.measure, place)
            for claim in statement.claims
            for place in claim.places(configurations)
        )
        by_sum.append((*_verdict(evidence), evidence))
    (verdict, sentence, evidence), (other, why, further) = by_sum[0], by_sum[-1]
    if verdict != other:
        missing = [
            text
            for its_verdict, text, of_sum in by_sum
            if its_verdict == CANNOT_TELL and None in [piece.found for piece in of_sum]
        ]
        both = f"As cut, it {_in_a_sentence(verdict)}: {sentence} Without the ramp, it {_in_a_sentence(other)}: {why}"
        verdict, sentence = (CANNOT_TELL, missing[0]) if missing else (DEPENDS, both)
    every = tuple(dict.fromkeys((*evidence, *further)))
    return Finding(statement, verdict, sentence, (_least_margin(evidence), _least_margin(further)), every)


def _least_margin(evidence: Sequence[Evidence]) -> float:
    """The least margin; nan where that of a missing comparison might be less, and it would matter."""
    known = [piece.margin for piece in evidence if piece.found]
    least = min(known, default=math.nan)
    return least if len(known) == len(evidence) or least < 0.0 else math.nan


def _in_a_sentence(verdict: str) -> str:
    return "is unclear" if verdict == CANNOT_TELL else verdict


def _verdict(evidence: Sequence[Evidence]) -> tuple[str, str]:
    """It holds if every claim is met everywhere, and does not if one is not; the sentence is about the decisive one."""
    if not evidence:
        return CANNOT_TELL, "There are no trials."
    answers = [piece.answer for piece in evidence]
    verdict = FAILS if False in answers else CANNOT_TELL if None in answers else HOLDS
    decisive = [piece for piece in evidence if piece.answer is {FAILS: False, CANNOT_TELL: None, HOLDS: True}[verdict]]
    closest = min(decisive, key=lambda piece: (piece.found is not None, piece.margin))
    if closest.found is None:
        return verdict, f"{closest.why[:1].upper()}{closest.why[1:]}."
    how = {FAILS: "fail. ", CANNOT_TELL: "unclear. "}
    count = f"{len(decisive)} of {len(evidence)} {how[verdict]}" if verdict in how else "Closest: "
    return verdict, f"{count if len(evidence) > 1 else ''}{closest.judged}."


def findings(trials: Trials, timeouts: bool = False) -> list[Finding]:
    """All eleven within each participant, for any study: of simulated operators or people, complete or not.

    timeouts: trials whose time was up count as well.
    """
    ended, finished, people = to_compare(trials, timeouts), finished_share(trials), people_of(trials)
    by_measure = {measure: scores(ended, measure) for measure in IN_BOXES}
    of_spread = spreads(ended, ERROR)

    def compare(claim: Claim, measure: str, place: Place) -> Evidence:
        table = of_spread if claim.spread else by_measure[measure]
        first, second = claim.cells(place)
        about = claim, measure, place, claim.matters
        if why := _why_not(dict.fromkeys([*first, *second, (place[0], 1)]), {cell[1:] for cell in table}, finished):
            return Evidence(*about, why)
        uncontrolled = float(np.mean([value for cell, value in table.items() if cell[1:] == (place[0], 1)]))
        differences = []
        for person in people:
            a, b = ([table.get((person, *cell)) for cell in side] for side in (first, second))
            if None not in a and None not in b:
                differences.append(float(np.mean(a) - np.mean(b)))  # type: ignore[arg-type]
        if not differences or not uncontrolled > 0.0:
            nobody = f"no participant tried both sides on {' and '.join(dict.fromkeys(place))}"
            none = "does not vary, as that of a single trial" if claim.spread else "is 0"
            return Evidence(*about, f"{BY_NAME[measure].short} without control {none}" if differences else nobody)
        return Evidence(*about, "", uncontrolled, mean_interval(np.array(differences) / uncontrolled))

    return [_finding(statement, compare, configurations_of(trials)) for statement in STATEMENTS]


def _why_not(cells: Iterable[tuple[str, int]], measured: set[tuple], finished: Mapping[tuple, float]) -> str:
    """Why the trials of these devices and controllers cannot be compared; "": they can."""
    for device, controller in cells:
        share = finished.get((device, controller))
        trials = f"trials of {CONTROLLER[controller]!r} on {device}"
        if share is None:
            return f"no {trials}"
        if share < LEAST_FINISHED:
            return f"only {percent(share)} of the {trials} reached the end"
        if (device, controller) not in measured:
            return f"nothing measured in the {trials}"
    return ""


class PooledBox(NamedTuple):
    """Quartiles of the pooled trials of a controller on a device, in the measure's unit."""

    q1: float
    median: float
    q3: float


Boxes = Mapping[tuple[str, str, int], PooledBox]  # by measure, configuration and controller


def pooled_boxes(trials: Trials, timeouts: bool = False) -> dict[tuple[str, str, int], PooledBox]:
    """The boxes of a study; none where under 90 % of the trials reached the end. timeouts: those count as well."""
    finished = finished_share(trials)
    boxes = {}
    for (device, controller), cell in to_compare(trials, timeouts).groupby(["configuration", "controller"], sort=False):
        if isinstance(controller, int) and finished[device, controller] >= LEAST_FINISHED:
            for measure in IN_BOXES:
                if len(values := cell[measure].dropna().to_numpy()):
                    quartiles = np.quantile(values, (0.25, 0.5, 0.75), method=QUARTILE_METHOD)
                    boxes[measure, device, controller] = PooledBox(*quartiles.tolist())
    return boxes


def box_findings(boxes: Boxes, configurations: Sequence[str], bands: float = 1.0) -> list[Finding]:
    """All eleven by boxes. bands: factor on what matters, 15 % and 30 %, to see what hangs on them."""

    def compare(claim: Claim, measure: str, place: Place) -> Evidence:
        first, second = claim.cells(place)
        about = claim, measure, place, bands * claim.matters
        for device, controller in (*first, *second, (place[0], 1)):
            if (measure, device, controller) not in boxes:
                why = f"no box of {CONTROLLER[controller]!r} on {device}, or too few of its trials reached the end"
                return Evidence(*about, why)
        uncontrolled = _size(claim, boxes[measure, place[0], 1])
        if not uncontrolled > 0.0:
            return Evidence(*about, f"{BY_NAME[measure].short} without control has no size on {place[0]}")
        ours, theirs = ([boxes[measure, *cell] for cell in side] for side in (first, second))
        a, b = (float(np.mean([_size(claim, box) for box in side])) for side in (ours, theirs))
        apart = math.inf
        if claim.clear:
            apart = min(theirs[0].q1 - ours[0].median, theirs[0].median - ours[0].q3) / uncontrolled
        more = (a - b) / uncontrolled
        return Evidence(*about, "", uncontrolled, Interval(0, more, more, more), apart)

    return [_finding(statement, compare, configurations) for statement in STATEMENTS]


def box_findings_of(trials: Trials, timeouts: bool = False) -> list[Finding]:
    """All eleven by boxes, of a study's trials."""
    return box_findings(pooled_boxes(trials, timeouts), configurations_of(trials))


def _size(claim: Claim, box: PooledBox) -> float:
    return box.q3 - box.q1 if claim.spread else box.median
