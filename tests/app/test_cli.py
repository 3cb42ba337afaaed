"""The command line: exit codes, one sentence for wrong input, nothing half written, data on stdout."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from refusals import refusal

from app.cli import main
from app.progress import ProgressBar
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


def files(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


#: One of each file and kind; every other refusal is a test of the file's own reader.
WRONG_FILES = {
    "unknown device": ("scene.toml", "device.toml", "six-brake", "unknown device 'six-brake'"),
    "negative mass": ("device.toml", "tip_kg = 0.5", "tip_kg = -0.5", r"mass\.tip_kg must be at least 0, not -0\.5"),
    "unknown brake": ("device.toml", 'E = "mrb-2107-3"', 'E = "mrb"', "unknown brake 'mrb'"),
    "missing key": ("scene.toml", "(?m)^step_s.*$", "", "required key step_s is missing"),
    "NaN in the force file": ("force.csv", "-6", "nan", r"force\.csv: line 3: fy_N must be finite"),
    "force file missing": ("scene.toml", "force.csv", "push.csv", r"force\.file: push\.csv: cannot be read"),
    "not TOML": ("scene.toml", "step_s =", "step_s", r"scene\.toml: is not valid TOML"),
}


LINKS = "must be sim, serial:PORT, socket://HOST:NUMBER or driver:FILE.py"
WRONG_ARGUMENTS = {
    "no verb of that name": (["fly"], "invalid choice: 'fly'"),
    "option without a verb": (["--bogus"], r"unrecognized arguments: --bogus \(see phd run --help\)"),
    "no scene": (["simulate", "--out", "o.csv"], "required: SCENE.toml"),
    "no output": (["simulate", "scene.toml"], "required: --out"),
    "unknown option": (["doctor", "--json", "--fast"], r"unrecognized arguments: --fast \(see phd doctor --help\)"),
    "a verb nearly right": (["stdy"], r"did you mean study\?"),
    "an option nearly right": (["study", "--opertors", "3", "--out", "s"], r"did you mean --operators\?"),
    "the version nearly right": (["--verison"], r"did you mean --version\?"),
    "a value nearly right": (["run", "--theme", "drk"], r"did you mean dark\?"),
    "an empty protocol": (["study", "", "--out", "s"], "unknown protocol ''"),
    "an empty population": (["study", "--population", "", "--out", "s"], "unknown population ''"),
    "an empty sweep": (["study", "--sweep", "", "--out", "s"], "unknown sweep ''"),
    "shortened option": (["simulate", "scene.toml", "--ou", "o.csv"], "--out"),
    "scene missing": (["simulate", "no.toml", "--out", "o.csv"], r"no\.toml: cannot be read \(no such file"),
    "scene is a folder": (["simulate", ".", "--out", "o.csv"], "cannot be read"),
    "folder missing": (["simulate", "scene.toml", "--out", "no/o.csv"], r"no[/\\]o\.csv: cannot be created"),
    "folder unwritable": (["simulate", "scene.toml", "--out", "/proc/o.csv"], r"proc[/\\]o\.csv: cannot be created"),
    "folder is a file": (["simulate", "scene.toml", "--out", "scene.toml/o.csv"], "cannot be created"),
    "output exists": (["simulate", "scene.toml", "--out", "force.csv"], "force.csv: exists already"),
    "output is a folder": (["simulate", "scene.toml", "--out", "."], "exists already"),
    "no operators": (
        ["study", "--operators", "0", "--out", "s"],
        "--operators: must be a whole number of at least 1",
    ),
    "many operators": (["study", "--operators", "1001", "--out", "s"], "--operators: at most 1000"),
    "endless operators": (["study", "--operators", "9" * 40, "--out", "s"], "--operators: at most 1000"),
    "seed": (["study", "--seed", "-1", "--out", "s"], "--seed"),
    "rules": (["study", "--rules", "none", "--out", "s"], "--rules: invalid choice"),
    "low gain": (["study", "--low-gain", "much", "--out", "s"], "--low-gain: must be a number greater than 0"),
    "study device": (["study", "--device", "six-brake", "--out", "s"], "unknown device 'six-brake'"),
    "study device twice": (["study", "--device", "pter", "pter", "--out", "s"], "--device: two devices have the same"),
    "device without a verb": (["--device", "six-brake", "--print-plan"], "unknown device 'six-brake'"),
    "participant": (["run", "--participant", "../x"], "participant .*: must be letters a to z and digits"),
    "link": (["run", "--link", "usb", "--print-plan"], f"--link: {LINKS}, not 'usb'"),
    "link, no number": (["run", "--link", "socket://b", "--print-plan"], f"--link: {LINKS}, not 'socket://b'"),
    "link, no address": (
        ["run", "--link", "serial:socket://b", "--print-plan"],
        "--link: an address must be socket://HOST:NUMBER, not 'socket://b'",
    ),
    "link and operator": (
        ["run", "--link", "serial:x", "--input", "operator", "--print-plan"],
        "--input operator: on the bench the force sensor",
    ),
    "no port": (["run", "--link", "serial:/dev/none"], r"serial:/dev/none: there is no such port \(phd doctor lists"),
}  # fmt: skip


@pytest.mark.parametrize("arguments, says", WRONG_ARGUMENTS.values(), ids=WRONG_ARGUMENTS)
def test_wrong_arguments_give_one_sentence_exit_2_and_nothing_written(folder, capsys, arguments, says):
    before = files(folder)
    assert re.search(says, refusal(capsys, *arguments))
    assert files(folder) == before


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


@pytest.mark.parametrize("verb", [[], ["run"], ["study"], ["simulate"], ["analyze"]])
def test_every_verb_explains_itself(capsys, verb):
    assert main([*verb, "--help"]) == 0
    said = capsys.readouterr()
    assert said.err == "" and said.out.startswith("usage: phd")
    assert "example:\n  phd " + verb[0] in said.out if verb else "simulate" in said.out


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


def test_progress_shows_on_a_terminal_only_and_only_after_a_second(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    for terminal, after, shows in ((True, 2.0, True), (True, 0.5, False), (False, 2.0, False)):
        monkeypatch.setattr(sys.stderr, "isatty", lambda t=terminal: t, raising=False)
        with contextlib.closing(ProgressBar("simulating")) as progress:
            now[0] += after
            progress(0.5)
            assert ("50 %" in capsys.readouterr().err) == shows
        assert bool(capsys.readouterr().err) == shows  # the bar is wiped again


def phd(*arguments: str, **options) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "app.cli", *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options,
    )  # fmt: skip


def test_the_command_itself_refuses_without_a_traceback_and_without_qt(folder):
    change(folder / "scene.toml", "1e-3", "0")
    seen = "import sys; from app.cli import main; code = main(sys.argv[1:]); print(code, 'PySide6' in sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", seen, "simulate", "scene.toml", "--out", "out.csv"],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert process.stdout == "2 False\n"
    assert process.stderr.count("\n") == 1 and process.stderr.startswith("phd: scene.toml: step_s ")


def hear_ctrl_c() -> None:
    """Also where whoever started the tests does not, as in the background of a shell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM there, and Ctrl-C goes to all processes of a console")
def test_a_long_run_that_is_stopped_leaves_no_file(folder):
    """A row takes minutes: its kernel hears nothing, the program does."""
    change(folder / "scene.toml", "step_s = 1e-3", "step_s = 1e-5\noutput_interval_s = 9e3")
    change(folder / "scene.toml", "duration_s = 0.05", "duration_s = 9e3")
    change(folder / "scene.toml", 'file = "force.csv"', "constant_N = [0, 0]")
    codes = {signal.SIGINT: 130, signal.SIGTERM: 143}
    outs = {number: folder / f"{number.name}.csv" for number in codes}
    running = {
        number: phd("simulate", "scene.toml", "--out", out.name, preexec_fn=hear_ctrl_c) for number, out in outs.items()
    }
    try:
        deadline = time.perf_counter() + 200
        while time.perf_counter() < deadline and not all(out.exists() for out in outs.values()):
            time.sleep(0.05)
        time.sleep(2.0)  # its kernels are loaded
        for number, process in running.items():
            process.send_signal(number)
            _, said = process.communicate(timeout=200)
            assert process.returncode == codes[number] and "Traceback" not in said
    finally:
        for process in running.values():
            process.kill()  # one that does not hear
    assert not any(out.exists() for out in outs.values())


def test_a_verb_whose_reader_is_gone_ends_quietly():
    process = phd("run", "--print-plan", stdin=subprocess.DEVNULL)
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(200) == 141
