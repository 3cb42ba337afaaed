"""`phd recover` keeps every whole batch of what a crash left, says what it was, and throws nothing away."""

import json
import operator
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from disks import flip_a_bit
from recorded import batch_ends
from refusals import refusal
from sessions import Killed, crash_in_trial, files, killing, of, run_trials, session_of

from app.cli import main
from experiments.recording.reader import read_recording
from experiments.recording.writer import save_as_parquet
from experiments.session import recover as recovery
from experiments.session.files import cell, hold_lock, read_stored, write_pooled_table
from experiments.session.recover import recover
from tests.support.rows import read_rows


@pytest.fixture(scope="module")
def crashed(tmp_path_factory) -> Path:
    """Two trials done, killed in the third, 4500 ticks in: it is in its movement."""
    data = tmp_path_factory.mktemp("recover") / "data"
    with session_of(data, 2) as session:
        crash_in_trial(session, ticks=4500)
    return data


@pytest.fixture
def data(crashed, tmp_path) -> Path:
    """A copy to recover."""
    return shutil.copytree(crashed, tmp_path / "data")


def test_a_trial_that_was_cut_off_keeps_every_whole_batch_and_is_marked_recovered(data, capsys):
    stream = of(data) / "trials" / "run-003.arrows"
    there, content = read_recording(stream), stream.read_bytes()
    before = files(data)
    assert main(["verify", str(data)]) == 1
    assert main(["recover", str(data)]) == 0
    assert main(["verify", str(data)]) == 0
    kept = read_recording(stream.with_suffix(".parquet"))
    assert kept.whole and kept.outcome["status"] == "recovered" and kept.metadata == there.metadata
    assert kept.rows == there.rows == 4500
    for name, values in there.columns.items():
        assert np.array_equal(kept.column(name), values, equal_nan=True), name
    assert stream.with_name("run-003.arrows.crashed").read_bytes() == content and not stream.exists()
    row = read_rows(of(data) / "trials.csv")[2]
    assert (row.run, row.status) == (3, "recovered")
    assert (
        row.value("duration_s") == pytest.approx(there.in_phase("move").sum() / 1000, abs=0.002)
        and row.value("path_error_m") > 0
    )
    replaced = "run-003", "trials.csv", "journal.end"
    untouched = {name: text for name, text in before.items() if not any(one in name for one in replaced)}
    after = files(data)
    assert all(
        after[name].startswith(text) if name.endswith("journal.jsonl") else after[name] == text
        for name, text in untouched.items()
    )
    assert json.loads(after["sub-01/ses-01/journal.jsonl"].splitlines()[-1])["event"] == "recovered"
    done = recover(data)  # again: nothing is left to do
    assert files(data) == after and not done["recovered"] and not done["faults"]


def test_wherever_the_stream_was_cut_what_is_whole_is_kept(data):
    stream = of(data) / "trials" / "run-003.arrows"
    content, ends = stream.read_bytes(), batch_ends(stream)
    generator = np.random.default_rng(1)
    table = of(data) / "trials.csv"
    table_before = table.read_bytes()
    cuts = {0, 5, ends[0][0] - 1, ends[0][0], ends[1][0] + 9, *map(int, generator.integers(0, len(content), 8))}
    for cut in sorted(cuts):
        stream.write_bytes(content[:cut])
        assert not recover(data)["faults"], cut
        whole = max((rows for end, rows in ends if end <= cut), default=None)
        row = read_rows(table)[2]
        assert row.status == "recovered", cut
        if whole is None:  # not even its header: the journal knows which trial it was
            assert row.recording == "" and cell(row) == cell(read_stored(of(data)).plan[2])
        else:
            assert read_recording(of(data) / row.recording).rows == whole, cut
            (of(data) / row.recording).unlink()
        assert stream.with_name("run-003.arrows.crashed").read_bytes() == content[:cut]
        stream.with_name("run-003.arrows.crashed").unlink()
        table.write_bytes(table_before)


def test_a_damaged_batch_is_left_out_and_the_rest_is_kept(data):
    stream = of(data) / "trials" / "run-003.arrows"
    ends = batch_ends(stream)
    flip_a_bit(stream, (ends[1][0] + ends[2][0]) // 2)
    done = recover(data)
    assert "batch 1 (rows 500 to 999): damaged" in done["recovered"][0] and not done["faults"]
    kept = read_recording(of(data) / "trials" / "run-003.parquet")
    assert kept.rows == 4000 and "batch 1" in kept.outcome["reason"]
    row = read_rows(of(data) / "trials.csv")[2]
    assert row.status == "recovered" and row.value("acceleration_dft_sum") is None  # no even grid, nothing to filter


def test_a_trial_that_was_closed_before_the_crash_counts_as_it_ended(tmp_path):
    for data in (tmp_path / "killed", tmp_path / "not"):
        with session_of(data, 1) as session:
            if data.name == "not":
                run_trials(session, 1)
            else:
                crash_in_trial(session, closed=True)
    done = recover(tmp_path / "killed")
    assert done["completed"] and not done["recovered"] and not done["faults"]
    table = Path("sub-01", "ses-01", "trials.csv")
    assert (tmp_path / "killed" / table).read_bytes() == (tmp_path / "not" / table).read_bytes()


@pytest.mark.parametrize("step", ["save_as_parquet", "set_aside", "append_row", "journal.write_event"])
@pytest.mark.parametrize("when", ["before", "after"])
def test_a_crash_while_recovering_is_recovered_from(data, monkeypatch, step, when):
    kill = killing(operator.attrgetter(step)(recovery) if when == "after" else None)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(f"experiments.session.{'' if '.' in step else 'recover.'}{step}", kill)
        recover(data)
    assert not recover(data)["faults"]
    rows = read_rows(of(data) / "trials.csv")
    assert [(row.run, row.status) for row in rows][2:] == [(3, "recovered")]
    assert read_recording(of(data) / rows[2].recording).rows == 4500
    names = [path.name for path in (of(data) / "trials").iterdir()]
    assert sorted(names)[-2:] == ["run-003.arrows.crashed", "run-003.parquet"] and len(names) == 4


def test_half_written_copies_are_removed_even_where_they_are_a_second_name_of_a_whole_file(data):
    trials = of(data) / "trials"
    os.link(trials / "run-001.parquet", trials / ".run-001.parquet.partial")
    (of(data) / ".trials.csv.partial").write_text("part")
    kept = (trials / "run-001.parquet").read_bytes()
    assert len(recover(data)["removed"]) == 2
    assert not list(data.rglob(".*.partial")) and (trials / "run-001.parquet").read_bytes() == kept


def test_a_table_that_is_lost_or_spoilt_is_made_again_from_the_recordings(data):
    recover(data)
    table = of(data) / "trials.csv"
    right = table.read_bytes()
    write_pooled_table(data)
    pooled = (data / "trials.csv").read_bytes()
    table.write_bytes(b"spoilt")
    (data / "trials.csv").write_bytes(b"spoilt too")
    assert not recover(data)["faults"]
    assert table.read_bytes() == right and table.with_name("trials.csv.damaged").read_bytes() == b"spoilt"
    assert (data / "trials.csv").read_bytes() == pooled
    table.unlink()
    assert not recover(data)["faults"] and table.read_bytes() == right


def test_what_cannot_be_rescued_is_named_and_left_as_it_is(data, capsys):
    recover(data)
    path = of(data) / "trials" / "run-001.parquet"
    path.write_bytes(path.read_bytes()[:-100])
    before = files(data)
    assert main(["recover", str(data)]) == 1
    assert "run-001.parquet" in capsys.readouterr().out and files(data) == before


def spoil(data: Path, **outcome) -> None:
    """The first trial's force is not a number from some tick on; outcome: what else its end record says."""
    path = of(data) / "trials" / "run-001.parquet"
    there = read_recording(path)
    force = there.column("hand_fx_N").copy()
    force[-300:] = np.nan
    path.unlink()
    columns, outcome = {**there.columns, "hand_fx_N": force}, {**there.outcome, **outcome}
    save_as_parquet(replace(there, columns=columns, outcome=outcome), path, sync=False)


def test_one_recording_that_can_give_no_row_keeps_no_other_trial_from_its_row(data):
    """A trial that counts, with a force that is not a number in it; the trials behind it have lost their rows."""
    spoil(data)
    (of(data) / "trials.csv").unlink()
    done = recover(data)
    assert [row.run for row in read_rows(of(data) / "trials.csv")] == [2, 3]
    assert done["rows_added"] == [f"sub-01/ses-01/trials.csv: run {run}" for run in ("2, done", "3, recovered")]
    (told,) = done["not_rescued"]
    assert "run-001.parquet: hand_fx_N: the sample of tick" in told and done["faults"]
    once = files(data)
    recover(data)
    assert files(data) == once


@pytest.mark.parametrize("status", ["aborted", "stopped", "recovered"])
def test_a_trial_that_a_bad_force_cut_short_has_a_row_without_measures(data, status):
    spoil(data, status=status)
    (of(data) / "trials.csv").unlink()
    assert not recover(data)["faults"]
    rows = read_rows(of(data) / "trials.csv")
    assert [row.run for row in rows] == [1, 2, 3] and rows[0].status == status
    assert (
        rows[0].value("duration_s") is None
        and rows[0].value("path_error_m") is None
        and rows[1].value("path_error_m") > 0
    )


def test_a_session_that_a_live_process_holds_is_refused_and_not_touched(data, capsys):
    before = files(data)
    with hold_lock(of(data)) as lock:
        assert "is using this folder" in refusal(capsys, "recover", data)
    assert not lock.is_locked
    assert {name: text for name, text in files(data).items() if name != ".lock"} == before
    assert main(["recover", str(data)]) == 0
