"""Tidy CSV: a file a recording, a row a tick; trials.csv, a row a trial; and what every column means.

OUT/README.md
    trials.csv                  as in the data folder; `recording` names the CSV file
    questionnaire.csv           a row for each block that was asked about, if any was
    notes.csv                   what the experimenter wrote down, if anything
    columns.json                file -> column -> unit and description
    sub-01/ses-01/run-001.csv   every tick
                  run-001.json  what is known of the trial: its path, rules, gain, how it ended
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa

from experiments.analysis.trials_table import DICTIONARY, STATUSES, Column, TrialRow, write_table
from experiments.export.answers import answers_and_notes, write_answers_and_notes
from experiments.export.columns import DECISION_READING, PHASE_LEVELS, recording_column
from experiments.export.files import Exported, ExportedTrial, write_columns, write_json
from experiments.recording.schema import TEXT_COLUMNS

_LEVELS = {"phase": PHASE_LEVELS, "status": STATUSES}

_README = """\
# {name}, as CSV

Trials on a planar five-bar whose joints carry brakes: a hand moves the handle along a path.

- `trials.csv`: one row a trial, in the order in which the sessions ran them. `recording` is the file of its ticks.
- `sub-*/ses-*/run-*.csv`: every tick, 1000 a second; beside each a `.json` with what is known of the trial.
- `questionnaire.csv`, `notes.csv`, where there are any: the answers after each block; what the experimenter wrote.
- `columns.json`: unit and meaning of every column. J stands for a joint: A and B at the bases, E and C the elbows.

UTF-8, comma, line feed, one header line; SI units; numbers in the shortest form that reads back to the same double;
an empty cell: nothing was measured, or the number was not finite. Frame: x to the participant's right, y away from
the participant. `assumed` in a `.json`: numbers of the device or the brakes are assumed, not measured.
"""


class CsvTables:
    """A CSV export in a folder that exists and is empty."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._rows: list[TrialRow] = []
        self._columns: dict[str, Column] = {}

    def add(self, trial: ExportedTrial) -> None:
        """Write one recording and what is known of it."""
        place = PurePosixPath(trial.subject, trial.session, f"run-{trial.row.run:03d}.csv")
        path = self.folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        recording = trial.recording
        unit = recording.metadata.get("command_unit", "A")
        self._columns |= {name: recording_column(name, unit) for name in trial.names}
        columns = {
            name: pa.array(recording.text(name), pa.string()) if name in TEXT_COLUMNS else recording.column(name)
            for name in trial.names
        }
        write_columns(path, columns, ",", header=True, missing="")
        about = {"trial": trial.about, "outcome": trial.outcome, "begun": trial.begun, "phd": trial.software}
        write_json(path.with_suffix(".json"), about)
        self._rows.append(replace(trial.row, recording=str(place)))

    def finish(self, exported: Exported) -> None:
        """Write the table, the dictionary and the README."""
        order = sorted((*self._rows, *exported.unrecorded), key=lambda row: (row.participant, row.run))
        write_table(self.folder / "trials.csv", order)
        tables: dict[str, Mapping[str, Column]] = {"trials.csv": DICTIONARY, "sub-*/ses-*/run-*.csv": self._columns}
        tables |= write_answers_and_notes(self.folder, *answers_and_notes(exported.sessions))
        write_json(self.folder / "columns.json", {name: _described(columns) for name, columns in tables.items()})
        (self.folder / "README.md").write_bytes(exported.readme(_README))


def _described(columns: Mapping[str, Column]) -> dict[str, dict]:
    entries: dict[str, dict[str, Any]] = {}
    for name, (meaning, unit) in columns.items():
        more = f" ({DECISION_READING})" if name == "decision" else ""
        entries[name] = {"unit": unit, "description": meaning + more}
        entries[name] |= {"levels": _LEVELS[name]} if name in _LEVELS else {}
    return entries
