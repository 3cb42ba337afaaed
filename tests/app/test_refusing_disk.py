"""A session server that is asked to end while its disk takes nothing; disks that are read alone; other users."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from live import kill, live_window
from processes import gone
from protocols import PAPER, changed
from recorded_disk import RecordedDisk
from sessions import new_session, of, recording_path, run_trials
from waiting import wait_until

from app.cli import main
from app.ipc.messages import Setup
from app.session_server.server import LOG
from core.files import InputError
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.verify import verify

ROOT = Path(__file__).resolve().parents[2]


def test_ticks_that_are_in_memory_alone_as_the_server_is_asked_to_end_are_said_and_come_back(tmp_path, monkeypatch):
    """The process itself, with SIGTERM: the next opening has every tick."""
    disk = RecordedDisk(tmp_path)
    endless = changed(PAPER.text, end_radius_m="1e-6", time_out_s="1000.0")
    (tmp_path / "endless.toml").write_text(endless, encoding="utf-8")
    about = {"DISK_ROOT": disk.root, "DISK_LOG": disk.log, "DISK_TOLD": disk.told, "LD_PRELOAD": disk.library}
    for name, value in about.items():
        monkeypatch.setenv(name, str(value))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "own"))
    setup = Setup(disk.root / "data", str(tmp_path / "endless.toml"), hand="operator", seed=5, real_time=False)
    with live_window(setup) as opened:
        opened.open()
        run = opened.start().running.run
        opened.until_tick(lambda rows: len(rows) > 500)
        disk.told.write_text("write session.db")
        opened.until(lambda s: s.in_memory)
        opened.until_tick(lambda rows: len(rows) > 1500)
        seen, pids = len(opened.rows), opened.processes()
        kill(opened.client.pid, signal.SIGTERM)
        wait_until(lambda: all(map(gone, pids)))
        (log,) = (setup.data_dir / LOG).read_text().splitlines()
        (setup.data_dir / LOG).unlink()
        ticks = int(re.search(r"([\d,]+) ticks", log)[1].replace(",", ""))
        assert ticks >= seen - 1000 and str(tmp_path / "own") in log
        disk.told.unlink()
        resumed = Session.resume(setup.data_dir, "01", sync=False)
        assert f"{ticks:,} ticks that the disk had refused are in the session now" in resumed.repaired.sentence()
        resumed.close()
        kept = read_recording(recording_path(of(setup.data_dir), run))
        assert kept.whole and kept.rows >= seen - 1
    assert verify(setup.data_dir)["faults"] == []


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a trial and one that a kill cut off, its ticks in the write-ahead log."""
    data = tmp_path_factory.mktemp("crashed") / "made"
    session = new_session(data)
    run_trials(session, 1)
    script = (
        "import os, sys; sys.path.insert(0, sys.argv[2]); from pathlib import Path\n"
        "from sessions import run; from experiments.store.session import Session\n"
        "s = Session.resume(Path(sys.argv[1]), '01'); t, w = s.begin(s.next_planned()); run(t, w, 1500); os._exit(0)"
    )
    session.close()
    subprocess.run([sys.executable, "-c", script, str(data), str(ROOT / "tests/support")], check=True, cwd=ROOT)
    assert (of(data) / "session.db-wal").stat().st_size > 0
    return data


@pytest.fixture
def crashed(made: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(made, tmp_path / "made")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may mount a file system")
def test_a_disk_that_is_read_alone_is_read_as_it_is_and_written_to_in_no_way(crashed, tmp_path, capsys):
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(place)], capture_output=True).returncode:
        pytest.skip("a file system cannot be mounted here")
    try:
        without_index = shutil.ignore_patterns("*-shm")  # which SQLite cannot make here: it is read from a copy
        shutil.copytree(crashed, place / "data", ignore=without_index)
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        faults = verify(place / "data")["faults"]
        assert [fault["fault"] for fault in faults if "cut off" in fault["fault"]]
        assert read_recording(of(place / "data") / "trials/run-002.parquet").rows >= 1000
        assert main(["export", str(place / "data"), "--csv", str(tmp_path / "csv")]) == 0
        capsys.readouterr()
        assert main(["analyze", str(place / "data")]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and "read-only file system" in said
        with pytest.raises((InputError, OSError), match="ead-only file system"):
            Session.resume(place / "data", "01")
        subprocess.run(["mount", "-o", "remount,rw", str(place)], check=True)
        Session.resume(place / "data", "01", sync=False).close()
        assert verify(place / "data")["faults"] == []
    finally:
        subprocess.run(["umount", str(place)], check=True)


def as_anybody(*arguments: object) -> subprocess.CompletedProcess:
    """A verb without root's privileges."""
    command = ["setpriv", "--bounding-set=-all", "--inh-caps=-all", sys.executable, "-m", "app.cli"]
    about = {"capture_output": True, "text": True, "cwd": ROOT, "check": False}
    return subprocess.run([*command, *map(str, arguments)], **about)
