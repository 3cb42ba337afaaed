"""Opening a session closes what a crash left, says what it was, and throws nothing away."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from damage import edited, found
from protocols import short
from sessions import Killed, crash_in_trial, files, killing, new_session, of, run_trials, session_of

from app.cli import main
from experiments.store import recording, repair
from experiments.store.database import DATABASE
from experiments.store.journal import REPAIRED, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from tests.support.rows import read_rows


@pytest.fixture(scope="module")
def crashed(tmp_path_factory) -> Path:
    """Two trials done, killed in the third, 4500 ticks in: it is in its movement."""
    data = tmp_path_factory.mktemp("repair") / "data"
    with session_of(data, 2) as session:
        crash_in_trial(session, ticks=4500)
    return data


@pytest.fixture
def data(crashed, tmp_path) -> Path:
    """A copy to open."""
    return shutil.copytree(crashed, tmp_path / "data")


def opened(data: Path) -> str:
    """What is said as the session is opened."""
    session = Session.resume(data, "01", sync=False)
    session.close()
    return session.repaired.sentence()


def test_a_trial_that_was_cut_off_keeps_every_tick_and_is_marked_recovered(data):
    path = of(data) / "trials" / "run-003.parquet"
    there, before = read_recording(path), files(data)
    assert there.rows == 4500 and not there.complete and main(["verify", str(data)]) == 1
    assert opened(data) == "What a crash had left open is closed: trial 3, 4,500 ticks."
    assert main(["verify", str(data)]) == 0
    kept = read_recording(path)
    assert kept.whole and kept.outcome["status"] == "recovered" and kept.metadata == there.metadata
    for name, values in there.columns.items():
        assert np.array_equal(kept.column(name), values, equal_nan=True), name
    row = read_rows(of(data) / "trials.csv")[2]
    assert (row.run, row.status) == (3, "recovered")
    assert row.value("duration_s") == pytest.approx(there.in_phase("move").sum() / 1000, abs=0.002)
    assert row.value("path_error_m") > 0
    after = files(data)
    assert all(after[name] == text for name, text in before.items() if "run-" in name)
    (event,) = (entry.about for entry in read_events(of(data)) if entry.event is REPAIRED)
    assert event["trials"] == ["trial 3, 4,500 ticks"] and event["rows"] == ["trial 3 is recovered"]
    assert opened(data) == ""  # again: nothing is left to do


def test_damaged_ticks_are_left_out_and_the_rest_is_kept(data):
    with edited(of(data) / DATABASE) as db:
        db.execute("UPDATE ticks SET crc = crc + 1 WHERE number = (SELECT min(number) + 1 FROM ticks)")
    assert "4,000 ticks" in opened(data)
    kept = read_recording(of(data) / "trials" / "run-003.parquet")
    assert kept.rows == 4000 and "do not match their checksum" in kept.outcome["reason"]
    row = read_rows(of(data) / "trials.csv")[2]
    assert row.status == "recovered" and row.value("acceleration_dft_sum") is None  # no even grid, nothing to filter


def test_a_trial_that_had_ended_before_the_crash_counts_as_it_ended(tmp_path):
    for data in (tmp_path / "killed", tmp_path / "not"):
        with session_of(data, 1) as session:
            if data.name == "not":
                run_trials(session, 1)
            else:
                crash_in_trial(session, closed=True)
    opened(tmp_path / "killed")
    table = Path("sub-01", "ses-01", "trials.csv")
    assert (tmp_path / "killed" / table).read_bytes() == (tmp_path / "not" / table).read_bytes()


@pytest.mark.parametrize(
    ("place", "step", "when"), [(recording, "write_parquet", "after"), (repair, "close_trial", "before")]
)
def test_a_crash_while_a_trial_is_closed_is_put_right(data, monkeypatch, place, step, when):
    death = killing(getattr(place, step) if when == "after" else None)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(place, step, death)
        Session.resume(data, "01")
    opened(data)
    rows = read_rows(of(data) / "trials.csv")
    assert [(row.run, row.status) for row in rows][2:] == [(3, "recovered")]
    assert read_recording(of(data) / rows[2].recording).rows == 4500
    assert sorted(path.name for path in (of(data) / "trials").iterdir()) == [f"run-00{n}.parquet" for n in (1, 2, 3)]
    assert found(data) == {}


def test_a_table_that_is_lost_or_spoilt_is_made_again(data):
    opened(data)
    table = of(data) / "trials.csv"
    right = table.read_bytes()
    table.write_bytes(b"spoilt")
    opened(data)
    assert table.read_bytes() == right
    table.unlink()
    opened(data)
    assert table.read_bytes() == right and found(data) == {}


def test_opening_a_session_that_is_complete_touches_nothing(tmp_path):
    session = new_session(tmp_path, protocol=short())
    while session.next_planned():
        session.skip("not today")
    session.close()
    before = files(tmp_path)
    assert opened(tmp_path) == "" and files(tmp_path) == before


def test_what_a_disk_does_not_take_is_put_where_the_user_keeps_data(monkeypatch, tmp_path):
    for named, place in (("XDG_DATA_HOME", "data"), ("LOCALAPPDATA", "local"), ("HOME", "home/.local/share")):
        with monkeypatch.context() as patch:
            for variable in ("XDG_DATA_HOME", "LOCALAPPDATA"):
                patch.setenv(variable, "")
            patch.setenv(named, str(tmp_path / place.partition("/")[0]))
            patch.setenv("USERPROFILE", str(tmp_path / "home"))
            assert next(repair.rescue_places("s")) == tmp_path / place / "phd-rescued" / "s.db"
