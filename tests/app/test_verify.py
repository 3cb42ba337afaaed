"""`phd verify` names everything that is damaged, missing or contradicted, and nothing that is not."""

import json
import shutil
from pathlib import Path

import pytest
from disks import flip_a_bit
from recorded import batch_ends
from refusals import refusal
from sessions import closed_session, crash_in_trial, files, new_session, run

from app.cli import main
from experiments.session.files import write_pooled_table
from experiments.session.verify import verify


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study folder with one session, three trials done and the plan unfinished."""
    data = tmp_path_factory.mktemp("verify") / "data"
    closed_session(data, 3)
    write_pooled_table(data)
    return data


@pytest.fixture
def data(whole, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(whole, tmp_path / "data")


def faults(data):
    """file -> what is wrong with it."""
    found: dict[str, list[str]] = {}
    for fault in verify(data)["faults"]:
        found.setdefault(fault["file"], []).append(fault["fault"])
    return found


def test_a_whole_session_with_an_unfinished_plan_has_no_fault_and_is_not_touched(data, capsys):
    before = files(data)
    assert main(["verify", str(data), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["faults"] == [] and (said["sessions"], said["whole"], said["recovered"]) == (1, 3, 0)
    assert main(["verify", str(data / "sub-01" / "ses-01")]) == 0  # the session itself
    assert files(data) == before


def test_a_folder_that_was_hardly_begun_has_no_fault_and_is_said_to_be_empty(tmp_path, capsys):
    for verb in ("verify", "recover"):
        assert main([verb, str(tmp_path)]) == 0
        assert capsys.readouterr().err == f"warning: {tmp_path}: holds no session yet\n"
        assert not list(tmp_path.iterdir())
    (tmp_path / ".study.json.partial").write_text('{"opera')
    (tmp_path / "sub-01" / "ses-01" / "trials").mkdir(parents=True)
    (tmp_path / "sub-01" / "ses-01" / ".session.json.partial").write_text('{"pl')
    assert main(["verify", str(tmp_path)]) == 0


def test_a_folder_of_other_files_or_none_at_all_is_wrong_input(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").touch()
    for folder in (tmp_path / "photos", tmp_path / "none", tmp_path / "photos" / "a.png"):
        for verb in ("verify", "recover"):
            refusal(capsys, verb, folder)
    assert files(tmp_path) == {"photos/a.png": b""}


def test_every_damaged_batch_of_a_stream_is_named(tmp_path):
    session = new_session(tmp_path)
    stream = crash_in_trial(session, ticks=3000)  # a batch each 500 ticks
    ends = batch_ends(stream)
    for batch in (1, 4):
        flip_a_bit(stream, (ends[batch][0] + ends[batch + 1][0]) // 2, 4)
    name = stream.relative_to(tmp_path).as_posix()
    said = faults(tmp_path)[name]
    assert said[0] == "batch 1 (rows 500 to 999): damaged" and said[1] == "batch 4 (rows 2000 to 2499): damaged"
    assert "cut off" in said[2]


SESSION, TABLE = "sub-01/ses-01", "sub-01/ses-01/trials.csv"
ONE, TWO, THREE = (f"{SESSION}/trials/run-00{run}.parquet" for run in (1, 2, 3))


def edited(data: Path, name: str, old: str, new: str) -> None:
    (data / name).write_text((data / name).read_text().replace(old, new, 1))


def without_last_row(data: Path) -> None:
    (data / TABLE).write_text("".join((data / TABLE).read_text().splitlines(True)[:-1]))


def exchanged(data: Path) -> None:
    for old, new in ((ONE, "x"), (TWO, ONE), ("x", TWO)):
        (data / old).rename(data / new)


SPOILT = {
    "a changed bit": (lambda d: flip_a_bit(d / THREE), THREE, "file: "),
    "recording gone": (lambda d: (d / TWO).unlink(), TWO, "missing: trials.csv names it"),
    "recording and row gone": (
        lambda d: ((d / THREE).unlink(), without_last_row(d)), THREE.removesuffix(".parquet"), "missing: the journal",
    ),
    "row gone": (without_last_row, TABLE, "has no row for run 3"),
    "number changed": (lambda d: edited(d, TABLE, ",1,done,0.0", ",1,done,0.1"), TABLE, "path_error_m is 0.1"),
    "status changed": (
        lambda d: edited(d, TABLE, ",done,", ",timeout,"), TABLE, "run 1: status is timeout, its recording gives done",
    ),
    "recordings exchanged": (exchanged, ONE, "says that it is run 2"),
    "table unreadable": (lambda d: (d / TABLE).write_bytes(b"\x00\xff"), TABLE, "cannot be read"),
    "plan changed": (
        lambda d: edited(d, f"{SESSION}/session.json", '"controller": 1', '"controller": 2'),
        f"{SESSION}/session.json", "does not match its checksum",
    ),
    "session.json gone": (
        lambda d: (d / SESSION / "session.json").unlink(), f"{SESSION}/session.json", "cannot be read",
    ),
    "session gone": (lambda d: shutil.rmtree(d / "sub-01"), "trials.csv", "run 1 of participant 01: no session's"),
}  # fmt: skip


@pytest.mark.parametrize("spoil, file, says", SPOILT.values(), ids=SPOILT)
def test_what_is_missing_or_contradicted_is_named(data, capsys, spoil, file, says):
    spoil(data)
    assert main(["verify", str(data)]) == 1
    assert any(line.startswith(f"{file}: ") and says in line for line in capsys.readouterr().out.splitlines())


def test_a_trial_in_progress_is_no_fault_while_its_process_lives(tmp_path):
    session = new_session(tmp_path)
    trial, writer = session.begin(session.next_planned())
    run(trial, writer, 1500)
    found = verify(tmp_path)
    assert found["faults"] == [] and found["in_progress"] == 1 and found["in_use"] == 1
    session.close()  # as the end of the process would
    assert "cut off" in faults(tmp_path)["sub-01/ses-01/trials/run-001.arrows"][0]
    writer.abandon()
