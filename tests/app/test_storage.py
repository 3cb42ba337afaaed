"""What a live session does when its disk does not: nothing that was recorded is lost, nothing is done twice, and what
was cut short without anybody's decision comes again.
"""

import contextlib
import time
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from damage import edited
from disks import Disk, full, locked
from protocols import PAPER, changed, protocol_of, short
from sessions import new_session, run, run_trials

from app.ipc.messages import BAD, BREAK, READY
from app.session_server.device_setup import SimulatedSetup
from app.session_server.preflight import check_recording
from app.session_server.session_progress import SessionProgress
from app.session_server.steps import stage_of
from app.session_server.storage import Storage
from experiments.inputs import MOUSE
from experiments.store.cells import cell
from experiments.store.files import rows_of
from experiments.store.journal import ANSWERS, BREAK_ENDED, CLOCK_JUMPED, ENDED, NOTE, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.verify import verify

PIECE = 50  # ticks that are written at a time
MOUSE_HELD = SimulatedSetup(None, MOUSE)


class Idle:
    """A runner with nothing to run."""

    run = None


class Ended:
    """A trial of a session that has come to its end."""

    def __init__(self, session: Session, ticks: int = 10**9, full_disk: Disk | None = None) -> None:
        """full_disk: it is full from its first tick on."""
        self.planned = session.next_planned()
        self.trial, self.writer = session.begin(self.planned)
        self.recorder = SimpleNamespace(writer=self.writer)
        if full_disk is not None:
            full_disk.refuses = full
        while not self.trial.finished and self.trial.ticks < ticks:
            with contextlib.suppress(OSError):
                run(self.trial, self.writer, self.trial.ticks + PIECE, PIECE)
        self.cut_short, self.again = True, "never"
        if not self.trial.finished:
            self.trial.abort("the lamp fell down")
            with contextlib.suppress(OSError):
                run(self.trial, self.writer)

    def finish(self, session: Session):
        return session.finish(self.trial, self.writer, self.cut_short)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


@pytest.fixture
def session(tmp_path: Path, disk: Disk) -> Iterator[Session]:
    session = new_session(tmp_path / "data", protocol=short())
    yield session
    session.end()


@pytest.fixture
def said() -> list[tuple[str, bool]]:
    return []


@pytest.fixture
def storage(session: Session, said, monkeypatch: pytest.MonkeyPatch) -> Storage:
    monkeypatch.setattr("app.session_server.storage.RETRY_S", 0.0)
    storage = Storage(Idle(), lambda sentence, bad=False: said.append((sentence, bad)))
    storage.set_session(SessionProgress(session))
    return storage


def in_order(session: Session) -> None:
    """The files say what the session says, and verify has nothing to say."""
    assert rows_of(session.folder) == session.rows
    session.close()
    assert verify(session.data_dir)["faults"] == []


def test_events_that_the_disk_did_not_take_are_written_before_a_session_is_left(storage, session, disk):
    disk.refuses = full
    storage.write(NOTE, text="before")
    storage.write(ANSWERS, configuration="three-brake", block=1, values={"effort": 70})
    assert storage.in_memory == "2 lines of the journal"
    with pytest.raises(OSError, match="No space left"):
        storage.leave()
    assert storage.progress is not None
    disk.refuses = None
    storage.leave()
    assert storage.progress is None
    note, said, *_ = [entry for entry in read_events(session.folder) if entry.event in (NOTE, ANSWERS)]
    assert note.about["text"] == "before" and said.about["values"] == {"effort": 70} and note.time <= said.time


@pytest.mark.parametrize("elsewhere", [True, False])
def test_what_the_disk_never_takes_is_put_elsewhere_and_taken_as_the_session_is_opened(
    storage, session, disk, capsys, monkeypatch, tmp_path, elsewhere
):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / ("home" if elsewhere else "a file")))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "a file"))
    (tmp_path / "a file").touch()
    ended = Ended(session, ticks=1500, full_disk=disk)
    storage.store_trial(ended)
    storage.write(NOTE, text="the lamp flickers")
    disk.only_folder = session.folder
    ticks = session.database.pending_ticks
    assert ticks > 1000
    left = storage.end()
    error = capsys.readouterr().err
    assert storage.progress is None and f"{ticks:,} ticks" in left and left in error
    disk.refuses = None
    again = Session.resume(session.data_dir, "01", sync=False)
    if elsewhere:
        assert "they are in" in left
        assert again.repaired.ticks_kept_elsewhere == ticks and f"{ticks:,} ticks" in again.repaired.sentence()
        assert [row.status for row in again.rows] == ["aborted" if not ended.cut_short else "stopped"]
        assert NOTE in [entry.event for entry in read_events(session.folder)]
        assert not list((tmp_path / "home" / "phd-rescued").iterdir())
    else:
        assert "are lost" in left
    in_order(again)


@pytest.mark.parametrize("spoilt", [True, False])
def test_what_was_put_elsewhere_is_not_taken_if_it_was_changed_or_comes_too_late(
    storage, session, disk, monkeypatch, tmp_path, spoilt
):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))
    storage.store_trial(Ended(session, ticks=500, full_disk=disk))
    storage.write(NOTE, text="the lamp flickers")
    disk.only_folder = session.folder
    assert "they are in" in storage.end()
    disk.refuses = None
    (place,) = (tmp_path / "home" / "phd-rescued").iterdir()
    if spoilt:
        with edited(place) as db:
            db.execute("UPDATE ticks SET count = count + 1 WHERE number = 1")
    else:
        place.rename(tmp_path / "later")
        with_more = Session.resume(session.data_dir, "01", sync=False)
        with_more.note("without it")
        with_more.close()
        (tmp_path / "later").rename(place)
    again = Session.resume(session.data_dir, "01", sync=False)
    says = "ticks 1: does not match its checksum" if spoilt else "the session went on without what is in it"
    assert says in again.repaired.sentence() and place.exists() and again.repaired.ticks_kept_elsewhere == 0
    again.close()


@pytest.mark.parametrize(("refuses", "why"), [(full, "no space left"), (locked, "permission denied")])
def test_a_disk_that_takes_nothing_stops_the_next_trial_until_it_does(storage, session, said, disk, refuses, why):
    ended = Ended(session)
    disk.refuses = refuses
    storage.store_trial(ended)
    assert session.rows == [] and storage.not_written.startswith("Trial 1 is not complete. ") and said[-1][1]
    assert why in storage.not_written.lower()
    assert "Make room on the disk, or let the folder be written to again, " in said[-1][0]
    assert check_recording("", storage.not_written, "").state == BAD
    storage.retry()
    assert storage.not_written and session.rows == []
    disk.refuses = None
    storage.retry()
    assert not storage.not_written and [row.status for row in session.rows] == ["done"]
    assert "trial 1 is done" in said[-1][0]
    assert storage.progress.coming == session.plan[1]
    in_order(session)


@pytest.mark.parametrize("room", (0, 1, 2, 4))
def test_wherever_a_disk_takes_no_more_the_trial_has_its_row_when_it_does_again(storage, session, disk, room):
    """room: writes (commits, files) that it still takes."""
    ended = Ended(session)
    disk.refuses, disk.room = full, room
    storage.store_trial(ended)
    storage.write(NOTE, text="somebody coughed")
    disk.refuses = None
    storage.retry()
    assert not storage.not_written
    (row,) = session.rows
    assert row.status == "done" and read_recording(session.folder / row.recording).whole
    events = [entry.event for entry in read_events(session.folder)]
    assert events.count(NOTE) == events.count(ENDED) == 1
    assert storage.progress.coming == session.plan[1]
    in_order(session)


def test_a_clock_that_was_set_is_an_event_and_the_order_stays(storage, session, monkeypatch):
    session.note("before")
    wall = time.time
    monkeypatch.setattr("experiments.store.journal.time.time", lambda: wall() - 3600.0)
    session.note("after")
    session.note("later")
    entries = read_events(session.folder)[-4:]
    assert [entry.about.get("text") for entry in entries] == ["before", None, "after", "later"]
    assert entries[1].event is CLOCK_JUMPED and entries[1].about["seconds"] == pytest.approx(-3600.0, abs=1.0)


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
    ended = Ended(session, ticks=200)
    ended.cut_short, ended.again = False, "now"
    storage.store_trial(ended)
    assert cell(storage.progress.coming) == cell(session.plan[1]) and "It is repeated next" in said[-1][0]
    in_order(session)


def test_the_end_of_the_plan_names_the_trials_without_a_result(storage, said, tmp_path):
    session = new_session(tmp_path / "few", protocol=short(paths=1))
    storage.set_session(SessionProgress(session))
    run_trials(session, len(session.plan) - 2)
    ended = Ended(session, ticks=200)
    ended.cut_short = False
    storage.store_trial(ended)
    assert storage.progress.without_valid_trial() == ""
    session.skip("short of time")
    storage.update_next("")
    last = len(session.plan)
    assert f"2 of its {last} trials have no result: {last - 1} (aborted), {last} (skipped)" in said[-1][0]
    session.redo(session.rows[-2].run, "there is time")
    storage.store_trial(Ended(session))
    assert f"1 of its {last} trials has no result: {last} (skipped)" in said[-1][0]
    session.end()


def test_a_break_goes_on_when_the_bench_is_started_again_and_is_not_asked_for_again_once_it_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten minutes after each trial, by the clock of the machine, which may be set."""
    text = changed(PAPER.text, blocks="1") + "\n[breaks]\nafter_trials = 1\nleast_s = 600.0\n"
    session = new_session(tmp_path / "data", protocol=protocol_of(text))

    def opened_again(later_s: float) -> SessionProgress:
        nonlocal session

        class Shifted(datetime):
            @classmethod
            def now(cls, tz=None):
                return datetime.now(tz) + timedelta(seconds=later_s)

        monkeypatch.setattr("app.session_server.session_progress.datetime", Shifted)
        session.close()
        session = Session.resume(tmp_path / "data", "01", sync=False)
        return SessionProgress(session)

    assert stage_of(opened_again(0.0), MOUSE_HELD) == READY
    run_trials(session, 1)
    for later_s, least_s, most_s in ((0.0, 400.0, 600.0), (450.0, 1e-9, 150.0), (-3600.0, 400.0, 600.0)):
        progress = opened_again(later_s)  # the clock was set back: the whole break, not an hour of it
        assert stage_of(progress, MOUSE_HELD) == BREAK and least_s < progress.break_left_s() <= most_s
    assert stage_of(opened_again(3600.0), MOUSE_HELD) == READY, "it passed while the session was closed"
    run_trials(session, 1)
    assert stage_of(opened_again(0.0), MOUSE_HELD) == BREAK
    session.journal(BREAK_ENDED, settled=session.finished_count)
    assert stage_of(opened_again(0.0), MOUSE_HELD) == READY
    run_trials(session, 1)
    assert stage_of(opened_again(0.0), MOUSE_HELD) == BREAK
    session.close()
