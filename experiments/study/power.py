"""`phd power`: how many people an experiment needs, from simulated people."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
import pandas as pd

from core.control.controllers import Preset
from core.files import InputError
from experiments.analysis.metrics import BY_NAME, Metric
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.sheet import PAGE_IN, STYLE, figure_bytes, plain, sheet, title
from experiments.analysis.statistics import LEAST_PEOPLE, ByController, by_configuration
from experiments.analysis.trials_table import TrialRow, Trials, as_table, frame_bytes, to_compare
from experiments.atomic_files import make_empty_folder, write_new_files
from experiments.numbers import percent, significant
from experiments.progress import Progress, no_progress
from experiments.protocol import Protocol
from experiments.study.helpers import cores, process_pool
from experiments.study.people_needed import (
    FULL,
    MOST_PEOPLE,
    Draws,
    Needed,
    people_needed,
    scores_of,
    share_found,
)
from experiments.study.unrecorded import operator_trials, with_low_gain_found
from experiments.trial.population import Population
from experiments.trial.real_trial import load_kernels

SEED = 1
CURVE = (6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 70, 100, 140, 200)  # people, of the figure
SIMULATED = "people are simulated, and most of their numbers assumed"
COLUMNS = ("from", "configuration", "first", "second", "measure", "unit", "power", "people", "low", "high", "shift")


class Question(NamedTuple):
    """What the experiment is to find."""

    first: Preset
    second: Preset
    measure: Metric
    power: float
    draws: Draws = FULL


class Answer(NamedTuple):
    """How many people find it, of one kind and in one configuration."""

    source: str  # a population
    configuration: str
    needed: Needed
    shift: float  # median over people of first minus second, in the measure's unit
    curve: tuple[float, ...]  # power at the numbers of `CURVE`

    @property
    def words(self) -> str:
        low, high = self.needed.low, self.needed.high
        between = f"{_people(low)} to {_people(high)}" if low != high else _people(low)
        return f"{_people(self.needed.people)} people (95 %: {between})"


def _people(count: int | None) -> str:
    return f"more than {MOST_PEOPLE}" if count is None else str(count)


def question_of(protocol: Protocol, between: Sequence[str], measure: str, power: float) -> Question:
    """The question in the words of the protocol: controllers by name or number. InputError for unknown ones."""
    first, second = (protocol.controllers[protocol.number_of(name)] for name in between)
    if first == second:
        raise InputError(f"--between: {between[0]!r} and {between[1]!r} are the same controller")
    return Question(first, second, measure_of(measure, protocol), power)


def measure_of(name: str, protocol: Protocol) -> Metric:
    """InputError unless it is a measure of trials.csv."""
    known = BY_NAME | {metric.name: metric for metric in own_metrics(protocol)}
    if name not in known:
        raise InputError(f"--measure: there is no {name!r}; there are {', '.join(known)}")
    return known[name]


def simulated_trials(
    protocol: Protocol, population: Population, people: int, measure: Metric, progress: Progress = no_progress
) -> Trials:
    """The trials of so many simulated people, on all cores, without recordings; of the measures this one alone."""
    load_kernels()
    protocol = with_low_gain_found(protocol, population)
    found: list[TrialRow] = []
    with process_pool(min(cores(), people)) as pool:
        calls = [pool.submit(_trials_of, protocol, population, person, measure) for person in range(1, people + 1)]
        for done, call in enumerate(calls, start=1):
            found += call.result()
            progress(done / people)
    return as_table(found)


def _trials_of(protocol: Protocol, population: Population, person: int, measure: Metric) -> list[TrialRow]:
    return [row for row, _ in operator_trials(protocol, population, person, (measure,))]


def answers(trials: Trials, source: str, protocol: Protocol, question: Question) -> list[Answer]:
    """The answer for each configuration, and for all pooled where there are several. InputError: too few people."""
    found = []
    for configuration, table in by_configuration(to_compare(trials), question.measure.name):
        people, pair, shift = _people_of(table, protocol, question, f"{source}, {configuration}")
        curve = tuple(share_found(people, pair, n, question.draws.curve_studies, SEED) for n in CURVE)
        needed = people_needed(people, pair, question.power, SEED, question.draws)
        found.append(Answer(source, configuration, needed, shift, curve))
    return found


def _people_of(
    table: ByController, protocol: Protocol, question: Question, where: str
) -> tuple[np.ndarray, tuple[int, int], float]:
    """The scores of the people, the places of the two controllers in them, and the median of their differences."""
    numbers = {preset: number for number, preset in protocol.controllers.items()}
    controllers = list(table)
    wanted = [numbers[preset] for preset in (question.first, question.second)]
    scores = scores_of(table, controllers) if controllers else np.empty((0, 0))
    missing = [number for number in wanted if number not in controllers]
    if missing:
        raise InputError(f"{where}: nobody finished a trial with controller {missing[0]}")
    a, b = (controllers.index(number) for number in wanted)
    differences = scores[:, a] - scores[:, b]
    differences = differences[np.isfinite(differences)]
    if len(differences) < LEAST_PEOPLE:
        few = f"only {len(differences)} finished trials with both"
        raise InputError(f"{where}: {few}, at least {LEAST_PEOPLE} people must")
    return scores, (a, b), float(np.median(differences))


def write_power(found: Sequence[Answer], question: Question, protocol: Protocol, out: Path) -> dict:
    """Write power.csv and power.png into a folder; the summary."""
    first, second = (" ".join(preset.name.split()) for preset in (question.first, question.second))
    about = f'"{first}" against "{second}", {question.measure.short}, protocol {protocol.name}'
    what = (first, second, question.measure.name, question.measure.unit, question.power)
    lines = [(each.source, each.configuration, *what, *map(_cell, each.needed), each.shift) for each in found]
    table = pd.DataFrame(lines, columns=COLUMNS)
    measure = question.measure
    picture = power_figure(found, question, f"{about}. {SIMULATED[0].upper()}{SIMULATED[1:]}.")
    write_new_files({out / "power.csv": frame_bytes(table), out / "power.png": picture})
    return {
        "out": str(out),
        "question": f"{about}, found with a power of {percent(question.power)}",
        "answers": [
            {
                "from": f"{each.source}, {each.configuration}",
                "people": each.words,
                "median_difference": (
                    f"median difference {significant(each.shift * measure.scale)} {measure.shown_unit}"
                ),
            }
            for each in found
        ],
        "warnings": [SIMULATED],
    }


def _cell(count: int | None) -> str:
    return f">{MOST_PEOPLE}" if count is None else str(count)


def power_figure(found: Sequence[Answer], question: Question, note: str) -> bytes:
    """PNG: the power against the number of people, a panel a configuration, a line a source."""
    configurations = list(dict.fromkeys(answer.configuration for answer in found))
    note += (
        " Test: signed-rank on each person's mean, Holm over all pairs of controllers, as phd analyze does. "
        "Bars: 95 % interval of the number that is needed."
    )
    with matplotlib.rc_context(STYLE):
        margins, height = (0.6, 0.15, 0.5, 0.35), 3.4
        figure, grid = sheet(note, (PAGE_IN, height), margins, (1, len(configurations)), (0.25, 0.0), sharey=True)
        for axes, configuration in zip(grid[0], configurations, strict=True):
            here = [answer for answer in found if answer.configuration == configuration]
            for place, answer in enumerate(here):
                (line,) = axes.plot(CURVE, answer.curve, "o-", markersize=2.5, linewidth=1.2, label=answer.source)
                low, high = (MOST_PEOPLE if end is None else end for end in answer.needed[1:])
                height = question.power + 0.02 * (place - 0.5 * (len(here) - 1))
                axes.plot((low, high), (height, height), color=line.get_color(), linewidth=3.0, alpha=0.5)
            axes.axhline(question.power, color="black", linewidth=0.6, linestyle=":")
            axes.set(xscale="log", xlim=(CURVE[0], MOST_PEOPLE), ylim=(0.0, 1.02), xlabel="People")
            axes.set_xticks((6, 10, 20, 50, 100, 200), ("6", "10", "20", "50", "100", "200"))
            axes.minorticks_off()
            plain(axes)
            title(axes, configuration)
        grid[0, 0].set_ylabel("Power")
        grid[0, -1].legend(frameon=False, loc="lower right")
        return figure_bytes(figure, "png")


def power(
    protocol: Protocol,
    question: Question,
    populations: Mapping[str, Population],
    people: int,
    out: Path,
    progress: Progress = no_progress,
) -> dict:
    """How many people find the difference, of each population by its name; the summary. people: simulated of each."""
    make_empty_folder(out, "results are never overwritten")
    try:
        found: list[Answer] = []
        for done, (name, population) in enumerate(populations.items()):

            def share_done(share: float, done: int = done) -> None:
                progress((done + share) / len(populations))

            trials = simulated_trials(protocol, population, people, question.measure, share_done)
            found += answers(trials, name, protocol, question)
        return write_power(found, question, protocol, out)
    except BaseException:
        out.rmdir()
        raise
