"""Obstacles and their guard: distances, refusals; no hand within the push that is allowed for gets in."""

import math

import msgspec
import numpy as np
import pytest

from core.control.algorithm import Tick
from core.control.controllers import DECISIONS, Preset, decide, make_controller
from core.control.guard import Around, Guard, make_around, tick_at
from core.control.velocity_field import HOLDS, Seen, new_memory
from core.device import load_device
from core.files import InputError, from_plain
from core.obstacles import Nearest, ObstacleFile, away_from, build_obstacles
from core.obstacles import nearest_obstacle as nearest_of
from core.path import line
from experiments.assumptions import DEFAULTS, ENCODERS, Assumptions
from tests.support.reaches import (
    KINDS,
    PUSHES_N,
    guarded,
    held_on,
    pushed_device,
    random_attacks,
    run_reach,
)

FOUR, THREE = load_device("four-brake"), load_device("three-brake")
EAST = np.array([1.0, 0.0])


ER, PTER = load_device("er-two-brake"), load_device("pter")
DISPLAYS = {device.name: device for device in (ER, THREE, FOUR, PTER)}


@pytest.mark.parametrize("name", DISPLAYS)
@pytest.mark.parametrize("kind", KINDS)
def test_no_hand_of_the_full_push_gets_in_where_the_guard_was_sure_and_without_it_many_do(name: str, kind: str) -> None:
    """Straight, run-ups, turning, rocking, any pushes."""
    device, least, sure, entered = DISPLAYS[name], [], 0, 0
    for n, task in enumerate(random_attacks(np.random.default_rng(2026 + KINDS.index(kind)), kind, device, 8)):
        guard = Guard(push_N=PUSHES_N[name], release=("pull", "clear")[n % 2])
        found, without = (
            run_reach(pushed_device(device, task.tip), guarded(device, task.obstacle, one), task.forces)
            for one in (guard, None)
        )
        assert found.first_unsure > 0.0 or found.unsure > 0
        assert found.least > 0.0 or found.first_unsure == 0.0, f"{1e3 * found.least:.1f} mm"
        assert name != "er-two-brake" or found.unsure == 0, "without play the promise is for ever"
        least.append(found.least)
        sure += found.first_unsure > 0.0
        entered += without.least < 0.0
    assert sure > 2 and entered > 2
    assert np.median(least) < 0.045, "the guard stops far from what it guards"


def test_hands_that_got_in_where_mass_and_rows_of_one_pose_were_looked_at_do_not() -> None:
    tip, angle = (0.05548013008429037, 0.3957751133750697), 0.6885950036147301  # 2.4 mm inside
    way = np.array([math.cos(angle), math.sin(angle)])
    x, y = tip + 0.07910270863217779 * way
    wall = ObstacleFile(half_plane_m=(x, y, *-way))
    came = run_reach(pushed_device(ER, tip), guarded(ER, wall, Guard(push_N=8.0)), 8.0 * way * np.ones((1500, 1)))
    assert came.unsure == 0
    assert 0.0 < came.least < 0.005
    for pull_ticks in (200, 300, 400):  # a run-up: 135 mm inside
        forces = 11.0 * np.where(np.arange(2500)[:, None] < pull_ticks, -EAST, EAST)
        wall = ObstacleFile(half_plane_m=(0.09, 0.4, -1.0, 0.0))
        came = run_reach(pushed_device(THREE, (0.0, 0.4)), guarded(THREE, wall, Guard(push_N=11.0)), forces)
        assert came.first_unsure > 0.0
        assert came.least > 0.01
        assert came.fastest < 1.0, "it is slowed before it is too fast to be stopped"


def test_a_hand_seen_late_by_encoders_stays_out_too_and_only_because_the_guard_knows_the_delay() -> None:
    """A long filter and delay; push and speed of a hand that the guard sees 70 ms ago."""
    late, guard = Assumptions(sensing=ENCODERS, filter_samples=61, delay_samples=10), Guard(push_N=8.0)
    least = []
    for task in random_attacks(np.random.default_rng(15), "pushes", ER, 20):
        least.append([
            run_reach(
                pushed_device(ER, task.tip), guarded(ER, task.obstacle, guard, known), task.forces, assumed=late,
            ).least
            for known in (late, DEFAULTS)
        ])  # fmt: skip
    known, unknown = np.array(least).T
    assert known.min() > 0.0
    assert np.count_nonzero(unknown < 0.0) > 1


def test_where_it_cannot_be_sure_the_guard_locks_and_says_so() -> None:
    wall = ObstacleFile(half_plane_m=(0.005, 0.4, -1.0, 0.0))
    guard = make_around(Around(obstacles=(wall,), guard=Guard(push_N=17.0)), FOUR)
    controller = make_controller(Preset("", "none"), FOUR.force_normalised_N, around=guard)
    tick = tick_at(FOUR, (0.0, 0.4), (0.5, 0.0))
    code, _ = decide(controller, line((-0.1, 0.4), (0.1, 0.4)), tick)
    assert DECISIONS[code] == "lock: obstacle, too late to be sure"
    assert tick.memory[HOLDS] == 0.0
    assert (tick.current == FOUR.brakes.current_max).all()


def test_a_hand_that_pushes_against_the_wall_is_held_by_locks_that_do_not_chatter() -> None:
    controller = guarded(FOUR, ObstacleFile(half_plane_m=(0.06, 0.4, -1.0, 0.0)), Guard(push_N=17.0))
    reached = run_reach(pushed_device(FOUR, (0.0, 0.4)), controller, 15.0 * EAST * np.ones((2000, 1)))
    assert 1 <= reached.locks <= 5, "it stops, may come a little nearer, then it stands"
    assert 0.0 < reached.last == pytest.approx(reached.least, abs=1e-4)


@pytest.mark.parametrize("release", ["pull", "clear"])
def test_a_hand_that_pulls_away_is_let_go_at_once_where_the_protocol_says_so(release: str) -> None:
    wall = ObstacleFile(half_plane_m=(0.01, 0.4, -1.0, 0.0))
    pushes = held_on(np.concatenate([8.0 * EAST * np.ones((5, 1)), -8.0 * EAST * np.ones((10, 1))]))
    reached = run_reach(pushed_device(ER, (0.0, 0.4)), guarded(ER, wall, Guard(push_N=8.0, release=release)), pushes)
    if release == "pull":
        assert reached.last > reached.least + 0.02
    else:
        assert reached.last < reached.least + 0.002, "the lock is what traps a hand near a wall"


@pytest.mark.parametrize("name", DISPLAYS)
def test_a_hand_that_pushed_too_hard_is_let_go_when_it_pulls_away(name: str) -> None:
    """Beyond the promise, too: nobody has to fight the brakes to get away."""
    push, device = PUSHES_N[name], DISPLAYS[name]
    wall = ObstacleFile(half_plane_m=(0.03, 0.4, -1.0, 0.0))
    pushes = held_on(np.concatenate([1.9 * push * EAST * np.ones((6, 1)), -push * EAST * np.ones((12, 1))]))
    reached = run_reach(pushed_device(device, (0.0, 0.4)), guarded(device, wall, Guard(push_N=push)), pushes)
    assert reached.last > reached.least + 0.01


def test_near_an_obstacle_the_field_leads_round_it_and_at_its_edge_away_from_it() -> None:
    around = make_around(Around(obstacles=(ObstacleFile(disc_m=(0.0, 0.45, 0.02)),)), FOUR)
    controller = make_controller(Preset("", "sdof", (0.0,)), FOUR.force_normalised_N, around=around)
    device = pushed_device(FOUR, (0.0, 0.4))
    g, mass, path = device.body["g"][0], device.body["mass"][0], line((-0.1, 0.4), (0.1, 0.4))

    def beta(y: float, force: float) -> tuple[float, float]:
        seen = Seen(0.0, y, 0.0, 0.0, force, 0.0)
        _, field = decide(controller, path, Tick(seen, g, mass, device.brakes[0], new_memory(), np.zeros(4)))
        return field.beta_x, field.beta_y

    assert beta(0.43 - 1e-9, 5.0) == pytest.approx((0.0, -1.0), abs=1e-6)  # at the edge: outward
    assert beta(0.44, 5.0) == pytest.approx((0.0, -1.0), abs=1e-6)  # inside likewise
    assert beta(0.38 + 1e-9, 5.0) == pytest.approx((1.0, 0.0), abs=1e-6)  # 5 cm away: along, in the hand's sense
    assert beta(0.38 + 1e-9, -5.0) == pytest.approx((-1.0, 0.0), abs=1e-6)
    middle = beta(0.405, 5.0)
    assert middle == pytest.approx((math.sqrt(0.5), -math.sqrt(0.5)), abs=1e-6)
    assert beta(0.37, 5.0)[1] > 0.0  # farther away the path's field counts again


SQUARE = ((0.1, 0.3), (0.2, 0.3), (0.2, 0.4), (0.1, 0.4))


def nearest_obstacle(edges: np.ndarray, x: float, y: float) -> Nearest:
    """Of all edges."""
    return Nearest(*nearest_of(edges, len(edges), x, y))


def outline(corners: tuple[tuple[float, float], ...], spacing: int = 2000) -> np.ndarray:
    """Points all along the edge of a polygon."""
    ends = np.array(corners)
    ways = np.linspace(0.0, 1.0, spacing)[:, None, None]
    return (ends + ways * (np.roll(ends, -1, axis=0) - ends)).reshape(-1, 2)


def convex(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """A random convex polygon, either way round."""
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(3, 9)))
    while np.diff(angles, append=angles[0] + 2.0 * math.pi).min() < 0.1:
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, len(angles)))
    corners = [(0.05 + 0.08 * math.cos(a), 0.4 + 0.05 * math.sin(a)) for a in angles]
    return tuple(corners if rng.random() < 0.5 else corners[::-1])


def test_the_distance_from_a_polygon_is_that_of_the_nearest_point_of_its_edge_negative_inside() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        corners = convex(rng)
        edges, points = build_obstacles([ObstacleFile(polygon_m=corners)]), outline(corners)
        for x, y in rng.uniform((-0.1, 0.3), (0.2, 0.5), (20, 2)):
            found = nearest_obstacle(edges, x, y)
            nearest = points[np.argmin(np.hypot(points[:, 0] - x, points[:, 1] - y))]
            assert abs(found.distance) == pytest.approx(math.dist(nearest, (x, y)), abs=1e-6)
            on_edge = x - found.distance * found.n_x, y - found.distance * found.n_y
            assert math.dist(on_edge, nearest) < 1e-3 or found.distance < 0.0
            assert math.hypot(found.n_x, found.n_y) == pytest.approx(1.0)


def test_a_step_along_the_normal_leads_away_as_far() -> None:
    rng = np.random.default_rng(4)
    shapes = [
        ObstacleFile(disc_m=(0.0, 0.4, 0.03)), ObstacleFile(half_plane_m=(0.0, 0.35, 1.0, 2.0)),
        ObstacleFile(polygon_m=SQUARE),
    ]  # fmt: skip
    for shape in shapes:
        edges = build_obstacles([shape])
        for x, y in rng.uniform((-0.2, 0.2), (0.3, 0.5), (200, 2)):
            here = nearest_obstacle(edges, x, y)
            if here.distance > 0.0:
                further = nearest_obstacle(edges, x + 0.01 * here.n_x, y + 0.01 * here.n_y)
                assert further.distance == pytest.approx(here.distance + 0.01, abs=1e-9)


def test_of_several_obstacles_the_nearest_counts_and_none_is_infinitely_far() -> None:
    shapes = [ObstacleFile(disc_m=(0.0, 0.4, 0.03)), ObstacleFile(polygon_m=SQUARE)]
    both, alone = build_obstacles(shapes), [build_obstacles([shape]) for shape in shapes]
    for x, y in np.random.default_rng(5).uniform((-0.2, 0.2), (0.3, 0.5), (200, 2)):
        distances = [away_from(edges, 0, len(edges), x, y).distance for edges in alone]
        assert nearest_obstacle(both, x, y).distance == min(distances)
    assert nearest_obstacle(np.zeros((0, 7)), 0.0, 0.4).distance == math.inf


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, "must be one of disc_m, half_plane_m, polygon_m"),
        ({"disc_m": [0, 0.4, 0.1], "polygon_m": SQUARE}, "must be one of disc_m, half_plane_m, polygon_m"),
        ({"disc_m": [0, 0.4, 0.0]}, "must be at least 1e-06"),
        ({"half_plane_m": [0, 0.4, 0, 0]}, "has no length"),
        ({"polygon_m": [[0, 0], [1, 0]]}, "3"),
        ({"polygon_m": [[0, 0], [1, 0], [0.2, 0.2], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 1], [0, 1], [1, 0]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 0], [2, 0], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [0, 0], [1, 0], [0, 1]]}, "two corners on end are the same"),
    ],
)
def test_an_obstacle_that_cannot_be_is_refused_in_a_sentence(content: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        from_plain(msgspec.json.decode(msgspec.json.encode(content)), ObstacleFile, "file")
