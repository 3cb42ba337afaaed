"""A recording gives back what was written, every tick of it, or names what is missing; as Parquet it is the same."""

import contextlib
import json
import sqlite3
import stat
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from disks import Disk, full
from recorded import NAMES, assert_holds, new_session_database, record, ticks

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments import atomic_files
from experiments.analysis.trials_table import as_table, write_table
from experiments.atomic_files import TRIES, retry_while_locked
from experiments.store import recording as recording_module
from experiments.store.database import DATABASE, Database, reading, trials_in
from experiments.store.recording import RecordingWriter, close_trial, read_recording


@pytest.fixture
def database(tmp_path):
    with new_session_database(tmp_path) as database:
        yield database


def begun(database: Database, run: int = 1) -> RecordingWriter:
    return RecordingWriter(database, ("trials", run), "AEB", {})


def recording_of(database: Database, run: int = 1):
    return read_recording(database.path.parent / "trials" / f"run-{run:03d}.parquet")


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("braked", ["AEBC", "AEB", "A", "", "BC"])
def test_columns_are_the_promised_ones_without_those_of_missing_brakes(tmp_path, braked, closed):
    rows = ticks(50)
    recording = read_recording(record(tmp_path, rows, braked, closed=closed))
    missing = {f"{kind}_{joint}_{unit}" for joint in "AEBC" if joint not in braked
               for kind, unit in (("current", "A"), ("torque", "N_m"))}  # fmt: skip
    promised = [name for name in NAMES if name not in missing]
    assert list(recording.columns)[: len(promised)] == promised and not missing & set(recording.columns)
    assert_holds(recording, rows)


@pytest.mark.parametrize("closed", [True, False])
def test_reading_back_gives_every_tick_the_words_metadata_and_outcome(tmp_path, closed):
    rows = ticks(3456)
    rows[7, tick_log.HAND_FX] = np.nan  # a sensor that failed is recorded as it was
    rows[8, tick_log.HAND_FX] = -np.inf
    rows[9, tick_log.HAND_FX] = -0.0
    recording = read_recording(record(tmp_path, rows, pieces=7, outcome={"status": "timeout"}, closed=closed))
    assert recording.whole and recording.rows == 3456
    assert_holds(recording, rows)
    assert np.signbit(recording.column("hand_fx_N")[9])
    assert recording.metadata == {"participant": "01"} and recording.outcome == {"status": "timeout"}
    assert list(recording.text("decision")) == [DECISIONS[int(code)] for code in rows[:, tick_log.DECISION]]
    assert list(recording.text("stuck")) == [tick_log.STUCK_LETTERS[int(code)] for code in rows[:, tick_log.STUCK]]
    assert np.array_equal(recording.in_phase("move"), rows[:, tick_log.PHASE] == tick_log.MOVE)
    with pytest.raises(InputError, match="current_C_A"):
        recording.column("current_C_A")


def test_any_parquet_program_reads_the_file_and_its_ticks_have_left_the_database(tmp_path):
    rows = ticks(2345)
    path = record(tmp_path, rows, "AEBC")
    table = pq.read_table(path)
    assert table.column_names[: len(NAMES)] == list(NAMES) and table.num_rows == 2345
    assert table.column("decision").to_pylist() == [DECISIONS[int(code)] for code in rows[:, tick_log.DECISION]]
    assert json.loads(table.schema.metadata[b"phd"])["metadata"] == {"participant": "01"}
    assert json.loads(pq.read_metadata(path).metadata[b"outcome"]) == {"status": "done"}
    with contextlib.closing(sqlite3.connect(tmp_path / DATABASE)) as db:
        assert db.execute("SELECT count(*) FROM ticks").fetchone() == (0,)
    assert not list(path.parent.glob(".*"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_files_and_folders_are_their_users_own(tmp_path):
    path = record(tmp_path / "new", ticks(20))
    modes = {
        place.name: stat.S_IMODE(place.stat().st_mode) for place in (path, path.parent, tmp_path / "new" / DATABASE)
    }
    assert modes == {path.name: 0o600, "trials": 0o700, DATABASE: 0o600}


def test_a_long_recording_is_written_in_pieces_and_read_column_by_column(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.store.recording.PIECE_ROWS", 2000)
    monkeypatch.setattr("experiments.store.recording.LONG_ROWS", 5000)
    rows = ticks(7500)
    path = record(tmp_path, rows, pieces=5)
    assert pq.ParquetFile(path).num_row_groups == 4
    recording = read_recording(path)
    assert isinstance(recording.columns, recording_module.LongColumns) and recording.whole and recording.rows == 7500
    assert_holds(recording, rows)
    assert "nothing" not in recording.columns and len(recording.columns) > 40


@pytest.mark.parametrize("braked, metadata", [("BA", {}), ("X", {}), ("AA", {}), ("A", {"x": object()})])
def test_a_recording_that_cannot_be_described_is_refused(database, braked, metadata):
    with pytest.raises(InputError, match="recording"):
        RecordingWriter(database, ("trials", 1), braked, metadata)
    with pytest.raises(InputError, match="no such recording"):
        database.commit()
        recording_of(database)


def test_ticks_are_on_the_disk_in_time_for_a_kill_or_a_power_cut(tmp_path):
    """20 ticks every 20 ms, as while a person moves: somebody else sees all but the last 0.2 s of them."""
    with new_session_database(tmp_path, sync=True) as database:
        writer = begun(database)
        writer.flush()
        for chunk in np.array_split(ticks(600), 30):
            time.sleep(0.02)
            writer.write(chunk)
            assert writer.rows - recording_of(database).rows <= 220
        writer.close()
    assert recording_of(database).rows == 600


@pytest.fixture
def disk(monkeypatch) -> Disk:
    return Disk(monkeypatch)


def test_what_the_disk_refuses_is_counted_and_too_much_of_it_is_said(disk, tmp_path):
    database = new_session_database(tmp_path)
    writer = begun(database)
    database.pending_bytes = 10**9
    assert writer.is_full, "a gigabyte of memory is too much"
    database.pending_bytes = 0
    writer.write(ticks(1000))
    writer.flush()
    disk.refuses = full
    writer.write(ticks(1500))
    with pytest.raises(OSError, match="No space left"):
        writer.flush()
    assert database.pending_ticks == 1500 and writer.written.ticks == 1000
    disk.refuses = None
    writer.flush()
    assert not writer.is_full and writer.written.ticks == 2500
    database.close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no folder that is in use")
@pytest.mark.parametrize("back", [True, False])
def test_a_session_whose_folder_vanishes_keeps_its_ticks_until_it_is_back(tmp_path, back):
    folder = tmp_path / "ses-01"
    folder.mkdir()
    rows, database = ticks(3000), new_session_database(folder)
    writer = begun(database)
    writer.write(rows[:1000])
    writer.flush()
    folder.rename(tmp_path / "elsewhere")
    for piece in np.array_split(rows[1000:], 4):
        writer.write(piece)
        with pytest.raises(FileNotFoundError):
            writer.flush()
    assert database.pending_ticks == 2000
    if back:
        (tmp_path / "elsewhere").rename(folder)
        database.reopen()
        writer.close({"status": "done"})
        database.close()
        assert_holds(recording_of(database), rows)
    else:
        folder.mkdir()
        with new_session_database(folder) as other:
            begun(other).flush()
        with pytest.raises(InputError, match="another session"):
            database.reopen()
        with pytest.raises(OSError):
            database.close()


@pytest.mark.parametrize("column, value", [
    (tick_log.DECISION, len(DECISIONS)), (tick_log.PHASE, 0.5), (tick_log.STUCK, -1), (tick_log.PHASE, np.nan)
])  # fmt: skip
def test_a_tick_with_a_code_without_a_word_is_refused_and_the_rest_is_kept(database, column, value):
    rows, writer = ticks(1500), begun(database)
    writer.write(rows[:600])
    writer.flush()
    rows[700, column] = value
    with pytest.raises(ValueError, match="without a word"):
        writer.write(rows[600:])
        writer.flush()
    trial = writer.close({"status": "stopped"})
    database.commit()
    close_trial(database, trial, sync=False)
    database.commit()
    assert_holds(recording_of(database), rows[:600])
    assert recording_of(database).whole


def test_a_file_that_is_not_what_was_written_stops_the_closing_and_the_ticks_stay(database, monkeypatch):
    rows, writer = ticks(100), begun(database)
    writer.write(rows)
    trial = writer.close({"status": "done"})
    database.commit()
    write = recording_module.write_parquet

    def wrong(path, text, outcome, pieces):
        write(path, text, outcome, [piece + (np.arange(len(piece)) == 2)[:, None] * 1e-9 for piece in pieces])

    with monkeypatch.context() as patch, pytest.raises(OSError, match="differs from what was written"):
        patch.setattr("experiments.store.recording.write_parquet", wrong)
        close_trial(database, trial, sync=False)
    assert not list((database.path.parent / "trials").iterdir())
    assert recording_of(database).rows == 100


@pytest.mark.parametrize("seed", [2])
def test_no_changed_bit_of_a_file_goes_unnoticed_wherever_it_is_cut_or_changed(tmp_path, seed):
    path = record(tmp_path, ticks(300))
    data, generator = path.read_bytes(), np.random.default_rng(seed)
    for place in generator.integers(0, len(data), 60):
        changed = bytearray(data)
        changed[place] ^= 1 << int(generator.integers(8))
        for content in (bytes(changed), data[:place]):
            path.write_bytes(content)
            recording = read_recording(path)
            assert not recording.whole and recording.rows == 0 and "was changed or cut" in recording.faults, place
    path.unlink()
    assert read_recording(path).faults == "file: missing"


def test_a_description_of_a_later_form_is_said_and_no_tick_is_trusted(tmp_path):
    path = record(tmp_path, ticks(5))
    with reading(tmp_path) as stored:
        ((trial, _),) = trials_in(stored)
    with Database(tmp_path) as database:
        database.put("trial", *trial._replace(about=trial.about.replace('"form": ', '"form": 9')))
    recording = read_recording(path)
    assert not recording.rows and "this program reads form" in recording.damaged[0]


def refused(winerror: int | None) -> PermissionError:
    error = PermissionError(13, "denied", "trials.csv")
    if winerror:
        error.winerror = winerror
    return error


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The waits, which take no time."""
    waited: list[float] = []
    monkeypatch.setattr(atomic_files.time, "sleep", waited.append)
    return waited


def test_the_tries_are_bounded_and_end_in_one_sentence(waits: list[float], tmp_path: Path, monkeypatch) -> None:
    tries: list[tuple] = []

    def never(*arguments: object) -> None:
        tries.append(arguments)
        raise refused(32)

    monkeypatch.setattr(atomic_files.os, "replace", never)
    with pytest.raises(InputError, match=r"^.*trials\.csv: cannot be written \(another program has it open"):
        write_table(tmp_path / "trials.csv", as_table([]), replacing=True)
    assert len(tries) == TRIES == len(waits) + 1
    assert not list(tmp_path.iterdir())


def test_an_exception_in_the_trial_keeps_its_ticks_without_an_end(database):
    rows = ticks(150)
    ring = rows.copy()
    with pytest.raises(ZeroDivisionError), begun(database) as writer:
        writer.write(ring)
        ring[:] = np.nan  # what was given was copied
        raise ZeroDivisionError
    recording = recording_of(database)
    assert not recording.complete and recording.damaged == []
    assert_holds(recording, rows)


def test_a_commit_waits_for_another_process(tmp_path):
    with new_session_database(tmp_path) as database:
        writer = begun(database)
        writer.flush()
        with contextlib.closing(sqlite3.connect(tmp_path / DATABASE, check_same_thread=False)) as other:
            other.execute("BEGIN IMMEDIATE")
            threading.Timer(0.2, other.rollback).start()
            writer.write(ticks(10))
            writer.flush()


@pytest.mark.parametrize("winerror", [5, 32, 33])
def test_it_is_tried_again_until_it_is_free(waits: list[float], winerror: int) -> None:
    refusals, done = [refused(winerror)] * 3, []

    def do(word: str) -> None:
        if refusals:
            raise refusals.pop(0)
        done.append(word)

    retry_while_locked(do, "once")
    assert done == ["once"] and len(waits) == 3
