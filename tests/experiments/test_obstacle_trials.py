"""Obstacles in protocols and trials: what is refused, what a trial records, and that it can be replayed."""

import csv
from pathlib import Path

import pytest

from core.files import InputError
from experiments.protocol import SHIPPED_FOLDER, load_protocol
from experiments.recording.reader import read_recording
from experiments.study.replay import replay
from experiments.study.study import run_study
from experiments.trial.population import load_population

TEXT = (SHIPPED_FOLDER / "obstacles.toml").read_text()


def protocol_with(folder: Path, old: str, new: str) -> Path:
    """The shipped protocol with one thing changed."""
    assert old in TEXT
    path = folder / "changed.toml"
    path.write_text(TEXT.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("disc_m = [0.0, 0.42, 0.02]", "disc_m = [0.10, 0.40, 0.02]", "path 1 ends in an obstacle"),
        ("disc_m = [0.0, 0.42, 0.02]", "disc_m = [0.0, 0.42]", "disc_m must hold 3 values, not 2"),
        ("push_N = 10.0", "push_N = 50.0", "must be less than the .* that device four-brake holds on path 1"),
        ('release = "pull"', 'release = "never"', "guard.release must be one of pull, clear"),
        ("[0.05, 0.28], [0.0, 0.28]]", "[0.0, 0.28], [0.05, 0.28]]", "polygon_m: must be convex"),
    ],
)
def test_obstacles_that_cannot_be_run_are_refused_in_a_sentence(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        load_protocol(protocol_with(tmp_path, old, new))


def test_a_guard_without_an_obstacle_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "alone.toml"
    path.write_text((SHIPPED_FOLDER / "paper.toml").read_text() + "\n[guard]\npush_N = 5.0\n")
    with pytest.raises(InputError, match="guard: there is no obstacle to guard"):
        load_protocol(path)


def test_a_guard_of_a_device_without_brakes_is_refused(tmp_path: Path) -> None:
    free = protocol_with(tmp_path, 'kind = "proportional"\ngain_N_s_m = 500.0', 'kind = "none"')
    with pytest.raises(InputError, match="guard: device unicycle has no brakes to lock"):
        load_protocol(free, devices=["unicycle"])


def test_a_steered_castor_leads_an_insisting_hand_along_a_wall_that_a_free_one_lets_it_through(tmp_path: Path) -> None:
    """The operator's path leads through the wall; the guide steers the castor, which nothing else can hold."""
    wall = tmp_path / "wall.toml"
    wall.write_text("""
name = "wall"
devices = ["unicycle"]
blocks = 1
[trial]
time_out_s = 6.0
[[obstacle]]
half_plane_m = [0.0, 0.42, 0.0, -1.0]
[[path]]
number = 1
kind = "polyline"
points_m = [[-0.10, 0.35], [0.0, 0.48], [0.10, 0.35]]
[[controller]]
number = 1
name = "None"
kind = "none"
[[controller]]
number = 2
name = "SDOF"
kind = "sdof"
""")
    run_study(tmp_path / "study", 2, load_protocol(wall), load_population())
    with (tmp_path / "study" / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        assert (float(row["deepest_entry_m"]) > 0.03) == (row["controller"] == "1")
    recording = read_recording(tmp_path / "study" / next(row["recording"] for row in rows if row["controller"] == "2"))
    assert recording.column("hand_fy_N")[recording.in_phase("move")].max() > 10.0, "it pushes at the wall"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One operator's study round obstacles, with a guard that acts."""
    folder = tmp_path_factory.mktemp("obstacles")
    changed = folder / "near.toml"
    changed.write_text(TEXT.replace("blocks = 3", "blocks = 1").replace("disc_m = [0.0, 0.42", "disc_m = [0.0, 0.405"))
    run_study(folder / "study", 1, load_protocol(changed), load_population())
    return folder / "study"


def test_a_trial_records_its_distance_from_obstacles_and_no_operator_gets_in(study: Path) -> None:
    with (study / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    for row in rows:
        assert float(row["deepest_entry_m"]) == 0.0 < float(row["least_clearance_m"])
        recording = read_recording(study / row["recording"])
        distance = recording.column("obstacle_distance_m")[recording.in_phase("move")]
        assert distance.min() == pytest.approx(float(row["least_clearance_m"]))
        locked = recording.text("decision")[recording.in_phase("move")] == "lock: obstacle"
        assert locked.mean() == pytest.approx(float(row["guarded_share"]))


def test_trials_round_obstacles_are_replayed_tick_by_tick_and_each_decision_is_the_same_again(study: Path) -> None:
    for file in sorted(study.glob("sub-*/ses-*/trials/*.parquet"))[:4]:
        summary = replay(file)
        assert summary["equal"] is True
        assert summary["decisions"]["different"] == 0 < summary["decisions"]["decisions"]
