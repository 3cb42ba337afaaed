"""Blind sessions: nothing but the key tells a controller, and who opens it stands in the journal first."""

import contextlib
import json
import shutil
import sqlite3
from dataclasses import replace

import conclusions
import pytest
from protocols import PAPER, short
from sessions import crash_in_trial, files, new_session, of, run_trials

from app.cli import main
from core.control.controllers import ALGORITHMS
from core.files import InputError
from experiments.store.blind import new_key
from experiments.store.cells import cell
from experiments.store.database import DATABASE
from experiments.store.files import write_pooled_table
from experiments.store.journal import KEY_OPENED, UNBLINDED, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.stored import read_stored
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from tests.support.rows import read_rows

CODES = {"K1", "K2", "K3", "K4", "K5"}


@pytest.fixture(scope="module")
def coded(tmp_path_factory):
    """A blind session, six trials done of which one was skipped and one redone."""
    data = tmp_path_factory.mktemp("blind") / "data"
    session = new_session(data, protocol=short(), blind=True)
    run_trials(session, 3)
    session.skip("late")
    session.redo(2, "looked away")
    run_trials(session, 2)
    session.close()
    write_pooled_table(data)
    return data


@pytest.fixture
def data(coded, tmp_path):
    """A copy to open."""
    return shutil.copytree(coded, tmp_path / "data")


def key_of(data):
    return read_stored(of(data)).key


def test_a_key_is_drawn_anew_each_time_and_names_every_controller_once():
    keys = [tuple(new_key(PAPER.controllers).items()) for _ in range(40)]
    assert all(sorted(number for _, number in key) == [1, 2, 3, 4, 5] for key in keys)
    assert all({code for code, _ in key} == CODES for key in keys) and len(set(keys)) > 20


def test_nothing_but_the_key_tells_a_controller(data):
    key = key_of(data)
    assert set(key) == CODES and sorted(key.values()) == [1, 2, 3, 4, 5]
    assert {trial.controller for trial in read_stored(of(data)).plan} == CODES
    for row in read_rows(of(data) / "trials.csv"):
        assert (
            row.controller in CODES and row.value("switches_per_s") is None and row.value("unreachable_share") is None
        )
        if row.recording:
            about = read_recording(of(data) / row.recording).metadata
            assert about["controller"] == row.controller and "preset" not in about
            assert row.value("path_error_m") is not None
    for entry in read_events(of(data)):
        assert entry.about.get("controller", "K1") in CODES and "key" not in entry.about
    with contextlib.closing(sqlite3.connect(of(data) / DATABASE)) as db:
        texts = str([db.execute(f"SELECT * FROM {table}").fetchall() for table in ("about", "plan", "event", "result")])
    assert not any(f'"{code}": {number}' in texts for code, number in key.items())


def test_a_trial_runs_with_the_controller_that_its_code_stands_for(data):
    session, key = Session.resume(data, "01", sync=False), key_of(data)
    planned = session.next_planned()
    assert session.blind and session.preset(planned) == PAPER.controllers[key[planned.controller]]
    trial, writer = session.begin(planned)
    assert list(ALGORITHMS)[trial.controller.algorithm] == session.preset(planned).kind
    session.close()


def test_a_blind_session_is_whole_to_verify_and_goes_on_after_a_crash(data):
    assert verify(data)["faults"] == []
    session = Session.resume(data, "01", sync=False)
    crash_in_trial(session)
    session = Session.resume(data, "01", sync=False)
    assert session.blind and session.rows[-1].status == "recovered" and session.rows[-1].controller in CODES
    assert cell(session.next_planned()) == cell(session.rows[-1])
    session.close()


def test_unblinded_every_table_names_the_controllers_and_has_all_measures(data, tmp_path):
    coded_rows, key = read_rows(of(data) / "trials.csv"), key_of(data)
    session = Session.resume(data, "01", sync=False)
    with pytest.raises(InputError, match="who"):
        session.unblind(" ")
    assert session.blind and not any(entry.event is UNBLINDED for entry in read_events(session.folder))
    session.unblind("Dr Weiss")
    assert not session.blind and {trial.controller for trial in session.plan} == {1, 2, 3, 4, 5}
    for before, now in zip(coded_rows, session.rows, strict=True):
        assert now.controller == key[before.controller] and now.value("path_error_m") == before.value("path_error_m")
        assert now.controller_name == PAPER.controllers[now.controller].name
        assert (now.value("switches_per_s") is not None) == bool(now.recording)
        if now.recording and now.controller != 3:  # with a gap, a trial that stayed in it has none either
            assert (now.value("unreachable_share") is not None) == (now.controller != 1)
    opened = [entry.about for entry in read_events(session.folder) if entry.event is UNBLINDED]
    assert [(event["who"], event["key"]) for event in opened] == [("Dr Weiss", key)]
    run_trials(session, 1)  # and it goes on, in the open
    assert read_recording(session.folder / session.rows[-1].recording).metadata["preset"]["kind"]
    with pytest.raises(InputError, match="not blind"):
        session.unblind("somebody else")
    session.close()
    write_pooled_table(data)
    assert verify(data)["faults"] == []
    again = Session.resume(data, "01", sync=False)
    assert not again.blind and again.plan == session.plan and again.rows == session.rows
    again.close()
    analyze(data, tmp_path / "out")  # from the recordings: the same table
    by_analysis, table = read_rows(tmp_path / "out" / "trials.csv"), read_rows(data / "trials.csv")
    assert [replace(row, recording="") for row in by_analysis] == [replace(row, recording="") for row in table]


def test_analysis_stays_coded_names_no_controller_and_refuses_findings(data, tmp_path, capsys):
    before = files(data)
    with conclusions.drawn():
        assert main(["analyze", str(data), "--out", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["coded"] == 6 and files(data) == before
    table, again = read_rows(data / "trials.csv"), read_rows(tmp_path / "out" / "trials.csv")
    assert [replace(row, recording="") for row in again] == [replace(row, recording="") for row in table]
    report = (tmp_path / "out" / "report" / "report.md").read_text()
    assert "The controllers are coded" in report
    names = [preset.name for preset in PAPER.controllers.values() if preset.name != "No control"]
    assert not any(name in report for name in names)
    assert {path.name for path in (tmp_path / "out" / "report").iterdir()} == {
        "by_path.csv",
        "participant_means.csv",
        "report.md",
    }
    svg = (tmp_path / "out" / "figures" / "fig16_path_error.svg").read_text()
    assert svg and not any(f"<!-- {name}" in svg for name in names)
    assert ">K2<" in svg


def test_analysis_that_opens_the_key_says_who_did_it_and_leaves_the_tables_coded(data, tmp_path):
    tables = [(path, path.read_bytes()) for path in (data / "trials.csv", of(data) / "trials.csv")]
    key = key_of(data)
    assert main(["analyze", str(data), "--out", str(tmp_path / "out"), "--unblind"]) == 0
    coded_rows, rows = read_rows(data / "trials.csv"), read_rows(tmp_path / "out" / "trials.csv")
    assert [row.controller for row in rows] == [key[row.controller] for row in coded_rows]
    assert all(row.value("switches_per_s") is not None for row in rows if row.recording)
    opened = [entry.about for entry in read_events(of(data)) if entry.event is KEY_OPENED]
    assert len(opened) == 1 and opened[0]["who"] and opened[0]["analysis"] == str(tmp_path / "out")
    assert all(path.read_bytes() == content for path, content in tables)
    assert verify(data)["faults"] == []
    assert (tmp_path / "out" / "report" / "findings.csv").exists()
