"""Obstacles and their guard: distances, refusals; no hand within the push that is allowed for gets in."""

import math

import msgspec
import numpy as np
import pytest

from core.control.controllers import Preset, decide, make_controller
from core.control.guard import Around, Guard, least_held, make_around, stopping_distance
from core.control.velocity_field import new_memory
from core.device import Device, load_device
from core.files import InputError, from_plain
from core.obstacles import MOST_EDGES, Nearest, ObstacleFile, away_from, build_obstacles
from core.obstacles import nearest_obstacle as nearest_of
from core.path import line
from core.simulator.simulated_device import SimulatedDevice
from experiments.assumptions import DEFAULTS, ENCODERS, Assumptions
from experiments.trial.encoder_sensing import sensed_age
from tests.support.reaches import guarded, pushed_device, random_task, run_reach

FOUR, THREE = load_device("four-brake"), load_device("three-brake")
EAST = np.array([1.0, 0.0])


@pytest.mark.parametrize(("device", "most", "play"), [
    (FOUR, 20.0, True), (FOUR, 20.0, False), (THREE, 12.0, True), (THREE, 12.0, False),
])  # fmt: skip
def test_no_hand_within_the_push_gets_into_an_obstacle_and_without_the_guard_most_do(
    device: Device, most: float, play: bool
) -> None:
    rng, least, entered = np.random.default_rng(11), [], 0
    for _ in range(60):
        task = random_task(rng, most)
        with_guard, without = (
            guarded(device, task.obstacle, guard) for guard in (Guard(push_N=most, release="clear"), None)
        )
        least.append(run_reach(pushed_device(device, task.tip, play), with_guard, task.pushes).least)
        entered += run_reach(pushed_device(device, task.tip, play), without, task.pushes).least < 0.0
    assert min(least) > 0.0
    assert entered > 40
    assert np.median(least) < 0.03, "the guard stops far from what it guards"


def test_a_hand_seen_late_by_encoders_stays_out_too_and_only_because_the_guard_knows_the_delay() -> None:
    """A long filter and delay; push and speed of a hand that the guard sees 40 ms ago."""
    late, guard = Assumptions(sensing=ENCODERS, filter_samples=61, delay_samples=10), Guard(push_N=15.0)
    rng, least = np.random.default_rng(15), []
    for _ in range(60):
        task = random_task(rng, 15.0)
        least.append([
            run_reach(
                pushed_device(FOUR, task.tip, play=False), guarded(FOUR, task.obstacle, guard, known), task.pushes,
                assumed=late,
            ).least
            for known in (late, DEFAULTS)
        ])  # fmt: skip
    known, unknown = np.array(least).T
    assert known.min() > 0.0
    assert np.count_nonzero(unknown < 0.0) > 5


def test_the_bound_from_what_is_seen_late_is_never_under_the_way_from_there() -> None:
    """A hand pushes a free device, then all brakes lock: the bound from tip and velocity as they were seen."""
    late = Assumptions(sensing=ENCODERS, filter_samples=31, delay_samples=5)
    tip_age, velocity_age = sensed_age(late)
    rng = np.random.default_rng(16)
    for _ in range(40):
        angle, force = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(2.0, 15.0)
        device = pushed_device(FOUR, (rng.uniform(-0.05, 0.05), rng.uniform(0.37, 0.43)), play=bool(rng.integers(2)))
        device.hand.grips["held"][0] = force * math.cos(angle), force * math.sin(angle)
        device.settle(np.zeros(4), 0.0)
        course = [device.state["tip"][0].copy()]
        for n in range(rng.integers(40, 120)):
            device.move(np.zeros(4), 1e-3 * n, 1e-3)
            course.append(device.state["tip"][0].copy())
        window = np.array(course[-round(1e3 * (2.0 * velocity_age - tip_age)) - 1 :])
        ticks = np.arange(len(window) - round(1e3 * tip_age)) * 1e-3
        vx, vy = (np.polyfit(ticks, window[: len(ticks), axis], 1)[0] for axis in (0, 1))
        around = make_around(Around(guard=Guard(push_N=force)), FOUR.brakes, (tip_age, velocity_age))[0]
        bound = stopping_distance(around, device.brakes[0], device.state["g"][0], device.state["mass"][0], vx, vy, 1.0)
        start, furthest = window[len(ticks) - 1, :2], 0.0
        for n in range(400):
            device.move(device.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(start, device.tip))
        assert furthest <= bound, f"{1e3 * furthest:.1f} mm, bound {1e3 * bound:.1f} mm"


def test_a_push_beyond_what_is_allowed_for_gets_in() -> None:
    rng = np.random.default_rng(13)
    guard, least = Guard(push_N=3.0), []
    for task in (random_task(rng, 30.0) for _ in range(30)):
        least.append(run_reach(pushed_device(FOUR, task.tip), guarded(FOUR, task.obstacle, guard), task.pushes).least)
    assert min(least) < 0.0, "what the guard does not promise must be seen, or the tasks are too easy"


def way(device: SimulatedDevice, force: float, vx: float, vy: float) -> float:
    """The bound (m) for a hand that pushes with at most `force` (N)."""
    around, state = make_around(Around(guard=Guard(push_N=force)), device.device.brakes), device.state[0]
    return float(stopping_distance(around[0], device.brakes[0], state.g, state.mass, vx, vy, 1.0))


def test_the_bound_is_never_under_the_way_that_a_push_takes() -> None:
    rng = np.random.default_rng(12)
    for _ in range(60):
        angle, speed, force = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 0.4), rng.uniform(0.1, 18.0)
        device = pushed_device(FOUR, (rng.uniform(-0.05, 0.05), rng.uniform(0.37, 0.43)), play=bool(rng.integers(2)))
        device.state["tip"][0, 2:] = speed * math.cos(angle), speed * math.sin(angle)
        device.hand.grips["held"][0] = force * math.cos(angle), force * math.sin(angle)
        device.settle(np.zeros(4), 0.0)
        bound = way(device, force, *device.state["tip"][0, 2:])
        start, furthest = device.tip, 0.0
        for n in range(400):
            device.move(device.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(start, device.tip))
        assert furthest <= bound, f"{1e3 * furthest:.1f} mm, bound {1e3 * bound:.1f} mm"


def test_the_more_the_hand_may_push_and_the_faster_it_comes_the_longer_the_way() -> None:
    device = pushed_device(FOUR, (0.0, 0.4))
    device.settle(np.zeros(4), 0.0)
    forces = [way(device, force, 0.2, 0.0) for force in (0.1, 5.0, 10.0, 20.0)]
    speeds = [way(device, 10.0, speed, 0.0) for speed in (0.0, 0.1, 0.3, 0.6)]
    assert forces == sorted(forces) and speeds == sorted(speeds) and forces[0] > 0.0
    held = least_held(FOUR.mechanism, FOUR.brakes, np.array([[0.0, 0.4]]))
    assert way(device, 1.01 * held, 0.0, 0.0) == math.inf, "more than a full lock holds cannot be stopped"


def test_a_hand_that_pushes_against_the_wall_is_held_by_locks_that_do_not_chatter() -> None:
    controller = guarded(FOUR, ObstacleFile(half_plane_m=(0.06, 0.4, -1.0, 0.0)), Guard(push_N=20.0))
    reached = run_reach(pushed_device(FOUR, (0.0, 0.4)), controller, 15.0 * EAST * np.ones((20, 1)))
    assert 1 <= reached.locks <= 5, "it stops, may come a little nearer, then it stands"
    assert 0.0 < reached.last == pytest.approx(reached.least, abs=1e-4)


@pytest.mark.parametrize("release", ["pull", "clear"])
def test_a_hand_that_pulls_away_is_let_go_at_once_where_the_protocol_says_so(release: str) -> None:
    wall = ObstacleFile(half_plane_m=(0.03, 0.4, -1.0, 0.0))
    pushes = np.concatenate([15.0 * EAST * np.ones((5, 1)), -8.0 * EAST * np.ones((10, 1))])
    device = pushed_device(FOUR, (0.0, 0.4), play=False)
    reached = run_reach(device, guarded(FOUR, wall, Guard(push_N=20.0, release=release)), pushes)
    if release == "pull":
        assert reached.last > reached.least + 0.02
    else:
        assert reached.last < reached.least + 0.002, "the lock is what traps a hand near a wall"


def test_who_feigns_a_pull_comes_nearer_than_the_guard_promises() -> None:
    """The price of letting go by the sensed force, which the documentation states."""
    rng = np.random.default_rng(14)
    tasks = [random_task(rng, 20.0) for _ in range(40)]
    least = {
        release: np.array([
            run_reach(
                pushed_device(FOUR, task.tip), guarded(FOUR, task.obstacle, Guard(push_N=20.0, release=release)),
                task.pushes, adversary=True,
            ).least
            for task in tasks
        ])
        for release in ("pull", "clear")
    }  # fmt: skip
    assert least["clear"].min() > 0.0
    assert np.median(least["pull"]) < np.median(least["clear"])


def test_near_an_obstacle_the_field_leads_round_it_and_at_its_edge_away_from_it() -> None:
    around = make_around(Around(obstacles=(ObstacleFile(disc_m=(0.0, 0.45, 0.02)),)), FOUR.brakes)
    controller = make_controller(Preset("", "sdof", (0.0,)), FOUR.force_normalised_N, around=around)
    device = pushed_device(FOUR, (0.0, 0.4))
    g, mass, path = device.state["g"][0], device.state["mass"][0], line((-0.1, 0.4), (0.1, 0.4))

    def beta(y: float, force: float) -> tuple[float, float]:
        _, field = decide(
            controller, device.brakes[0], path, new_memory(), 0.0, y, 0.0, 0.0, force, 0.0, g, mass, np.zeros(4)
        )
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
        ({"disc_m": [0, 0.4, 0.0]}, "must be greater than 0"),
        ({"half_plane_m": [0, 0.4, 0, 0]}, "has no length"),
        ({"polygon_m": [[0, 0], [1, 0]]}, "3"),
        ({"polygon_m": [[0, 0], [1, 0], [0.2, 0.2], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 1], [0, 1], [1, 0]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [1, 0], [2, 0], [0, 1]]}, "must be convex"),
        ({"polygon_m": [[0, 0], [0, 0], [1, 0], [0, 1]]}, "two corners on end are the same"),
        ({"ring_m": [0, 0]}, "unknown key"),
    ],
)
def test_an_obstacle_that_cannot_be_is_refused_in_a_sentence(content: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        from_plain(msgspec.json.decode(msgspec.json.encode(content)), ObstacleFile, "file")


def test_more_edges_than_the_kernels_have_room_for_are_refused() -> None:
    discs = [ObstacleFile(disc_m=(0.001 * n, 0.4, 0.01)) for n in range(MOST_EDGES + 1)]
    assert len(build_obstacles(discs[1:])) == MOST_EDGES
    with pytest.raises(ValueError, match="at most"):
        build_obstacles(discs)
