"""Recordings: written as a stream while a trial runs, kept as Parquet once closed and verified, read from either.

`recording_form` says what is in one, `recording_writer` how it grows, `recording_reader` what survives damage.
"""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from core.errors import InputError
from experiments.recording.atomic_files import give_new_name, written_beside
from experiments.recording.reader import PARQUET_SUFFIX, STREAM_SUFFIX, read_parquet
from experiments.recording.reader import read_recording as read_recording
from experiments.recording.schema import SEAL, TEXT_COLUMNS, make_schema, same_content, seal
from experiments.recording.schema import Recording as Recording
from experiments.recording.schema import recording_columns as recording_columns
from experiments.recording.writer import RecordingWriter as RecordingWriter


def convert_to_parquet(path: str | Path, sync: bool = True) -> Path:
    """Turn a closed, undamaged stream into Parquet, compare the two, remove the stream; returns the new path.

    Never overwrites: a Parquet file that is there already must hold the same (then only the stream is removed).
    InputError if the stream is cut, damaged, or the other file differs; the stream then stays.
    """
    path = Path(path)
    target = path.with_suffix(PARQUET_SUFFIX)
    if path.suffix != STREAM_SUFFIX:
        raise InputError(f"{path}: only a {STREAM_SUFFIX} stream can be converted")
    stream = read_recording(path)
    if stream.damaged:
        raise InputError(f"{path}: damaged, not converted: {'; '.join(stream.damaged)}")
    if not stream.complete:
        raise InputError(f"{path}: has no end record, not converted")
    save_as_parquet(stream, target, sync)
    path.unlink()
    return target


def save_as_parquet(recording: Recording, target: Path, sync: bool = True) -> None:
    """Write a recording as Parquet and read it back to compare; one that is there already must hold the same.

    InputError if the file that is there differs (neither is touched); OSError if it cannot be written.
    """
    if not target.exists():
        with written_beside(target, _parquet_bytes(recording), sync) as partial:
            back = read_parquet(partial)
            if not back.whole or not same_content(back, recording):
                raise OSError(f"{partial}: what was read back differs from {recording.path.name}")
            give_new_name(partial, target)
    else:
        there = read_parquet(target)
        if not there.whole or not same_content(there, recording):
            raise InputError(
                f"{target}: exists already and differs from {recording.path.name}, neither was touched"
            )


def _parquet_bytes(recording: Recording) -> bytes:
    schema = make_schema(
        recording.braked, recording.metadata, recording.words["decision"], recording.sensors, recording.columns
    )
    arrays = [
        pa.DictionaryArray.from_arrays(pa.array(codes), pa.array(recording.words[name], pa.string()))
        if name in TEXT_COLUMNS
        else pa.array(codes)
        for name, codes in recording.columns.items()
    ]
    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(
        sink,
        schema,
        compression="snappy",  # on noisy doubles zstd saves a tenth of the space for twice the time
        use_dictionary=list(TEXT_COLUMNS),
        use_byte_stream_split=[name for name in recording.columns if name not in TEXT_COLUMNS],  # a fifth smaller
        write_statistics=False,
    ) as writer:
        writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
        about: dict[str, Any] = {"outcome": json.dumps(recording.outcome, sort_keys=True), "crc32": SEAL.decode()}
        writer.add_key_value_metadata(about)
    data = sink.getvalue().to_pybytes()
    footer = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    return seal(data, footer)
