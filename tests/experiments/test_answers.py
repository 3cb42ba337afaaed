"""Answers and notes leave the journal: as CSV, as a BIDS phenotype, with the results; without any, no file."""

import json
import shutil

import pytest
from exports import rows, table, validate
from sessions import closed_session, new_session

from app.window.participant.questionnaire import ITEMS
from experiments.export.export import export
from experiments.export.files import (
    NOTES_CSV,
    QUESTIONNAIRE_CSV,
    answers_and_notes,
    write_answers_and_notes,
    write_phenotype,
)
from experiments.store.database import Database
from experiments.store.journal import ANSWERS, CONTROLLER_ANSWERS, JournalWriter
from experiments.store.journal import NOTE as NOTED

SCALES = [item for item, *_ in ITEMS]
FIRST, SECOND = (dict(zip(SCALES, (5.0 * (n + i) for i in range(7)), strict=True)) for n in (1, 4))
NOTE = 'said: "too hard", asked for a pause,\nthen went on'


@pytest.fixture(scope="module")
def silent(tmp_path_factory):
    """A session in which nobody said anything."""
    data = tmp_path_factory.mktemp("silent") / "study"
    closed_session(data, 2)
    return data


@pytest.fixture
def study(silent, tmp_path):
    """The same with answers after two blocks and a note; another participant has only written a note."""
    data = shutil.copytree(silent, tmp_path / "study")
    with Database(data / "sub-01" / "ses-01") as database:
        journal = JournalWriter(database)
        journal.write(NOTED, text=NOTE)
        for block, values in ((1, FIRST), (2, SECOND)):
            journal.write(ANSWERS, configuration="three-brake", block=block, values=values)
    other = new_session(data, "02")
    other.note("did not come")
    other.close()
    return data


def test_answers_and_notes_are_tables_of_their_own_and_described(study, tmp_path):
    export(study, {"csv": tmp_path / "csv"})
    answers, notes = rows(tmp_path / "csv" / QUESTIONNAIRE_CSV), rows(tmp_path / "csv" / NOTES_CSV)
    assert [(a["participant"], a["configuration"], a["block"]) for a in answers] == [
        ("01", "three-brake", "1"), ("01", "three-brake", "2"),
    ]  # fmt: skip
    assert [{scale: float(a[scale]) for scale in SCALES} for a in answers] == [FIRST, SECOND]
    assert [(note["participant"], note["text"]) for note in notes] == [("01", NOTE), ("02", "did not come")]
    assert all(note["time"].endswith("+00:00") for note in notes)
    described = json.loads((tmp_path / "csv" / "columns.json").read_text())
    for name, lines in ((QUESTIONNAIRE_CSV, answers), (NOTES_CSV, notes)):
        assert set(described[name]) == set(lines[0]) and all(entry["description"] for entry in described[name].values())
    for item, low, high in ITEMS:
        meaning = described[QUESTIONNAIRE_CSV][item]["description"]
        assert low.split("_")[0] in meaning and high.split("_")[-1] in meaning


def test_answers_are_a_phenotype_that_the_official_validator_accepts(study, tmp_path):
    out = tmp_path / "bids"
    export(study, {"bids": out})
    [tsv] = out.glob("phenotype/*.tsv")
    names, row = table(tsv)
    assert names[0] == "participant_id" and row[0] == "sub-01" and len(names) == 1 + 2 * len(SCALES)
    assert [float(cell) for cell in row[1:]] == [*FIRST.values(), *SECOND.values()]
    described = json.loads(tsv.with_suffix(".json").read_text())
    assert set(described) == {"MeasurementToolMetadata", *names[1:]}
    found = validate(out)
    assert not [issue for issue in found if issue[0] == "error"], found
    assert not [issue for issue in found if "PHENOTYPE" in issue[1] or "TSV" in issue[1]], found


def test_answers_after_a_controller_belong_to_it_in_every_export(tmp_path):
    session = new_session(tmp_path, "07")
    session.journal(CONTROLLER_ANSWERS, configuration="four-brake", controller=3, values=FIRST)
    session.close()
    home = session.folder
    answers, notes = answers_and_notes([home])
    assert answers[0][:5] == ("07", "four-brake", 0, 3, FIRST)
    described = write_answers_and_notes(tmp_path, answers, notes)[QUESTIONNAIRE_CSV]
    [row] = rows(tmp_path / QUESTIONNAIRE_CSV)
    assert (row["controller"], row["block"]) == ("3", "") and described.keys() == row.keys()
    write_phenotype(tmp_path, answers)
    head = (tmp_path / "phenotype" / "tlxsmoothness.tsv").read_text().splitlines()[0]
    assert f"four-brake_controller-3_{next(iter(FIRST))}" in head.split("\t")
