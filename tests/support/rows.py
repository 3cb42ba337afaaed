"""Rows of trials.csv with measures of a test's own."""

from dataclasses import replace

from experiments.analysis.trials_table import TrialRow


def with_measures(row: TrialRow, **values: float | None) -> TrialRow:
    """A row with these measures in place of its own; None: without that one."""
    measures = {**row.measures, **values}
    return replace(row, measures={name: value for name, value in measures.items() if value is not None})
