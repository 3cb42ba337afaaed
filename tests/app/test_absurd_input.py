"""Absurd numbers are refused before anything runs, strange ones warned of with the unit that was probably meant."""

import os
import re
import warnings
from pathlib import Path

import pytest

from app.cli import main
from core import files
from core.device import COBOT_FOLDER, SHIPPED_FOLDER, load_device, shipped_devices
from core.files import InputError, StrangeInput, read_text
from experiments.protocol import load_protocol
from experiments.simulate.cobot_scene import is_cobot_scene, load_cobot, read_cobot_scene
from experiments.simulate.scene import read_scene

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
DEVICE = (SHIPPED_FOLDER / "four-brake.toml").read_text(encoding="utf-8").replace("mrb-2107-3", "brake.toml")
BRAKE = (SHIPPED_FOLDER.parent / "brake_files" / "mrb-2107-3.toml").read_text(encoding="utf-8")
SCENE = """device = "device.toml"
duration_s = 0.02
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
initial_tip_velocity_m_s = [0.0, 0.0]
[brakes]
torque_N_m = {A = 5.6, E = 0.3, B = 0.3}
[force]
constant_N = [10.0, 0.0]
"""
FORCES = "t_s,fx_N,fy_N\n0,1,2\n0.01,3,4\n0.02,5,6\n"
LARGEST = "1.0\nk = [3.25, 0.35, -1.5625, 7.25, -0.3875]"  # current_max_A, and what follows it
FROM_FILE = ("constant_N = [10.0, 0.0]", 'file = "force.csv"')

#: What is written in place of what, and what the refusal says.
ABSURD = {
    "force": (
        "[10.0, 0.0]",
        "[1e150, 0.0]",
        r"scene\.toml: value 1 of force\.constant_N must be at most 100000, not 1e\+150",
    ),
    "speed": ("[0.0, 0.0]", "[0, -1e200]", r"value 2 of initial_tip_velocity_m_s must be at least -100, not"),
    "length": ("L_AE_m = 0.2794", "L_AE_m = 1e-300", r"geometry\.L_AE_m must be at least 0\.001, not 1e-300"),
    "long link": ("L_AE_m = 0.2794", "L_AE_m = 1e5", r"geometry\.L_AE_m must be at most 1000, not 100000"),
    "base": ("base_B_m = [ 0.0762", "base_B_m = [ 1e9", r"value 1 of geometry\.base_B_m must be at most 1000"),
    "mass": ("tip_kg = 0.5", "tip_kg = 1e5", r"mass\.tip_kg must be at most 10000, not 100000"),
    "inertia": ("rotor_inertia_kg_m2 = 1e-4", "rotor_inertia_kg_m2 = 1e5", "rotor_inertia_kg_m2 must be at most 10000"),
    "tip": ("[0.05, 0.40]", "[1e300, 0.4]", "value 1 of initial_tip_m must be at most 1000"),
    "torque": ("A = 5.6", "A = 1e9", r"brakes\.torque_N_m\.A must be at most 100000"),
    "current": ("current_max_A = 1.0", "current_max_A = 1e5", r"current_max_A must be at most 10000"),
    "torque of a brake": ("k = [3.25, 0.35,", "k = [3.25, 1e30,", "value 2 of k must be at most 100000"),
    "torque at its largest current": (
        "7.25, -0.3875]",
        "1e9, -0.2e9]",
        r"k: the torque at current_max_A must be at most",
    ),
    "time constant": ("a_avg_s = 0.030", "a_avg_s = 1e-300", r"rise\.a_avg_s must be at least 1e-06"),
    "step": ("step_s = 1e-3", "step_s = 2.0", "step_s must be at most 1, not 2"),
    "number of steps": ("= 0.02\nstep_s = 1e-3", "= 50\nstep_s = 1e-8", r"step_s: 5e\+09 steps are too many"),
    "number of rows": ("= 0.02\nstep_s = 1e-3", "= 50\nstep_s = 1e-6", r"output_interval_s: 5e\+07 rows are too many"),
    "force in a file": ("0.01,3,4", "0.01,3,-1e6", r"force\.csv: line 3: fy_N must be at least -100000 N, not -1e\+06"),
}
#: What is written in place of what, and what the warning says.
STRANGE = {
    "30 kg for 30 g": ("tip_kg = 0.5", "tip_kg = 30", "mass.tip_kg = 30 kg is strange; if 30 g is meant, write 0.03"),
    "mm for m": ("L_AE_m = 0.2794", "L_AE_m = 279.4", "279.4 m is strange; if 279.4 mm is meant, write 0.2794"),
    "mN for N": (
        "[10.0, 0.0]",
        "[5e3, 0.0]",
        "value 1 of force.constant_N = 5000 N is strange; if 5000 mN is meant, write 5",
    ),
    "mm/s for m/s": ("[0.0, 0.0]", "[50, 0.0]", "50 m/s is strange; if 50 mm/s is meant, write 0.05"),
    "N mm for N m": ("A = 5.6", "A = 5600", "torque_N_m.A = 5600 N m is strange; if 5600 N mm is meant, write 5.6"),
    "g cm2 for kg m2": ("m2 = 1e-4", "m2 = 900", "900 kg m2 is strange; if 900 kg cm2 is meant, write 0.09"),
    "mA for A": (LARGEST, "200\nk = [0.02, 0.35, 0.0, 0.02, 0.35]", "200 A is strange; if 200 mA is meant, write 0.2"),
    "N mm for N m of a brake": (
        LARGEST,
        "1.0\nk = [3250, 350, -1562.5, 7250, -387.5]",
        "value 2 of k = 350 N m is strange; if 350 N mm is meant",
    ),
    "ms for s": ("step_s = 1e-3", "step_s = 1", "step_s = 1 s is strange; if 1 ms is meant, write 0.001"),
    "degrees for rad": ("rotation_rad = 0.0", "rotation_rad = 90", "90 rad is strange; if 90 degrees is meant"),
    "ms for s in a file": ("0.02,5,6", "20,5,6", "t_s ends at 20 s, the scene at 0.02 s; if 20 ms is meant"),
    "mA for A in a torque table": (
        "1.0\nk = [3.25, 0.35, -1.5625, 7.25, -0.3875]",
        "1.0\ntorque_table = [[0.0, 0.3], [1000.0, 5.0]]",
        "torque_table = 1000 A is strange; if 1000 mA is meant, write 1",
    ),
    "mN for N in a file": ("0.01,3,4", "0.01,3,4000", "line 3: fy_N = 4000 N is strange; if 4000 mN is meant, write 4"),
}


def write(folder: Path, old: str, new: str) -> Path:
    """Scene, device, brake and force file in a folder, one of them changed."""
    texts = {"scene.toml": SCENE, "device.toml": DEVICE, "brake.toml": BRAKE, "force.csv": FORCES}
    if old in FORCES:
        texts["scene.toml"] = SCENE.replace(*FROM_FILE)
    assert any(old in text for text in texts.values())
    for name, text in texts.items():
        (folder / name).write_text(text.replace(old, new), encoding="utf-8")
    return folder / "scene.toml"


@pytest.mark.parametrize("old, new, says", ABSURD.values(), ids=ABSURD)
def test_an_absurd_number_is_refused_in_one_sentence_before_anything_runs(tmp_path: Path, capsys, old, new, says):
    out = tmp_path / "out.csv"
    assert main(["simulate", str(write(tmp_path, old, new)), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert re.search(says, said) and len(said.strip().splitlines()) == 1, said
    assert not out.exists()


@pytest.mark.parametrize("old, new, says", STRANGE.values(), ids=STRANGE)
def test_a_strange_number_is_warned_of_once_with_the_unit_that_was_meant(tmp_path: Path, capsys, old, new, says):
    out = tmp_path / "out.csv"
    out.write_text("")  # refused after the scene was read, before anything runs
    assert main(["simulate", str(write(tmp_path, old, new)), "--out", str(out)]) == 2
    found = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert sum(says in line for line in found) == 1, found
    assert len(found) == 1, found


def test_nothing_that_comes_with_the_program_is_strange():
    with warnings.catch_warnings():
        warnings.simplefilter("error", StrangeInput)
        for name in shipped_devices():
            load_device(name)
        for cobot in COBOT_FOLDER.glob("*.toml"):
            load_cobot(cobot.stem, ROOT, "test")
        protocols = [*(ROOT / "experiments" / "protocols").glob("*.toml"), *(EXAMPLES / "protocols").glob("*.toml")]
        for protocol in protocols:
            load_protocol(protocol)
        scenes = [
            *(ROOT / "experiments" / "scenes").glob("*.toml"),
            *(ROOT / "experiments" / "benchmark").glob("*.toml"),
        ]
        for scene in scenes:
            if "initial_" in scene.read_text(encoding="utf-8"):
                (read_cobot_scene if is_cobot_scene(scene) else read_scene)(scene)


@pytest.mark.parametrize(
    "key, value, refused, strange",
    [
        ("trial.start_radius_m", 3.0, 3e4, "3 m is strange; if 3 mm is meant, write 0.003"),
        ("release.force_N", 30_000.0, 1e30, "30000 N is strange; if 30000 mN is meant, write 30"),
        ("mouse.mass_kg", 30.0, 1e30, "30 kg is strange; if 30 g is meant, write 0.03"),
    ],
)
def test_a_protocol_is_held_to_the_same_ranges(tmp_path: Path, key, value, refused, strange):
    text = (ROOT / "experiments" / "protocols" / "paper.toml").read_text(encoding="utf-8")
    table, name = key.split(".")
    text = re.sub(rf"(?ms)^\[{table}\].*?(?=^\[|\Z)", "", text)

    def write_protocol(number: float) -> Path:
        (tmp_path / "p.toml").write_text(f"{text}\n[{table}]\n{name} = {number}\n", encoding="utf-8")
        return tmp_path / "p.toml"

    with pytest.warns(StrangeInput, match=re.escape(strange)):
        load_protocol(write_protocol(value))
    with pytest.raises(InputError, match=f"{key} must be at most"):
        load_protocol(write_protocol(refused))


@pytest.mark.skipif(os.name == "nt", reason="has no file without an end")
@pytest.mark.parametrize("verb", ["simulate", "identify"])
def test_a_file_without_an_end_is_refused(tmp_path: Path, monkeypatch, capsys, verb):
    monkeypatch.setattr(files, "MOST_TEXT_BYTES", 1000)
    assert main([verb, "/dev/zero", "--out", str(tmp_path / "out")]) == 2
    assert "/dev/zero: is larger than 0.001 MB, the most" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_text_may_be_as_large_as_the_limit_and_no_larger(tmp_path: Path, monkeypatch):
    (file := tmp_path / "a.txt").write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(file) == "a\nb\nc\n"
    monkeypatch.setattr(files, "MOST_TEXT_BYTES", file.stat().st_size)
    assert read_text(file) == "a\nb\nc\n"
    monkeypatch.setattr(files, "MOST_TEXT_BYTES", file.stat().st_size - 1)
    with pytest.raises(InputError, match=r"a\.txt: is larger than"):
        read_text(file)
