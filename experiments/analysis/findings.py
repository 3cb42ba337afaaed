"""The paper's eleven statements (Sections V-B and VI), judged within each participant and by boxes.

The rules, fixed before any data, stand in docs/judging.md. A statement is split into claims.

Within each participant: a claim is split into comparisons, one for each configuration and each measure of one thing.
In a comparison every participant gives one difference, first minus second, of the medians of their own trials (for
"consistent": of their trials' mean distance from the middle of the box). `mean_interval` takes the differences as
normal, which few people cannot show: below six the report warns. "Uncontrolled median": of the participants' scores
without control, in the same configuration (between configurations: on the three-brake device). Our choices: the
difference within a person, where the paper compares boxes; "SDOF" reduces path error if it does without and with gap;
"proportional" against "SDOF" overall is the mean of the two gains against the mean of the two gaps; what four brakes
gain is judged over the four controllers that brake.

By boxes, as the paper judges (our choice: it draws boxes and states no rule): a box holds the trials of everyone
(three people in the paper) with one controller on one device, by the measure of Fig. 16, 17 or 18. U is the size of
the uncontrolled box on the first side's device: its median, or its length (q3 - q1) where lengths are compared.
Several controllers on one side count by the mean of their medians. A rule's margin, in units of U, is not under 0
where the rule is met; a statement's margin is the least of its claims on all devices.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from core.control.controllers import Preset
from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.metrics import BY_NAME, JUDGED
from experiments.analysis.statistics import (
    PAPER_CONFIGURATIONS,
    Interval,
    Scores,
    configurations_of,
    finished_share,
    mean_interval,
    people_of,
    scores,
    spreads,
    too_few,
)
from experiments.analysis.trials_table import TrialRow, to_compare
from experiments.numbers import fixed, percent

BELOW, SIMILAR, AT_MOST = "below", "similar", "at most"
SIMILAR_SHARE = 0.15  # of the uncontrolled median
LITTLE_OF_U, SIMILAR_OF_U = 0.15, 0.30  # by boxes
LEAST_FINISHED = 0.9  # share of the trials of each controller compared
HOLDS, FAILS, CANNOT_TELL = "holds", "does not hold", "cannot tell"
DEPENDS = "depends on how the cut is treated"
#: The two sums of smoothness, as the acceleration is cut and without the ramp that the cut leaves.
SUMS = ("acceleration_dft_sum", "acceleration_dft_sum_ramp_removed")
#: What judges the statements within each participant, fixed with the rules: a further measure changes no verdict.
#: The exact acceleration is none of them, a real device has no accelerometer.
ERROR, FORCE = ("path_error_m",), ("mean_tip_force_N", "force_over_progress_N")
ROUGHNESS = ("acceleration_dft_sum", "acceleration_weighted_rms_m_s2")
IN_BOXES = tuple(metric.name for metric in JUDGED)  # the measures that have boxes
CONTROLLER = {1: "none", 2: "SDOF", 3: "SDOF with gap", 4: "proportional high gain", 5: "proportional low gain"}
GROUP = {(2, 3): "SDOF, both", (4, 5): "proportional, both", (2, 3, 4, 5): "all controllers"}
Controllers = tuple[int, ...]  # several: their mean


def named(controllers: Controllers) -> str:
    """One controller, or several that count by their mean."""
    return CONTROLLER[controllers[0]] if len(controllers) == 1 else GROUP[controllers]


class Claim(NamedTuple):
    """One thing to compare: `first` with `second`, by measures that must agree."""

    kind: str  # BELOW, SIMILAR, AT_MOST
    measures: tuple[str, ...]
    first: Controllers
    second: Controllers
    spread: bool = False  # compare how far trials lie from the middle of the box, not the trials
    little: bool = False  # "little change": by boxes the band is narrower
    clear: bool = False  # "significantly": by boxes neither median may lie in the other box
    devices: bool = False  # first on the three-brake device, second on the four-brake one; else each device in turn

    def places(self, configurations: Sequence[str]) -> list[tuple[str, str]]:
        """Each place of the comparison: the device of `first`, and that of `second`."""
        return [PAPER_CONFIGURATIONS] if self.devices else [(one, one) for one in configurations]

    def sides(self, place: tuple[str, str]) -> tuple[tuple[str, Controllers], tuple[str, Controllers]]:
        """What is compared at a place: device and controllers, on either side."""
        return (place[0], self.first), (place[1], self.second)


class Statement(NamedTuple):
    """One of the paper's statements."""

    number: int
    text: str
    claims: tuple[Claim, ...]


def _each(
    kind: str, measures: tuple[str, ...], *pairs: tuple[int | Controllers, int | Controllers], **more: bool
) -> tuple[Claim, ...]:
    """A claim for each pair of controllers, or of groups of them."""
    both = ((one if isinstance(one, tuple) else (one,) for one in pair) for pair in pairs)
    return tuple(Claim(kind, measures, first, second, **more) for first, second in both)


_ALL = (2, 3, 4, 5)  # the controllers that brake
STATEMENTS = (
    Statement(
        1, "SDOF control (without and with gap) reduces path error", _each(BELOW, ERROR, (2, 1), (3, 1), clear=True)
    ),
    Statement(
        2, "Proportional control reduces path error at either gain", _each(BELOW, ERROR, (4, 1), (5, 1), clear=True)
    ),
    Statement(
        3,
        "SDOF with gap is the most consistent in accuracy",
        _each(BELOW, ERROR, (3, 1), (3, 2), (3, 4), (3, 5), spread=True),
    ),
    Statement(4, "The gap makes SDOF smoother", _each(BELOW, ROUGHNESS, (3, 2))),
    Statement(5, "The gap lowers the force of SDOF", _each(BELOW, FORCE, (3, 2))),
    Statement(6, "The gap costs a negligible amount of accuracy", _each(AT_MOST, ERROR, (3, 2))),
    Statement(
        7,
        "The low gain lowers force and is smoother, with little change in accuracy",
        _each(BELOW, FORCE, (5, 4), clear=True)
        + _each(BELOW, ROUGHNESS, (5, 4), clear=True)
        + _each(SIMILAR, ERROR, (5, 4), little=True),
    ),
    Statement(
        8,
        "Low-gain proportional control is about as light and smooth as none",
        _each(SIMILAR, FORCE, (5, 1)) + _each(SIMILAR, ROUGHNESS, (5, 1)),
    ),
    Statement(
        9,
        "Proportional control is lighter and smoother than SDOF",
        _each(BELOW, FORCE, ((4, 5), (2, 3))) + _each(BELOW, ROUGHNESS, ((4, 5), (2, 3))),
    ),
    Statement(
        10,
        "Four brakes gain nothing over three, and their uncontrolled error spreads wider",
        _each(AT_MOST, ERROR, (_ALL, _ALL), devices=True)
        + _each(AT_MOST, FORCE, (_ALL, _ALL), devices=True)
        + _each(AT_MOST, ROUGHNESS, (_ALL, _ALL), devices=True)
        + _each(BELOW, ERROR, (1, 1), spread=True, devices=True),
    ),
    Statement(
        11,
        "All controllers improve accuracy by a similar amount",
        _each(BELOW, ERROR, *((k, 1) for k in _ALL))
        + _each(SIMILAR, ERROR, *((j, k) for k in _ALL for j in _ALL if k < j)),
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


class Comparison(NamedTuple):
    """One claim, by one measure, in one configuration (or between two)."""

    claim: Claim
    measure: str
    where: str
    answer: bool | None  # None: unclear
    reason: str = ""  # why unclear, when it is not the interval's width
    found: Interval | None = None  # of first minus second, in the measure's shown unit
    band: float = 0.0  # what counts as similar or negligible, in that unit

    @property
    def what(self) -> str:
        """What is compared with what."""
        spread = "spread of " if self.claim.spread else ""
        against = "" if self.claim.devices else f" against {named(self.claim.second)}"
        return f"{spread}{BY_NAME[self.measure].short}, {named(self.claim.first)}{against}"

    @property
    def numbers(self) -> str:
        """Where, and the difference with its interval."""
        if self.found is None:
            return f"{self.where} ({self.reason})"
        metric = BY_NAME[self.measure]
        middle, low, high = (fixed(value, 2, "+") for value in self.found[1:])
        inside = [f"{low} to {high}"] if self.found.is_bounded else []
        inside += [f"band {self.band:.2f}"] if self.claim.kind != BELOW else []
        return f"{self.where} {middle} {metric.shown_unit}" + (f" ({'; '.join(inside)})" if inside else "")

    @property
    def needed(self) -> str:
        """What the difference must be for the claim."""
        if self.claim.kind == BELOW:
            return "less than 0"
        band = f"{percent(SIMILAR_SHARE)} of the uncontrolled median, the band"
        return f"at most {band}" if self.claim.kind == AT_MOST else f"within {band}, either way"

    @property
    def margin(self) -> float:
        """How far a true comparison is from not being so, in bands."""
        if self.found is None or not self.band:
            return 0.0
        if self.claim.kind == BELOW:
            return -self.found.high / self.band
        outermost = self.found.high if self.claim.kind == AT_MOST else max(self.found.high, -self.found.low)
        return (self.band - outermost) / self.band


class Finding(NamedTuple):
    """A statement's verdict, with what it rests on."""

    statement: Statement
    verdict: str  # HOLDS, FAILS, CANNOT_TELL
    sentence: str
    people: int  # the fewest that any of its comparisons rests on
    comparisons: tuple[Comparison, ...]


def findings(rows: Sequence[TrialRow], timeouts: bool = False) -> list[Finding]:
    """All eleven, for any study: of simulated operators or people, complete or not.

    timeouts: trials whose time was up count as well.
    """
    ended = to_compare(rows, timeouts)
    by_measure = {column: scores(ended, column, np.median) for column in (*ERROR, *FORCE, *ROUGHNESS)}
    error_spread, finished = spreads(ended, ERROR[0]), finished_share(rows)
    people, configurations = people_of(rows), configurations_of(rows)
    found = []
    for statement in STATEMENTS:
        compared = [
            _compare(claim, measure, place, error_spread if claim.spread else by_measure[measure], finished, people)
            for claim in statement.claims
            for place in claim.places(configurations)
            for measure in claim.measures
        ]
        fewest = min((one.found.people for one in compared if one.found), default=len(people))
        found.append(Finding(statement, *_decide(statement, compared), fewest, tuple(compared)))
    return found


def _compare(
    claim: Claim,
    measure: str,
    place: tuple[str, str],
    table: Scores,
    finished: dict[tuple[str, int | str], float],
    people: Sequence[str],
) -> Comparison:
    """A claim by one measure: first on the first device of `place`, second on the second."""
    here, there = place
    where = here if here == there else f"{here} against {there}"
    uncontrolled = [value for (_, device, k), value in table.items() if (device, k) == (here, 1)]
    reason = _why_not(measure, (*claim.sides(place), (here, (1,))), table, finished)
    differences = []
    for person in people:
        a, b = ([table.get((person, device, k)) for k in controllers] for device, controllers in claim.sides(place))
        if None not in a and None not in b:
            differences.append(float(np.mean(a) - np.mean(b)))  # type: ignore[arg-type]
    if not reason and not differences:
        reason = f"no participant tried both sides ({where})"
    if not reason and not np.median(uncontrolled) > 0.0:
        reason = f"{BY_NAME[measure].short} without control is 0 on {here}"
    if reason:
        return Comparison(claim, measure, where, None, reason)
    scale = BY_NAME[measure].scale
    band = scale * SIMILAR_SHARE * float(np.median(uncontrolled))
    interval = mean_interval(scale * np.array(differences))
    return Comparison(claim, measure, where, answer(claim.kind, interval, band), "", interval, band)


def _why_not(
    measure: str, sides: Sequence[tuple[str, Controllers]], table: Scores, finished: dict[tuple[str, int | str], float]
) -> str:
    """Why trials with these controllers on these devices cannot be compared; "": they can."""
    measured = {cell[1:] for cell in table}
    for device, controller in dict.fromkeys((device, k) for device, controllers in sides for k in controllers):
        share = finished.get((device, controller))
        of_it = f"trials of {CONTROLLER[controller]!r} on {device}"
        if share is None:
            return f"no {of_it}"
        if share < LEAST_FINISHED:
            return f"only {percent(share)} of the {of_it} reached the end"
        if (device, controller) not in measured:
            return f"nothing measured in the {of_it}"
    return ""


def answer(kind: str, found: Interval, band: float) -> bool | None:
    """Whether an interval means yes (True), no (False), or neither (None) for a comparison of this kind."""
    within = -band <= found.low and found.high <= band
    if kind == BELOW:
        return True if found.high < 0.0 else False if found.low > 0.0 or within else None
    if kind == AT_MOST:
        return True if found.high <= band else False if found.low > band else None
    return True if within else False if found.low > band or found.high < -band else None


def _decide(statement: Statement, compared: Sequence[Comparison]) -> tuple[str, str]:
    """The verdict and its sentence: about the first false claim, or the first unclear one, or the narrowest."""
    if not compared:
        return CANNOT_TELL, "There are no trials."
    by_answer: dict[bool | None, list[list[Comparison]]] = {True: [], False: [], None: []}
    for claim in statement.claims:
        of_it = [comparison for comparison in compared if comparison.claim is claim]
        answers = {comparison.answer for comparison in of_it}
        by_answer[answers.pop() if len(answers) == 1 else None].append(of_it)
    true, false, unclear = by_answer[True], by_answer[False], by_answer[None]
    count = len(statement.claims)
    if false:
        how_many = f"{len(false)} of {count} claims fail{'s' if len(false) == 1 else ''}. " if count > 1 else ""
        return FAILS, f"{how_many}{_listed(false[0])}; needed: {false[0][0].needed}."
    if unclear:
        how_many = f"{len(unclear)} of {count} claims unclear. " if count > 1 else ""
        return CANNOT_TELL, how_many + _why_unclear(unclear[0])
    closest = min(true, key=lambda of_it: min(one.margin for one in of_it))
    return HOLDS, f"{'Closest. ' if count > 1 else ''}{_listed(closest)}."


def _listed(compared: Sequence[Comparison]) -> str:
    places: dict[str, list[str]] = {}
    for one in compared:
        places.setdefault(one.what, []).append(one.numbers)
    text = "; ".join(f"{what}: {', '.join(numbers)}" for what, numbers in places.items())
    return text[:1].upper() + text[1:]


def _why_unclear(compared: Sequence[Comparison]) -> str:
    missing = "; ".join(dict.fromkeys(one.reason for one in compared if one.reason))
    if missing:
        return f"{missing[:1].upper()}{missing[1:]}."
    if {True, False} <= {one.answer for one in compared}:
        why = "measures or devices disagree"
    elif not all(one.found.is_bounded for one in compared if one.found):
        why = "one participant has no interval"
    else:
        why = "an interval is too wide"
    return f"{_listed(compared)}; needed: {compared[0].needed}, but {why}."


def description_only(found: Sequence[Finding]) -> str:
    """The sentence that refuses to claim anything for others; empty if there are people enough."""
    return too_few(min(one.people for one in found))


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
    verdict: str  # HOLDS, FAILS, CANNOT_TELL; DEPENDS where the two sums do not agree
    margins: tuple[float, float]  # by either of SUMS: the least of its claims, in units of U; nan: one cannot tell
    sentence: str

    @property
    def margin(self) -> float:
        """The lesser by the two sums: not under 0 where the statement holds by both; nan: one cannot tell."""
        return math.nan if math.isnan(sum(self.margins)) else min(self.margins)


def pooled_boxes(rows: Sequence[TrialRow], timeouts: bool = False) -> dict[tuple[str, str, int], PooledBox]:
    """The boxes of a study; none where under 90 % of the trials reached the end. timeouts: those count as well."""
    finished = finished_share(rows)
    values: dict[tuple[str, str, int], list[float]] = {}
    for row in to_compare(rows, timeouts):
        if isinstance(row.controller, int) and finished[row.configuration, row.controller] >= LEAST_FINISHED:
            for measure in IN_BOXES:
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
        by_sum = [_judged(statement, total, boxes, configurations, bands) for total in SUMS]
        (verdict, margin, sentence), (other, other_margin, why) = by_sum
        if CANNOT_TELL in (verdict, other):  # a box is missing
            verdict, sentence = (verdict, sentence) if verdict == CANNOT_TELL else (other, why)
        elif other != verdict:
            sentence = f"As cut, {verdict}: {sentence} Without the ramp, {other}: {why}"
            verdict = DEPENDS
        found.append(BoxFinding(statement, verdict, (margin, other_margin), sentence))
    return found


def _judged(
    statement: Statement, total: str, boxes: Boxes, configurations: Sequence[str], bands: float
) -> tuple[str, float, str]:
    """Verdict, margin and sentence of a statement with smoothness by this sum."""
    compared = [
        Compared(claim, measure, place, _margin(claim, measure, place, boxes, bands))
        for claim in statement.claims
        for measure in [total if claim.measures == ROUGHNESS else claim.measures[0]]
        for place in claim.places(configurations)
    ]
    decisive = min(compared, key=lambda one: (not math.isnan(one.margin), one.margin), default=None)
    if decisive is None or math.isnan(decisive.margin):
        return CANNOT_TELL, math.nan, _why_missing(decisive, boxes) if decisive else "No trials."
    return HOLDS if decisive.margin >= 0.0 else FAILS, decisive.margin, _sentence(decisive, boxes, bands)


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
    return LITTLE_OF_U if claim.kind in (BELOW, AT_MOST) or claim.little else SIMILAR_OF_U


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
    allowed = percent(band)
    needed = {BELOW: f"lower by {allowed}", AT_MOST: f"at most {allowed} more"}.get(claim.kind, f"within {allowed}")
    clear = ", neither median in the other's box" if claim.clear else ""
    size = "length" if claim.spread else "median"
    text = f"{what}, {who}: {texts[0]} {metric.shown_unit} against {texts[1]} {metric.shown_unit}"
    return f"{text[:1].upper()}{text[1:]}; needed: {needed} of the uncontrolled {size}{clear}."
