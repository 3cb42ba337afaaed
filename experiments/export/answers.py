"""Answers to the questionnaire and the experimenter's notes: from the journals into CSV, or a BIDS phenotype."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.analysis.charts import Answers
from experiments.analysis.trials_table import Column
from experiments.export.files import NOTES, QUESTIONNAIRE, SCALES, scale_column, write_json, write_rows
from experiments.session.journal import ANSWERS, CONTROLLER_ANSWERS, NOTE, read_events

QUESTIONNAIRE_CSV, NOTES_CSV = "questionnaire.csv", "notes.csv"
_TOOL = {
    "Description": "after a block or a controller: the six scales of the raw NASA-TLX in words of our own, and one on "
    "the smoothness of the movement; 0 to 100 in steps of 5, nothing set beforehand",
    "TermURL": "https://doi.org/10.1016/S0166-4115(08)62386-9",
}


class Note(NamedTuple):
    """What the experimenter wrote down."""

    time: str  # ISO, UTC
    participant: str
    text: str


def answers_and_notes(sessions: Iterable[Path]) -> tuple[list[Answers], list[Note]]:
    """The answers and notes in the journals of these session folders (.../sub-01/ses-01), in their order."""
    answers, notes = [], []
    for folder in sessions:
        participant = folder.parent.name.removeprefix("sub-")
        for event, at, about in read_events(folder):
            if event is ANSWERS:
                answers.append(Answers(participant, about["configuration"], about["block"], 0, about["values"], at))
            elif event is CONTROLLER_ANSWERS:
                whose = about["configuration"], 0, about["controller"]
                answers.append(Answers(participant, *whose, about["values"], at))
            elif event is NOTE:
                notes.append(Note(at, participant, about["text"]))
    return answers, notes


def write_answers_and_notes(
    folder: Path, answers: Sequence[Answers], notes: Sequence[Note]
) -> dict[str, dict[str, Column]]:
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


def write_phenotype(folder: Path, answers: Sequence[Answers]) -> None:
    """The answers as BIDS has them: phenotype/NAME.tsv, a row a participant, and .json. Nothing without answers.

    A participant has one row there, so a column is a scale after one block: "three-brake_block-1_effort", or after one
    controller: "three-brake_controller-3_effort".
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


def _scales(answers: Iterable[Answers]) -> list[str]:
    """Every scale that was answered: ours in their order, then any other."""
    there = dict.fromkeys(scale for a in answers for scale in a.values)
    return [*(scale for scale in SCALES if scale in there), *(scale for scale in there if scale not in SCALES)]
