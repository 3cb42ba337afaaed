"""What a live session does when its disk does not: nothing that was recorded is lost, nothing is done twice, and what
was cut short without anybody's decision comes again.
"""

import contextlib
import os
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from disks import full, locked
from protocols import PAPER, changed, protocol_of, short
from sessions import new_session, run, run_trials

from app.ipc.messages import BAD, BREAK, CAUTION, READY
from app.session_server import session_progress as progress_module
from app.session_server import storage as storage_module
from app.session_server.device_setup import SimulatedSetup
from app.session_server.preflight import check_recording
from app.session_server.session_progress import SessionProgress
from app.session_server.steps import stage_of
from app.session_server.storage import Storage
from app.session_server.trial_runner import TrialRun
from experiments.inputs import MOUSE
from experiments.recording.reader import read_recording
from experiments.session import journal
from experiments.session.files import cell, rows_of
from experiments.session.journal import ANSWERS, BREAK_ENDED, NOTE, read_events
from experiments.session.recover import recover
from experiments.session.session import Session
from experiments.session.verify import verify

MOUSE_HELD = SimulatedSetup(None, MOUSE)


class Idle:
    """A runner with nothing to run."""

    run = None


class Ended:
    """A trial of a session that has come to its end."""

    unsaved = TrialRun.unsaved

    def __init__(self, session: Session, ticks: int = 10**9) -> None:
        self.planned = session.next_planned()
        self.trial, self.writer = session.begin(self.planned)
        self.recorder = SimpleNamespace(writer=self.writer, trouble=None)
        run(self.trial, self.writer, ticks)
        self.name, self.cut_short, self.again = f"Run {self.planned.run}", True, "never"
        if not self.trial.finished:
            self.trial.abort("the lamp fell down")
            run(self.trial, self.writer)

    def abandon_recording(self) -> None:
        with contextlib.suppress(OSError):
            self.writer.abandon()

    def finish(self, session: Session):
        return session.finish(self.trial, self.writer, self.cut_short, accept_stream=True)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    session = new_session(tmp_path / "data", protocol=short())
    yield session
    session.close()


@pytest.fixture
def said() -> list[tuple[str, bool]]:
    return []


@pytest.fixture
def storage(session: Session, said, monkeypatch: pytest.MonkeyPatch) -> Storage:
    monkeypatch.setattr(storage_module, "RETRY_S", 0.0)
    storage = Storage(session.data_dir, Idle(), lambda sentence, bad=False: said.append((sentence, bad)))
    storage.set_session(SessionProgress(session))
    return storage


def in_order(session: Session) -> None:
    """The files say what the session says, and verify has nothing to say."""
    assert rows_of(session.folder) == session.rows
    session.close()
    assert verify(session.data_dir)["faults"] == []


def test_a_stream_that_does_not_become_parquet_is_the_recording_until_it_does(storage, session, said, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.recording.writer.written_beside", full)
        storage.store_trial(Ended(session))
        assert [(row.status, row.recording) for row in session.rows] == [("done", "trials/run-001.arrows")]
        assert not storage.not_written and storage.streams == 1 and "its stream is whole" in said[-1][0]
        assert check_recording("", storage.not_written, storage.verified, storage.streams).state == CAUTION
        assert storage.progress.coming == session.plan[1]  # the session goes on
        storage.retry()
        assert storage.streams == 1
    kept = read_recording(session.folder / "trials" / "run-001.arrows")
    storage.retry()
    assert storage.streams == 0 and [row.recording for row in session.rows] == ["trials/run-001.parquet"]
    assert read_recording(session.folder / "trials" / "run-001.parquet").rows == kept.rows
    assert not storage.not_written and check_recording("", storage.not_written, "", storage.streams).state not in (
        BAD,
        CAUTION,
    )
    in_order(session)


def test_lines_that_the_disk_did_not_take_are_written_before_a_session_is_left(storage, session, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.session.journal.write_event", full)
        storage.write(ANSWERS, configuration="three-brake", block=1, values={"effort": 70})
        with pytest.raises(OSError, match="No space left"):
            storage.leave()
        assert storage.progress is not None
    storage.leave()
    assert storage.progress is None
    (said,) = (entry for entry in read_events(session.folder) if entry.event is ANSWERS)
    assert said.about["values"] == {"effort": 70}


def test_lines_that_the_disk_never_takes_are_in_the_log(storage, session, monkeypatch, capsys):
    monkeypatch.setattr("experiments.session.journal.write_event", full)
    storage.write(NOTE, text="the lamp flickers")
    storage.close_session()
    assert storage.progress is None and "the lamp flickers" in capsys.readouterr().err


def test_what_was_left_as_a_stream_is_converted_by_recover(storage, session, monkeypatch):
    monkeypatch.setattr("experiments.recording.writer.written_beside", full)
    storage.store_trial(Ended(session))
    session.close()
    monkeypatch.undo()
    assert recover(session.data_dir)["faults"] == []
    assert [row.recording for row in rows_of(session.folder)] == ["trials/run-001.parquet"]


@pytest.mark.parametrize(("refuses", "why"), [(full, "no space left"), (locked, "operation not permitted")])
def test_a_table_that_the_disk_does_not_take_stops_the_next_trial_until_it_does(
    storage, session, said, monkeypatch, refuses, why
):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.recording.atomic_files.written_beside", refuses)
        storage.store_trial(Ended(session))
        assert session.rows == [] and storage.not_written.startswith("Run 1 is not complete. ") and said[-1][1]
        assert why in storage.not_written.lower() and "Or go on in another folder" in storage.not_written
        assert "Make room on the disk, or let the folder be written to again, " in said[-1][0]
        assert check_recording("", storage.not_written, "", 0).state == BAD
        storage.retry()
        assert storage.not_written and session.rows == []
    storage.retry()
    assert (
        not storage.not_written and [row.status for row in session.rows] == ["done"] and "run 1 is done" in said[-1][0]
    )
    assert storage.progress.coming == session.plan[1]
    in_order(session)


@pytest.mark.parametrize("room", range(0, 6000, 450))
def test_wherever_a_disk_takes_no_more_the_trial_has_its_row_when_it_does_again(storage, session, monkeypatch, room):
    """room: bytes that journal, tables and recording may still have."""
    left, write = [room], os.write
    ended = Ended(session)

    def until_full(handle, data):
        if len(data) > left[0]:
            full()
        left[0] -= len(data)
        return write(handle, data)

    with monkeypatch.context() as patch:
        patch.setattr(journal.os, "write", until_full)
        patch.setattr("experiments.recording.writer.written_beside", full)
        storage.store_trial(ended)
        storage.write(NOTE, text="somebody coughed")
    storage.retry()
    assert not storage.not_written and storage.streams == 0
    (row,) = session.rows
    assert row.status in ("done", "recovered") and read_recording(session.folder / row.recording).whole
    assert [entry.event for entry in read_events(session.folder)].count(NOTE) == 1
    assert (storage.progress.coming == session.plan[1]) == (row.status == "done")
    in_order(session)


def test_a_line_of_the_journal_that_came_too_late_has_the_time_of_what_happened(storage, session, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(journal.os, "write", full)
        storage.write(NOTE, text="one")
        storage.write(NOTE, text="two")
    session.note("later")
    storage.retry()
    events = {entry.about.get("text"): entry.time for entry in read_events(session.folder)}
    assert events["one"] <= events["two"] <= events["later"]


def test_a_table_changed_by_hand_is_set_aside_and_made_again(storage, session):
    run_trials(session, 1)
    table = session.folder / "trials.csv"
    by_hand = table.read_bytes().replace(b"\n", b"\r\n")
    table.write_bytes(by_hand)
    storage.store_trial(Ended(session))
    assert storage.not_written
    storage.retry()
    assert not storage.not_written and [row.status for row in session.rows] == ["done", "done"]
    assert (session.folder / "trials.csv.damaged").read_bytes() == by_hand
    in_order(session)


def test_what_nobody_decided_to_end_comes_again_and_what_somebody_did_does_not(storage, session, said):
    storage.store_trial(Ended(session, ticks=200))
    (row,) = session.rows
    assert row.status == "stopped" and "the lamp fell down" in said[-1][0] and "is repeated next" in said[-1][0]
    assert read_recording(session.folder / row.recording).outcome["status"] == "stopped"
    again = storage.progress.coming
    assert cell(again) == cell(row) and again.run != row.run
    ended = Ended(session, ticks=200)
    ended.cut_short = False
    storage.store_trial(ended)
    assert session.rows[-1].status == "aborted" and cell(storage.progress.coming) == cell(session.plan[1])
    in_order(session)


def test_the_end_of_the_plan_names_the_trials_without_a_result(storage, session, said):
    run_trials(session, len(session.plan) - 2)
    ended = Ended(session, ticks=200)
    ended.cut_short = False
    storage.store_trial(ended)
    assert storage.progress.without_valid_trial() == ""
    session.skip("short of time")
    storage.update_tables("")
    last = len(session.plan)
    assert f"2 of its {last} trials have no result: {last - 1} (aborted), {last} (skipped)" in said[-1][0]
    session.redo(session.rows[-2].run, "there is time")
    storage.store_trial(Ended(session))
    assert f"1 of its {last} trials has no result: {last} (skipped)" in said[-1][0]


@pytest.fixture
def rested(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Opens a session with a break of ten minutes after each trial, again and again; `later` lets the clock go on."""

    class Again:
        def __init__(self) -> None:
            text = changed(PAPER.text, blocks="1") + "\n[breaks]\nafter_trials = 1\nleast_s = 600.0\n"
            self.session = new_session(tmp_path / "data", protocol=protocol_of(text))
            self.session.close()

        def open(self) -> SessionProgress:
            self.session.close()
            self.session = Session.resume(tmp_path / "data", "01", sync=False)
            return SessionProgress(self.session)

        def later(self, seconds: float) -> None:
            monkeypatch.setattr(progress_module, "datetime", shifted(seconds))

    again = Again()
    yield again
    again.session.close()


def shifted(seconds: float) -> type:
    """A clock of the machine that was set, or has gone on, by so much; the monotonic one has not."""

    class Shifted(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.now(tz) + timedelta(seconds=seconds)

    return Shifted


def test_a_break_is_gone_on_with_when_the_bench_had_to_be_started_again(rested):
    progress = rested.open()
    assert stage_of(progress, MOUSE_HELD) == READY
    run_trials(rested.session, 1)
    progress = rested.open()
    assert stage_of(progress, MOUSE_HELD) == BREAK and 400.0 < progress.break_left_s() <= 600.0
    rested.later(450.0)
    progress = rested.open()
    assert stage_of(progress, MOUSE_HELD) == BREAK and 0.0 < progress.break_left_s() <= 150.0
    rested.later(-3600.0)  # somebody set the clock: the whole break, not an hour of it
    assert 400.0 < rested.open().break_left_s() <= 600.0


def test_a_break_that_passed_while_the_session_was_closed_or_was_ended_is_not_asked_for_again(rested):
    rested.open()
    run_trials(rested.session, 1)
    rested.later(3600.0)
    assert stage_of(rested.open(), MOUSE_HELD) == READY
    run_trials(rested.session, 1)
    rested.later(0.0)
    assert stage_of(rested.open(), MOUSE_HELD) == BREAK
    rested.session.journal(BREAK_ENDED, settled=rested.session.finished_count)
    assert stage_of(rested.open(), MOUSE_HELD) == READY
    run_trials(rested.session, 1)
    assert stage_of(rested.open(), MOUSE_HELD) == BREAK
