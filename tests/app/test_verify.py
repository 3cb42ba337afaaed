"""`phd verify` names everything that is damaged, missing, stale or from elsewhere, and nothing that is not."""

import json
import re
import shutil
from pathlib import Path

import pytest
from damage import found, make_whole
from disks import flip_a_bit
from sessions import files, new_session, run

from app.cli import main
from core.files import InputError
from experiments.export.export import export
from experiments.export.results import read_results
from experiments.store.database import DATABASE
from experiments.store.files import pooled_rows
from experiments.store.session import Session
from experiments.store.verify import verify
from experiments.study.analyze import analyze


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study folder with one session, three trials done and the plan unfinished."""
    return make_whole(tmp_path_factory.mktemp("verify") / "data")


@pytest.fixture
def data(whole, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(whole, tmp_path / "data")


def test_a_whole_session_with_an_unfinished_plan_has_no_fault_and_is_not_touched(data, capsys):
    before = files(data)
    assert main(["verify", str(data), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["faults"] == [] and (said["sessions"], said["whole"], said["recovered"]) == (1, 3, 0)
    assert main(["verify", str(data / "sub-01" / "ses-01")]) == 0  # the session itself
    assert files(data) == before


def test_a_folder_that_was_hardly_begun_has_no_fault_and_is_said_to_be_empty(tmp_path, capsys):
    assert main(["verify", str(tmp_path)]) == 0
    assert capsys.readouterr().err == f"warning: {tmp_path}: holds no session yet\n"
    assert not list(tmp_path.iterdir())
    (tmp_path / ".study.db.partial").write_text("SQL")
    (tmp_path / "sub-01" / "ses-01").mkdir(parents=True)
    (tmp_path / "sub-01" / "ses-01" / DATABASE).touch()
    assert main(["verify", str(tmp_path)]) == 0
    session = new_session(tmp_path)  # and it can be begun again
    session.close()


SESSION, TABLE = "sub-01/ses-01", "sub-01/ses-01/trials.csv"
ONE, TWO, THREE = (f"{SESSION}/trials/run-00{run}.parquet" for run in (1, 2, 3))
AGAIN = "it is made again at the end of the next trial, or when the session is opened"


def text_edited(data: Path, name: str, old: str, new: str) -> None:
    (data / name).write_text((data / name).read_text().replace(old, new, 1))


def exchanged(data: Path) -> None:
    for old, new in ((ONE, "x"), (TWO, ONE), ("x", TWO)):
        (data / old).rename(data / new)


def without_a_column(data: Path) -> None:
    lines = (data / TABLE).read_text().splitlines()
    (data / TABLE).write_text("".join(line.rpartition(",")[0] + "\n" for line in lines))


SPOILT = {
    "a changed bit": (lambda d: flip_a_bit(d / THREE), THREE, "does not match its checksum"),
    "truncated": (lambda d: (d / TWO).write_bytes((d / TWO).read_bytes()[:-9]), TWO, "it was changed or cut"),
    "recording gone": (lambda d: (d / TWO).unlink(), TWO, "file: missing"),
    "recordings exchanged": (exchanged, ONE, "does not match its checksum"),
    "table edited": (lambda d: text_edited(d, TABLE, ",excluded,0.0", ",excluded,0.1"), TABLE, f"was edited.*{AGAIN}"),
    "last column gone": (without_a_column, TABLE, "is stale or was edited"),
    "table gone": (lambda d: (d / TABLE).unlink(), TABLE, f"is missing; {AGAIN}"),
    "pooled table edited": (
        lambda d: text_edited(d, "trials.csv", "redone", "done"), "trials.csv", "phd study --resume makes it again",
    ),
    "folder renamed": (
        lambda d: (d / "sub-01").rename(d / "sub-07"), "sub-07/ses-01", "it holds the session of sub-01/ses-01",
    ),
    "folder copied": (
        lambda d: shutil.copytree(d / "sub-01", d / "sub-01 - Copy"), "sub-01 - Copy/ses-01", "the folder is a copy",
    ),
    "session copied": (
        lambda d: shutil.copytree(d / SESSION, d / "sub-01" / "ses-02"), "sub-01/ses-02", "the folder is a copy",
    ),
    "conflict copy": (
        lambda d: shutil.copy(d / SESSION / DATABASE, d / SESSION / "session (conflicted copy).db"),
        f"{SESSION}/session (conflicted copy).db", "a conflict copy",
    ),
    "database gone": (lambda d: (d / SESSION / DATABASE).unlink(), SESSION, "its session.db is missing"),
}  # fmt: skip


@pytest.mark.parametrize("spoil, file, says", SPOILT.values(), ids=SPOILT)
def test_what_is_missing_or_from_elsewhere_is_named(data, capsys, spoil, file, says):
    spoil(data)
    assert main(["verify", str(data)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith(f"{file}") and re.search(says, line) for line in lines), lines


@pytest.mark.parametrize("name", ["sub-01 - Copy", "sub-02"])
def test_a_copied_session_counts_once_and_every_reader_names_the_copy(data, tmp_path, name):
    before = pooled_rows(data)
    shutil.copytree(data / "sub-01", data / name)
    assert pooled_rows(data) == before
    results = read_results(data)
    assert len(results.trials) == len(before) and any(name in problem for problem in results.problems)
    if name.startswith("sub-02"):
        with pytest.raises(InputError, match="copy"):
            Session.resume(data, "02", sync=False)
        return
    for summary in (analyze(data, tmp_path / "a"), export(data, {"bids": tmp_path / "bids"})):
        assert summary["trials"] == len(before)
        assert any(name in sentence and "copy" in sentence for sentence in summary["left_out"])
    assert [path.name for path in (tmp_path / "bids").glob("sub-*")] == ["sub-01"]


def test_lost_and_damaged_recordings_are_named_with_their_participant(data, tmp_path):
    (data / TWO).unlink()
    flip_a_bit(data / ONE)
    lost = "left out: 1 recording of participant 01 is missing or cut"
    assert lost in read_results(data).problems
    for summary in (analyze(data, tmp_path / "a"), export(data, {"csv": tmp_path / "csv"})):
        assert lost in summary["warnings"]
        assert sum("run-001" in entry or "run-002" in entry for entry in summary["left_out"]) == 2
    (data / ONE).write_bytes((data / ONE).read_bytes()[:-9])
    assert "left out: 2 recordings of participant 01 are missing or cut" in read_results(data).problems


def test_a_trial_in_progress_is_no_fault_while_its_process_lives(tmp_path):
    session = new_session(tmp_path)
    trial, writer = session.begin(session.next_planned())
    run(trial, writer, 1500)
    seen = verify(tmp_path)
    assert seen["faults"] == [] and seen["in_progress"] == 1 and seen["in_use"] == 1
    session.close()  # as the end of the process would
    assert "cut off" in found(tmp_path)["sub-01/ses-01/trials/run-001.parquet"][0]
