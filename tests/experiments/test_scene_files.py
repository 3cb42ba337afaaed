"""Scene files, schedules and forces: what they mean, and what is refused."""

import json
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exports import rows as csv_rows
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from app.cli import main
from core.files import InputError
from experiments.simulate.cobot_scene import CobotRun, read_cobot_scene
from experiments.simulate.scene import read_scene

SCENE = """\
device = "three-brake"
duration_s = 0.02
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
"""


@pytest.fixture
def scene(tmp_path: Path):
    """A function that writes a scene (and files beside it) and reads it."""

    def read(more: str = "", *changes: tuple[str, str], **files: str):
        text = SCENE + more
        for pattern, replacement in changes:
            assert re.search(pattern, text), pattern
            text = re.sub(pattern, replacement, text)
        for name, content in files.items():
            (tmp_path / f"{name}.csv").write_text(content)
        (tmp_path / "scene.toml").write_text(text)
        return read_scene(tmp_path / "scene.toml")

    return read


def _read_plain_scene():
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.toml").write_text(SCENE)
        return read_scene(Path(folder) / "scene.toml")


_SCENE = _read_plain_scene()


def test_constants_hold_for_the_whole_scene_and_unnamed_joints_are_zero(scene):
    s = scene("[brakes]\ntorque_N_m = {A = 5.6, B = 0.3, C = 0}\n[force]\nconstant_N = [10, -1]\n")
    assert s.schedule.tolist() == [[5.6, 0.0, 0.3, 0.0]] and s.schedule_t[0] <= 0.0
    assert np.all(s.force == [10.0, -1.0])


def test_a_schedule_overrides_the_constants_in_columns_of_any_order_that_may_be_zero_without_a_brake(scene):
    more = '[brakes]\ntorque_N_m = {A = 1}\nschedule = "brakes.csv"\n'
    s = scene(more, brakes="t_s,B,C,A\n-1,0.1,0,0.2\n0.005,0.3,0,0.4\n")
    assert s.schedule_t.tolist() == [-1.0, 0.005]
    assert s.schedule.tolist() == [[0.2, 0.0, 0.1, 0.0], [0.4, 0.0, 0.3, 0.0]]


def test_paths_are_relative_to_the_scene_file(scene, tmp_path: Path, monkeypatch):
    from core.device import load_device

    (tmp_path / "mine.toml").write_text(load_device("four-brake").text)
    monkeypatch.chdir("/")
    assert scene("", ('"three-brake"', '"mine.toml"')).device.braked == "AEBC"


def test_a_duration_may_miss_a_whole_number_of_steps_by_rounding_only(scene):
    assert scene("", ("= 0.02", "= 0.020000000000001")).steps == 20
    with pytest.raises(InputError, match="not a whole number of output intervals"):
        scene("", ("= 0.02", "= 0.02000001"))


@given(st.integers(1, 10**6), st.sampled_from([1e-3, 1e-2, 5e-3, 2e-3, 1e-5, 0.1, 0.3]))
def test_output_times_are_multiples_of_the_interval_to_rounding(k, interval):
    scene = replace(_SCENE, output_interval_s=interval)
    time = scene.row_times(k, 1)[0]
    assert abs(time - k * interval) <= 4e-16 * time
    if interval == 1e-3:
        assert time == float(f"{k}e-3")


TABLE = '[brakes]\nschedule = "brakes.csv"\n'
FORCE = '[force]\nfile = "force.csv"\n'
HEAD = "t_s,fx_N,fy_N\n"
BAD_SCENES = {
    "unknown integrator": ('integrator = "euler"\n', {}, "integrator must be one of event, stepping, karnopp"),
    "part of a step": ("output_interval_s = 1.5e-3\n", {}, r"interval_s \(0.0015 s\) is not a whole"),
    "interval of no step": ("output_interval_s = 1e-4\n", {}, "output_interval_s .* is not a whole"),
    "torque without a brake": ("[brakes]\ntorque_N_m = {C = 1}\n", {}, "torque_N_m.C: three-brake has no brake"),
    "current for ideal": ("[brakes]\ncurrent_amperes = {A = 1}\n", {}, "current_amperes does not go with"),
    "torque for mr": ('fidelity = "mr"\n[brakes]\ntorque_N_m = {A = 1}\n', {}, "torque_N_m does not go with"),
    "current above the limit": ('fidelity = "mr"\n[brakes]\ncurrent_amperes = {A = 1.1}\n', {}, "at most 1 A"),
    "file and constant": ('[force]\nfile = "f"\nconstant_N = [1, 1]\n', {}, "either file or constant_N"),
    "no schedule": (TABLE, {}, r"scene\.toml: brakes\.schedule: .*brakes\.csv: cannot be read \(no such file"),
    "schedule starts late": (TABLE, {"brakes": "t_s,A\n0.1,1\n"}, "line 2: the first time must be 0 or earlier"),
    "schedule stands still": (TABLE, {"brakes": "t_s,A\n0,1\n\n1,1\n1,2\n"}, "line 5: time must rise, but 1 s"),
    "schedule negative": (TABLE, {"brakes": "t_s,A\n0,1\n1,-1\n"}, "line 3: A must not be negative, not -1"),
    "schedule for no brake": (TABLE, {"brakes": "t_s,C\n0,0\n1,1\n"}, "line 3: C: three-brake has no brake"),
    "nan in force": (FORCE, {"force": HEAD + "0,0,0\n0.01,nan,0\n1,0,0\n"}, "line 3: fx_N must be finite"),
    "force too short": (FORCE, {"force": HEAD + "0,0,0\n0.019,0,0\n"}, "ends at 0.019 s, before the scene does"),
}  # fmt: skip


@pytest.mark.parametrize("more, files, says", BAD_SCENES.values(), ids=BAD_SCENES)
def test_a_scene_that_cannot_run_is_refused_with_file_key_and_reason(scene, more, files, says):
    with pytest.raises(InputError, match=says) as refusal:
        scene(more, **files)
    assert re.search(r"(scene\.toml|brakes\.csv|force\.csv)", str(refusal.value))


EXAMPLES = Path(__file__).resolve().parents[2] / "experiments" / "scenes"
PATH, WALL = ((EXAMPLES / f"{name}.toml").read_text() for name in ("scooter", "scooter-wall"))
ONE_CASTOR = """
name = "one castor"
mass_kg = 3.0
inertia_kg_m2 = 1.0
hubs_m = [[0.0, 0.0]]
steering_rate_max_rad_s = 30.0
"""
FREE = 'cobot = "scooter"\nduration_s = 1.0\nstep_s = 1e-3\n[force]\n'


def simulated(tmp_path, capsys, text, name="scene"):
    """Columns of the file and the summary of a scene."""
    (tmp_path / f"{name}.toml").write_text(text)
    out = tmp_path / f"{name}.csv"
    assert main(["simulate", str(tmp_path / f"{name}.toml"), "--out", str(out), "--json"]) == 0
    rows = csv_rows(out)
    words = [row.pop("limited") for row in rows]
    columns = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    return columns, words, json.loads(capsys.readouterr().out)


def test_the_scooter_comes_to_the_path_and_to_its_heading_by_the_hands_energy_alone(tmp_path, capsys):
    columns, limited, summary = simulated(tmp_path, capsys, PATH)
    assert len(columns["t_s"]) == 401 and columns["t_s"][-1] == 4.0
    assert abs(columns["y_m"][-1]) < 1e-6 and abs(columns["heading_rad"][-1]) < 1e-2 and columns["x_m"][-1] > 2.0
    assert columns["kinetic_J"] == pytest.approx(columns["work_J"], abs=1e-9) and summary["energy_residual_J"] < 1e-9
    assert any(limited) and {*"".join(limited)} <= {*"123"}
    assert summary["half_step_differs_m"] < 3e-4 and summary["warnings"] == [] and summary["assumed"]


def test_the_scooter_is_kept_from_the_wall_and_slides_along_it(tmp_path, capsys):
    columns, _, summary = simulated(tmp_path, capsys, WALL)
    assert columns["y_m"].max() < 0.4 and columns["y_m"][-1] > 0.39 and columns["x_m"][-1] > 1.0
    assert summary["least_distance_from_wall_m"] == pytest.approx(0.4 - columns["y_m"].max())


def test_a_cobot_may_have_one_castor_and_a_long_scene_is_the_same_in_chunks(tmp_path):
    (tmp_path / "one.toml").write_text(ONE_CASTOR)
    (tmp_path / "scene.toml").write_text(FREE.replace("scooter", "one.toml") + "constant = [3.0, 6.0, 0.0]\n")
    scene = read_cobot_scene(tmp_path / "scene.toml")
    whole, run = CobotRun(scene).run_chunk(1001), CobotRun(scene)
    parts = np.concatenate([run.run_chunk(400), run.run_chunk(601)])
    assert np.array_equal(parts, whole)
    assert whole[-1, 2] / whole[-1, 1] == pytest.approx(2.0, abs=0.2), "it turned into the force"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (FREE.replace("scooter", "skater"), "unknown cobot"),
        (FREE + 'constant = [1, 0, 0]\nfile = "x.csv"\n', "not both"),
        (FREE.replace("step_s = 1e-3", "step_s = 3e-3"), "whole number"),
        (FREE.replace("scooter", "one.toml") + "constant = [0.0, 0.0, 1.0]\n", "torque must be 0"),
        (PATH + WALL[WALL.index("[wall]") :], "not both"),
        (WALL.replace("at_m = [0.0, 0.4]", "at_m = [0.0, -0.4]"), "behind the wall"),
        (WALL.replace("normal = [0.0, -1.0]", "normal = [0.0, 0.0]"), "direction"),
        (PATH.replace("within_m = 0.3", "within_m = 0.0"), "within_m"),
        (PATH.replace("heading_rad = 0.0", f"heading_rad = {10**400}"), "heading_rad"),
        (PATH.replace('"segment"', '"spiral"'), "spiral"),
        (FREE + 'file = "gone.csv"\n', "gone.csv"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_a_sentence_and_nothing_is_written(tmp_path, capsys, text, reason):
    (tmp_path / "one.toml").write_text(ONE_CASTOR)
    (tmp_path / "scene.toml").write_text(text)
    assert reason in refusal(capsys, "simulate", tmp_path / "scene.toml", "--out", tmp_path / "motion.csv")
    assert not (tmp_path / "motion.csv").exists()
    with pytest.raises(InputError):
        read_cobot_scene(tmp_path / "scene.toml")


IN_AND_OUT = """
device = "three-brake"
duration_s = 0.3
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
fidelity = "mr"
[brakes]
current_amperes = {A = 0.4, B = 0.1}
[force]
file = "push.csv"
"""


def test_a_scene_writes_what_went_in_and_the_energies_balance(tmp_path, capfdbinary):
    (tmp_path / "scene.toml").write_text(IN_AND_OUT)
    (tmp_path / "push.csv").write_text("t_s,fx_N,fy_N\n0,0,0\n0.1,12,-3\n0.3,8,5\n")
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "motion.csv")]) == 0
    table = csv_rows(tmp_path / "motion.csv")
    column = {name: np.array([float(row[name]) for row in table]) for name in table[0] if name != "stuck"}
    t = column["t_s"]
    for name, values in (("hand_fx_N", [0, 12, 8]), ("hand_fy_N", [0, -3, 5])):
        assert column[name] == pytest.approx(np.interp(t, [0, 0.1, 0.3], values), abs=1e-9)
    currents = {joint: set(column[f"current_{joint}_A"]) for joint in "AEB"}
    assert currents == {"A": {0.4}, "E": {0.0}, "B": {0.1}} and "current_C_A" not in column
    left = column["work_hand_J"] - column["heat_brakes_J"] - column["kinetic_J"] - column["lost_at_stops_J"]
    assert np.abs(left).max() < 1e-6 < 1e-2 < column["work_hand_J"][-1]
    assert np.all(np.diff(column["heat_brakes_J"]) >= -1e-12)
    moved = np.gradient(column["tip_x_m"], t), np.gradient(column["tip_y_m"], t)
    power = column["hand_fx_N"] * moved[0] + column["hand_fy_N"] * moved[1]
    assert column["work_hand_J"][-1] == pytest.approx(np.trapezoid(power, t), rel=1e-2)
    capfdbinary.readouterr()
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", "-"]) == 0
    out, err = capfdbinary.readouterr()
    assert out == (tmp_path / "motion.csv").read_bytes() and b"301 rows" in err
    (tmp_path / "ideal.toml").write_text(IN_AND_OUT.replace('"mr"', '"ideal"').replace("current_amperes", "torque_N_m"))
    assert main(["simulate", str(tmp_path / "ideal.toml"), "--out", str(tmp_path / "ideal.csv")]) == 0
    header = (tmp_path / "ideal.csv").read_text().splitlines()[0]
    assert "current_" not in header and header.endswith("work_hand_J,heat_brakes_J,kinetic_J,lost_at_stops_J")
