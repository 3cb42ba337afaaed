"""A recording gives back what was written, every tick of it, or names what is missing; as Parquet it is the same."""

import contextlib
import json
import shutil
import sys
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from disks import fill_up, full
from recorded import NAMES, assert_holds, batch_ends, record, ticks

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.recording import atomic_files
from experiments.recording import writer as recording_writer
from experiments.recording.atomic_files import TRIES, retry_while_locked
from experiments.recording.reader import read_recording
from experiments.recording.schema import same_content
from experiments.recording.writer import RecordingWriter, convert_to_parquet
from tests.support.rows import write_rows


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run-001.arrows"


def flip(data: bytes, place: int, bit: int) -> bytes:
    flipped = bytearray(data)
    flipped[place] ^= 1 << bit
    return bytes(flipped)


@pytest.mark.parametrize("braked", ["AEBC", "AEB", "A", "", "BC"])
def test_columns_are_the_promised_ones_without_those_of_missing_brakes(path, braked):
    rows = ticks(50)
    recording = read_recording(record(path, rows, braked))
    missing = {f"{kind}_{joint}_{unit}" for joint in "AEBC" if joint not in braked
               for kind, unit in (("current", "A"), ("torque", "N_m"))}  # fmt: skip
    promised = [name for name in NAMES if name not in missing]
    assert list(recording.columns)[: len(promised)] == promised and not missing & set(recording.columns)
    assert_holds(recording, rows)


def test_reading_back_gives_every_tick_the_words_metadata_and_outcome(path):
    rows = ticks(3456)
    rows[7, tick_log.HAND_FX] = np.nan  # a sensor that failed is recorded as it was
    rows[8, tick_log.HAND_FX] = -np.inf
    recording = read_recording(record(path, rows, pieces=7, outcome={"status": "timeout"}))
    assert recording.whole and recording.rows == 3456
    assert_holds(recording, rows)
    assert recording.metadata == {"participant": "01"} and recording.outcome == {"status": "timeout"}
    assert list(recording.text("decision")) == [DECISIONS[int(code)] for code in rows[:, tick_log.DECISION]]
    assert list(recording.text("stuck")) == [tick_log.STUCK_LETTERS[int(code)] for code in rows[:, tick_log.STUCK]]
    assert np.array_equal(recording.in_phase("move"), rows[:, tick_log.PHASE] == tick_log.MOVE)
    with pytest.raises(InputError, match="current_C_A"):
        recording.column("current_C_A")


def test_any_arrow_program_reads_the_stream_its_end_record_and_the_zip_checksum_of_each_batch(path):
    data = record(path, ticks(2500)).read_bytes()
    source = pa.BufferReader(data)
    stream, start, batches = pa.ipc.open_stream(source), batch_ends(path)[0][0], []
    with pytest.raises(StopIteration):
        while True:
            batches.append(stream.read_next_batch_with_custom_metadata())
            message, start = data[start : source.tell()], source.tell()
            digits = batches[-1][1]["crc32"]
            assert message.count(digits) == 1
            assert int(digits, 16) == zlib.crc32(message.replace(digits, b"\x18" * 8))
    *ticks_of, (last, about) = batches
    assert [batch.num_rows for batch, _ in ticks_of] == [1000, 1000, 500]
    assert last.num_rows == 0 and last.schema == ticks_of[0][0].schema and about["end"] == b"end"
    assert [int(about["sequence"]) for _, about in batches] == [0, 1, 2, 3]
    assert [int(about["first_row"]) for _, about in batches] == [0, 1000, 2000, 2500]
    assert ticks_of[0][0].schema.field("phase").type == pa.dictionary(pa.int8(), pa.string())


def test_a_stream_cut_anywhere_gives_back_every_whole_batch_and_lacks_its_end(path):
    rows = ticks(700)
    data, ends = record(path, rows, pieces=5, flush=True).read_bytes(), batch_ends(path)
    generator = np.random.default_rng(1)
    edges = [end + shift for end, _ in ends for shift in (-1, 0, 1)]
    cuts = {0, 1, len(data) - 1, len(data) - 8, *edges, *map(int, generator.integers(0, len(data), 120))}
    for cut in sorted(cut for cut in cuts if cut < len(data)):
        path.write_bytes(data[:cut])
        recording = read_recording(path)
        whole = max((count for end, count in ends if end <= cut), default=0)
        assert not recording.complete and not recording.whole and recording.rows == whole, cut
        if whole:
            assert_holds(recording, rows[:whole])
        if cut >= ends[0][0]:
            assert recording.damaged == [], cut  # a clean cut is no damage
        with pytest.raises(InputError, match="not converted"):
            convert_to_parquet(path)


def test_a_parquet_file_cut_anywhere_is_not_whole(path):
    path = convert_to_parquet(record(path, ticks(600))).path
    data = path.read_bytes()
    for cut in np.random.default_rng(7).integers(0, len(data), 150):
        path.write_bytes(data[:cut])
        assert not read_recording(path).whole, cut


@pytest.mark.parametrize("suffix", [".arrows", ".parquet"])
def test_no_changed_bit_goes_unnoticed_and_no_changed_row_is_returned(path, suffix):
    rows = ticks(300)
    record(path, rows, pieces=3, flush=True)
    header_end = batch_ends(path)[0][0]
    if suffix == ".parquet":
        path = convert_to_parquet(path).path
    data = path.read_bytes()
    generator = np.random.default_rng(2)
    places = {*map(int, generator.integers(0, len(data), 250)), *range(len(data) - 60, len(data))}
    if suffix == ".arrows":
        places |= {*range(0, header_end, 29), *range(header_end, header_end + 2000, 13)}
    for place in sorted(places):
        path.write_bytes(flip(data, place, int(generator.integers(8))))
        recording = read_recording(path)
        assert not recording.whole, place
        if suffix == ".arrows" and recording.rows:  # what is returned is a selection of the true rows
            kept = np.searchsorted(rows[:, tick_log.T], recording.column("t_s"))
            assert len(kept) >= 200
            assert_holds(recording, rows[kept])


def test_damage_inside_costs_one_batch_and_names_it(path):
    rows = ticks(500)
    data, ends = record(path, rows, pieces=5, flush=True).read_bytes(), batch_ends(path)
    for place in (ends[2][0] - 30, ends[1][0] + 5, ends[1][0]):  # a value, the message's length, its marker
        path.write_bytes(flip(data, place, 6))
        recording = read_recording(path)
        assert recording.complete and recording.damaged == ["batch 1 (rows 100 to 199): damaged"]
        assert_holds(recording, np.delete(rows, np.s_[100:200], axis=0))


def test_an_existing_file_is_never_overwritten(path, tmp_path):
    before = record(path, ticks(10)).read_bytes()
    with pytest.raises(InputError, match="exists already"):
        RecordingWriter(path, "AEB", {})
    assert path.read_bytes() == before
    with pytest.raises(InputError, match="cannot be created"):
        RecordingWriter(tmp_path / "no folder" / "run-001.arrows", "AEB", {})


@pytest.mark.parametrize("braked, metadata", [("BA", {}), ("X", {}), ("AA", {}), ("A", {"x": object()})])
def test_a_recording_that_cannot_be_described_is_refused_before_a_file_exists(path, braked, metadata):
    with pytest.raises(InputError, match="recording"):
        RecordingWriter(path, braked, metadata)
    assert not path.exists()


def test_an_exception_in_the_trial_keeps_its_ticks_without_an_end(path):
    rows = ticks(150)
    ring = rows.copy()
    with pytest.raises(ZeroDivisionError), RecordingWriter(path, "AEB", {}) as writer:
        writer.write(ring)
        ring[:] = np.nan  # what was given was copied
        raise ZeroDivisionError
    recording = read_recording(path)
    assert not recording.complete and recording.damaged == []
    assert_holds(recording, rows)
    with pytest.raises(ValueError, match="closed"):
        writer.write(rows)


def test_rows_reach_the_file_in_time_for_a_kill_and_the_disk_in_time_for_a_power_cut(path, monkeypatch):
    now, syncs = [100.0], []
    monkeypatch.setattr(recording_writer.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(recording_writer.os, "fsync", lambda handle: syncs.append(now[0]))
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


def take_away(path, way):
    """In the middle of a recording: its file, its folder, or the disk that the folder is on."""
    if way == "the file":
        path.unlink()
    elif way == "the folder":
        shutil.rmtree(path.parent)
    else:
        path.parent.rename(path.parent.with_name("elsewhere"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no file that is in use")
@pytest.mark.parametrize("way", ["the file", "the folder", "the disk"])
def test_a_recording_whose_file_vanishes_says_so_once_and_is_saved_whole_when_there_is_a_place_again(tmp_path, way):
    path = tmp_path / "trials" / "run-001.arrows"
    path.parent.mkdir()
    rows, writer = ticks(5000), RecordingWriter(path, "AEB", {})
    writer.write(rows[:1000])
    take_away(path, way)
    with pytest.raises(FileNotFoundError):
        writer.write(rows[1000:2000])
    for piece in np.array_split(rows[2000:], 7):
        writer.write(piece)  # said once: from now on the ticks go to memory
    with pytest.raises(FileNotFoundError):
        writer.close({"status": "done"})
    assert writer.lost == 0 and not writer.is_stored() and not path.exists()
    if way == "the folder":
        with pytest.raises(InputError):
            writer.save(path.parent / "not there" / "trials" / path.name)
    elif way == "the disk":
        path.parent.with_name("elsewhere").rename(path.parent)  # with what was written until then
        assert 0 < read_recording(path).rows < 5000
    writer.save()
    assert writer.is_stored()
    recording = read_recording(path)
    assert recording.whole and recording.outcome == {"status": "done"}
    assert_holds(recording, rows)


@pytest.mark.parametrize("room", [0, 300, 20_000, 200_000])
def test_wherever_a_disk_is_full_no_tick_is_lost_once_it_has_room(path, room):
    rows, writer = ticks(4000), RecordingWriter(path, "AEB", {})
    with pytest.MonkeyPatch.context() as patch:
        fill_up(patch, room)
        with contextlib.suppress(OSError):
            writer.write(rows[:1500])
        with contextlib.suppress(OSError):
            writer.write(rows[1500:])
        with pytest.raises(OSError, match="No space left"):
            writer.close({"status": "done"})
        with pytest.raises(OSError, match="No space left"):
            full_save(writer, patch)
    writer.save()
    assert_holds(read_recording(path), rows)
    assert read_recording(path).whole and list(path.parent.iterdir()) == [path]


def full_save(writer, patch):
    patch.setattr("experiments.recording.atomic_files.written_beside", full)
    writer.save()


def test_what_stands_where_a_recording_in_memory_belongs_is_set_aside(tmp_path):
    path = tmp_path / "trials" / "run-001.arrows"
    path.parent.mkdir()
    writer = RecordingWriter(path, "AEB", {})
    shutil.rmtree(path.parent)
    with pytest.raises(FileNotFoundError):
        writer.close()
    path.parent.mkdir()
    path.write_bytes(b"somebody else's")
    writer.save()
    assert path.with_name("run-001.arrows.other").read_bytes() == b"somebody else's" and read_recording(path).whole


def test_ticks_that_neither_disk_nor_memory_takes_are_counted_and_the_recording_does_not_claim_to_be_whole(
    path, monkeypatch
):
    rows, writer = ticks(4000), RecordingWriter(path, "AEB", {}, sync=False)
    writer.write(rows[:1000])
    monkeypatch.setattr(recording_writer, "MOST_IN_MEMORY", writer.bytes_written + 1000)
    with monkeypatch.context() as patch:
        fill_up(patch, 0)
        with pytest.raises(OSError, match="No space left"):
            writer.write(rows[1000:2000])
        assert writer.lost == 0
        writer.write(rows[2000:3500])
        assert writer.lost == 1500 and writer.rows == 3500
        with pytest.raises(OSError, match="No space left"):
            writer.close({"status": "done"})
    writer.save()
    kept = read_recording(path)
    assert not kept.complete and kept.rows == 2000 == writer.rows - writer.lost


def test_a_recording_too_long_for_memory_is_in_its_file_and_what_comes_after_the_disk_is_counted_as_lost(
    path, monkeypatch
):
    monkeypatch.setattr(recording_writer, "MOST_IN_MEMORY", 10_000)
    rows, writer = ticks(3000), RecordingWriter(path, "AEB", {}, sync=False)
    writer.write(rows[:2000])
    fill_up(monkeypatch, 0)
    with pytest.raises(OSError, match="No space left"):
        writer.write(rows[2000:])
    assert (writer.lost, writer.rows_written) == (1000, 2000)
    with pytest.raises(OSError, match="No space left"):
        writer.close({"status": "done"})
    with pytest.raises(InputError, match="not in memory"):
        writer.save()
    assert read_recording(path).rows == 2000 and not read_recording(path).complete


@pytest.mark.parametrize("column, value", [
    (tick_log.DECISION, len(DECISIONS)), (tick_log.PHASE, 0.5), (tick_log.STUCK, -1), (tick_log.PHASE, np.nan)
])  # fmt: skip
def test_a_tick_with_a_code_without_a_word_is_refused(path, column, value):
    rows = ticks(1500)
    rows[3, column] = value
    with pytest.raises(ValueError, match="without a word"):
        RecordingWriter(path, "AEB", {}, sync=False).write(rows)


def test_parquet_holds_the_same_as_the_stream_which_then_goes(path, tmp_path):
    rows = ticks(2345)
    rows[5, tick_log.HAND_FX], rows[6, tick_log.HAND_FX] = np.nan, -0.0
    stream = read_recording(record(path, rows, "AEBC"))
    returned = convert_to_parquet(path)
    target = returned.path
    assert target == tmp_path / "run-001.parquet" and sorted(tmp_path.iterdir()) == [target]
    back = read_recording(target)
    assert back.whole and same_content(back, stream) and same_content(back, returned)
    table = pq.read_table(target)  # any Parquet reader
    assert table.column_names[: len(NAMES)] == list(NAMES) and table.num_rows == 2345
    assert table.column("decision").to_pylist() == list(stream.text("decision"))
    assert json.loads(table.schema.metadata[b"phd"])["metadata"] == {"participant": "01"}


@pytest.mark.parametrize("count", [0, 1])
def test_a_recording_of_hardly_anything_survives_conversion(path, count):
    assert read_recording(record(path, ticks(count))).whole
    back = convert_to_parquet(path)
    assert back.whole and back.rows == count and back.words["decision"] == DECISIONS


def test_conversion_never_overwrites_and_finishes_what_a_crash_left(path, tmp_path):
    data = record(path, ticks(100)).read_bytes()
    target = convert_to_parquet(path).path
    kept = target.read_bytes()
    path.write_bytes(data)  # as if killed between naming the new file and removing the stream
    (tmp_path / ".run-001.parquet.partial").write_bytes(b"half")
    assert convert_to_parquet(path).path == target
    assert target.read_bytes() == kept and not path.exists()
    record(path, ticks(100, seed=5))
    with pytest.raises(InputError, match="differs"):
        convert_to_parquet(path)
    assert target.read_bytes() == kept and path.exists()


def test_same_content_looks_at_every_bit_and_word(tmp_path):
    recordings = []
    for k, change in enumerate([None, (tick_log.TIP_X, 1e-300), (tick_log.TIP_X, -0.0), (tick_log.DECISION, 1.0)]):
        rows = ticks(20)
        rows[3, [tick_log.TIP_X, tick_log.DECISION]] = 0.0
        if change:
            rows[3, change[0]] = change[1]
        recordings.append(read_recording(record(tmp_path / f"run-{k}.arrows", rows)))
    first, *others = recordings
    assert same_content(first, first) and not any(same_content(first, other) for other in others)


def test_what_is_no_recording_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "x.txt").write_text("x")
    for path in (tmp_path / "x.txt", tmp_path / "none.arrows", tmp_path / "none.parquet"):
        with pytest.raises(InputError, match=path.name):
            read_recording(path)
    pq.write_table(pa.table({"t_s": [0.0]}), tmp_path / "foreign.parquet")
    foreign = read_recording(tmp_path / "foreign.parquet")
    assert foreign.rows == 0 and foreign.damaged and not foreign.complete


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


@pytest.mark.parametrize("winerror", [5, 32, 33])
def test_it_is_tried_again_until_it_is_free(waits: list[float], winerror: int) -> None:
    refusals, done = [refused(winerror)] * 3, []

    def do(word: str) -> None:
        if refusals:
            raise refusals.pop(0)
        done.append(word)

    retry_while_locked(do, "once")
    assert done == ["once"] and len(waits) == 3


def test_the_tries_are_bounded_and_end_in_one_sentence(waits: list[float], tmp_path: Path, monkeypatch) -> None:
    tries: list[tuple] = []

    def never(*arguments: object) -> None:
        tries.append(arguments)
        raise refused(32)

    monkeypatch.setattr(atomic_files.os, "replace", never)
    with pytest.raises(InputError, match=r"^.*trials\.csv: cannot be written \(another program has it open"):
        write_rows(tmp_path / "trials.csv", [], replacing=True)
    assert len(tries) == TRIES == len(waits) + 1
    assert not list(tmp_path.iterdir())


def test_a_file_that_may_not_be_touched_at_all_is_refused_at_once(waits: list[float]) -> None:
    def do() -> None:
        raise refused(None)

    with pytest.raises(PermissionError, match="denied"):
        retry_while_locked(do)
    assert not waits
