"""Rows of trials.csv with measures of a test's own, and tables as rows."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from experiments.analysis.trials_table import TrialRow, as_rows, as_table, read_table, write_table


def with_measures(row: TrialRow, **values: float | None) -> TrialRow:
    """A row with these measures in place of its own; None: without that one."""
    measures = {**row.measures, **values}
    return replace(row, measures={name: value for name, value in measures.items() if value is not None})


def read_rows(path: Path) -> list[TrialRow]:
    """The rows of a table's file."""
    return as_rows(read_table(path))


def write_rows(path: Path, rows: Iterable[TrialRow], replacing: bool = False) -> None:
    """Rows as a table's file."""
    write_table(path, as_table(rows), replacing)
