"""After a crash a session and a study go on at the next trial, as they were begun, and lose nothing."""

import json
import shutil
from collections import Counter
from dataclasses import replace

import pytest
from protocols import PAPER, PEOPLE, short
from sessions import Killed, closed_session, crash_in_trial, files, new_session, of, run_trials, session_of

from app.cli import main
from core.files import InputError
from experiments.analysis.trials_table import COUNTED
from experiments.protocol import protocol_from_json, protocol_to_json
from experiments.store.cells import cell
from experiments.store.files import hold_lock
from experiments.store.session import Session
from experiments.store.stored import read_stored
from experiments.store.verify import verify
from experiments.study import study as studies
from experiments.study.study import resume_study, run_study
from experiments.study.unrecorded import study_trials
from tests.support.rows import read_rows


def kill_in_run(monkeypatch, run: int) -> None:
    """The study dies in the middle of this run of the first operator; the others wait for that in their second."""
    real = studies.StudyRun.run_ticks

    def run_ticks(self, trial, writer):
        first = writer.database.path.parts[-3] == "sub-01"
        if first and trial.planned.run == run:
            writer.write(self.rows[: trial.run(self.rows[:3000])])
            raise Killed
        if not first and trial.planned.run == 2:
            assert self.shared.stop.wait(120)
        real(self, trial, writer)

    monkeypatch.setattr(studies.StudyRun, "run_ticks", run_ticks)


def high():
    """10 trials an operator, the low gain of 500 N s/m."""
    return protocol_from_json({**protocol_to_json(short(paths=1, seed="5")), "overrides": {"low_gain": 500.0}}, "test")


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A study of three operators on two cores, killed in run 4 of the first: the third is not begun."""
    folder = tmp_path_factory.mktemp("killed") / "study"
    with pytest.MonkeyPatch.context() as patch, pytest.raises(Killed):
        kill_in_run(patch, 4)
        patch.setattr("experiments.study.helpers.cores", lambda: 2)
        run_study(folder, 3, high(), PEOPLE)
    return folder


@pytest.fixture
def interrupted(killed, tmp_path):
    """A copy to go on with."""
    return shutil.copytree(killed, tmp_path / "study")


def test_a_crashed_trial_is_kept_and_its_cell_is_run_again_under_the_next_free_number(tmp_path):
    with session_of(tmp_path, 2) as session:
        crash_in_trial(session)
        plan = session.plan
    session = Session.resume(tmp_path, "01", sync=False)
    assert session.plan == plan and [row.status for row in session.rows] == ["done", "done", "recovered"]
    again = session.next_planned()
    assert again.run == 61 and cell(again) == cell(plan[2])
    run_trials(session, 1)
    assert session.next_planned() == plan[3]  # then on in the order of the plan
    run_trials(session, 1)
    assert [row.run for row in read_rows(session.folder / "trials.csv")] == [1, 2, 3, 61, 4]
    session.close()
    assert verify(tmp_path)["faults"] == []
    second = Session.resume(tmp_path, "01", sync=False)
    assert second.next_planned() == plan[4] and second.finished_count == 4
    second.close()


def test_a_session_without_a_crash_goes_on_as_it_was_stored_whatever_the_protocols_file_says_today(tmp_path):
    session = closed_session(tmp_path, 2, protocol=short(rules='"literal"'))
    again = Session.resume(tmp_path, "01", sync=False)
    assert again.next_planned() == session.plan[2] and again.person == session.person
    assert again.rows == session.rows and again.plan == session.plan and len(again.plan) == 20
    assert again.protocol.text == session.protocol.text and again.protocol.rules == "literal"
    assert again.protocol.note() == session.protocol.note() and again.protocol.paths == PAPER.paths
    assert [device.text for device in again.protocol.devices] == [device.text for device in PAPER.devices]
    again.close()


def test_a_session_that_a_live_process_holds_is_not_resumed(tmp_path):
    session = new_session(tmp_path)
    with pytest.raises(InputError, match="is using this folder"):
        Session.resume(tmp_path, "01")
    session.close()
    Session.resume(tmp_path, "01").close()
    with pytest.raises(InputError, match="exists already"):
        new_session(tmp_path)


@pytest.mark.parametrize("blind", [False, True])
def test_a_session_that_was_hardly_created_is_created_anew(tmp_path, blind):
    of(tmp_path).mkdir(parents=True)
    (of(tmp_path) / "session.db").touch()
    session = new_session(tmp_path, protocol=short(), blind=blind)
    assert session.next_planned().run == 1 and not list(session.folder.glob(".*.partial"))
    assert session.preset(session.plan[0]) in PAPER.controllers.values()
    session.close()
    Session.resume(tmp_path, "01", sync=False).close()


def test_an_interrupted_study_goes_on_with_what_it_was_begun_with(interrupted, capsys):
    before = files(interrupted)
    rows_before = {name: read_rows(interrupted / name) for name in before if name.endswith("ses-01/trials.csv")}
    asked = ["--seed", "5", "--operators", "3", "--low-gain", "500", "--rules", "settled"]  # what it was begun with
    assert main(["study", "--resume", "--out", str(interrupted), *asked, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["trials"], said["recovered"], said["low_gain_N_s_m"]) == (31, 1, 500.0)
    rows = read_rows(interrupted / "trials.csv")
    for participant in ("01", "02", "03"):
        mine = [row for row in rows if row.participant == participant]
        plan = read_stored(interrupted / f"sub-{participant}" / "ses-01").plan
        planned = Counter((t.configuration, t.controller, t.path, t.block) for t in plan)
        counted = [row for row in mine if row.status in COUNTED]
        assert Counter((r.configuration, r.controller, r.path, r.block) for r in counted) == planned
    assert [(row.run, row.status) for row in rows if row.status not in COUNTED] == [(4, "recovered")]
    assert verify(interrupted)["faults"] == [] and (interrupted / "figures" / "boxplots.png").is_file()
    after = files(interrupted)
    for name, content in before.items():  # nothing that was there has changed
        if name.endswith((".db", ".db-wal", ".db-shm")):
            continue
        if name.endswith("ses-01/trials.csv"):  # it gains rows, and columns that only these fill
            assert read_rows(interrupted / name)[: len(rows_before[name])] == rows_before[name]
        else:
            assert after[name] == content

    assert resume_study(interrupted, {})["trials"] == 31 and files(interrupted) == after  # it is complete

    theirs = [row for row, _ in study_trials(high(), PEOPLE, 3)]  # the study without a crash
    rows = [replace(row, recording="") for row in rows]
    assert [r for r in rows if r.participant == "03"] == [r for r in theirs if r.participant == "03"]
    assert [r for r in rows if r.participant == "01"][:3] == theirs[:3]  # before the crash


def test_a_study_killed_while_drawing_draws_its_figures_on_resume(tmp_path, monkeypatch):
    def killed(table, folder, *what, **options):
        (folder / "fig16_path_error.png").write_bytes(b"half")
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(studies, "draw_boxplots", killed)
        with pytest.raises(Killed):
            run_study(tmp_path / "study", 1, short(paths=1, seed="2"), PEOPLE)
    assert not (tmp_path / "study" / "figures").exists()
    half = tmp_path / "study" / ".figures.partial"  # as the system's own kill leaves it
    half.mkdir()
    (half / "fig16_path_error.png").write_bytes(b"half")
    resume_study(tmp_path / "study", {})
    left = [path.name for path in (tmp_path / "study" / "figures").iterdir()]
    assert left == ["boxplots.png"], "the half one is gone"
    assert not half.exists()


def test_what_is_asked_by_name_must_be_what_the_study_was_begun_with(interrupted, capsys):
    before = files(interrupted)
    for arguments, said in (
        (["displays"], "begun with another protocol (paper)"),
        (["--seed", "6"], "--seed: the study was begun with 5"),
        (["--operators", "2"], "--operators: the study was begun with 3"),
        (["--rules", "literal"], "--rules: the study was begun with settled"),
        (["--low-gain", "5"], "--low-gain: the study was begun with 500"),
        (["--device", "four-brake"], "--device: the study was begun with other devices"),
    ):
        assert main(["study", "--resume", "--out", str(interrupted), *arguments]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and said in error
    assert files(interrupted) == before


@pytest.mark.parametrize("there", ["none", "empty", "half", "damaged", "running"])
def test_a_folder_with_nothing_to_resume_is_refused_in_one_sentence(interrupted, tmp_path, capsys, there):
    folder = tmp_path / there
    if there != "none":
        folder.mkdir()
    if there == "half":
        (folder / ".study.db.partial").write_text("{")
    if there == "damaged":
        (folder / "study.db").write_text("no database")
    if there == "running":
        folder = interrupted
    before = files(folder)
    lock = hold_lock(folder) if there == "running" else None
    assert main(["study", "--resume", "--out", str(folder)]) == 2
    if lock:
        lock.release()
    assert capsys.readouterr().err.count("\n") == 1 and files(folder) == before and folder.exists() == (there != "none")


def test_a_folder_in_which_a_study_was_hardly_begun_takes_a_new_one(tmp_path):
    (tmp_path / ".study.db.partial").write_text("{")
    (tmp_path / ".study.db.partial-wal").write_text("{")
    (tmp_path / ".lock").touch()
    assert run_study(tmp_path, 1, short(paths=1, seed="2"), PEOPLE)["trials"] == 10
