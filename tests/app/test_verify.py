"""`phd verify` names everything that is damaged, missing or contradicted, and nothing that is not."""

import json
import shutil

import pytest
from recorded import batch_ends
from sessions import crash_in_trial, files, new_session, run, session_of

from app.cli import main
from experiments.session.files import write_pooled_table
from experiments.session.verify import verify


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study folder with one session, three trials done and the plan unfinished."""
    data = tmp_path_factory.mktemp("verify") / "data"
    with session_of(data, 3):
        pass
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


def test_a_folder_that_was_hardly_begun_has_no_fault(tmp_path, capsys):
    assert main(["verify", str(tmp_path)]) == 0
    (tmp_path / ".study.json.partial").write_text('{"opera')
    (tmp_path / "sub-01" / "ses-01" / "trials").mkdir(parents=True)
    (tmp_path / "sub-01" / "ses-01" / ".session.json.partial").write_text('{"pl')
    assert main(["verify", str(tmp_path)]) == 0


def test_a_folder_of_other_files_or_none_at_all_is_wrong_input(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").touch()
    for folder in (tmp_path / "photos", tmp_path / "none", tmp_path / "photos" / "a.png"):
        for verb in ("verify", "recover"):
            assert main([verb, str(folder)]) == 2
            assert capsys.readouterr().err.count("\n") == 1
    assert files(tmp_path) == {"photos/a.png": b""}


def test_every_damaged_batch_of_a_stream_is_named(tmp_path):
    session = new_session(tmp_path)
    stream = crash_in_trial(session, ticks=3000)  # a batch each 500 ticks
    ends = batch_ends(stream)
    content = bytearray(stream.read_bytes())
    for batch in (1, 4):
        content[(ends[batch][0] + ends[batch + 1][0]) // 2] ^= 16
    stream.write_bytes(content)
    name = stream.relative_to(tmp_path).as_posix()
    said = faults(tmp_path)[name]
    assert said[0] == "batch 1 (rows 500 to 999): damaged" and said[1] == "batch 4 (rows 2000 to 2499): damaged"
    assert "cut off" in said[2]


def change_a_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)


def drop_last_row(session):
    table = session / "trials.csv"
    table.write_text("".join(table.read_text().splitlines(True)[:-1]))


SPOILT = {
    "a changed bit": (
        lambda s: change_a_bit(s / "trials" / "run-003.parquet"),
        "sub-01/ses-01/trials/run-003.parquet",
        "file: ",
    ),
    "recording gone": (
        lambda s: (s / "trials" / "run-002.parquet").unlink(),
        "sub-01/ses-01/trials/run-002.parquet",
        "missing: trials.csv names it",
    ),
    "recording and row gone": (
        lambda s: ((s / "trials" / "run-003.parquet").unlink(), drop_last_row(s)),
        "sub-01/ses-01/trials/run-003",
        "missing: the journal",
    ),
    "row gone": (drop_last_row, "sub-01/ses-01/trials.csv", "has no row for run 3"),
    "number changed": (
        lambda s: (s / "trials.csv").write_text((s / "trials.csv").read_text().replace(",1,done,0.0", ",1,done,0.1")),
        "sub-01/ses-01/trials.csv",
        "path_error_m is 0.1",
    ),
    "status changed": (
        lambda s: (s / "trials.csv").write_text((s / "trials.csv").read_text().replace(",done,", ",timeout,", 1)),
        "sub-01/ses-01/trials.csv",
        "run 1: status is timeout, its recording gives done",
    ),
    "recordings exchanged": (
        lambda s: (
            (s / "trials" / "run-001.parquet").rename(s / "x"),
            (s / "trials" / "run-002.parquet").rename(s / "trials" / "run-001.parquet"),
            (s / "x").rename(s / "trials" / "run-002.parquet"),
        ),
        "sub-01/ses-01/trials/run-001.parquet",
        "says that it is run 2",
    ),
    "table unreadable": (
        lambda s: (s / "trials.csv").write_bytes(b"\x00\xff"),
        "sub-01/ses-01/trials.csv",
        "cannot be read",
    ),
    "plan changed": (
        lambda s: (s / "session.json").write_text(
            (s / "session.json").read_text().replace('"controller": 1', '"controller": 2', 1)
        ),
        "sub-01/ses-01/session.json",
        "plan_sha256",
    ),
    "session.json gone": (lambda s: (s / "session.json").unlink(), "sub-01/ses-01/session.json", "cannot be read"),
    "session gone": (lambda s: shutil.rmtree(s.parent), "trials.csv", "run 1 of participant 01: no session's"),
}


@pytest.mark.parametrize("spoil, file, says", SPOILT.values(), ids=SPOILT)
def test_what_is_missing_or_contradicted_is_named(data, capsys, spoil, file, says):
    spoil(data / "sub-01" / "ses-01")
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
