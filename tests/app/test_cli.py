"""The command line: exit codes, one sentence for wrong input, nothing half written, data on stdout."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from waiting import wait_until

from app.cli import main
from core.device import load_device

ROOT = Path(__file__).resolve().parents[2]
SCENE = """\
device = "device.toml"
duration_s = 0.05
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
[brakes]
torque_N_m = {A = 0.3, E = 0.3, B = 0.3}
[force]
file = "force.csv"
"""
FORCE = "t_s,fx_N,fy_N\n0,6,0\n0.05,0,-6\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """The current folder, holding a good scene with its device and force files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "device.toml").write_text(load_device("three-brake").text)
    (tmp_path / "force.csv").write_text(FORCE)
    return tmp_path


def change(file: Path, pattern: str, replacement: str) -> None:
    text = file.read_text()
    assert re.search(pattern, text), pattern
    file.write_text(re.sub(pattern, replacement, text))


def hear_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def phd(*arguments: str) -> subprocess.Popen:
    """The program, in the current folder; Ctrl-C is heard, as in a shell's foreground."""
    return subprocess.Popen(
        [sys.executable, "-m", "app.cli", *arguments], env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=None if sys.platform == "win32" else hear_ctrl_c,
    )  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_good_scene_beside_them_exits_0(folder, capsys):
    assert main(["simulate", "scene.toml", "--out", "out.csv"]) == 0
    assert re.search(r"out\.csv: 51 rows, device three-brake \(assumed\)", capsys.readouterr().out)
    lines = (folder / "out.csv").read_text().split("\n")
    assert len(lines) == 51 + 2 and lines[1].startswith("0,0.05,0.4,0,0,")
    assert main(["simulate", "scene.toml", "--out", "again.csv", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["rows"], summary["steps"], summary["simulated_s"], summary["assumed"]) == (51, 50, 0.05, True)
    assert {"wall_s", "events", "fallbacks"} <= set(summary)
    assert (folder / "again.csv").read_bytes() == (folder / "out.csv").read_bytes()


def fail_with(monkeypatch, error: BaseException) -> None:
    """Make every scene end in this error, once its file is there."""

    def broken(scene):
        raise error

    monkeypatch.setattr("experiments.simulate.simulate.SceneRun", broken)


FAILURES = {
    "disk full": (OSError(28, "No space left on device"), 1, "no space left on device"),
    "no longer writable": (PermissionError(13, "Permission denied", "x"), 2, "x: permission denied"),
    "motion diverges": (FloatingPointError("the simulated motion is no longer finite"), 1, "no longer finite"),
    "interrupt": (KeyboardInterrupt(), 130, "interrupted"),
}


@pytest.mark.parametrize("error, code, says", FAILURES.values(), ids=FAILURES)
def test_a_run_that_fails_says_why_and_leaves_nothing(folder, capsys, monkeypatch, error, code, says):
    fail_with(monkeypatch, error)
    before = files(folder)
    assert main(["simulate", "scene.toml", "--out", "out.csv"]) == code
    assert re.search(rf"(?m)^phd: .*{says}$", capsys.readouterr().err)
    assert files(folder) == before


def test_a_fault_of_our_own_is_named_as_one_and_its_traceback_kept(folder, tmp_path, capsys, monkeypatch):
    fail_with(monkeypatch, ZeroDivisionError("ours"))
    reports = tmp_path / "reports"
    reports.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(reports))
    assert main(["simulate", "scene.toml", "--out", "out.csv"]) == 1
    (report,) = reports.iterdir()
    (said,) = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"phd: internal error in test_cli.py, line \d+: ZeroDivisionError: ours; .* with (.*)", said)
    assert said.endswith(str(report)) and "in broken" in report.read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM there, and Ctrl-C goes to all processes of a console")
def test_a_long_run_that_is_stopped_leaves_no_file(folder):
    """A row takes minutes: its kernel hears nothing, the program does. (Its thread ends with its process alone.)"""
    change(folder / "scene.toml", "step_s = 1e-3", "step_s = 1e-5\noutput_interval_s = 9e3")
    change(folder / "scene.toml", "duration_s = 0.05", "duration_s = 9e3")
    change(folder / "scene.toml", 'file = "force.csv"', "constant_N = [0, 0]")
    codes = {signal.SIGINT: 130, signal.SIGTERM: 143}
    outs = {number: folder / f"{number.name}.csv" for number in codes}
    running = {number: phd("simulate", "scene.toml", "--out", out.name) for number, out in outs.items()}
    try:
        wait_until(lambda: all(out.exists() for out in outs.values()))
        time.sleep(1.0)  # their kernels are loaded
        for number, process in running.items():
            process.send_signal(number)
            _, said = process.communicate(timeout=200)
            assert process.returncode == codes[number] and "Traceback" not in said
    finally:
        for process in running.values():
            process.kill()  # one that does not hear
    assert not any(out.exists() for out in outs.values())


def test_a_verb_whose_reader_is_gone_ends_quietly():
    process = phd("run", "--print-plan")
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(200) == 141
