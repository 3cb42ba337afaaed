"""What the experimenter decides in a session: skip, redo, notes, practice, breaks; it survives crashes and analysis."""

import shutil

import pytest
from protocols import protocol_of, short
from sessions import Killed, kill, killing, move_to_the_end, new_session, run, run_trials

from core.files import InputError
from experiments.store import files
from experiments.store.cells import cell
from experiments.store.files import free_participant, rows_of, write_pooled_table
from experiments.store.journal import EXCLUDED, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Participant, Session
from experiments.store.verify import verify
from experiments.study.analyze import analyze


def statuses(session):
    return [(row.run, row.status) for row in session.rows]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Run 1 done, 2 skipped, 3 done and redone as 21, 4 done; with its table of all participants."""
    data = tmp_path_factory.mktemp("session") / "data"
    session = new_session(data, protocol=short())
    run_trials(session, 1)
    session.skip("the participant sneezed")
    run_trials(session, 1)
    session.redo(3, "looked away")
    run_trials(session, 2)
    session.note("asked to move a little slower")
    session.close()
    write_pooled_table(data)
    return data


@pytest.fixture
def data(kept, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(kept, tmp_path / "data")


def test_a_trial_that_is_postponed_comes_at_the_end_of_its_configuration_also_after_the_session_was_closed(tmp_path):
    session = new_session(tmp_path)
    run_trials(session, 2)
    session.redo(1, "the participant asked", at_end=True)
    first = session.plan[0]
    here = [trial for trial in session.plan if trial.configuration == first.configuration]
    assert session.next_planned() == session.plan[2]
    session.close()
    session = Session.resume(tmp_path, "01", sync=False)
    for trial in here[2:]:
        assert cell(session.next_planned()) == cell(trial)
        session.skip("quick")
    again = session.next_planned()
    assert cell(again) == cell(first) and again.run > len(session.plan)
    session.close()


def test_an_excluded_run_settles_its_cell_and_stays_in_the_table_with_its_recording(tmp_path):
    session = new_session(tmp_path, protocol=short())
    run_trials(session, 2)
    content = (session.folder / session.rows[1].recording).read_bytes()
    row = session.exclude(2, "the participant sneezed")
    assert row.status == "excluded" and row.value("path_error_m") is not None and session.finished_count == 2
    assert rows_of(session.folder) == session.rows and statuses(session) == [(1, "done"), (2, "excluded")]
    assert (session.folder / row.recording).read_bytes() == content
    told = [entry.about for entry in read_events(session.folder) if entry.event is EXCLUDED]
    assert told == [{"run": 2, "reason": "the participant sneezed"}]
    for number, reason, words in ((2, "twice", "is excluded"), (3, "early", "is not done"), (1, " ", "a reason is")):
        with pytest.raises(InputError, match=f"run {number}: {words}"):
            session.exclude(number, reason)
    session.close()
    assert verify(tmp_path)["faults"] == []
    session = Session.resume(tmp_path, "01", sync=False)
    assert session.redo(2, "after all").status == "redone"
    session.close()
    assert verify(tmp_path)["faults"] == []


def practising(tmp_path, **values):
    """A session of a hand at the mouse, with two practice trials a configuration."""
    return Session(tmp_path, Participant("01"), short(paths=1, practice_trials="2", **values), sync=False)


def test_practice_comes_before_each_configuration_is_recorded_apart_and_counts_nowhere(tmp_path):
    session = practising(tmp_path)
    first = session.plan[0].configuration
    for number in (1, 2):
        planned = session.next_planned()
        assert (planned.block, planned.run, planned.configuration) == (0, number, first)
        trial, writer = session.begin(planned)
        move_to_the_end(trial, writer)
        assert session.finish(trial, writer).status == "done"
    assert session.rows == [] and session.finished_count == 0 and not (session.folder / "trials.csv").exists()
    assert session.next_planned() == session.plan[0]
    extra = session.next_practice()  # whenever it is asked for
    assert (extra.block, extra.run) == (0, 3)
    names = sorted(path.name for path in (session.folder / "practice").iterdir())
    assert names == ["run-001.parquet", "run-002.parquet"]
    session.close()
    found = verify(tmp_path)
    assert found["faults"] == [] and found["whole"] == 2
    with pytest.raises(InputError, match="no recordings"):
        analyze(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    session = Session.resume(tmp_path, "01", sync=False)
    assert session.next_planned() == session.plan[0]
    while session.next_planned().configuration == first:
        session.skip("on to the next")
    assert session.next_planned().block == 0 and session.next_planned().configuration != first
    session.skip("knows it")
    session.skip("knows it")
    assert session.next_planned() == session.plan[5] and len(session.rows) == 5
    session.close()
    assert verify(tmp_path)["faults"] == []


def test_a_practice_trial_that_a_crash_cut_off_is_recovered_and_practised_again(tmp_path):
    session = practising(tmp_path)
    trial, writer = session.begin(session.next_planned())
    run(trial, writer, 1000)
    kill(session)
    assert any("practice/run-001.parquet" in fault["file"] for fault in verify(tmp_path)["faults"])
    session = Session.resume(tmp_path, "01", sync=False)
    assert read_recording(session.folder / "practice" / "run-001.parquet").rows == 1000
    planned = session.next_planned()
    assert (planned.block, planned.run) == (0, 2) and session.rows == []
    session.close()
    assert verify(tmp_path)["faults"] == []


def test_a_simulated_operator_does_not_practise(tmp_path):
    session = new_session(tmp_path, protocol=short(practice_trials="2"))
    assert session.next_planned() == session.plan[0]
    session.close()


def test_a_break_is_due_after_so_many_trials_of_a_configuration_and_not_before_the_re_rig(tmp_path):
    text = short().text + "\n[breaks]\nafter_trials = 4\nleast_s = 9.0\n"
    session = new_session(tmp_path, protocol=protocol_of(text))
    due = []
    while session.next_planned():
        session.skip("quick")
        due.append(session.break_due)
    session.close()
    assert [i for i, is_due in enumerate(due, start=1) if is_due] == [4, 8, 14, 18]


def test_a_session_is_for_one_of_the_protocols_participants(tmp_path):
    protocol = short(participants='["anna", "berta"]')
    with pytest.raises(InputError, match=r"participant 01: is none of the paper protocol's \(anna, berta\)"):
        Session(tmp_path, Participant("01"), protocol)
    assert not list(tmp_path.iterdir())
    assert free_participant(tmp_path, protocol.participants) == "anna"
    Session(tmp_path, Participant("anna"), protocol, sync=False).close()
    assert free_participant(tmp_path, protocol.participants) == "berta" and free_participant(tmp_path) == "01"
    Session(tmp_path, Participant("berta"), protocol, sync=False).close()
    with pytest.raises(InputError, match="every participant"):
        free_participant(tmp_path, protocol.participants)


@pytest.mark.parametrize("what", ["skip", "redo"])
def test_a_decision_is_there_after_a_crash_before_its_tables_are_written(data, monkeypatch, what):
    session = Session.resume(data, "01", sync=False)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(files, "write_session_table", killing())
        session.skip("gone") if what == "skip" else session.redo(4, "gone")
    kill(session)
    session = Session.resume(data, "01", sync=False)
    assert ((5, "skipped") if what == "skip" else (4, "redone")) in statuses(session)
    session.close()
    assert verify(data)["faults"] == []
