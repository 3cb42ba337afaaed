"""What an export holds, each trial as it may be shown, and how columns, tables and objects become text."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow.csv import WriteOptions, write_csv

from experiments.analysis.trials_table import TrialRow, csv_bytes
from experiments.recording.schema import Recording

#: Columns of the ticks that show what the brakes did, and with it which controller it was.
_TELLTALE = ("current_", "torque_", "stuck", "decision", "energy_brakes")


class ExportedTrial(NamedTuple):
    """One whole recording, and what may be shown of it."""

    subject: str  # "sub-01"
    session: str  # "ses-01"
    recording: Recording
    row: TrialRow
    about: dict[str, Any]  # of the recording's metadata; the controller as the table has it
    outcome: dict[str, Any]
    begun: str  # time of day, ISO; empty where it is not known
    software: str  # version of phd that recorded it
    blind: bool

    @property
    def names(self) -> list[str]:
        """The columns of the recording that may be shown."""
        return [name for name in self.recording.columns if not (self.blind and name.startswith(_TELLTALE))]


class Exported(NamedTuple):
    """What an export holds once."""

    name: str  # of the data folder
    left_out: list[str]  # recordings, and why
    blind: list[str]  # sessions not opened yet
    unrecorded: list[TrialRow]  # rows of trials that left no recording
    sessions: list[Path]  # their folders

    def readme(self, text: str) -> bytes:
        """README.md: `text` with the name in it, and what is missing."""
        lines = [text.format(name=self.name)]
        if self.blind:
            lines += [
                f"Blind: {', '.join(self.blind)}. Controllers stand there by a code, and what the brakes did is not",
                "here (currents, torques, decisions). Export again once the sessions have been opened.",
                "",
            ]
        if self.left_out:
            lines += ["Left out:", "", *(f"- {entry}" for entry in self.left_out)]
        return ("\n".join(lines).rstrip() + "\n").encode()


def write_columns(
    path: Path, columns: Mapping[str, np.ndarray | pa.Array], delimiter: str, header: bool, missing: str
) -> None:
    """Write columns as text, a line a row; numbers in the shortest form that reads back to the same double.

    missing: what stands for a number that is not finite.
    """
    arrays = [
        column if isinstance(column, pa.Array) else pa.array(column, mask=~np.isfinite(column))
        for column in columns.values()
    ]
    options = WriteOptions(
        include_header=header, delimiter=delimiter, quoting_style="needed", quoting_header="none", null_string=missing
    )
    with path.open("xb") as file:
        write_csv(pa.table(arrays, names=list(columns)), file, options)


def write_rows(path: Path, lines: Iterable[Sequence[str]], delimiter: str = "\t") -> None:
    """Write a small table of texts, the header first."""
    path.write_bytes(csv_bytes(lines, delimiter))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write one JSON object, in the order given."""
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")
