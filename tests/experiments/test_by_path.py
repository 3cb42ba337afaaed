"""The table of results path by path, against pandas, and what a report makes of it."""

import pytest
from test_boxplots import BOTH, LABELS, study

from experiments.analysis.by_path import by_path, by_path_table
from experiments.analysis.trials_table import as_table


def test_a_row_is_the_median_and_the_quartiles_of_a_device_a_path_a_controller_and_a_measure():
    trials = as_table(study(controllers=(1, 4)))
    found = by_path(trials, LABELS)
    assert len(found) == len(BOTH) * 2 * 2 * 3, "devices, paths, controllers, measures that have a value"
    for row in found.itertuples():
        place = trials["configuration"].eq(row.configuration) & trials["path"].eq(row.path)
        values = trials[place & trials["controller"].eq(row.controller)][row.measure]
        assert (row.median, row.q1, row.q3) == pytest.approx(tuple(values.quantile([0.5, 0.25, 0.75])))
        assert row.trials == len(values) == 9
    assert set(found["controller_name"]) == {"No control", "Proportional, high gain"}
    table = by_path_table(found, ())
    assert "path error (mm)" in table and "Proportional, high gain" in table and table.count("\n") == 1 + 8
    assert by_path_table(by_path(trials[trials["path"] == 1], LABELS), ()) == ""


def test_codes_of_blind_sessions_are_not_pooled_over_their_participants():
    coded = as_table(study(2, controllers=(1,))).assign(controller="K1")
    assert set(by_path(coded, LABELS)["controller"]) == {"P01 K1", "P02 K1"}
