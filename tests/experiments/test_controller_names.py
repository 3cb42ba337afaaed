"""Every table names its controllers as the protocol does; a blind session's by their codes; old folders gain names."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from exports import errors, rows
from protocols import protocol_of, short
from sessions import files, new_session, run_trials

from experiments.export.export import export
from experiments.store.files import write_pooled_table
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from tests.support.rows import read_rows

#: Two controllers that Table I has not, with numbers of their own.
OTHERS = """
[[controller]]
number = 3
name = "Free hand"
kind = "none"

[[controller]]
number = 8
name = "Rail, 2 mm"
kind = "proportional"
gain_N_s_m = 70.0
gap_m = 0.002
"""
NAMES = {3: "Free hand", 8: "Rail, 2 mm"}
WORDS = {3: "none", 8: "proportional, gap 2 mm, gain 70 N s/m"}


def others():
    """The paper's protocol with other controllers: eight trials."""
    text = short(blocks=2, paths=1).text
    return protocol_of(re.sub(r"\[\[controller\]\].*\n(.+\n)+", "", text) + OTHERS)


@pytest.fixture(scope="module")
def coded(tmp_path_factory) -> Path:
    """A blind session: two trials done, one skipped, one redone."""
    data = tmp_path_factory.mktemp("names") / "data"
    session = new_session(data, protocol=others(), blind=True)
    run_trials(session, 2)
    session.skip("late")
    session.redo(1, "looked away")
    session.close()
    write_pooled_table(data)
    return data


@pytest.fixture(scope="module")
def open_data(tmp_path_factory) -> Path:
    """Three trials and a skipped one of a session whose controllers nobody hides."""
    data = tmp_path_factory.mktemp("open") / "data"
    session = new_session(data, protocol=others())
    run_trials(session, 3)
    session.skip("late")
    session.close()
    write_pooled_table(data)
    return data


def test_every_row_of_every_table_has_the_name_that_the_protocol_gives(open_data, tmp_path):
    for table in open_data.rglob("trials.csv"):
        found = rows(table)
        assert {row["status"] for row in found} == {"done", "skipped"}
        assert [row["controller_name"] for row in found] == [NAMES[int(row["controller"])] for row in found]
        assert list(found[0])[-1] == "controller_name"
    analyze(open_data, tmp_path / "again")
    again = [replace(row, recording="") for row in read_rows(tmp_path / "again" / "trials.csv")]
    assert again == [replace(row, recording="") for row in read_rows(open_data / "trials.csv")]
    assert verify(open_data)["faults"] == []


def test_while_a_session_is_blind_no_file_but_key_and_protocol_has_a_name(coded, tmp_path):
    told = b"Free hand", b"Rail, 2 mm", b"gap 2 mm"
    for name, content in files(coded).items():
        if not name.endswith(("session.db", ".parquet")):
            assert not [word for word in told if word in content], name
    for table in coded.rglob("trials.csv"):
        assert all(row["controller_name"] == row["controller"] in ("K1", "K2") for row in rows(table))
    outs = {"bids": tmp_path / "bids", "csv": tmp_path / "csv"}
    export(coded, outs)
    for out in outs.values():
        for name, content in files(out).items():
            assert not [word for word in told if word in content], name
            tells = b"current_", b"torque", b'"seed"'
            assert not name.startswith("sub-01") or not [word for word in tells if word in content], name
    analyze(coded, tmp_path / "again")
    for name, content in files(tmp_path / "again").items():
        if not name.endswith((".png", ".pdf")):
            assert not [word for word in told if word in content], name
    levels = json.loads((outs["bids"] / "scans.json").read_text())["controller"]["Levels"]
    assert set(levels.values()) == {"coded, the session is blind"} and not errors(outs["bids"])


def test_the_data_dictionary_says_what_each_controller_of_the_protocol_is(open_data, tmp_path):
    outs = {"bids": tmp_path / "bids", "csv": tmp_path / "csv"}
    export(open_data, outs)
    wanted = {str(number): f"{NAMES[number]}: {WORDS[number]}" for number in NAMES}
    scans = json.loads((outs["bids"] / "scans.json").read_text())
    columns = json.loads((outs["csv"] / "columns.json").read_text())["trials.csv"]
    for numbers, by_name in (
        (scans["controller"]["Levels"], scans["controller_name"]["Levels"]),
        (columns["controller"]["levels"], columns["controller_name"]["levels"]),
    ):
        assert numbers == wanted and by_name == {NAMES[number]: WORDS[number] for number in NAMES}
    assert "in the protocol" in scans["controller"]["Description"] == columns["controller"]["description"]
    assert all(b"Table I" not in content for out in outs.values() for content in files(out).values())
    [table] = outs["bids"].rglob("*_scans.tsv")
    with table.open(newline="") as lines:
        scanned = list(csv.DictReader(lines, delimiter="\t"))
    assert [row["controller_name"] for row in scanned] == [NAMES[int(row["controller"])] for row in scanned]
    assert not errors(outs["bids"])
