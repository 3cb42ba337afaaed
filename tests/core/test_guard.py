"""The guard of obstacles: no hand within the push that is allowed for gets in; who pulls away is let go."""

import math

import numpy as np
import pytest

from core.control.algorithm import LOCK_OBSTACLE
from core.control.controllers import Controller, Preset, decide, make_controller
from core.control.guard import Guard, make_around, stopping_distance
from core.control.velocity_field import new_memory
from core.device import Device, load_device
from core.obstacles import ObstacleFile, nearest_obstacle
from core.path import Path, line
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice

PATH: Path = line((-0.1, 0.4), (0.1, 0.4))
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


def way(device: SimulatedDevice, force: float, vx: float, vy: float) -> float:
    """The bound (m) for a hand that pushes with at most `force` (N)."""
    around, state = make_around(guard=Guard(push_N=force), brakes=device.device.brakes), device.state[0]
    return float(stopping_distance(around[0], device.brakes[0], state.g, state.mass, vx, vy, 1.0))


def guarded(device: SimulatedDevice, obstacle: ObstacleFile, guard: Guard | None) -> Controller:
    """No control beside the guard."""
    around = make_around([obstacle], guard=guard, brakes=device.device.brakes)
    return make_controller(Preset("", "none"), device.device.force_normalised_N, around=around)


class Reach:
    """A device, tick by tick, under the guard of one obstacle."""

    def __init__(self, device: SimulatedDevice, obstacle: ObstacleFile, guard: Guard | None) -> None:
        self.device, self.controller = device, guarded(device, obstacle, guard)
        self.memory, self.current, self.n = new_memory(), np.zeros(4), 0
        self.locked, self.locks, self.last, self.least = False, 0, 0, self.distance

    @property
    def distance(self) -> float:
        """From the obstacle, m."""
        around = self.controller.around[0]
        return float(nearest_obstacle(around.edges, around.count, *self.device.tip)[0])

    def tick(self) -> None:
        """Decide and move, as a trial does."""
        device, state = self.device, self.device.state[0]
        device.settle(self.current, 1e-3 * self.n)
        code, _ = decide(
            self.controller, device.brakes[0], PATH, self.memory, *state.tip, *state.hand_force, state.g, state.mass,
            self.current,
        )  # fmt: skip
        if (code == LOCK_OBSTACLE) != self.locked:
            self.locked, self.last, self.locks = not self.locked, self.n, self.locks + (not self.locked)
        device.move(self.current, 1e-3 * self.n, 1e-3)
        self.n, self.least = self.n + 1, min(self.least, self.distance)


def restless(reach: Reach, rng: np.random.Generator, towards: float, most: float) -> float:
    """A hand that pushes more or less towards the obstacle, another way every 0.1 s; the least distance, m."""
    for n in range(800):
        if n % 100 == 0:
            push(reach.device, rng.uniform(0.3 * most, most), towards + rng.uniform(-1.3, 1.3))
        reach.tick()
    return reach.least


@pytest.mark.parametrize(("device", "most", "play"), [(FOUR, 20.0, True), (FOUR, 20.0, False), (THREE, 12.0, True)])
def test_no_hand_within_the_push_gets_into_an_obstacle_and_without_the_guard_most_do(
    device: Device, most: float, play: bool
) -> None:
    rng = np.random.default_rng(11)
    least, entered = [], 0
    for n in range(10):
        tip = rng.uniform(-0.1, 0.1), rng.uniform(0.34, 0.45)
        angle, distance = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.03, 0.07)
        place = tip[0] + distance * math.cos(angle), tip[1] + distance * math.sin(angle)
        wall = ObstacleFile(half_plane_m=(*place, -math.cos(angle), -math.sin(angle)))
        middle = place[0] + 0.02 * math.cos(angle), place[1] + 0.02 * math.sin(angle)
        obstacle = wall if n % 2 else ObstacleFile(disc_m=(*middle, 0.02))
        state = rng.bit_generator.state
        guard = Guard(push_N=most, release="clear")
        least.append(restless(Reach(pushed_device(device, tip, play), obstacle, guard), rng, angle, most))
        rng.bit_generator.state = state
        entered += restless(Reach(pushed_device(device, tip, play), obstacle, None), rng, angle, most) < 0.0
    assert min(least) > 0.0
    assert entered > 6
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
        bound = way(device, max(force, 1e-9), *device.state["tip"][0, 2:])
        start, furthest = device.tip, 0.0
        for n in range(600):
            device.move(device.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(start, device.tip))
        assert furthest <= bound, f"{1e3 * furthest:.1f} mm, bound {1e3 * bound:.1f} mm"


def test_the_more_the_hand_may_push_and_the_faster_it_comes_the_longer_the_way() -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=True)
    device.settle(np.zeros(4), 0.0)
    forces = [way(device, force, 0.2, 0.0) for force in (1e-9, 5.0, 10.0, 20.0)]
    speeds = [way(device, 10.0, speed, 0.0) for speed in (0.0, 0.1, 0.3, 0.6)]
    assert forces == sorted(forces) and speeds == sorted(speeds) and forces[0] > 0.0
    assert way(device, 60.0, 0.0, 0.0) == math.inf, "a push above what a full lock holds cannot be stopped"


def test_a_hand_that_pushes_against_the_wall_is_held_by_locks_that_do_not_chatter() -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=True)
    reach = Reach(device, ObstacleFile(half_plane_m=(0.06, 0.4, -1.0, 0.0)), Guard())
    push(device, 15.0, 0.0)
    for _ in range(2000):
        reach.tick()
    assert reach.locked and reach.locks <= 5 and reach.last < 1000, "it stops, comes a little nearer, then it stands"
    assert 0.0 < reach.distance < 0.03


@pytest.mark.parametrize("release", ["pull", "clear"])
def test_a_hand_that_pulls_away_is_let_go_at_once_where_the_protocol_says_so(release: str) -> None:
    device = pushed_device(FOUR, (0.0, 0.4), play=False)
    reach = Reach(device, ObstacleFile(half_plane_m=(0.03, 0.4, -1.0, 0.0)), Guard(release=release))
    push(device, 15.0, 0.0)
    for _ in range(500):
        reach.tick()
    stood = device.tip
    push(device, 8.0, math.pi)
    for _ in range(1000):
        reach.tick()
    if release == "pull":
        assert device.tip[0] < stood[0] - 0.02 and not reach.current.any()
    else:
        assert math.dist(device.tip, stood) < 0.002, "the lock is what traps a hand near a wall"
