"""What a data folder holds, at a glance; and the form that a participant fills in, from the session to its export."""

import json
import shutil
from pathlib import Path

import pytest
from exports import errors
from protocols import changed, protocol_of, short
from sessions import closed_session, move_to_the_end, new_session, run_trials

from core.files import InputError
from experiments.export.export import export
from experiments.store.overview import scan_folder
from experiments.store.session import Participant, Session
from experiments.store.stored import read_stored

FORM = '\n[form]\nhandedness = ["right", "left"]\nage = "number"\nfirst_time = ["yes", "no"]\nremarks = "text"\n'


def test_sessions_stand_with_how_far_they_are_and_the_newest_first(tmp_path: Path) -> None:
    for participant, trials in (("01", 20), ("02", 3)):
        session = new_session(tmp_path, participant, short())
        if participant == "02":
            session.skip("short of time")
            trials -= 1
        run_trials(session, trials)
        session.close()
    overview = scan_folder(tmp_path)
    newest, oldest = overview.sessions
    assert (newest.participant, newest.done, newest.planned, newest.complete) == ("02", 3, 20, False)
    assert (newest.lacking, oldest.lacking) == (1, 0), "a skipped trial is over without a result"
    assert (oldest.participant, oldest.done, oldest.complete, oldest.protocol) == ("01", 20, True, "paper")
    assert (overview.done, overview.planned, overview.operators, overview.problem) == (23, 40, 0, "")
    session = Session.resume(tmp_path, "02", sync=False)
    run_trials(session, 1)
    session.redo(2, "something disturbed the trial")
    session.close()
    assert scan_folder(tmp_path).sessions[0].done == 3, "a trial that comes again is not done"


def test_a_folder_without_sessions_and_a_session_that_is_damaged_are_named(tmp_path: Path) -> None:
    assert scan_folder(tmp_path / "none").sessions == () and not scan_folder(tmp_path / "none").problem
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("dear")
    assert "holds no session" in scan_folder(tmp_path / "letters").problem
    session = new_session(tmp_path / "data", "01", short(1))
    session.close()
    assert scan_folder(tmp_path / "data").sessions[0].done == 0
    shutil.copytree(session.folder, tmp_path / "data" / "sub-02" / "ses-01")
    (own, copy) = scan_folder(tmp_path / "data").sessions
    assert "is a copy" in copy.problem and copy.changed_s == own.changed_s, "as old as the session of which it is one"
    shutil.rmtree(tmp_path / "data" / "sub-02")
    (session.folder / "session.db").write_bytes(b"x" * 9000)
    (damaged,) = scan_folder(tmp_path / "data").sessions
    assert "session.db" in damaged.problem and not damaged.complete


def test_a_form_is_kept_with_the_session_and_exported_with_the_participants(tmp_path: Path) -> None:
    protocol = protocol_of(changed(short(1).text, devices='["four-brake"]') + FORM)
    answers = {"handedness": "left", "age": 27.0, "first_time": "yes", "remarks": "a, b"}
    session = Session(tmp_path / "data", Participant("01", form=answers), protocol, sync=False)
    session.close()
    assert read_stored(session.folder).about["form"] == answers
    closed_session(tmp_path / "data", 1, participant="02", protocol=protocol)
    session = Session.resume(tmp_path / "data", "01", sync=False)
    trial, writer = session.begin(session.next_planned())
    move_to_the_end(trial, writer)
    session.finish(trial, writer)
    session.close()
    export(tmp_path / "data", {"bids": tmp_path / "bids"})
    lines = [line.split("\t") for line in (tmp_path / "bids" / "participants.tsv").read_text().splitlines()]
    header = ["participant_id", "species", "age", "sex", "handedness", "first_time", "remarks", "hand"]
    assert lines[0] == header
    assert lines[1][:-1] == ["sub-01", "n/a", "27", "n/a", "left", "yes", "a, b"]
    assert lines[2][:-1] == ["sub-02", *["n/a"] * 6]
    about = json.loads((tmp_path / "bids" / "participants.json").read_text())
    assert list(about["handedness"]["Levels"]) == ["right", "left"] and "Levels" not in about["age"]
    assert not errors(tmp_path / "bids")


@pytest.mark.parametrize(
    ("form", "says"),
    [({"age": "old"}, "age must be a number"), ({"handedness": "both"}, "handedness must be one of right, left"),
     ({"weight": 70.0}, "does not ask for 'weight'"), ({"remarks": 1.0}, "remarks must be a text")],
)  # fmt: skip
def test_an_answer_that_the_protocol_does_not_ask_for_makes_no_session(tmp_path: Path, form: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Session(tmp_path, Participant("01", form=form), protocol_of(short(1).text + FORM), sync=False)
    assert not list(tmp_path.iterdir())
