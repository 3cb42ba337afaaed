"""What an export holds: each trial as it may be shown, and how its columns are written as text."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow.csv import WriteOptions, write_csv

from experiments.analysis.trials_table import TrialRow
from experiments.export.columns import NOTES, QUESTIONNAIRE, SCALES, Column
from experiments.recording.schema import Recording
from experiments.session.journal import ANSWERS, NOTE, read_events

#: Columns that say what the brakes did, and with it which controller it was.
_TELLTALE = ("current_", "torque_", "stuck", "decision", "energy_brakes")


class ExportedTrial(NamedTuple):
    """One whole recording and what may be told of it."""

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
    """What stands once in an export."""

    name: str  # of the data folder
    left_out: tuple[str, ...]  # recordings, and why
    blind: tuple[str, ...]  # sessions not opened yet
    unrecorded: tuple[TrialRow, ...]  # rows of trials that left no recording
    sessions: tuple[Path, ...]  # their folders

    def remarks(self) -> str:
        """What a reader has to know of what is missing, as lines of Markdown; empty if nothing is."""
        lines = []
        if self.blind:
            lines += [
                "",
                f"Blind: {', '.join(self.blind)}. Controllers stand there by a code, and what the brakes did is not",
                "here (currents, torques, decisions). Export again once the sessions have been opened.",
            ]
        if self.left_out:
            lines += ["", "Left out:", "", *(f"- {entry}" for entry in self.left_out)]
        return "\n".join(lines)


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
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter, lineterminator="\n").writerows(lines)
    path.write_text(text.getvalue(), encoding="utf-8")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write one JSON object, in the order given."""
    path.write_text(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")


QUESTIONNAIRE_CSV, NOTES_CSV = "questionnaire.csv", "notes.csv"
PHENOTYPE, TOOL = "phenotype", "tlxsmoothness"
MISSING = "n/a"

_TOOL = {
    "Description": "after a block: the six scales of the raw NASA-TLX in words of our own, and one on the smoothness "
    "of the movement; 0 to 100 in steps of 5, nothing set beforehand",
    "TermURL": "https://doi.org/10.1016/S0166-4115(08)62386-9",
}


class Answers(NamedTuple):
    """A participant's answers after one block."""

    participant: str
    configuration: str
    block: int
    values: dict[str, float]  # scale -> 0 to 100
    time: str  # ISO, UTC

    @property
    def subject(self) -> str:
        """As BIDS calls the participant."""
        return f"sub-{self.participant}"


class Note(NamedTuple):
    """What the experimenter wrote down."""

    time: str  # ISO, UTC
    participant: str
    text: str


class AnswersAndNotes(NamedTuple):
    """All of it, in the order of the sessions."""

    answers: tuple[Answers, ...] = ()
    notes: tuple[Note, ...] = ()


def answers_and_notes(sessions: Iterable[Path]) -> AnswersAndNotes:
    """What the journals of these session folders (.../sub-01/ses-01) hold, as far as they can be read."""
    answers: list[Answers] = []
    notes: list[Note] = []
    for folder in sessions:
        participant = folder.parent.name.removeprefix("sub-")
        for event, at, about in read_events(folder):
            if event is ANSWERS:
                answers.append(Answers(participant, about["configuration"], about["block"], about["values"], at))
            elif event is NOTE:
                notes.append(Note(at, participant, about["text"]))
    return AnswersAndNotes(tuple(answers), tuple(notes))


def write_answers_and_notes(folder: Path, found: AnswersAndNotes) -> dict[str, dict[str, Column]]:
    """questionnaire.csv and notes.csv into a folder; file -> its columns, of those written."""
    written = {}
    if found.answers:
        scales = scales_of(found.answers)
        names = ["participant", "configuration", "block", *scales, "time"]
        lines = [[a.participant, a.configuration, f"{a.block}", *_cells(a, scales, ""), a.time] for a in found.answers]
        write_rows(folder / QUESTIONNAIRE_CSV, [names, *lines], ",")
        written[QUESTIONNAIRE_CSV] = {name: questionnaire_column(name) for name in names}
    if found.notes:
        write_rows(folder / NOTES_CSV, [Note._fields, *found.notes], ",")
        written[NOTES_CSV] = {name: NOTES[name] for name in Note._fields}
    return written


def write_phenotype(folder: Path, answers: Sequence[Answers]) -> None:
    """The answers as BIDS has them: phenotype/NAME.tsv, a row a participant, and .json. Nothing without answers.

    A participant has one row there, so a column is a scale after one block: "three-brake_block-1_effort".
    """
    if not answers:
        return
    scales = scales_of(answers)
    columns = {
        f"{configuration}_block-{block}_{scale}": (configuration, block, scale)
        for configuration, block in dict.fromkeys((a.configuration, a.block) for a in answers)
        for scale in scales
    }
    people: dict[str, dict[tuple[str, int, str], float]] = {}
    for a in answers:
        row = people.setdefault(a.subject, {})
        row |= {(a.configuration, a.block, scale): value for scale, value in a.values.items()}
    lines = [
        [name, *(f"{row[key]}" if key in row else MISSING for key in columns.values())] for name, row in people.items()
    ]
    place = folder / PHENOTYPE
    place.mkdir()
    write_rows(place / f"{TOOL}.tsv", [["participant_id", *columns], *lines])
    described = {
        name: {"Description": f"{questionnaire_column(scale).description}; after block {block} on {configuration}"}
        for name, (configuration, block, scale) in columns.items()
    }
    write_json(place / f"{TOOL}.json", {"MeasurementToolMetadata": _TOOL, **described})


def scales_of(answers: Iterable[Answers]) -> list[str]:
    """Every scale that was answered: ours in their order, then any other."""
    there = dict.fromkeys(scale for a in answers for scale in a.values)
    return [*(scale for scale in SCALES if scale in there), *(scale for scale in there if scale not in SCALES)]


def questionnaire_column(name: str) -> Column:
    """What a column of questionnaire.csv means; a scale of another version is one that this one cannot describe."""
    return QUESTIONNAIRE.get(name) or Column("", f"answer on the scale {name}, 0 to 100")


def _cells(answers: Answers, scales: Sequence[str], missing: str) -> list[str]:
    return [f"{answers.values[scale]}" if scale in answers.values else missing for scale in scales]
