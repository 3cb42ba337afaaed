"""Error against force: its numbers against pandas, what a figure of it says."""

import itertools
import math

import pytest
from test_boxplots import BOTH, LABELS, study, view_of

from experiments.analysis.error_against_force import joined, marks_of
from experiments.analysis.trials_table import as_table
from tests.support.rows import with_measures


def test_a_mark_holds_median_and_quartiles_of_each_controller_on_each_device():
    trials = as_table(study())
    marks = marks_of(trials, view_of(LABELS))
    assert [(mark.controller, mark.configuration) for mark in marks] == list(itertools.product(range(1, 6), BOTH))
    for mark in marks:
        cell = trials[(trials["controller"] == mark.controller) & (trials["configuration"] == mark.configuration)]
        for box, column, scale in ((mark.error, "path_error_m", 1e3), (mark.force, "mean_tip_force_N", 1.0)):
            expected = scale * cell[column].quantile([0.25, 0.5, 0.75])
            assert (box.q1, box.median, box.q3) == pytest.approx(tuple(expected))
        assert mark.smoothness == pytest.approx(cell["acceleration_dft_sum"].median())
        assert f"{mark.error.median:.3g}" in mark.text and mark.configuration in mark.text
    assert [(a.controller, b.controller) for a, b in joined(marks)] == [(k, k) for k in range(1, 6)]


def test_a_controller_without_an_error_above_zero_or_without_a_measure_has_no_mark_and_smoothness_may_be_missing():
    rows = study(1, controllers=(1, 2, 3))
    changed = {1: {"path_error_m": 0.0}, 2: {"mean_tip_force_N": None}, 3: {"acceleration_dft_sum": None}}
    marks = marks_of(as_table(with_measures(row, **changed[row.controller]) for row in rows), view_of(LABELS))
    assert {mark.controller for mark in marks} == {3} and all(math.isnan(mark.smoothness) for mark in marks)
