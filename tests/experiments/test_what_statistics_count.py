"""Statistics say what they count: people and pairs that differ, why a p is missing, percent of no tiny mean."""

from dataclasses import replace

import pytest
from test_boxplots import study

from experiments.analysis.report_sentences import sentences
from experiments.analysis.statistics import pairs, statistics, trend
from experiments.analysis.trials_table import as_table


@pytest.mark.parametrize(
    ("differences", "differ", "missing"),
    [([0.0] * 5 + [1.0], 1, ""), ([0.0] * 8, 0, ""), ([1.0, 2.0, 0.0], 2, "3 of the 6 people")],
)
def test_a_difference_of_zero_beside_a_correlation_of_one_names_how_many_pairs_differ(differences, differ, missing):
    people = [f"{n}" for n in range(len(differences))]
    table = {1: dict(zip(people, differences, strict=True)), 2: dict.fromkeys(people, 0.0)}
    shift, correlation = pairs("path_error_m", "three-brake", table)
    assert shift.differ == correlation.differ == differ
    assert missing in shift.missing and bool(shift.missing) == (shift.p is None)
    if differ == 1:
        assert (shift.value, correlation.value) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("people", "words", "never"),
    [
        (4, ("4 of the 6 people", "not tested", "no trend can be told"), ("learning", "fatigue", "Friedman")),
        (7, ("Friedman", "learning or fatigue"), ("of the 6 people", "not tested")),
    ],
)
def test_four_people_show_no_learning_and_are_said_to_be_too_few_for_a_p(people, words, never):
    rows = [replace(row, run=run) for run, row in enumerate(study(people, controllers=(1, 2, 3)), start=1)]
    said = " ".join(sentences(statistics(as_table(rows))))
    assert all(word in said for word in words) and not any(word in said for word in never)
    assert all(bool(result.missing) == (people < 6) for result in trend(as_table(rows), "path_error_m"))
