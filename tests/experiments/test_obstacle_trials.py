"""Obstacles in protocols and trials: what is refused, what a trial records, and that it can be replayed."""

import math
from pathlib import Path

import numpy as np
import pytest
from exports import rows as csv_rows

from core.files import InputError
from core.obstacles import ObstacleFile, build_obstacles, nearest_obstacle
from core.path import Arc, Segment, build_path, point_at
from experiments.protocol import SHIPPED_FOLDER, load_protocol
from experiments.store.recording import read_recording
from experiments.study.replay import replay
from experiments.study.study import run_study
from experiments.trial.detour import CLEAR_M, from_obstacle, way_round
from experiments.trial.population import load_population

TEXT, PAPER = ((SHIPPED_FOLDER / f"{name}.toml").read_text() for name in ("obstacles", "paper"))


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
        ("push_N = 10.0", "push_N = 50.0", "must be less than the .* that device four-brake holds on path 1"),
        ("[0.05, 0.28], [0.0, 0.28]]", "[0.0, 0.28], [0.05, 0.28]]", "polygon_m: must be convex"),
        (TEXT, f"{PAPER}\n[guard]\npush_N = 5.0\n", "guard: there is no obstacle to guard"),
    ],
)
def test_obstacles_that_cannot_be_run_are_refused_in_a_sentence(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        load_protocol(protocol_with(tmp_path, old, new))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One operator's study round obstacles, with a guard that acts."""
    folder = tmp_path_factory.mktemp("obstacles")
    changed = folder / "near.toml"
    changed.write_text(TEXT.replace("blocks = 3", "blocks = 1").replace("disc_m = [0.0, 0.42", "disc_m = [0.0, 0.405"))
    run_study(folder / "study", 1, load_protocol(changed), load_population())
    return folder / "study"


def test_a_trial_records_its_distance_from_obstacles_and_no_operator_gets_in(study: Path) -> None:
    rows = csv_rows(study / "trials.csv")
    assert len(rows) == 6
    for row in rows:
        assert float(row["deepest_entry_m"]) == 0.0 < float(row["least_clearance_m"])
        recording = read_recording(study / row["recording"])
        distance = recording.column("obstacle_distance_m")[recording.in_phase("move")]
        assert distance.min() == pytest.approx(float(row["least_clearance_m"]))
        words = recording.text("decision")[recording.in_phase("move")]
        locked = np.isin(words, ["lock: obstacle", "lock: obstacle, too late to be sure"])
        assert locked.mean() == pytest.approx(float(row["guarded_share"]))


def test_trials_round_obstacles_are_replayed_tick_by_tick_and_each_decision_is_the_same_again(study: Path) -> None:
    for file in sorted(study.glob("sub-*/ses-*/trials/*.parquet"))[:2]:
        summary = replay(file)
        assert summary["equal"] is True
        assert summary["decisions"]["different"] == 0 < summary["decisions"]["decisions"]


ACROSS = Segment(start_m=(-0.1, 0.4), end_m=(0.1, 0.4))
BOX = ObstacleFile(polygon_m=((-0.02, 0.39), (0.02, 0.39), (0.02, 0.43), (-0.02, 0.43)))


def clearance(way, obstacles: list[ObstacleFile]) -> float:
    """The least distance of the way from any obstacle, m."""
    edges = build_obstacles(obstacles)
    places = [point_at(way, s)[:2] for s in np.linspace(0.0, way.length, 2000)]
    return min(nearest_obstacle(edges, len(edges), *place)[0] for place in places)


@pytest.mark.parametrize("obstacle", [
    ObstacleFile(disc_m=(0.0, 0.4, 0.02)), ObstacleFile(disc_m=(0.03, 0.41, 0.02)), BOX,
    ObstacleFile(polygon_m=((0.0, 0.41), (0.03, 0.44), (-0.03, 0.44))),
])  # fmt: skip
@pytest.mark.parametrize("path", [ACROSS, Arc(centre_m=(0.0, 0.35), radius_m=0.07, from_deg=150.0, to_deg=30.0)])
def test_the_way_keeps_clear_and_ends_where_the_path_does(obstacle: ObstacleFile, path: Segment | Arc) -> None:
    way, straight = way_round(path, [obstacle], "path 1"), build_path(path, "path 1")
    ends = [(straight.x0, straight.y0), (straight.x1, straight.y1)]
    assert clearance(way, [obstacle]) >= min(CLEAR_M, *(0.8 * from_obstacle(obstacle, *end) for end in ends)) - 1e-9
    assert math.dist((way.x0, way.y0), (straight.x0, straight.y0)) < 1e-12
    assert math.dist((way.x1, way.y1), (straight.x1, straight.y1)) < 1e-12


def test_of_the_two_ways_round_a_disc_the_shorter_is_taken_and_is_hardly_longer_than_tangents_and_arc() -> None:
    radius, off = 0.02 + CLEAR_M, 0.01
    way = way_round(ACROSS, [ObstacleFile(disc_m=(0.0, 0.4 + off, 0.02))], "path 1")
    places = np.array([point_at(way, s)[:2] for s in np.linspace(0.0, way.length, 2000)])
    assert places[:, 1].max() < 0.4 + 1e-9 and places[:, 1].min() == pytest.approx(0.4 + off - radius, abs=1e-3)
    half = math.sqrt(radius**2 - off**2)  # it leaves the path where it comes too near, not before
    arc = 2.0 * radius * math.acos(off / radius)
    assert way.length == pytest.approx(0.2 - 2.0 * half + arc, rel=0.02)


@pytest.mark.parametrize("obstacle", [
    ObstacleFile(half_plane_m=(0.05, 0.4, -1.0, 0.0)), ObstacleFile(disc_m=(0.1, 0.4, 0.02)),
])  # fmt: skip
def test_what_has_no_other_side_is_left_to_the_guard(obstacle: ObstacleFile) -> None:
    way = way_round(ACROSS, [obstacle], "path 1")
    assert np.array_equal(way.pieces, build_path(ACROSS, "path 1").pieces)
