"""A recording gives back what was written, every tick of it, or says plainly what is missing."""

import os
import zlib

import numpy as np
import pyarrow as pa
import pytest
from recorded import NAMES, assert_holds, batch_ends, record, ticks

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.recording import writer as recording_writer
from experiments.recording.reader import read_recording
from experiments.recording.writer import RecordingWriter, convert_to_parquet


@pytest.mark.parametrize("braked", ["AEBC", "AEB", "A", "", "BC"])
def test_columns_are_the_promised_ones_without_those_of_missing_brakes(tmp_path, braked):
    rows = ticks(50)
    recording = read_recording(record(tmp_path / "run-001.arrows", rows, braked))
    missing = {f"{kind}_{joint}_{unit}" for joint in "AEBC" if joint not in braked
               for kind, unit in (("current", "A"), ("torque", "N_m"))}  # fmt: skip
    assert list(recording.columns) == [name for name in NAMES if name not in missing]
    assert_holds(recording, rows)


def test_reading_back_gives_every_tick_the_words_and_what_was_said_about_the_trial(tmp_path):
    rows = ticks(3456)
    rows[7, tick_log.HAND_FX] = np.nan  # a sensor that failed is recorded as it was
    rows[8, tick_log.HAND_FX] = -np.inf
    recording = read_recording(record(tmp_path / "run-001.arrows", rows, pieces=7, outcome={"status": "timeout"}))
    assert recording.whole and recording.rows == 3456
    assert_holds(recording, rows)
    assert recording.metadata == {"participant": "01"} and recording.outcome == {"status": "timeout"}
    assert list(recording.text("decision")) == [DECISIONS[int(code)] for code in rows[:, tick_log.DECISION]]
    assert list(recording.text("stuck")) == [tick_log.STUCK_LETTERS[int(code)] for code in rows[:, tick_log.STUCK]]
    assert np.array_equal(recording.in_phase("move"), rows[:, tick_log.PHASE] == tick_log.MOVE)
    with pytest.raises(InputError, match="current_C_A"):
        recording.column("current_C_A")


def test_any_arrow_program_reads_the_stream_and_finds_its_end_record(tmp_path):
    path = record(tmp_path / "run-001.arrows", ticks(2500))
    with pa.ipc.open_stream(path) as stream:
        batches = []
        with pytest.raises(StopIteration):
            while True:
                batches.append(stream.read_next_batch_with_custom_metadata())
    *ticks_of, (last, about) = batches
    assert [batch.num_rows for batch, _ in ticks_of] == [1000, 1000, 500]
    assert last.num_rows == 0 and last.schema == ticks_of[0][0].schema and about["end"] == b"end"
    assert [int(about["sequence"]) for _, about in batches] == [0, 1, 2, 3]
    assert all(set(about) >= {b"crc32", b"rows", b"first_row"} for _, about in batches)
    assert ticks_of[0][0].schema.field("phase").type == pa.dictionary(pa.int8(), pa.string())


def test_checksum_of_a_batch_is_the_zip_checksum_of_its_bytes_without_the_digits(tmp_path):
    path = record(tmp_path / "run-001.arrows", ticks(1500))
    data = path.read_bytes()
    source = pa.BufferReader(data)
    stream = pa.ipc.open_stream(source)
    start = batch_ends(path)[0][0]
    for _ in range(3):
        _, about = stream.read_next_batch_with_custom_metadata()
        message = data[start : source.tell()]
        start = source.tell()
        digits = about["crc32"]
        assert message.count(digits) == 1
        assert int(digits, 16) == zlib.crc32(message.replace(digits, b"\x18" * 8))


def test_a_stream_cut_anywhere_gives_back_every_whole_batch_and_lacks_its_end(tmp_path):
    rows = ticks(700)
    path = tmp_path / "run-001.arrows"
    with RecordingWriter(path, "AEB", {}, sync=False) as writer:
        for piece in np.array_split(rows, 5):
            writer.write(piece)
            writer.flush()
    data = path.read_bytes()
    ends = batch_ends(path)
    generator = np.random.default_rng(1)
    edges = [end + shift for end, _ in ends for shift in (-1, 0, 1)]
    cuts = {0, 1, len(data) - 1, len(data) - 8, *edges, *map(int, generator.integers(0, len(data), 120))}
    for cut in sorted(cut for cut in cuts if cut < len(data)):
        path.write_bytes(data[:cut])
        recording = read_recording(path)
        whole = max((count for end, count in ends if end <= cut), default=0)
        assert not recording.complete and not recording.whole, cut
        assert recording.rows == whole, cut
        if whole:
            assert_holds(recording, rows[:whole])
        if cut >= ends[0][0]:
            assert recording.damaged == [], cut  # a clean cut is no damage
        with pytest.raises(InputError, match="not converted"):
            convert_to_parquet(path)


@pytest.mark.parametrize("suffix", [".arrows", ".parquet"])
def test_no_changed_bit_goes_unnoticed_and_no_changed_row_is_returned(tmp_path, suffix):
    rows = ticks(300)
    path = tmp_path / "run-001.arrows"
    with RecordingWriter(path, "AEB", {"participant": "01"}, sync=False) as writer:
        for piece in np.array_split(rows, 3):
            writer.write(piece)
            writer.flush()
        writer.close({"status": "done"})
    header_end = batch_ends(path)[0][0]
    if suffix == ".parquet":
        path = convert_to_parquet(path)
    data = path.read_bytes()
    generator = np.random.default_rng(2)
    places = {*map(int, generator.integers(0, len(data), 250)), *range(len(data) - 60, len(data))}
    if suffix == ".arrows":
        places |= {*range(0, header_end, 29), *range(header_end, header_end + 2000, 13)}
    for place in sorted(places):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(generator.integers(8))
        path.write_bytes(flipped)
        recording = read_recording(path)
        assert not recording.whole, place
        if suffix == ".arrows" and recording.rows:  # what is returned is a selection of the true rows
            kept = np.searchsorted(rows[:, tick_log.T], recording.column("t_s"))
            assert len(kept) >= 200
            assert_holds(recording, rows[kept])


def test_damage_inside_costs_one_batch_and_names_it(tmp_path):
    rows = ticks(500)
    path = tmp_path / "run-001.arrows"
    with RecordingWriter(path, "AEB", {}, sync=False) as writer:
        for piece in np.array_split(rows, 5):
            writer.write(piece)
            writer.flush()
    data = bytearray(path.read_bytes())
    ends = batch_ends(path)
    for place in (ends[2][0] - 30, ends[1][0] + 5, ends[1][0]):  # a value, the message's length, its marker
        flipped = bytearray(data)
        flipped[place] ^= 0x40
        path.write_bytes(flipped)
        recording = read_recording(path)
        assert recording.complete and not recording.whole
        assert recording.damaged == ["batch 1 (rows 100 to 199): damaged"]
        assert_holds(recording, np.delete(rows, np.s_[100:200], axis=0))


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = record(tmp_path / "run-001.arrows", ticks(10))
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        RecordingWriter(path, "AEB", {})
    assert path.read_bytes() == before
    with pytest.raises(InputError, match="cannot be created"):
        RecordingWriter(tmp_path / "no folder" / "run-001.arrows", "AEB", {})


@pytest.mark.parametrize("braked, metadata", [("BA", {}), ("X", {}), ("AA", {}), ("A", {"x": object()})])
def test_a_recording_that_cannot_be_described_is_refused_before_a_file_exists(tmp_path, braked, metadata):
    with pytest.raises(InputError, match="recording"):
        RecordingWriter(tmp_path / "run-001.arrows", braked, metadata)
    assert not list(tmp_path.iterdir())


def test_an_exception_in_the_trial_keeps_its_ticks_without_an_end(tmp_path):
    rows = ticks(150)
    path = tmp_path / "run-001.arrows"
    with pytest.raises(ZeroDivisionError), RecordingWriter(path, "AEB", {}) as writer:
        writer.write(rows)
        raise ZeroDivisionError
    recording = read_recording(path)
    assert not recording.complete and recording.damaged == [] and recording.rows == 150
    with pytest.raises(ValueError, match="closed"):
        writer.write(rows)


def test_rows_reach_the_file_in_time_for_a_kill_and_the_disk_in_time_for_a_power_cut(tmp_path, monkeypatch):
    now, syncs = [100.0], []
    monkeypatch.setattr(recording_writer.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(recording_writer.os, "fsync", lambda handle: syncs.append(now[0]))
    path = tmp_path / "run-001.arrows"
    writer = RecordingWriter(path, "AEB", {})
    syncs.clear()
    for chunk in np.array_split(ticks(2000), 100):  # 20 ticks every 20 ms, as while a person moves
        now[0] += 0.02
        writer.write(chunk)
        assert writer.rows - writer.rows_written <= 120
    assert read_recording(path).rows >= 1880  # while it is still open
    assert 5 <= len(syncs) <= 8  # 2 s; at most every 0.25 s
    assert min(np.diff(syncs)) >= 0.25 and max(np.diff(syncs)) < 0.25 + 0.03
    writer.close()
    assert read_recording(path).rows == 2000


def test_rows_given_are_copied(tmp_path):
    ring, path = ticks(10), tmp_path / "run-001.arrows"
    rows = ring.copy()
    with RecordingWriter(path, "AEB", {}, sync=False) as writer:
        writer.write(ring)
        ring[:] = np.nan
    assert_holds(read_recording(path), rows)


def test_a_full_disk_is_said_and_leaves_whole_batches(tmp_path, monkeypatch):
    rows, path = ticks(3000), tmp_path / "run-001.arrows"
    writer = RecordingWriter(path, "AEB", {}, sync=False)
    writer.write(rows[:2000])
    write, room = os.write, [5000]

    def write_until_full(handle, data):
        taken = min(len(data), room[0])
        room[0] -= taken
        if not taken:
            raise OSError(28, "No space left on device")
        return write(handle, data[:taken])

    monkeypatch.setattr(recording_writer.os, "write", write_until_full)
    with pytest.raises(OSError, match="No space left"):
        writer.write(rows[2000:])
    writer.close({"status": "done"})  # has nothing left to do, and must not claim a whole recording
    recording = read_recording(path)
    assert recording.rows == 2000 and not recording.complete and recording.damaged == []


def test_a_tick_with_a_code_without_a_word_is_refused(tmp_path):
    for column, value in (
        (tick_log.DECISION, len(DECISIONS)),
        (tick_log.PHASE, 0.5),
        (tick_log.STUCK, -1),
        (tick_log.PHASE, np.nan),
    ):
        rows = ticks(1500)
        rows[3, column] = value
        writer = RecordingWriter(tmp_path / f"run-{column}-{value}.arrows", "AEB", {}, sync=False)
        with pytest.raises(ValueError, match="without a word"):
            writer.write(rows)
