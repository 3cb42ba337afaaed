"""Rows of trials.csv with measures of a test's own, and tables as rows."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from experiments.analysis.trials_table import TrialRow, as_rows, as_table, read_table, write_table
from experiments.store.database import DATABASE, new_database
from experiments.store.files import add_row
from experiments.store.stored import put_about


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


def put_session(data: Path, participant: str, rows: Iterable[TrialRow]) -> Path:
    """A session of which nothing is known but these rows, in place of one that is there; its folder."""
    folder = data / f"sub-{participant}" / "ses-01"
    folder.mkdir(parents=True, exist_ok=True)
    with new_database(folder / DATABASE, sync=False) as database:
        put_about(database, {"participant": participant})
        for row in rows:
            add_row(database, row)
    return folder
