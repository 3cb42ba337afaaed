"""The guard of obstacles: no hand within the push that is allowed for gets in; who pulls away is let go."""

import math

import numpy as np
import pytest

from core.control.guard import GuardNumbers, keep_out, new_guard, stopping_distance
from core.device import Device, load_device
from core.kernel import kernel
from core.obstacles import ObstacleFile, build_obstacles, nearest_obstacle
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice

NO_RELEASE = math.inf
FOUR, THREE = load_device("four-brake"), load_device("three-brake")


def pushed_device(device: Device, tip: tuple[float, float], play: bool) -> SimulatedDevice:
    """At rest, to be pushed by `push`."""
    simulated = SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    if not play:
        simulated.brakes["play"][0] = 0.0
    return simulated


def push(device: SimulatedDevice, force: float, angle: float) -> None:
    """The hand's force (N) from now on."""
    device.hand.grips["held"][0] = force * math.cos(angle), force * math.sin(angle)


@kernel
def one_tick(guard, edges, brakes, states, current):
    """The guard's decision, as a tick makes it."""
    for i in range(4):
        current[i] = 0.0
    return keep_out(guard[0], edges, brakes[0], states[0], current)


def reach(device: SimulatedDevice, guard: np.recarray, edges: np.ndarray, rng: np.random.Generator, towards: float,
          most: float, ticks: int = 1200) -> tuple[float, int]:  # fmt: skip
    """A hand that pushes more or less towards the obstacle, another way every 0.1 s: least distance (m), locks."""
    current, least, locks, before = np.zeros(4), math.inf, 0, False
    for n in range(ticks):
        if n % 100 == 0:
            push(device, rng.uniform(0.3 * most, most), towards + rng.uniform(-1.3, 1.3))
        device.settle(current, 1e-3 * n)
        locked = one_tick(guard, edges, device.brakes, device.state, current)
        locks, before = locks + (locked and not before), locked
        device.move(current, 1e-3 * n, 1e-3)
        least = min(least, nearest_obstacle(edges, *device.tip).distance)
    return least, locks


@pytest.mark.parametrize("play", [True, False], ids=["play", "no play"])
@pytest.mark.parametrize(("device", "most"), [(FOUR, 20.0), (THREE, 12.0)], ids=["four-brake", "three-brake"])
def test_no_hand_within_the_push_gets_into_an_obstacle_and_without_the_guard_most_do(
    device: Device, most: float, play: bool
) -> None:
    rng = np.random.default_rng(11)
    least, entered = [], 0
    for n in range(24):
        tip = rng.uniform(-0.1, 0.1), rng.uniform(0.34, 0.45)
        angle, distance = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.03, 0.07)
        place = tip[0] + distance * math.cos(angle), tip[1] + distance * math.sin(angle)
        wall = ObstacleFile(half_plane_m=(*place, -math.cos(angle), -math.sin(angle)))
        edges = build_obstacles([wall if n % 2 else ObstacleFile(disc_m=(
            place[0] + 0.02 * math.cos(angle), place[1] + 0.02 * math.sin(angle), 0.02))])  # fmt: skip
        state = rng.bit_generator.state
        simulated = pushed_device(device, tip, play)
        guard = new_guard(GuardNumbers(most, 0.0, NO_RELEASE), simulated.brakes)
        least.append(reach(simulated, guard, edges, rng, angle, most)[0])
        rng.bit_generator.state = state
        unguarded = pushed_device(device, tip, play)
        entered += reach(unguarded, new_guard(GuardNumbers(0.0, -1.0, NO_RELEASE), unguarded.brakes), edges, rng, angle,
                         most)[0] < 0.0  # fmt: skip
    assert min(least) > 0.0
    assert entered > 16
    assert np.median(least) < (0.03 if device is FOUR else 0.05), "the guard stops far from what it guards"


def test_the_bound_is_never_under_the_way_that_a_straight_push_takes() -> None:
    rng = np.random.default_rng(12)
    for _ in range(40):
        angle, speed, force = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 0.4), rng.uniform(0.0, 18.0)
        device = pushed_device(FOUR, (rng.uniform(-0.05, 0.05), rng.uniform(0.37, 0.43)), play=bool(rng.integers(2)))
        device.state["tip"][0, 2:] = speed * math.cos(angle), speed * math.sin(angle)
        device.state["held"][0] = -1 if speed == 0.0 else device.state["held"][0]
        push(device, force, angle)
        device.settle(np.zeros(4), 0.0)
        guard, state = new_guard(GuardNumbers(force, 0.0, NO_RELEASE), device.brakes), device.state[0]
        bound = stopping_distance(
            guard[0], device.brakes[0], state.g, state.mass, state.tip[2], state.tip[3], False, state.torque_yield, 1.0
        )
        start, furthest = device.tip, 0.0
        for n in range(600):
            device.move(device.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(start, device.tip))
        assert furthest <= bound, f"{1e3 * furthest:.1f} mm, bound {1e3 * bound:.1f} mm"


def test_the_more_the_hand_may_push_and_the_faster_it_comes_the_longer_the_way() -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=True)
    device.settle(np.zeros(4), 0.0)
    state = device.state[0]

    def way(force: float, speed: float) -> float:
        guard = new_guard(GuardNumbers(force, 0.0, NO_RELEASE), device.brakes)
        return float(stopping_distance(
            guard[0], device.brakes[0], state.g, state.mass, speed, 0.0, False, state.torque_yield, 1.0
        ))  # fmt: skip

    forces = [way(force, 0.2) for force in (0.0, 5.0, 10.0, 20.0)]
    speeds = [way(10.0, speed) for speed in (0.0, 0.1, 0.3, 0.6)]
    assert forces == sorted(forces) and speeds == sorted(speeds) and forces[0] > 0.0
    assert way(0.0, 0.0) == 0.0
    assert way(60.0, 0.0) == math.inf, "a push above what a full lock holds cannot be stopped"


def test_a_hand_that_pushes_against_the_wall_is_held_by_locks_that_do_not_chatter() -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=True)
    edges = build_obstacles([ObstacleFile(half_plane_m=(0.06, 0.4, -1.0, 0.0))])
    guard = new_guard(GuardNumbers(20.0, 0.0, 2.0), device.brakes)
    current, locks, before, last = np.zeros(4), 0, False, 0
    push(device, 15.0, 0.0)
    for n in range(2000):
        device.settle(current, 1e-3 * n)
        locked = one_tick(guard, edges, device.brakes, device.state, current)
        locks, last, before = locks + (locked and not before), n if locked != before else last, locked
        device.move(current, 1e-3 * n, 1e-3)
    assert before and locks <= 3 and last < 1000, "a stop, at most a little nearer, then it stands"
    assert 0.0 < nearest_obstacle(edges, *device.tip).distance < 0.03


@pytest.mark.parametrize("let_go", [2.0, NO_RELEASE], ids=["a pull releases", "a pull does not release"])
def test_a_hand_that_pulls_away_is_let_go_at_once_where_the_protocol_says_so(let_go: float) -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=False)
    edges = build_obstacles([ObstacleFile(half_plane_m=(0.03, 0.4, -1.0, 0.0))])
    guard = new_guard(GuardNumbers(20.0, 0.0, let_go), device.brakes)
    current = np.zeros(4)
    for n in range(1500):
        push(device, 15.0 if n < 500 else 8.0, 0.0 if n < 500 else math.pi)
        device.settle(current, 1e-3 * n)
        one_tick(guard, edges, device.brakes, device.state, current)
        device.move(current, 1e-3 * n, 1e-3)
        if n == 499:
            stood = device.tip
    if let_go == 2.0:
        assert device.tip[0] < stood[0] - 0.02 and not current.any()
    else:
        assert math.dist(device.tip, stood) < 0.002, "the lock is what traps a hand near a wall"
