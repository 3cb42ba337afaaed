"""The contents of an export: trials, answers and notes, the meaning of its columns, and how they become text."""

import contextlib
import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow.csv import WriteOptions, write_csv

from core import tick_log
from core.control.controllers import DECISIONS, Preset
from core.files import InputError
from experiments.analysis.charts import AnswerSet
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.trials_table import DICTIONARY, DictionaryEntry, TrialRow, by_controller, csv_bytes
from experiments.recording import Recording
from experiments.store.journal import ANSWERS, CONTROLLER_ANSWERS, NOTE, read_events
from experiments.store.stored import read_stored

#: The columns of a recording.
RECORDING = {
    part.name: DictionaryEntry(part.meaning, part.unit) for column in tick_log.COLUMNS for part in column.spread()
}  # fmt: skip
#: The scales of the questionnaire after a block, 0 to 100.
SCALES = {
    "mental_demand": DictionaryEntry("NASA-TLX mental demand, 0 very little to 100 very much"),
    "physical_demand": DictionaryEntry("NASA-TLX physical demand, 0 very little to 100 very much"),
    "temporal_demand": DictionaryEntry("NASA-TLX temporal demand, 0 not at all hurried to 100 very hurried"),
    "performance": DictionaryEntry("NASA-TLX performance, 0 followed the lines perfectly to 100 not at all"),
    "effort": DictionaryEntry("NASA-TLX effort, 0 very little to 100 very hard"),
    "frustration": DictionaryEntry("NASA-TLX frustration, 0 not at all to 100 very irritated or discouraged"),
    "smoothness": DictionaryEntry("how the movement felt, 0 smooth to 100 jerky"),
}
#: The columns of questionnaire.csv besides the scales; a row for each block that was asked about.
QUESTIONNAIRE = {
    **{name: DICTIONARY[name] for name in ("participant", "configuration", "block", "controller")},
    "time": DictionaryEntry("when it was answered, UTC, ISO 8601"),
}
#: The columns of notes.csv; a row a note.
NOTES = {
    "time": DictionaryEntry("when it was written, UTC, ISO 8601"),
    "participant": DictionaryEntry("in whose session"),
    "text": DictionaryEntry("what the experimenter wrote"),
}
GZIP_LEVEL = 4  # a tenth larger than 9, in a quarter of the time
QUESTIONNAIRE_CSV, NOTES_CSV = "questionnaire.csv", "notes.csv"
_TOOL = {
    "Description": "after a block or a controller: the six scales of the raw NASA-TLX in words of our own, and one on "
    "the smoothness of the movement; 0 to 100 in steps of 5, nothing set beforehand",
    "TermURL": "https://doi.org/10.1016/S0166-4115(08)62386-9",
}
PHASE_LEVELS = {
    "approach": "brakes off, the hand moves to the start",
    "hold": "the hand waits at the start, brakes off",
    "move": "the movement along the path: every measure is taken here",
    "end": "after the movement, brakes off",
}
#: How the words of the column `decision` are to be read.
DECISION_READING = (
    "off: brakes off outside the movement; none: a controller without control; gap: inside the band without control; "
    "release / lock: no or full current on all brakes, and why; "
    "sdof J / prop J: the brake at joint J is used, by the SDOF or the proportional rule. All words: "
    + "; ".join(DECISIONS)
)
#: Columns of the ticks that show the brakes at work, and so which controller it was.
_TELLTALE = ("current_", "torque_", "stuck", "decision", "energy_brakes")


def recording_column(name: str, command_unit: str = "A") -> DictionaryEntry:
    """The meaning of a column of a recording. InputError: another version wrote it.

    command_unit: of the commands to the brakes, if they were no currents.
    """
    if name not in RECORDING:
        raise InputError(f"recording: column {name} is not described, it cannot be exported")
    column = RECORDING[name]
    if column.unit == "A" and command_unit != "A":
        meaning = column.meaning.replace("current", f"value ({command_unit})", 1)
        return column._replace(meaning=meaning, unit=command_unit)
    return column


def own_columns_described(sessions: Iterable[Path]) -> dict[str, DictionaryEntry]:
    """The measures of the files of one's own that the protocols of these sessions have."""
    found: dict[str, DictionaryEntry] = {}
    for folder in sessions:
        with contextlib.suppress(InputError):  # `phd verify` names what is wrong with it
            own = own_metrics(read_stored(folder).protocol)
            found |= {metric.name: DictionaryEntry(metric.meaning, metric.unit) for metric in own}
    return found


def controller_levels(rows: Iterable[TrialRow], sessions: Iterable[Path]) -> dict[str, dict[str, str]]:
    """The meaning of the cells of `controller` and `controller_name`: column -> cell -> words.

    From the protocols of the sessions (.../sub-01/ses-01), which may number different controllers alike; for a blind
    session only the code.
    """
    presets: dict[str, Mapping[int, Preset]] = {}
    for folder in sessions:
        with contextlib.suppress(InputError):  # `phd verify` names what is wrong with it
            presets[folder.parent.name.removeprefix("sub-")] = read_stored(folder).protocol.controllers
    found: dict[str, dict[str, dict[str, None]]] = {"controller": {}, "controller_name": {}}
    for row in sorted(rows, key=lambda row: by_controller(row.controller)):
        number, name = row.controller, row.controller_name
        preset = None if isinstance(number, str) else presets.get(row.participant, {}).get(number)
        words = preset.words if preset else "not known" if isinstance(number, int) else "coded, the session is blind"
        whole = f"{preset.name}: {words}" if preset else words
        found["controller"].setdefault(str(number), {})[whole] = None
        if name:
            found["controller_name"].setdefault(name, {})[words] = None
    return {column: {cell: " / ".join(each) for cell, each in cells.items()} for column, cells in found.items()}


def scale_column(name: str) -> DictionaryEntry:
    """The meaning of a scale of the questionnaire; one of another version is only named."""
    return SCALES.get(name) or DictionaryEntry(f"answer on the scale {name}, 0 to 100")


class ExportedTrial(NamedTuple):
    """One whole recording, with the metadata that may be shown."""

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
    """The description of an export as a whole."""

    name: str  # of the data folder
    left_out: list[str]  # recordings, and why
    blind: list[str]  # sessions not opened yet
    unrecorded: list[TrialRow]  # rows of trials that left no recording
    sessions: list[Path]  # their folders
    consent: list[bool]  # answers of the participants who were asked whether they take part

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
        if self.consent:
            answers = f"{self.consent.count(True)} agreed to take part, {self.consent.count(False)} declined"
            lines += [f"Consent was asked of each participant before anything else: {answers}.", ""]
        if self.left_out:
            lines += ["Left out:", "", *(f"- {entry}" for entry in self.left_out)]
        return ("\n".join(lines).rstrip() + "\n").encode()


def write_columns(
    path: Path, columns: Mapping[str, np.ndarray | pa.Array], delimiter: str, header: bool, missing: str
) -> None:
    """Write columns as text, a line a row; numbers in the shortest form that reads back to the same double.

    missing: what stands for a number that is not finite. A path that ends in .gz is compressed, always the same.
    """
    arrays = [
        column if isinstance(column, pa.Array) else pa.array(column, mask=~np.isfinite(column))
        for column in columns.values()
    ]
    options = WriteOptions(
        include_header=header, delimiter=delimiter, quoting_style="needed", quoting_header="none", null_string=missing
    )
    with path.open("xb") as plain, contextlib.ExitStack() as stack:
        file: Any = plain
        if path.suffix == ".gz":
            file = stack.enter_context(gzip.GzipFile("", "wb", GZIP_LEVEL, plain, mtime=0))
        write_csv(pa.table(arrays, names=list(columns)), file, options)


def write_rows(path: Path, lines: Iterable[Sequence[str]], delimiter: str = "\t") -> None:
    """Write a small table of texts, the header first."""
    path.write_bytes(csv_bytes(lines, delimiter))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")


class Note(NamedTuple):
    """A note of the experimenter."""

    time: str  # ISO, UTC
    participant: str
    text: str


def answers_and_notes(sessions: Iterable[Path]) -> tuple[list[AnswerSet], list[Note]]:
    """The answers and notes in the journals of these session folders (.../sub-01/ses-01), in their order."""
    answers, notes = [], []
    for folder in sessions:
        participant = folder.parent.name.removeprefix("sub-")
        for event, at, about in read_events(folder):
            if event is ANSWERS:
                answers.append(AnswerSet(participant, about["configuration"], about["block"], 0, about["values"], at))
            elif event is CONTROLLER_ANSWERS:
                cell = about["configuration"], 0, about["controller"]
                answers.append(AnswerSet(participant, *cell, about["values"], at))
            elif event is NOTE:
                notes.append(Note(at, participant, about["text"]))
    return answers, notes


def write_answers_and_notes(
    folder: Path, answers: Sequence[AnswerSet], notes: Sequence[Note]
) -> dict[str, dict[str, DictionaryEntry]]:
    """questionnaire.csv and notes.csv into a folder; file -> its columns, of those written."""
    written = {}
    if answers:
        scales = _scales(answers)
        part = ["block"] + ["controller"] * any(a.controller for a in answers)
        names = ["participant", "configuration", *part, *scales, "time"]
        lines = [
            [a.participant, a.configuration, *(str(getattr(a, name) or "") for name in part),
             *(str(a.values.get(scale, "")) for scale in scales), a.time]
            for a in answers
        ]  # fmt: skip
        write_rows(folder / QUESTIONNAIRE_CSV, [names, *lines], ",")
        written[QUESTIONNAIRE_CSV] = {name: QUESTIONNAIRE.get(name) or scale_column(name) for name in names}
    if notes:
        write_rows(folder / NOTES_CSV, [Note._fields, *notes], ",")
        written[NOTES_CSV] = {name: NOTES[name] for name in Note._fields}
    return written


def write_phenotype(folder: Path, answers: Sequence[AnswerSet]) -> None:
    """Write the answers as BIDS has them: phenotype/NAME.tsv, a row a participant, and .json; nothing without answers.

    A column is a scale after one block, "three-brake_block-1_effort", or one controller: "three-
    brake_controller-3_effort".
    """
    if not answers:
        return
    rows: dict[str, dict[str, str]] = {}
    about: dict[str, dict[str, str]] = {}
    scales = _scales(answers)
    for a in answers:
        kind, which = ("block", a.block) if a.block else ("controller", a.controller)
        place = f"{a.configuration}_{kind}-{which}_"
        rows.setdefault(f"sub-{a.participant}", {}).update({place + name: str(v) for name, v in a.values.items()})
        for scale in scales:
            meaning = f"{scale_column(scale).meaning}; after {kind} {which} on {a.configuration}"
            about[place + scale] = {"Description": meaning}
    lines = [[person, *(row.get(column, "n/a") for column in about)] for person, row in rows.items()]
    phenotype = folder / "phenotype"
    phenotype.mkdir()
    write_rows(phenotype / "tlxsmoothness.tsv", [["participant_id", *about], *lines])
    write_json(phenotype / "tlxsmoothness.json", {"MeasurementToolMetadata": _TOOL, **about})


def _scales(answers: Iterable[AnswerSet]) -> list[str]:
    """All scales that were answered: ours in their order, then others."""
    answered = dict.fromkeys(scale for a in answers for scale in a.values)
    return [*(scale for scale in SCALES if scale in answered), *(scale for scale in answered if scale not in SCALES)]
