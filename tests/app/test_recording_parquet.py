"""A closed recording as Parquet: the same in every bit, never in another's place, and what is no recording."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recorded import NAMES, record, ticks

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.recording.reader import read_recording
from experiments.recording.schema import same_content
from experiments.recording.writer import convert_to_parquet


def test_parquet_holds_the_same_as_the_stream_which_then_goes(tmp_path):
    rows = ticks(2345)
    rows[5, tick_log.HAND_FX], rows[6, tick_log.HAND_FX] = np.nan, -0.0
    path = record(tmp_path / "run-001.arrows", rows, "AEBC")
    stream = read_recording(path)
    target = convert_to_parquet(path)
    assert target == tmp_path / "run-001.parquet" and sorted(tmp_path.iterdir()) == [target]
    back = read_recording(target)
    assert back.whole and same_content(back, stream)
    table = pq.read_table(target)  # any Parquet reader
    assert table.column_names == NAMES and table.num_rows == 2345
    assert table.column("decision").to_pylist() == list(stream.text("decision"))
    assert json.loads(table.schema.metadata[b"phd"])["metadata"] == {"participant": "01"}


@pytest.mark.parametrize("count", [0, 1])
def test_a_recording_of_hardly_anything_survives_conversion(tmp_path, count):
    path = record(tmp_path / "run-001.arrows", ticks(count))
    assert read_recording(path).whole
    back = read_recording(convert_to_parquet(path))
    assert back.whole and back.rows == count and back.words["decision"] == DECISIONS


def test_conversion_never_overwrites_and_finishes_what_a_crash_left(tmp_path):
    rows = ticks(100)
    stream = record(tmp_path / "run-001.arrows", rows)
    data = stream.read_bytes()
    target = convert_to_parquet(stream)
    kept = target.read_bytes()
    stream.write_bytes(data)  # as if killed between naming the new file and removing the stream
    (tmp_path / ".run-001.parquet.partial").write_bytes(b"half")
    assert convert_to_parquet(stream) == target
    assert target.read_bytes() == kept and not stream.exists()

    other = record(tmp_path / "run-001.arrows", ticks(100, seed=5))
    with pytest.raises(InputError, match="differs"):
        convert_to_parquet(other)
    assert target.read_bytes() == kept and other.exists()


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
