"""Disks that take no more, or are read alone: one sentence says so, and what was recorded before is as it was."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from protocols import short
from sessions import files, of, run, session_of

from app.cli import main
from core.files import InputError
from experiments.store.files import rows_of
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.verify import verify
from tests.support.rows import read_rows


@pytest.fixture
def mounted(tmp_path: Path):
    """A file system of its own, of 4 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root may mount a file system")
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)], capture_output=True).returncode:
        pytest.skip("a file system cannot be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def remount(place: Path, how: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{how}", str(place)], check=True)


def stopped_cleanly(folder: Path, error: str) -> dict[str, bytes]:
    """The recordings of a study that a full disk has stopped; one at most is not whole, that of the next trial."""
    assert error.count("\n") == 1 and "no space left on device" in error and "--resume" in error
    rows = rows_of(folder / "sub-01" / "ses-01")
    assert [row.status for row in rows] == ["done"] * len(rows)
    left = {fault["file"]: fault["fault"] for fault in verify(folder)["faults"]}
    left = {name: fault for name, fault in left.items() if not name.endswith("trials.csv")}  # they are made again
    assert all(f"run-{len(rows) + 1:03d}" in f"{name} {fault}" for name, fault in left.items()), left
    kept = {name: content for name, content in files(folder).items() if name.endswith(".parquet")}
    assert len(kept) >= len(rows) >= 1
    return kept


def test_a_disk_that_is_full_stops_the_study_and_more_room_lets_it_go_on(mounted, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("experiments.study.study.TRIAL_BYTES", 0)  # else it is refused before it begins
    (tmp_path / "short.toml").write_text(short(paths=1).text)
    out = mounted / "study"
    assert main(["study", str(tmp_path / "short.toml"), "--operators", "1", "--seed", "2", "--out", str(out)]) == 1
    kept = stopped_cleanly(out, capsys.readouterr().err)
    assert main(["study", "--resume", "--out", str(out)]) == 1  # still full: again one sentence, nothing touched
    assert capsys.readouterr().err.count("\n") == 1
    assert kept.items() <= files(out).items()
    remount(mounted, "size=60m")
    assert main(["study", "--resume", "--out", str(out)]) == 0
    assert kept.items() <= files(out).items() and verify(out)["faults"] == []
    rows = read_rows(out / "trials.csv")
    assert [row.status for row in rows].count("done") == 10 and len(rows) <= 11


def test_a_disk_that_is_read_alone_is_read_as_it_is_and_written_to_in_no_way(mounted, tmp_path, capsys):
    remount(mounted, "size=60m")
    data = mounted / "data"
    with session_of(tmp_path / "data", 1) as session:
        run(*session.begin(session.next_planned()), 1500)  # its ticks are in the write-ahead log, as a kill leaves them
        without_index = shutil.ignore_patterns("*-shm")  # which SQLite cannot make here: it is read from a copy
        shutil.copytree(tmp_path / "data", data, ignore=without_index)
    assert (of(data) / "session.db-wal").stat().st_size > 0
    remount(mounted, "ro")
    assert [fault["fault"] for fault in verify(data)["faults"] if "cut off" in fault["fault"]]
    assert read_recording(of(data) / "trials/run-002.parquet").rows >= 1000
    assert main(["export", str(data), "--csv", str(tmp_path / "csv")]) == 0
    capsys.readouterr()
    assert main(["analyze", str(data)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "read-only file system" in said
    with pytest.raises((InputError, OSError), match="ead-only file system"):
        Session.resume(data, "01")
    remount(mounted, "rw")
    Session.resume(data, "01", sync=False).close()
    assert verify(data)["faults"] == []
