"""What an export holds, each trial as it may be shown; what its columns mean; how they become text."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow.csv import WriteOptions, write_csv

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.analysis.trials_table import DICTIONARY, Column, TrialRow, csv_bytes
from experiments.recording.schema import Recording

#: What the ticks of a recording hold.
RECORDING = {
    one.name: Column(one.meaning, one.unit) for column in tick_log.COLUMNS for one in column.spread()
}  # fmt: skip
#: The scales of the questionnaire after a block, 0 to 100.
SCALES = {
    "mental_demand": Column("NASA-TLX mental demand, 0 very little to 100 very much"),
    "physical_demand": Column("NASA-TLX physical demand, 0 very little to 100 very much"),
    "temporal_demand": Column("NASA-TLX temporal demand, 0 not at all hurried to 100 very hurried"),
    "performance": Column("NASA-TLX performance, 0 followed the lines perfectly to 100 not at all"),
    "effort": Column("NASA-TLX effort, 0 very little to 100 very hard"),
    "frustration": Column("NASA-TLX frustration, 0 not at all to 100 very irritated or discouraged"),
    "smoothness": Column("how the movement felt, 0 smooth to 100 jerky"),
}
#: What questionnaire.csv holds besides the scales, one row for each block that was asked about.
QUESTIONNAIRE = {
    **{name: DICTIONARY[name] for name in ("participant", "configuration", "block", "controller")},
    "time": Column("when it was answered, UTC, ISO 8601"),
}
#: What notes.csv holds, one row a note.
NOTES = {
    "time": Column("when it was written, UTC, ISO 8601"),
    "participant": Column("in whose session"),
    "text": Column("what the experimenter wrote"),
}
PHASE_LEVELS = {
    "approach": "brakes off, the hand moves to the start",
    "hold": "the hand waits at the start, brakes off",
    "move": "the movement along the path: every measure is taken here",
    "end": "after the movement, brakes off",
}
#: How the words of the column `decision` are to be read.
DECISION_READING = (
    "off: brakes off outside the movement; none: controller 1; gap: inside the band without control; "
    "release / lock: no or full current on all brakes, and why; "
    "sdof J / prop J: the brake at joint J is used, by the SDOF or the proportional rule. All words: "
    + "; ".join(DECISIONS)
)
#: Columns of the ticks that show what the brakes did, and with it which controller it was.
_TELLTALE = ("current_", "torque_", "stuck", "decision", "energy_brakes")


def recording_column(name: str, command_unit: str = "A") -> Column:
    """What a column of a recording means. InputError if it is not described: another version wrote it.

    command_unit: of what was commanded to the brakes, where it was no current.
    """
    if name not in RECORDING:
        raise InputError(f"recording: column {name} is not described, it cannot be exported")
    column = RECORDING[name]
    if column.unit == "A" and command_unit != "A":
        meaning = column.meaning.replace("current", f"value ({command_unit})", 1)
        return column._replace(meaning=meaning, unit=command_unit)
    return column


def scale_column(name: str) -> Column:
    """What a scale of the questionnaire means; one of another version is only named."""
    return SCALES.get(name) or Column(f"answer on the scale {name}, 0 to 100")


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

    def readme(self, form: str) -> bytes:
        """README.md of this form ("bids", "csv"): with the name in it, and what is missing."""
        text = Path(__file__).with_name(f"readme_{form}.md").read_text(encoding="utf-8")
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
