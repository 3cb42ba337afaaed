"""Scenes of a cobot: from a file to its motion, the laws on the way, and what is refused."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.files import InputError
from experiments.simulate.cobot_scene import CobotRun, read_cobot_scene

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
PATH, WALL = ((EXAMPLES / f"{name}.toml").read_text() for name in ("scooter", "scooter-wall"))
FREE = 'cobot = "scooter"\nduration_s = 1.0\nstep_s = 1e-3\n[force]\n'


def simulated(tmp_path, capsys, text, name="scene"):
    """Columns of the file and the summary of a scene."""
    (tmp_path / f"{name}.toml").write_text(text)
    out = tmp_path / f"{name}.csv"
    assert main(["simulate", str(tmp_path / f"{name}.toml"), "--out", str(out), "--json"]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
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


def test_a_free_caster_moves_as_the_free_body_under_a_force_file(tmp_path, capsys):
    (tmp_path / "hand.csv").write_text("t_s,fx_N,fy_N,torque_N_m\n0,0,0,0\n1,30,0,0\n")
    columns, _, _ = simulated(tmp_path, capsys, FREE + 'file = "hand.csv"\n')
    assert columns["x_m"][-1] == pytest.approx(1.0 / 6.0, rel=1e-6), "a = t m/s2"


def test_a_unicycle_is_a_cobot_too_and_a_long_scene_is_the_same_in_chunks(tmp_path):
    (tmp_path / "scene.toml").write_text(FREE.replace("scooter", "unicycle") + "constant = [3.0, 6.0, 0.0]\n")
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
        (FREE.replace("scooter", "unicycle") + "constant = [0.0, 0.0, 1.0]\n", "torque must be 0"),
        (PATH + WALL[WALL.index("[wall]") :], "not both"),
        (WALL.replace("at_m = [0.0, 0.4]", "at_m = [0.0, -0.4]"), "behind the wall"),
        (WALL.replace("normal = [0.0, -1.0]", "normal = [0.0, 0.0]"), "direction"),
        (PATH.replace("within_m = 0.3", "within_m = 0.0"), "within_m"),
        (PATH.replace('"segment"', '"spiral"'), "spiral"),
        (FREE + 'file = "gone.csv"\n', "gone.csv"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_a_sentence_and_nothing_is_written(tmp_path, capsys, text, reason):
    (tmp_path / "scene.toml").write_text(text)
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "motion.csv")]) == 2
    told = capsys.readouterr().err
    assert reason in told and told.count("\n") == 1 and not (tmp_path / "motion.csv").exists()
    with pytest.raises(InputError):
        read_cobot_scene(tmp_path / "scene.toml")
