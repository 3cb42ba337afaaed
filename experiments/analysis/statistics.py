"""Statistics of a study, with the participant as the unit: what differs, by how much, and what else could explain it.

Means of each participant's trials; Friedman across controllers; Wilcoxon signed-rank for each pair, Holm within each
measure and configuration; Hodges-Lehmann differences and matched-pairs rank-biserial correlations with intervals; the
trend over the order of trials; path error against speed, and adjusted for it. "pooled": the mean of a participant's
configurations. Below six participants there are no p-values and no intervals: three people prove nothing for others.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import stats

from experiments.analysis.metrics import compared_for
from experiments.analysis.participants import (
    LEAST_PEOPLE,
    LEVEL,
    Scores,
    configurations_of,
    mean_interval,
    median_interval,
    people_of,
    scores,
    shift_interval,
)
from experiments.analysis.trials_table import TrialRow, to_compare

MEASURES = tuple(name for thing in ("accuracy", "force", "smoothness", "") for name in compared_for(thing))
POOLED = "pooled"
TREND_TRIALS = 10  # a trend is the change over so many trials
SEED, RESAMPLES = 1, 2000  # of the bootstrap


class Result(NamedTuple):
    """One number of statistics.csv. Empty text or None: does not apply, or too few people for it."""

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


def statistics(rows: Sequence[TrialRow], timeouts: bool = False) -> list[Result]:
    """Every result, always in the same order. timeouts: trials whose time was up count as well."""
    rows = to_compare(rows, timeouts)
    results: list[Result] = []
    for measure in MEASURES:
        for configuration, table in by_configuration(rows, measure):
            results += [*means(measure, configuration, table), *friedman(measure, configuration, table)]
            results += pairs(measure, configuration, table)
    for measure in MEASURES:
        results += trend(rows, measure)
    return results + error_and_speed(rows)


def by_configuration(rows: Sequence[TrialRow], measure: str) -> Iterator[tuple[str, dict[int, dict[str, float]]]]:
    """Each configuration, and all pooled if there are several, with controller -> participant -> mean."""
    table, configurations = scores(rows, measure), configurations_of(rows)
    for configuration in configurations:
        yield configuration, _controllers(table, (configuration,), people_of(rows))
    if len(configurations) > 1:
        yield POOLED, _controllers(table, configurations, people_of(rows))


def _controllers(table: Scores, configurations: Sequence[str], people: Sequence[str]) -> dict[int, dict[str, float]]:
    found: dict[int, dict[str, float]] = {}
    for controller in sorted({cell[2] for cell in table}):
        for person in people:
            values = [table.get((person, configuration, controller)) for configuration in configurations]
            if None not in values:
                found.setdefault(controller, {})[person] = float(np.mean(values))  # type: ignore[arg-type]
    return found


def means(measure: str, configuration: str, table: dict[int, dict[str, float]]) -> list[Result]:
    """Mean over participants of their means, with Student's interval."""
    results = []
    for controller, of_people in table.items():
        found = mean_interval(list(of_people.values()))
        ends = found[2:] if found.people >= LEAST_PEOPLE else (None, None)
        about = ("mean", measure, configuration, f"{controller}", "", found.people, "mean")
        results.append(Result(*about, found.middle, *ends))
    return results


def friedman(measure: str, configuration: str, table: dict[int, dict[str, float]]) -> list[Result]:
    """Whether any controller differs, over the participants that tried all: chi-square and Kendall's W."""
    people = [person for person in next(iter(table.values()), {}) if all(person in of for of in table.values())]
    if len(table) < 3 or len(people) < 2:
        return []
    data = np.array([[of_people[person] for person in people] for of_people in table.values()])
    if np.all(data == data[0]):  # every participant the same with every controller: nothing to rank
        return []
    found = stats.friedmanchisquare(*data)
    controllers, enough = " ".join(map(str, table)), len(people) >= LEAST_PEOPLE
    w = float(found.statistic) / (len(people) * (len(table) - 1))
    about = ("friedman", measure, configuration, controllers, "", len(people))
    return [
        Result(*about, "chi_square", float(found.statistic), p=float(found.pvalue) if enough else None),
        Result(*about, "kendall_W", w),
    ]


def pairs(measure: str, configuration: str, table: dict[int, dict[str, float]]) -> list[Result]:
    """Each pair of controllers, first minus second: shift, rank-biserial correlation, Wilcoxon with Holm."""
    found, chances = [], []
    for a, b in combinations(table, 2):
        both = [person for person in table[a] if person in table[b]]
        if not both:
            continue
        differences = np.array([table[a][person] - table[b][person] for person in both])
        enough = len(both) >= LEAST_PEOPLE
        about = (measure, configuration, f"{a}", f"{b}", len(both))
        shift = shift_interval(differences)
        low, high = rank_biserial_interval(differences) if enough else (None, None)
        found.append(
            [
                Result("difference", *about, "hodges_lehmann", shift.middle, *(shift[2:] if enough else ())),
                Result("difference", *about, "rank_biserial", rank_biserial(differences), low, high),
            ]
        )
        chances.append(signed_rank_p(differences) if enough else None)
    known = [p for p in chances if p is not None]
    adjusted = iter(holm(known))
    for pair, p in zip(found, chances, strict=True):
        if p is not None:
            pair[0] = pair[0]._replace(p=p, p_holm=next(adjusted))
    return [result for pair in found for result in pair]


def signed_rank_p(differences: np.ndarray) -> float:
    """Two-sided p of Wilcoxon's signed-rank test: exact without ties and zeros, zeros left out."""
    rest = differences[differences != 0.0]
    return float(stats.wilcoxon(rest).pvalue) if len(rest) else 1.0


def holm(chances: Sequence[float]) -> list[float]:
    """p-values adjusted for being several (Holm's step-down)."""
    order = np.argsort(chances, kind="stable")
    adjusted, largest = [1.0] * len(chances), 0.0
    for rank, i in enumerate(order):
        largest = max(largest, min(1.0, (len(chances) - rank) * chances[i]))
        adjusted[i] = largest
    return adjusted


def least_p_holm(pairs: Sequence[Result]) -> float:
    """The smallest p after Holm's correction that so few people allow in these pairs of one family, whatever they do.

    Wilcoxon's smallest p of n people is that of all n differing the same way, 2 / 2^n.
    """
    return min(1.0, len(pairs) * min((2.0 * 0.5**pair.people for pair in pairs), default=1.0))


def rank_biserial(differences: np.ndarray) -> float:
    """Matched pairs: (sum of ranks over 0 minus sum of those under it) / sum of all; 0 if all are 0. In [-1, 1]."""
    return float(_rank_biserials(np.atleast_2d(differences))[0])


def _rank_biserials(samples: np.ndarray) -> np.ndarray:
    """The same for each row (m, n)."""
    ranks = stats.rankdata(np.abs(samples), axis=1) - np.count_nonzero(samples == 0.0, axis=1, keepdims=True)
    ranks[samples == 0.0] = 0.0
    total = ranks.sum(axis=1)
    return np.divide((np.sign(samples) * ranks).sum(axis=1), total, out=np.zeros(len(samples)), where=total > 0.0)


def rank_biserial_interval(differences: np.ndarray) -> tuple[float, float]:
    """Percentile bootstrap over participants, seeded. All the same way gives +-1 to +-1."""
    drawn = resampled(len(differences))
    return quantiles(_rank_biserials(differences[drawn]))


def resampled(people: int) -> np.ndarray:
    """Participants drawn with replacement, (RESAMPLES, people); the same for every measure."""
    return np.random.default_rng(SEED).integers(0, people, (RESAMPLES, people))


def quantiles(values: np.ndarray) -> tuple[float, float]:
    """The middle 95 % of bootstrapped values."""
    low, high = np.quantile(values, (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)))
    return float(low), float(high)


def trend(rows: Sequence[TrialRow], measure: str) -> list[Result]:
    """Learning or fatigue: each participant's change over ten trials, in % of their mean; its median over people.

    The slope over the number of the trial within each task (configuration, controller, segment): what differs
    between tasks, and between the configuration that came first and the other, cannot pass for a trend.
    """
    slopes = []
    for person in people_of(rows):
        of_person = [row for row in rows if row.participant == person]
        run, value = within_tasks(of_person, [(row.run, getattr(row, measure)) for row in of_person])
        values = [v for row in of_person if (v := getattr(row, measure)) is not None]
        mean = np.mean(values or [0.0])
        if np.any(run) and mean:
            slopes.append(100.0 * TREND_TRIALS * float(run @ value / (run @ run)) / mean)
    if not slopes:
        return []
    found = median_interval(slopes)
    enough = found.people >= LEAST_PEOPLE
    interval, p = (found[2:], signed_rank_p(np.array(slopes))) if enough else ((None, None), None)
    about = ("trend", measure, "all", "", "", found.people, "percent_in_10_trials")
    return [Result(*about, found.middle, *interval, p=p)]


def within_tasks(rows: Sequence[TrialRow], values: Sequence[tuple]) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of values less their mean in the task (participant, configuration, controller, segment); no empty ones."""
    tasks: dict[tuple, list[tuple]] = {}
    for row, pair in zip(rows, values, strict=True):
        if None not in pair:
            task = (row.participant, row.configuration, row.controller, row.segment)
            tasks.setdefault(task, []).append(pair)
    centred = [np.array(pairs, dtype=float) - np.mean(pairs, axis=0) for pairs in tasks.values()]
    both = np.concatenate(centred) if centred else np.empty((0, 2))
    return both[:, 0], both[:, 1]


def log_speed(row: TrialRow) -> float | None:
    """Doublings of mean speed along the path, from an arbitrary zero for each segment; None unless it was finished."""
    return -math.log2(row.duration_s) if row.status == "done" and row.duration_s else None


def error_and_speed(rows: Sequence[TrialRow]) -> list[Result]:
    """Path error against speed, trial by trial within a task, and each controller's error at the common speed.

    The slope is that of the same person in the same task, one for all; interval by bootstrap over participants.
    Adjusted: as if each participant had moved with every controller at the mean of their speeds.
    """
    people, products, squares, errors = [], [], [], []
    for person in people_of(rows):
        of_person = [row for row in rows if row.participant == person]
        speed, error = within_tasks(of_person, [(log_speed(row), row.path_error_m) for row in of_person])
        if np.any(speed):
            people.append(person)
            products.append(float(speed @ error))
            squares.append(float(speed @ speed))
            errors.append(float(error @ error))
    if not people:
        return []
    slope = sum(products) / sum(squares)
    spread = math.sqrt(sum(squares) * sum(errors))
    low = high = None
    if len(people) >= LEAST_PEOPLE:
        drawn = resampled(len(people))
        low, high = quantiles(np.array(products)[drawn].sum(axis=1) / np.array(squares)[drawn].sum(axis=1))
    about = ("speed", "path_error_m", "all", "", "", len(people))
    results = [
        Result(*about, "m_per_doubling", slope, low, high),
        Result(*about, "correlation", sum(products) / spread if spread else None),
    ]
    for configuration in configurations_of(rows):
        results += _adjusted(rows, configuration, slope)
    return results


def _adjusted(rows: Sequence[TrialRow], configuration: str, slope: float) -> list[Result]:
    cells: dict[tuple[int, str], list[tuple[float, float]]] = {}
    for row in rows:
        speed = log_speed(row)
        if row.configuration == configuration and speed is not None and row.path_error_m is not None:
            cells.setdefault((row.controller, row.participant), []).append((speed, row.path_error_m))
    own = {cell: np.mean(trials, axis=0) for cell, trials in cells.items()}
    usual = {p: np.mean([mean[0] for (_, q), mean in own.items() if q == p]) for _, p in own}
    results = []
    for controller in sorted({controller for controller, _ in own}):
        of_it = {person: mean for (k, person), mean in own.items() if k == controller}
        faster = float(np.mean([mean[0] - usual[person] for person, mean in of_it.items()]))
        error = float(np.mean([mean[1] for mean in of_it.values()]))
        about = ("speed", "path_error_m", configuration, f"{controller}", "", len(of_it))
        results += [
            Result(*about, "doublings_above_own_mean", faster),
            Result(*about, "mean_error", error),
            Result(*about, "error_at_common_speed", error - slope * faster),
        ]
    return results
