"""What cannot be is refused in one sentence: exit code 2, nothing on stdout, nothing written. And what is strange is
warned of with the unit that was probably meant."""

import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from protocols import PAPER, changed
from refusals import refusal

from app.cli import main
from core import files
from core.device import COBOT_FOLDER, SHIPPED_FOLDER, load_device, shipped_devices
from core.files import MOST_SAID, InputError, StrangeInput, read_text
from experiments.protocol import load_protocol
from experiments.simulate.cobot_scene import is_cobot_scene, load_cobot, read_cobot_scene
from experiments.simulate.scene import read_scene

ROOT = Path(__file__).parents[2]
TEXTS = {
    "scene.toml": """device = "device.toml"
duration_s = 0.02
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
initial_tip_velocity_m_s = [0.0, 0.0]
[brakes]
torque_N_m = {A = 5.6, E = 0.3, B = 0.3}
[force]
file = "force.csv"
""",
    "device.toml": (SHIPPED_FOLDER / "four-brake.toml").read_text(encoding="utf-8").replace("mrb-2107-3", "brake.toml"),
    "brake.toml": (SHIPPED_FOLDER.parent / "brake_files" / "mrb-2107-3.toml").read_text(encoding="utf-8"),
    "force.csv": "t_s,fx_N,fy_N\n0,1,2\n0.01,3,4\n0.02,5,6\n",
    "sweep.toml": 'name = "it"\noperators = 1\n[[controller]]\nkind = "none"\n',
    "displays.pdf": "mine",
}
SIMULATE = ["simulate", "scene.toml", "--out", "out.csv"]
LONG, DEEP = "x" * 70_000, "y/" * 20_000
LINK = "must be sim, serial:PORT, socket://HOST:NUMBER or driver:FILE.py"
BOARD = f"serial:{os.devnull}"  # on every system something that can be opened

#: A command -> key words of its refusal.
COMMANDS = {
    "fly": "invalid choice: 'fly'",
    "--bogus": r"unrecognized arguments: --bogus \(see phd run --help\)",
    "doctor --json --fast": r"unrecognized arguments: --fast \(see phd doctor --help\)",
    "simulate --out o.csv": "required: SCENE.toml",
    "simulate scene.toml --ou o.csv": "--out",
    "nwe x": r"did you mean new\?",
    "stdy": r"did you mean study\?",
    "study --opertors 3 --out s": r"did you mean --operators\?",
    "run --theme drk": r"did you mean dark\?",
    "study '' --out s": "unknown protocol ''.*arena, displays, .*paper",
    "study --population '' --out s": "unknown population ''",
    "study --sweep '' --out s": "unknown sweep ''",
    "study --operators 0 --out s": "--operators: must be a whole number of at least 1",
    "study --operators 1001 --out s": "--operators: at most 1000",
    "study --seed -1 --out s": "--seed",
    "study --rules none --out s": "--rules: invalid choice",
    "study --low-gain much --out s": "--low-gain: must be a number greater than 0",
    "study --device pter pter --out s": "--device: two devices have the same",
    "--device six-brake --print-plan": "unknown device 'six-brake'",
    "new mine --device scooter": "--device: 'scooter' is no shipped device",
    "simulate no.toml --out o.csv": "unknown scene 'no.toml': neither",
    "simulate . --out o.csv": "unknown scene '.': neither",
    "simulate scene.toml --out no/o.csv": r"no[/\\]o\.csv: cannot be created",
    "simulate scene.toml --out scene.toml/o.csv": "cannot be created",
    "simulate scene.toml --out force.csv": "force.csv: exists already",
    "run --participant ../x": "participant .*: must be letters a to z and digits",
    "run --link usb --print-plan": f"--link: {LINK}, not 'usb'",
    "run --link socket://b --print-plan": f"--link: {LINK}, not 'socket://b'",
    "run --link serial:x --input operator --print-plan": "--input operator: on the bench the force sensor",
    "run --link serial:/dev/none": r"serial:/dev/none: there is no such port \(phd doctor lists",
    "run --link sim --force netft:10.0.0.1": "goes with --link serial:PORT",
    f"run --link {BOARD} --force ati": "must be netft:HOST",
    f"run --link {BOARD} --force netft:here:there": "cannot be read",
    "emulate --fault drop=2": "drop",
    "emulate --fault stuck-encoder=AE": "fault",
    "emulate --path 0 2 0 1": "the handle cannot be at",
    "emulate --socket 65536": "socket",
    "export circle --csv circle": "circle",
    "study --out .": "not empty",
    "study --out force.csv/below": "cannot be used",
    "study --cluster tcp://x:1 --out s": "--cluster: is for --sweep alone",
    "study --sweep sweep.toml --operators 3 --out s": "--operators: stands in the file of a sweep",
    "analyze empty": "no recordings",
    "analyze gone": "there is no such folder",
    "export . --csv s": "holds no session",
    "export .": "nothing to write",
    "replay gone.parquet --json": "cannot be read",
    "figures": "--out",
    "figures --out force.csv": "force.csv",
    "figures --out .": "displays.pdf: exists already",
    "figures --out s --device six-brake": "unknown device",
    "bench --out .": "never overwritten",
    "bench --out gone/b": "gone",
    "identify force.csv --omega-0 0": "--omega-0: must be",
    "identify force.csv --backlash-deg nan": "--backlash-deg: must be",
    "identify force.csv --out gone/b.toml": "folder does not exist",
}  # fmt: skip

#: What is written in place of what -> key words of the refusal.
CHANGES = {
    ("device.toml", "six-brake"): "unknown device 'six-brake'",
    ('"brake.toml"', '"mrb"'): "unknown brake 'mrb'",
    ("step_s = 1e-3", ""): "required key step_s is missing",
    ("[0.05, 0.40]", "[0.05, 4.0]"): r"initial_tip_m: the tip of four-brake cannot be at \(0.05, 4\)",
    ("[0.05, 0.40]", "[0.0, 0.605]"): "initial_tip_m: the tip",
    ("[0.05, 0.40]", "[0.05, -0.4]"): "initial_tip_m: the tip",
    ("step_s =", "step_s"): r"scene\.toml: is not valid TOML",
    ("force.csv", "push.csv"): r"force\.file: push\.csv: cannot be read",
    ("3,4", "3,nan"): r"force\.csv: line 3: fy_N must be finite",
    ("3,4", "3,-1e6"): r"force\.csv: line 3: fy_N must be at least -100000 N, not -1e\+06",
    ("tip_kg = 0.5", "tip_kg = -0.5"): r"mass\.tip_kg must be at least 0, not -0\.5",
    ("7.25, -0.3875]", "1e9, -0.2e9]"): r"k: the torque at current_max_A must be at most",
    ("step_s = 1e-3", "step_s = 0"): "step_s must be",
    ("= 0.02\nstep_s = 1e-3", "= 50\nstep_s = 1e-8"): r"step_s: 5e\+09 steps are too many",
    ("= 0.02\nstep_s = 1e-3", "= 50\nstep_s = 1e-6"): r"output_interval_s: 5e\+07 rows are too many",
}  # fmt: skip
TORQUES = "1.0\nk = [3.25, 0.35, -1.5625, 7.25, -0.3875]"  # current_max_A, and what follows it
#: What is written in place of what -> the warning.
STRANGE = {
    ("tip_kg = 0.5", "tip_kg = 30"): "mass.tip_kg = 30 kg is strange; if 30 g is meant, write 0.03",
    ("L_AE_m = 0.2794", "L_AE_m = 279.4"): "279.4 m is strange; if 279.4 mm is meant, write 0.2794",
    ("[0.0, 0.0]", "[50, 0.0]"): "50 m/s is strange; if 50 mm/s is meant, write 0.05",
    ("A = 5.6", "A = 5600"): "torque_N_m.A = 5600 N m is strange; if 5600 N mm is meant, write 5.6",
    ("step_s = 1e-3", "step_s = 1"): "step_s = 1 s is strange; if 1 ms is meant, write 0.001",
    ("rotation_rad = 0.0", "rotation_rad = 90"): "90 rad is strange; if 90 degrees is meant",
    ("0.02,5,6", "20,5,6"): "t_s ends at 20 s, the scene at 0.02 s; if 20 ms is meant",
    ("0.01,3,4", "0.01,3,4000"): "line 3: fy_N = 4000 N is strange; if 4000 mN is meant, write 4",
    (TORQUES, "1.0\ntorque_table = [[0.0, 0.3], [1000.0, 5.0]]"): "1000 A is strange; if 1000 mA is meant, write 1",
}  # fmt: skip

#: Commands with something endless in them.
ENDLESS = {
    "scene": ["simulate", LONG, "--out", "o.csv"], "verb": [LONG], "option": [f"--{LONG}"],
    "protocol with blanks": ["study", "a b " * 20_000, "--out", "o"], "deep folder": ["verify", DEEP],
    "number": ["study", "--operators", "9" * 100_000, "--out", "o"], "many words": ["study", *["w"] * 20_000],
}  # fmt: skip
#: Protocols with something endless in them.
ENDLESS_FILES = {
    "key": f'{"k" * 70_000} = 1\n{PAPER.text}', "rules": changed(PAPER.text, rules=f'"{"r " * 70_000}"'),
    "brackets": "[" * 70_000, "number": changed(PAPER.text, blocks="9" * 4000),
    "devices": changed(PAPER.text, devices=str(["three-brake"] * 70).replace("'", '"')),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, holding a good scene with its device, brake and force files, and a link to itself."""
    monkeypatch.chdir(tmp_path)
    for name, text in TEXTS.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "empty").mkdir()
    if os.name == "posix":
        (tmp_path / "circle").symlink_to("circle")
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def change(folder: Path, old: str, new: str) -> None:
    """One of the files."""
    (name,) = [name for name, text in TEXTS.items() if old in text]
    (folder / name).write_text(TEXTS[name].replace(old, new), encoding="utf-8")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_that_cannot_be(folder: Path, capfd: pytest.CaptureFixture, command: str) -> None:
    before = contents(folder)
    assert re.search(COMMANDS[command], refusal(capfd, *shlex.split(command)), re.I)
    assert contents(folder) == before


@pytest.mark.parametrize("old, new", CHANGES)
def test_a_file_that_cannot_be(folder: Path, capsys: pytest.CaptureFixture, old: str, new: str) -> None:
    change(folder, old, new)
    before = contents(folder)
    assert re.search(CHANGES[old, new], refusal(capsys, *SIMULATE))
    assert contents(folder) == before


@pytest.mark.parametrize("old, new", STRANGE)
def test_a_strange_number_is_warned_of_once_with_the_unit_that_was_meant(folder: Path, capsys, old, new) -> None:
    change(folder, old, new)
    (folder / "out.csv").touch()  # refused after the scene was read, before anything runs
    assert main(SIMULATE) == 2
    (found,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert STRANGE[old, new] in found


@pytest.mark.parametrize("what", [*ENDLESS, *ENDLESS_FILES])
def test_a_refusal_of_something_endless_is_short(folder: Path, capsys: pytest.CaptureFixture, what: str) -> None:
    (folder / "mine.toml").write_text(ENDLESS_FILES.get(what, ""))
    before = contents(folder)
    said = refusal(capsys, *ENDLESS.get(what, ["run", "mine.toml", "--print-plan"]))
    assert len(said) <= MOST_SAID + 100 and contents(folder) == before


@pytest.mark.parametrize(
    "key, value, refused, strange",
    [
        ("trial.start_radius_m", 3.0, 3e4, "3 m is strange; if 3 mm is meant, write 0.003"),
        ("mouse.mass_kg", 30.0, 1e30, "30 kg is strange; if 30 g is meant, write 0.03"),
    ],
)
def test_a_protocol_is_held_to_the_same_ranges(tmp_path: Path, key, value, refused, strange) -> None:
    table, name = key.split(".")
    text = re.sub(rf"(?ms)^\[{table}\].*?(?=^\[|\Z)", "", PAPER.text)

    def written(number: float) -> Path:
        (tmp_path / "p.toml").write_text(f"{text}\n[{table}]\n{name} = {number}\n", encoding="utf-8")
        return tmp_path / "p.toml"

    with pytest.warns(StrangeInput, match=re.escape(strange)):
        load_protocol(written(value))
    with pytest.raises(InputError, match=f"{key} must be at most"):
        load_protocol(written(refused))


def test_nothing_that_comes_with_the_program_is_strange() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", StrangeInput)
        for name in shipped_devices():
            load_device(name)
        for cobot in COBOT_FOLDER.glob("*.toml"):
            load_cobot(cobot.stem, ROOT, "test")
        for protocol in (*ROOT.glob("experiments/protocols/*.toml"), *ROOT.glob("docs/examples/protocols/*.toml")):
            load_protocol(protocol)
        for scene in (*ROOT.glob("experiments/scenes/*.toml"), *ROOT.glob("experiments/benchmark/*.toml")):
            if "initial_" in scene.read_text(encoding="utf-8"):
                (read_cobot_scene if is_cobot_scene(scene) else read_scene)(scene)


def test_a_text_may_be_as_large_as_the_limit_and_no_larger_nor_without_an_end(tmp_path: Path, monkeypatch) -> None:
    (file := tmp_path / "a.txt").write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    monkeypatch.setattr(files, "MOST_TEXT_BYTES", file.stat().st_size)
    assert read_text(file) == "a\nb\nc\n"
    monkeypatch.setattr(files, "MOST_TEXT_BYTES", file.stat().st_size - 1)
    for path in (file, *([Path("/dev/zero")] if os.name == "posix" else [])):
        with pytest.raises(InputError, match=f"{re.escape(str(path))}: is larger than"):
            read_text(path)


def test_the_command_itself_refuses_without_a_traceback_and_without_qt(folder: Path) -> None:
    change(folder, "1e-3", "0")
    seen = "import sys; from app.cli import main; code = main(sys.argv[1:]); print(code, 'PySide6' in sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", seen, *SIMULATE], env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True,
    )  # fmt: skip
    assert process.stdout == "2 False\n"
    assert process.stderr.count("\n") == 1 and process.stderr.startswith("phd: scene.toml: step_s ")
