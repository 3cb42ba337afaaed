"""The pages of results as points, boxes and curves: one description for the screen and for print.

A page has a chart for each measure of the figures, and of the protocol's own file. Every trial is a point, whose place
is the same on the screen and on paper; fewer than five have no box. A trial whose time was up is a cross above the
scale, unless it is asked into the boxes; any other that does not count is shown only if its row is among those given,
in grey, and is in no box.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np

from experiments.analysis.metrics import DRAWN, Metric
from experiments.analysis.statistics import people_of
from experiments.analysis.trials_table import (
    Controller,
    TrialRow,
    Trials,
    as_rows,
    by_controller,
    controllers_of,
    to_compare,
)
from experiments.numbers import significant

POOLED, PERSON, ORDER, SPEED, QUESTIONS = "pooled", "by_participant", "by_run", "by_speed", "questionnaire"
WHISKER = 1.5  # box lengths
QUARTILE_METHOD: Final = "linear"  # NumPy's name; MATLAB's is "hazen" and differs
MOST_CODES = 20  # along an axis; more cannot be read beside each other. Our choice
LEAST_IN_A_BOX = 5  # Our choice: fewer values are points without a box
GOLDEN = 0.6180339887  # run * GOLDEN modulo 1: a place beside the middle that is even, and always the same
BOX_SHARE = 0.42  # half a box's width, of the room that it has
GROUP_SHARE = 0.8  # of the room between two groups, for boxes
WINDOW_RUNS = 5  # the curve over runs is the median of this run and so many before and after it


class Box(NamedTuple):
    """The numbers of a box. Whiskers end at the furthest values within 1.5 box lengths."""

    n: int  # values
    median: float
    q1: float
    q3: float
    low: float  # end of the lower whisker
    high: float  # end of the upper whisker
    outliers: tuple[float, ...]  # beyond the whiskers, rising


def box_statistics(values: Iterable[float]) -> Box:
    """Median, quartiles (NumPy's "linear" method), whiskers and outliers of at least one finite value."""
    data = np.sort(np.asarray(list(values), dtype=float))
    if not len(data) or not np.all(np.isfinite(data)):
        raise ValueError("a box needs at least one value, all finite")
    q1, median, q3 = (float(q) for q in np.quantile(data, (0.25, 0.5, 0.75), method=QUARTILE_METHOD))
    reach = WHISKER * (q3 - q1)
    inside = data[(data >= q1 - reach) & (data <= q3 + reach)]
    low, high = min(float(inside[0]), q1), max(float(inside[-1]), q3)
    outliers = data[(data < low) | (data > high)]
    return Box(len(data), median, q1, q3, low, high, tuple(float(value) for value in outliers))


class Point(NamedTuple):
    """One trial, or one answer."""

    x: float
    y: float  # in the chart's unit
    controller: int | str  # whose colour it has; "": none
    look: int  # as `LOOKS`
    text: str  # participant, controller, trial and value, in words
    row: TrialRow | None = None


class PlacedBox(NamedTuple):
    """A box and where it stands."""

    x: float
    half: float  # of its width
    box: Box
    controller: int | str
    configuration: str
    look: int  # as `LOOKS`


class Chart(NamedTuple):
    """The content of one plot."""

    name: str  # of its file
    title: str
    unit: str
    ticks: tuple[tuple[float, str], ...]  # places with names along the axis; none: numbers
    x_title: str
    span: tuple[float, float]  # of the axis
    points: tuple[Point, ...]
    timeouts: tuple[Point, ...] = ()  # crosses above the scale
    others: tuple[Point, ...] = ()  # that do not count
    boxes: tuple[PlacedBox, ...] = ()
    curve: tuple[tuple[float, float], ...] = ()
    reach: float = 0.0  # up to where the scale goes at least
    colours: Mapping[Controller, int] = {}  # as `View.colours`
    logarithmic: bool = False

    @property
    def scale(self) -> str:
        """Of its values: "mm", or "mm, log scale"."""
        return ", ".join(filter(None, (self.unit, "log scale" * self.logarithmic)))

    @property
    def highest(self) -> float:
        """The largest value of its points and boxes, `reach` where that is more."""
        ends = [end for placed in self.boxes for end in (placed.box.q3, placed.box.high, *placed.box.outliers)]
        return max((*ends, *(point.y for point in (*self.points, *self.others)), self.reach))

    @property
    def lowest(self) -> float:
        """The least value of its points and boxes, 0 where that is more: only a measure of one's own can be below."""
        ends = [end for placed in self.boxes for end in (placed.box.low, *placed.box.outliers)]
        return min((*ends, *(point.y for point in (*self.points, *self.others)), 0.0))


class View(NamedTuple):
    """The choices by which charts show results."""

    configurations: tuple[str, ...]  # drawn as `LOOKS`, in this order
    names: Mapping[Controller, str]  # controller -> what stands under its boxes
    lengths: Mapping[int, float] = {}  # number of the path -> its length, m
    timeouts: bool = False  # in boxes and statistics
    logarithmic: bool = False  # the axis of path error
    measures: tuple[Metric, ...] = DRAWN  # a chart each
    colours: Mapping[Controller, int] = {}  # controller -> the place of its colour; a code has none
    trials: Mapping[tuple[str, int], str] = {}  # participant, run -> "trial 4, second try"; a first one may be left out

    def look(self, configuration: str) -> int:
        """The index in `LOOKS` of a configuration."""
        return self.configurations.index(configuration) % len(LOOKS)

    def name(self, controller: Controller) -> str:
        """A controller in one line; a code without the participant that it may be of."""
        if isinstance(controller, str):
            return controller.rpartition(" ")[2]
        return self.names.get(controller, f"controller {controller}").replace("\n", " ")

    def trial(self, row: TrialRow) -> str:
        """What a trial is called."""
        return self.trials.get((row.participant, row.run), f"trial {row.run}")

    def timeouts_on(self, chart: Chart) -> tuple[bool, bool]:
        """Whether trials whose time was up are in a chart's boxes, and else above its scale: they have no speed."""
        has_speed = chart.name.endswith(SPEED)
        return self.timeouts and not has_speed, not has_speed


class AnswerSet(NamedTuple):
    """A participant's answers after one block, or one controller, of a configuration."""

    participant: str
    configuration: str
    block: int  # 0: after a controller
    controller: Controller  # 0: after a block; a code of a blind session
    values: dict[str, float]  # question -> 0 to 100
    time: str  # ISO, UTC


#: How the boxes of the first configuration are drawn, of the second, ...; a fifth is as the first.
LOOKS = ("Filled", "Open", "Hatched", "Dotted")


def controllers_shown(trials: Trials, labels: Mapping[Controller, str]) -> dict[Controller, str]:
    """Controller or code -> what stands under its box, in order: all that have a label, and all codes of the trials."""
    used = controllers_of(trials)
    coded: dict[Controller, str] = {controller: controller for controller in used if isinstance(controller, str)}
    shown = coded if used and len(coded) == len(used) else {**labels, **coded}
    return {controller: shown[controller] for controller in sorted(shown, key=by_controller)}


def disambiguate_codes(trials: Trials) -> Trials:
    """The trials with codes that name their participant, if there are several: each blind session has its own key."""
    named = _with_people(trials["participant"].tolist(), trials["controller"].tolist())
    return trials.assign(controller=named) if named != trials["controller"].tolist() else trials


def _with_people(people: Sequence[str], controllers: Sequence[Controller]) -> list[Controller]:
    pairs = list(zip(people, controllers, strict=True))
    if len({who for who, controller in pairs if isinstance(controller, str)}) < 2:
        return list(controllers)
    return [f"P{who} {controller}" if isinstance(controller, str) else controller for who, controller in pairs]


def names_along_axis(groups: Mapping[int | str, str]) -> list[str]:
    """What stands under each group of boxes; of codes of several participants ("P01 K1") the code, and under the
    middle one whose it is. Where they are too many to be read, that alone.
    """
    of_person: dict[str, list[int]] = {}
    names = list(groups.values())
    for at, name in enumerate(names):
        person, _, code = name.rpartition(" ")
        if person and groups.get(name) == name:  # a code stands for itself
            of_person.setdefault(person, []).append(at)
            names[at] = code
    crowded = len(names) > MOST_CODES
    for person, places in of_person.items():
        middle = places[(len(places) - 1) // 2]
        for at in places:
            names[at] = "" if crowded else names[at]
        names[middle] = person if crowded else f"{names[middle]}\n{person}"
    return names


def left_out(trials: Trials, timeouts: bool = False, crosses: bool = True) -> str:
    """How many trials the boxes leave out, and why, as a caption has it; "": none.

    timeouts: those whose time was up are in the boxes. crosses: else they are shown above the scale.
    """
    count = Counter(trials["status"])
    late, excluded = (f"{n} trial{'s' if n != 1 else ''}" for n in (count["timeout"], count["excluded"]))
    parts = []
    if count["timeout"]:
        where = "in the boxes" if timeouts else "crosses above the scale, not in the boxes" if crosses else "not shown"
        parts.append(f"{late} timed out: {where}.")
    if count["excluded"]:
        parts.append(f"{excluded} excluded by the experimenter, not shown.")
    return " ".join(parts)


def charts(page: str, trials: Trials, view: View, answers: Sequence[AnswerSet] = ()) -> list[Chart]:
    """A page's charts of these trials, which are those that are chosen."""
    if page == QUESTIONS:
        if not answers:
            return []
        codes = _with_people([answer.participant for answer in answers], [answer.controller for answer in answers])
        named = [answer._replace(controller=code) for answer, code in zip(answers, codes, strict=True)]
        return [_questionnaire(named, view)]
    trials = trials if page == PERSON else disambiguate_codes(trials)
    make = {POOLED: _pooled, PERSON: _by_participant, ORDER: _by_run, SPEED: _by_speed}[page]
    return [make(trials, metric, view) for metric in view.measures]


def pooled(trials: Trials, metric: Metric, view: View) -> Chart:
    """Boxes as in Figs. 16 to 18 of the paper: of each controller in each configuration that has a trial."""
    return _pooled(trials, metric, view, least=1)._replace(others=())


def boxes(
    trials: Trials, metric: Metric, configurations: Sequence[str], timeouts: bool = False
) -> dict[tuple[Controller, str], Box]:
    """(controller, configuration) -> its box in those figures."""
    names: dict[Controller, str] = {k: "" for k in controllers_of(trials) if isinstance(k, int)}
    chart = pooled(trials, metric, View(tuple(configurations), names, timeouts=timeouts))
    return {(placed.controller, placed.configuration): placed.box for placed in chart.boxes}


def _pooled(trials: Trials, metric: Metric, view: View, least: int = LEAST_IN_A_BOX) -> Chart:
    groups = controllers_shown(trials, view.names)
    grouping = Grouping(groups, view.configurations, attrgetter("controller", "configuration"))
    return _boxed(POOLED, trials, metric, view, grouping, least)


def _by_participant(trials: Trials, metric: Metric, view: View) -> Chart:
    used = controllers_of(trials)
    controllers = [controller for controller in controllers_shown(trials, view.names) if controller in used]
    members = [(c, configuration) for c in controllers for configuration in view.configurations]

    def place(row: TrialRow) -> tuple:
        return row.participant, (row.controller, row.configuration)

    grouping = Grouping({who: who for who in people_of(trials)}, members, place)
    return _boxed(PERSON, trials, metric, view, grouping)._replace(x_title="Participant")


class Grouping(NamedTuple):
    """The order of boxes side by side."""

    groups: Mapping  # each with its name
    members: Sequence  # of every group: one box each
    place: Callable[[TrialRow], tuple]  # group and member of a trial


def _boxed(
    page: str,
    trials: Trials,
    metric: Metric,
    view: View,
    grouping: Grouping,
    least: int = LEAST_IN_A_BOX,
) -> Chart:
    """Boxes in groups; fewer trials than `least` have no box."""
    order, members = list(grouping.groups), grouping.members
    room = GROUP_SHARE / max(len(members), 1)

    def middle(row: TrialRow) -> float:
        group, member = grouping.place(row)
        return _middle(order.index(group), members.index(member), len(members))

    shown = trials[trials["configuration"].isin(view.configurations)]
    chart = _chart(page, shown, metric, view, lambda row: middle(row) + _beside(row.run, room))
    boxes = _boxes(((middle(point.row), point) for point in chart.points if point.row), room, least)
    ticks = tuple((float(i), name) for i, name in enumerate(names_along_axis(grouping.groups)))
    return chart._replace(ticks=ticks, span=(-0.5, max(len(order), 1) - 0.5), boxes=boxes)


def _middle(group: int, member: int, members: int) -> float:
    """Where the box of a member stands in its group, one of so many side by side; groups stand 1 apart."""
    return group + (member - 0.5 * (members - 1)) * (GROUP_SHARE / members)


def _beside(number: int, room: float) -> float:
    """How far from the middle of its box, which has so much room, the point of this number stands."""
    return (number * GOLDEN % 1.0 - 0.5) * 1.5 * BOX_SHARE * room


def _boxes(points: Iterable[tuple[float, Point]], room: float, least: int) -> tuple[PlacedBox, ...]:
    """The boxes of points, each given with the middle of its box; fewer than `least` have none."""
    found: dict[float, list[Point]] = {}
    for middle, point in points:
        found.setdefault(middle, []).append(point)
    return tuple(
        PlacedBox(
            at, BOX_SHARE * room, box_statistics(point.y for point in inside), inside[0].controller,
            inside[0].row.configuration if inside[0].row else "", inside[0].look,
        )
        for at, inside in found.items() if len(inside) >= least
    )  # fmt: skip


def _by_run(trials: Trials, metric: Metric, view: View) -> Chart:
    chart = _chart(ORDER, trials, metric, view, lambda row: float(row.run))
    runs, values = (np.array([getattr(point, axis) for point in chart.points]) for axis in ("x", "y"))
    curve = []
    for run in np.unique(runs):
        near = values[np.abs(runs - run) <= WINDOW_RUNS]
        if len(near) >= LEAST_IN_A_BOX:
            curve.append((float(run), float(np.median(near))))
    last = max(trials["run"], default=1)
    return chart._replace(x_title="Trial", span=(0.0, last + 1.0), curve=tuple(curve))


def _by_speed(trials: Trials, metric: Metric, view: View) -> Chart:
    """Mean speed along the path: a trial whose time was up did not come to its end, and has none."""
    lengths = trials["path"].map(view.lengths).astype(float)
    moved = to_compare(trials[(trials["duration_s"] > 0.0) & lengths.notna()])

    def speed(row: TrialRow) -> float:
        return 1e3 * view.lengths[row.path] / row.value("duration_s")

    speeds = [speed(row) for row in as_rows(moved)] or [1.0]
    chart = _chart(SPEED, moved, metric, view, speed)
    return chart._replace(x_title="Mean speed (mm/s)", span=(0.95 * min(speeds), 1.05 * max(speeds)))


def _chart(page: str, trials: Trials, metric: Metric, view: View, x: Callable[[TrialRow], float]) -> Chart:
    """The points of a chart: those that are compared, those whose time was up, and those that do not count."""
    measured = trials.dropna(subset=metric.name) if metric.name in trials else trials[:0]

    def points(chosen: Trials) -> tuple[Point, ...]:
        found = []
        for row in as_rows(chosen):
            value = metric.scale * row.value(metric.name)
            status = {"done": "", "timeout": " · time was up"}.get(row.status, f" · {row.status}")
            who = f"Participant {row.participant} · {view.name(row.controller)} · {view.trial(row)}"
            text = f"{who} · {significant(value)} {metric.shown_unit}{status}"
            found.append(Point(x(row), value, row.controller, view.look(row.configuration), text, row))
        return tuple(found)

    is_late = measured["status"] == "timeout"
    late = measured[is_late & (not view.timeouts)]
    others = measured[~is_late & (measured["status"] != "done")]
    content = metric.figure.partition("_")[2]
    return Chart(
        content if page == POOLED else f"{content}_{page}", metric.title, metric.shown_unit, (), "", (0.0, 1.0),
        points(to_compare(measured, view.timeouts)), points(late), points(others), colours=view.colours,
        logarithmic=view.logarithmic and metric is DRAWN[0],
    )  # fmt: skip


def _questionnaire(answers: Sequence[AnswerSet], view: View) -> Chart:
    answers = [answer for answer in answers if answer.configuration in view.configurations]
    each = [(answer, question, value) for answer in answers for question, value in answer.values.items()]
    questions = list(dict.fromkeys(question for _, question, _ in each))
    members = sorted(
        {(answer.configuration, answer.controller) for answer in answers},
        key=lambda member: (by_controller(member[1]), view.configurations.index(member[0])),
    )
    room = GROUP_SHARE / len(members)
    placed: list[tuple[float, Point]] = []
    for n, (a, question, value) in enumerate(each):
        middle = _middle(questions.index(question), members.index((a.configuration, a.controller)), len(members))
        after = f"after block {a.block}" if a.block else f"after {view.name(a.controller)}"
        text = f"Participant {a.participant} · {after} on {a.configuration} · {value:g}"
        x = middle + _beside(n, room)
        placed.append((middle, Point(x, value, a.controller or "", view.look(a.configuration), text)))
    boxes = _boxes(placed, room, LEAST_IN_A_BOX)
    ticks = tuple((float(i), question.replace("_", "\n")) for i, question in enumerate(questions))
    span = (-0.5, len(questions) - 0.5)
    points = tuple(point for _, point in placed)
    title = "Answers to the questionnaire"
    return Chart(QUESTIONS, title, "0 to 100", ticks, "", span, points, (), (), boxes, (), 100.0, view.colours)


def paths_of(shown: Iterable[Chart]) -> list[int]:
    """The paths whose trials are points of these charts."""
    return sorted({p.row.path for chart in shown for p in (*chart.points, *chart.timeouts) if p.row is not None})


def coloured(shown: Iterable[Chart], view: View) -> dict[int, str]:
    """Controller -> its name: of those that charts tell apart by their colours. Codes have none."""
    used = {point.controller for chart in shown for point in (*chart.points, *chart.timeouts)}
    return {number: view.name(number) for number in sorted(number for number in used if isinstance(number, int))}


def legend(chart: Chart, view: View) -> list[str]:
    """The meaning of a chart's marks, in short sentences."""
    parts = []
    if len(view.configurations) > 1:
        for look, word in enumerate(LOOKS[: len(view.configurations)]):
            parts.append(f"{word}: {' and '.join(view.configurations[look :: len(LOOKS)])}.")
    point = "answer" if chart.name == QUESTIONS else "trial"
    parts.append(f"A point is one {point}.")
    if counts := {placed.box.n for placed in chart.boxes}:
        parts.append(f"{min(counts)}{'' if len(counts) == 1 else f' to {max(counts)}'} {point}s per box.")
        parts.append(f"Box: middle half and median; whiskers: within {WHISKER:g} box lengths.")
    if chart.points and chart.ticks and len(chart.boxes) < len({(p.controller, p.look) for p in chart.points}):
        parts.append(f"Boxes need at least {LEAST_IN_A_BOX} {point}s.")
    if chart.curve:
        parts.append(f"Line: median of {2 * WINDOW_RUNS + 1} trials.")
    if chart.others:
        parts.append("Grey: trials that do not count.")
    return parts
