"""Statistics of a study, with the participant as the unit: what differs, by how much, and what else could explain it.

Means of each participant's trials; Friedman across controllers; Wilcoxon signed-rank for each pair, Holm within each
measure and configuration; Hodges-Lehmann differences and matched-pairs rank-biserial correlations with intervals; the
trend over the order of trials; path error against speed, and adjusted for it. "pooled": the mean of a participant's
configurations. Below six participants there are no p-values and no intervals: three people prove nothing for others.

Trials of one person are no independent observations; people are. So each participant's trials in a cell
(configuration, controller) become one score, and intervals and tests count participants. Which trials count, the
caller decides (`trials_table.to_compare`), as in the box plots.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import TRIED, Controller, Trials, by_controller, own_columns, to_compare

#: The paper's two, by device name.
PAPER_CONFIGURATIONS = ("three-brake", "four-brake")
#: Those that controllers are compared by: of accuracy, force, smoothness, then the others.
MEASURES = tuple(
    metric.name for thing in ("accuracy", "force", "smoothness", "") for metric in METRICS
    if metric.compared and metric.stands_for == thing
)  # fmt: skip
POOLED = "pooled"
TREND_TRIALS = 10  # a trend is the change over so many trials
SEED, RESAMPLES = 1, 2000  # of the bootstrap
#: With fewer, no 95 % interval exists that assumes no distribution (2 / 2^5 > 5 %), nor can a signed-rank test reach
#: 5 %.
LEAST_PEOPLE = 6
LEVEL = 0.95
_WORDS = (
    "Nobody is", "One participant is", "Two participants are", "Three participants are", "Four participants are",
    "Five participants are",
)  # fmt: skip
CELL = ["participant", "configuration", "controller"]
TASK = [*CELL, "path"]
Cell = tuple[str, str, int | str]  # participant, configuration, controller
Scores = dict[Cell, float]
ByController = dict[int, dict[str, float]]  # controller -> participant -> mean


class Result(NamedTuple):
    """One number of statistics.csv. Empty text or None: does not apply, or `missing` says why."""

    test: str
    measure: str
    configuration: str
    first: str
    second: str
    people: int
    statistic: str
    value: float | None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    p_holm: float | None = None
    differ: int | None = None  # people whose two means are not equal; of an order: pairs that change places
    missing: str = ""  # why there is no p, or no interval


#: Statistic -> what its value is.
STATISTICS = {
    "mean": "mean of the participants' means; interval by Student's t",
    "chi_square": "Friedman's test: `p` says whether the controllers differ at all",
    "kendall_W": "do the participants agree on the order of the controllers? 0: not at all, 1: fully",
    "hodges_lehmann": "middle of the participants' differences; `p` by Wilcoxon's signed-rank test",
    "rank_biserial": "do most participants differ in this direction? -1 to 1; interval by Wilson's score",
    "percent_in_10_trials": "change over ten trials of one task, in % of the participant's mean; median",
    "m_per_doubling": "change of the path error (m) at twice the speed",
    "correlation": "of path error and speed, -1 to 1",
    "doublings_above_own_mean": "speed against the participant's own mean; 1: twice as fast",
    "mean_error": "mean of the participants' path errors (m)",
    "error_at_common_speed": "the same, if all controllers had been used equally fast",
    "kendall_tau": "do `measure` and `second` rank the controllers alike? 1: yes, -1: reversed",
    "ratio_of_medians": "median of the trials with `first` over that with `second`",
    "median_ratio": "the measure without the reaction time over that with it; median trial",
}
#: Of `with_names`.
NAMED = (*Result._fields, "first_name", "second_name")


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


def statistics(trials: Trials, timeouts: bool = False) -> list[Result]:
    """Every result, always in the same order. timeouts: trials whose time was up count as well."""
    trials = to_compare(trials, timeouts)
    results: list[Result] = []
    measures = (*MEASURES, *own_columns(trials))
    for measure in measures:
        for configuration, table in by_configuration(trials, measure):
            results += [*means(measure, configuration, table), *friedman(measure, configuration, table)]
            results += pairs(measure, configuration, table)
    for measure in measures:
        results += trend(trials, measure)
    return results + error_and_speed(trials)


def with_names(results: Sequence[Result], names: Mapping[Controller, str]) -> list[tuple]:
    """Each result with the names of its controllers, an order of them included; "" where there is none."""

    def named(text: str) -> str:
        numbers = text.split(" < ")
        return " < ".join(names.get(int(k), "") for k in numbers) if all(map(str.isdigit, numbers)) else ""

    return [(*result, named(result.first), named(result.second)) for result in results]


def by_configuration(trials: Trials, measure: str) -> Iterator[tuple[str, ByController]]:
    """Each configuration, and all pooled if there are several: means of those who tried a controller in all of them."""
    table, configurations, people = scores(trials, measure), configurations_of(trials), people_of(trials)
    several = [(POOLED, configurations)] if len(configurations) > 1 else []
    for name, among in [(configuration, (configuration,)) for configuration in configurations] + several:
        found: ByController = {}
        for controller in sorted({cell[2] for cell in table}):
            for person in people:
                values = [table.get((person, configuration, controller)) for configuration in among]
                if None not in values:
                    found.setdefault(controller, {})[person] = float(np.mean(values))  # type: ignore[arg-type]
        yield name, found


def people_of(trials: Trials) -> tuple[str, ...]:
    """The participants, in the order of the trials."""
    return tuple(dict.fromkeys(trials["participant"]))


def configurations_of(trials: Trials) -> tuple[str, ...]:
    """The configurations: the paper's two first, then any others by name (participants meet them in any order)."""
    found = set(trials["configuration"])
    return (*(name for name in PAPER_CONFIGURATIONS if name in found), *sorted(found.difference(PAPER_CONFIGURATIONS)))


def scores(trials: Trials, column: str, average: Callable = np.mean) -> Scores:
    """Each participant's average of a column in each cell; no entry where there is nothing to average."""
    cells = trials.dropna(subset=column).groupby(CELL, sort=False)[column]
    return {cell: float(average(values.to_numpy())) for cell, values in cells}


def spreads(trials: Trials, column: str) -> Scores:
    """How far each participant's trials lie from the middle of their box, on average.

    The middle is the median of all participants' trials of that configuration and controller, the line in the box
    plot; so the score holds both the spread within a person and the person's own distance (Brown and Forsythe).
    """
    middles = trials.groupby(["configuration", "controller"])[column].transform("median")
    return scores(trials.assign(**{column: (trials[column] - middles).abs()}), column)


def finished_share(trials: Trials) -> dict[tuple[str, int | str], float]:
    """(configuration, controller) -> share of its trials that reached the end of the path; aborted ones did not."""
    tried = trials[trials["status"].isin(TRIED)]
    done = (tried["status"] == "done").groupby([tried["configuration"], tried["controller"]], sort=False)
    return {cell: float(ended.mean()) for cell, ended in done}


def why_no_p(people: int) -> str:
    """Why so few people give no p-value and no interval; "": they do."""
    return "" if people >= LEAST_PEOPLE else f"{people} of the {LEAST_PEOPLE} people that a p-value needs"


def too_few(people: int) -> str:
    """The sentence that refuses to claim anything for others; empty if there are enough people."""
    if people >= LEAST_PEOPLE:
        return ""
    return f"{_WORDS[people]} too few to claim any of this for others; read it as a description."


def mean_interval(values: Sequence[float] | np.ndarray) -> Interval:
    """The mean and its 95 % interval by Student's t: takes the values as normal, holds for two people as for many.

    Fewer people only widen it: the root mean square of its half-widths over all subsets of m of these people is
    t(m - 1) s / sqrt(m), with s the standard deviation of them all, and that falls with every person more.
    """
    data = np.asarray(values, dtype=float)
    n, middle = len(data), float(np.mean(data))
    half = float(scipy.stats.t.ppf(0.5 * (1.0 + LEVEL), n - 1) * scipy.stats.sem(data)) if n > 1 else math.inf
    return Interval(n, middle, middle - half, middle + half)


def median_interval(values: Sequence[float] | np.ndarray) -> Interval:
    """The median and its 95 % interval by counting (the sign test turned round): no distribution is assumed.

    From the k-th smallest to the k-th largest value, the largest k that covers the median of people with at least
    95 %. Below six values none does.
    """
    data = np.sort(np.asarray(values, dtype=float))
    n, middle = len(data), float(np.median(data))
    if n < LEAST_PEOPLE:
        return Interval(n, middle, -math.inf, math.inf)
    k = int(scipy.stats.binom.ppf(0.5 * (1.0 - LEVEL), n, 0.5))
    return Interval(n, middle, float(data[k - 1]), float(data[n - k]))


def means(measure: str, configuration: str, table: ByController) -> list[Result]:
    """Mean over participants of their means, with Student's interval."""
    results = []
    for controller, of_people in table.items():
        found = mean_interval(list(of_people.values()))
        about = ("mean", measure, configuration, f"{controller}", "", found.people, "mean")
        low, high = found[2:] if found.people >= LEAST_PEOPLE else (None, None)
        results.append(Result(*about, found.middle, low, high, missing=why_no_p(found.people)))
    return results


def friedman(measure: str, configuration: str, table: ByController) -> list[Result]:
    """Whether any controller differs, over the participants that tried all: chi-square and Kendall's W."""
    people = [person for person in next(iter(table.values()), {}) if all(person in of for of in table.values())]
    if len(table) < 3 or len(people) < 2:
        return []
    data = np.array([[of_people[person] for person in people] for of_people in table.values()])
    if np.all(data == data[0]):  # every participant the same with every controller: nothing to rank
        return []
    chi_square, p = map(float, scipy.stats.friedmanchisquare(*data))
    about = ("friedman", measure, configuration, " ".join(map(str, table)), "", len(people))
    return [
        Result(
            *about,
            "chi_square",
            chi_square,
            p=p if len(people) >= LEAST_PEOPLE else None,
            missing=why_no_p(len(people)),
        ),
        Result(*about, "kendall_W", chi_square / (len(people) * (len(table) - 1))),
    ]


def pairs(measure: str, configuration: str, table: ByController) -> list[Result]:
    """Each pair of controllers, first minus second: shift, rank-biserial correlation, Wilcoxon with Holm."""
    results: list[Result] = []
    chances: dict[int, float] = {}  # place in the results -> p
    for a, b in combinations(table, 2):
        differences = np.array([table[a][person] - table[b][person] for person in table[a] if person in table[b]])
        if not len(differences):
            continue
        about = ("difference", measure, configuration, f"{a}", f"{b}", len(differences))
        shift = shift_interval(differences)
        effect = rank_biserial(differences)
        count = int(np.count_nonzero(differences)), why_no_p(len(differences))
        of_shift: tuple[float | None, ...] = (None, None)
        of_effect = of_shift
        if len(differences) >= LEAST_PEOPLE:
            chances[len(results)] = signed_rank_p(differences)
            of_shift, of_effect = shift[2:], rank_biserial_interval(effect, len(differences))
        for statistic, value, (low, high) in (
            ("hodges_lehmann", shift.middle, of_shift), ("rank_biserial", effect, of_effect)
        ):  # fmt: skip
            results.append(Result(*about, statistic, value, low, high, None, None, *count))
    for (place, p), p_holm in zip(chances.items(), holm(list(chances.values())).tolist(), strict=True):
        results[place] = results[place]._replace(p=p, p_holm=p_holm)
    return results


def signed_rank_p(differences: np.ndarray) -> float:
    """Two-sided p of Wilcoxon's signed-rank test: exact without ties and zeros, zeros left out."""
    rest = differences[differences != 0.0]
    return float(scipy.stats.wilcoxon(rest).pvalue) if len(rest) else 1.0


def holm(chances: Sequence[float] | np.ndarray) -> np.ndarray:
    """p-values (.., n) adjusted for being several (Holm's step-down), along the last axis."""
    given = np.asarray(chances, dtype=float)
    order, n = np.argsort(given, axis=-1, kind="stable"), given.shape[-1]
    rising = np.maximum.accumulate((n - np.arange(n)) * np.take_along_axis(given, order, -1), axis=-1)
    adjusted = np.empty_like(given)
    np.put_along_axis(adjusted, order, np.minimum(rising, 1.0), -1)
    return adjusted


def least_p_holm(pairs: Sequence[Result]) -> float:
    """The smallest p after Holm's correction that so few people allow in these pairs of one family, whatever they do.

    Wilcoxon's smallest p of n people is that of all n differing the same way, 2 / 2^n.
    """
    return min(1.0, len(pairs) * min((2.0 * 0.5**pair.people for pair in pairs), default=1.0))


def shift_interval(values: Sequence[float] | np.ndarray) -> Interval:
    """Hodges-Lehmann: the median of all pairwise means, with the interval of the exact signed-rank test.

    Takes the values as symmetric about their middle. Below six values there is no such interval.
    """
    data = np.asarray(values, dtype=float)
    n = len(data)
    i, j = np.triu_indices(n)
    walsh = np.sort(0.5 * (data[i] + data[j]))
    middle = float(np.median(walsh))
    if n < LEAST_PEOPLE:
        return Interval(n, middle, -math.inf, math.inf)
    k = int(np.searchsorted(np.cumsum(signed_rank_distribution(n)), 0.5 * (1.0 - LEVEL)))
    return Interval(n, middle, float(walsh[k - 1]), float(walsh[len(walsh) - k]))


def signed_rank_distribution(n: int) -> np.ndarray:
    """Probability (n (n + 1) / 2 + 1,) of each sum of positive ranks among n values without a shift."""
    chances = np.zeros(n * (n + 1) // 2 + 1)
    chances[0] = 1.0
    for rank in range(1, n + 1):
        chances[rank:] = 0.5 * (chances[rank:] + chances[:-rank])
        chances[:rank] *= 0.5
    return chances


def rank_biserial(differences: np.ndarray) -> float:
    """Matched pairs: (sum of ranks over 0 minus sum of those under it) / sum of all, in [-1, 1]; 0 if all are 0."""
    rest = differences[differences != 0.0]
    ranks = scipy.stats.rankdata(np.abs(rest))
    return float(np.sign(rest) @ ranks / ranks.sum()) if len(rest) else 0.0


def rank_biserial_interval(effect: float, people: int) -> tuple[float, float]:
    """95 % score interval of a rank-biserial correlation, from the share of the ranks that are over 0 (Wilson's).

    Our choice: as of so many independent people that the share varies without a shift as it does, 3 n (n + 1) /
    (2 (2 n + 1)); with half a rank of continuity.
    """
    z, n = scipy.stats.norm.ppf(0.5 * (1.0 + LEVEL)), 1.5 * people * (people + 1) / (2 * people + 1)
    ends = []
    for side in (-1.0, 1.0):
        share = np.clip(0.5 * (1.0 + effect) + side / (people * (people + 1)), 0.0, 1.0)
        half = z * math.sqrt(share * (1.0 - share) / n + 0.25 * (z / n) ** 2)
        ends.append(2.0 * (share + 0.5 * z * z / n + side * half) / (1.0 + z * z / n) - 1.0)
    return max(-1.0, min(ends[0], effect)), min(1.0, max(ends[1], effect))


def _resampled(people: int) -> np.ndarray:
    """Participants drawn with replacement, (RESAMPLES, people); the same for every measure."""
    return np.random.default_rng(SEED).integers(0, people, (RESAMPLES, people))


def _middle(values: np.ndarray) -> tuple[float, float]:
    """The ends of the middle 95 % of bootstrapped values."""
    low, high = np.quantile(values, (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)))
    return float(low), float(high)


def trend(trials: Trials, measure: str) -> list[Result]:
    """Over the order of trials: each participant's change over ten trials, in % of their mean; its median over people.

    The slope over the number of the trial within each task (configuration, controller, path): what differs
    between tasks, and between the configuration that came first and the other, cannot pass for a trend.
    """
    slopes = []
    measured = trials.dropna(subset=measure)
    for _, of_person in measured.groupby("participant", sort=False):
        run, value = _within_tasks(of_person, "run", measure)
        mean = np.mean(of_person[measure].to_numpy())
        if np.any(run) and mean:
            slopes.append(100.0 * TREND_TRIALS * float(run @ value / (run @ run)) / mean)
    if not slopes:
        return []
    found = median_interval(slopes)
    result = Result("trend", measure, "all", "", "", found.people, "percent_in_10_trials", found.middle)
    if found.people < LEAST_PEOPLE:
        return [result._replace(missing=why_no_p(found.people))]
    return [result._replace(low=found.low, high=found.high, p=signed_rank_p(np.array(slopes)))]


def _within_tasks(trials: Trials, *columns: str) -> np.ndarray:
    """The columns, each less its mean in the task, task by task."""
    values, number = trials[list(columns)].to_numpy(dtype=float), trials.groupby(TASK, sort=False).ngroup().to_numpy()
    tasks = [values[number == task] for task in range(number.max(initial=-1) + 1)]
    return np.concatenate([task - task.mean(axis=0) for task in tasks]).T if tasks else np.empty((len(columns), 0))


def _with_speed(trials: Trials) -> Trials:
    """The trials that were finished, with their speed: doublings of the mean speed along the path, from an arbitrary
    zero for each path.
    """
    found = trials[(trials["status"] == "done") & (trials["duration_s"] > 0.0)].dropna(subset="path_error_m")
    return found.assign(speed=-np.log2(found["duration_s"].to_numpy()))


def error_and_speed(trials: Trials) -> list[Result]:
    """Path error against speed, trial by trial within a task, and each controller's error at the common speed.

    The slope is that of the same person in the same task, one for all; interval by bootstrap over participants.
    Adjusted: as if each participant had moved with every controller at the mean of their speeds.
    """
    trials = _with_speed(trials)
    sums = []  # of each participant: speed * error, speed^2, error^2
    for _, of_person in trials.groupby("participant", sort=False):
        speed, error = _within_tasks(of_person, "speed", "path_error_m")
        if np.any(speed):
            sums.append((float(speed @ error), float(speed @ speed), float(error @ error)))
    if not sums:
        return []
    product, square, errors = (sum(column) for column in zip(*sums, strict=True))
    slope, spread = product / square, math.sqrt(square * errors)
    low, high = None, None
    if len(sums) >= LEAST_PEOPLE:
        drawn = np.array(sums)[_resampled(len(sums))].sum(axis=1)
        low, high = _middle(drawn[:, 0] / drawn[:, 1])
    about = ("speed", "path_error_m", "all", "", "", len(sums))
    results = [
        Result(*about, "m_per_doubling", slope, low, high, missing=why_no_p(len(sums))),
        Result(*about, "correlation", product / spread if spread else None),
    ]
    for configuration in configurations_of(trials):
        results += _adjusted(trials[trials["configuration"] == configuration], configuration, slope)
    return results


def _adjusted(trials: Trials, configuration: str, slope: float) -> list[Result]:
    """trials: of this configuration."""
    own = scores(trials, "speed"), scores(trials, "path_error_m")
    usual = {p: np.mean([speed for (q, *_), speed in own[0].items() if q == p]) for p in people_of(trials)}
    results = []
    for controller in sorted({cell[2] for cell in own[0]}, key=by_controller):
        cells = [cell for cell in own[0] if cell[2] == controller]
        faster = float(np.mean([own[0][cell] - usual[cell[0]] for cell in cells]))
        error = float(np.mean([own[1][cell] for cell in cells]))
        about = ("speed", "path_error_m", configuration, f"{controller}", "", len(cells))
        results += [
            Result(*about, "doublings_above_own_mean", faster),
            Result(*about, "mean_error", error),
            Result(*about, "error_at_common_speed", error - slope * faster),
        ]
    return results
