"""A disk that takes no more: the study stops with one sentence, what was recorded before is as it was."""

import os
import subprocess

import pytest
from disks import Disk, full
from protocols import short
from sessions import files

from app.cli import main
from experiments.store.files import rows_of
from experiments.store.verify import verify
from tests.support.rows import read_rows


@pytest.fixture
def begin(tmp_path):
    """Arguments of a study of one operator and 10 trials, all but its folder."""
    (tmp_path / "short.toml").write_text(short(paths=1).text)
    return ["study", str(tmp_path / "short.toml"), "--operators", "1", "--seed", "2"]


def assert_stopped_cleanly(folder, error):
    assert error.count("\n") == 1 and "no space left on device" in error and "--resume" in error
    session = folder / "sub-01" / "ses-01"
    rows = rows_of(session)
    assert [row.status for row in rows] == ["done"] * len(rows)
    left = {fault["file"]: fault["fault"] for fault in verify(folder)["faults"]}
    left = {name: fault for name, fault in left.items() if not name.endswith("trials.csv")}  # they are made again
    assert all(f"run-{len(rows) + 1:03d}" in f"{name} {fault}" for name, fault in left.items()), left
    return len(rows)


@pytest.mark.parametrize("room", (16, 19, 22))
def test_a_study_on_a_disk_that_fills_up_ends_its_trial_and_says_so(begin, tmp_path, monkeypatch, capsys, room):
    """room: commits and files that it takes; a trial has about ten."""
    out = tmp_path / "study"
    with monkeypatch.context() as patch:
        disk = Disk(patch)
        disk.refuses, disk.room = full, room
        assert main([*begin, "--out", str(out)]) == 1
    done = assert_stopped_cleanly(out, capsys.readouterr().err)
    assert done >= 1
    before = files(out)
    assert main(["study", "--resume", "--out", str(out)]) == 0
    after = files(out)
    assert all(after[name] == content for name, content in before.items() if name.endswith(".parquet"))
    rows = read_rows(out / "trials.csv")
    assert [row.status for row in rows].count("done") == 10 and len(rows) <= 11
    assert verify(out)["faults"] == []


@pytest.fixture
def small_disk(tmp_path):
    """A file system of its own, of 4 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)], capture_output=True, text=True
    ) if os.name == "posix" else None  # fmt: skip
    if mount is None or mount.returncode:
        pytest.skip(f"a small file system cannot be mounted: {mount.stderr.strip() if mount else 'not on this system'}")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may mount a small file system")
def test_a_real_disk_that_is_full_stops_the_study_and_more_room_lets_it_go_on(begin, small_disk, capsys, monkeypatch):
    monkeypatch.setattr("experiments.study.study.TRIAL_BYTES", 0)  # else it is refused before it begins
    out = small_disk / "study"
    assert main([*begin, "--out", str(out)]) == 1
    done = assert_stopped_cleanly(out, capsys.readouterr().err)
    before = files(out)
    kept = {name: content for name, content in before.items() if name.endswith(".parquet")}
    assert len(kept) >= done >= 1
    assert main(["study", "--resume", "--out", str(out)]) == 1  # still full: again one sentence, nothing touched
    assert capsys.readouterr().err.count("\n") == 1
    assert kept.items() <= files(out).items()
    subprocess.run(["mount", "-o", "remount,size=60m", str(small_disk)], check=True)
    assert main(["study", "--resume", "--out", str(out)]) == 0
    assert kept.items() <= files(out).items() and verify(out)["faults"] == []
    assert [row.status for row in read_rows(out / "trials.csv")].count("done") == 10
