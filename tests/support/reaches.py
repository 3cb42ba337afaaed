"""Hands that push a device towards an obstacle, tick by tick, compiled: what the guard of obstacles is tried with."""

import math
from typing import NamedTuple

import numpy as np

from core.control.controllers import Controller, Preset, decide, make_controller
from core.control.guard import Around, Guard, make_around
from core.control.velocity_field import LOCKED, new_memory
from core.device import Device
from core.kernel import kernel
from core.obstacles import ObstacleFile, nearest_obstacle
from core.path import Path, line
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice, move, settle
from experiments.assumptions import DEFAULTS, Assumptions
from experiments.trial.encoder_sensing import new_sensing, see, sensed_age

PATH: Path = line((-0.1, 0.4), (0.1, 0.4))
TURN_TICKS = 100  # for so long a hand pushes one way


@kernel
def reach(
    controller, path, mechanisms, brakes, hand, states, scratches, sensing, memory, pushes, adversary, current, found
):  # fmt: skip
    """Ticks of a hand that pushes with pushes (n, 2), N, for 0.1 s each; found (3,): least and last distance, locks.

    adversary: 1: a locked hand pulls away with 3 N until it is let go, then pushes again.
    """
    around, state, grip = controller.around[0], states[0], hand.grips[0]
    found[0], found[1], found[2] = math.inf, 0.0, 0.0
    for n in range(pushes.shape[0] * TURN_TICKS):
        t = 1e-3 * n
        push_x, push_y = pushes[n // TURN_TICKS, 0], pushes[n // TURN_TICKS, 1]
        near = nearest_obstacle(around.edges, around.count, state.tip[0], state.tip[1])
        was_locked = memory[LOCKED]
        if adversary != 0 and was_locked != 0.0:
            push_x, push_y = 3.0 * near.n_x, 3.0 * near.n_y
        grip.held[0], grip.held[1] = push_x, push_y
        settle(mechanisms, brakes, hand, states, scratches, current, t, 2, 0)
        seen = state
        if sensing.sensors[0].on != 0:
            seen = sensing.seen[0]
            see(mechanisms[0], state, sensing.sensors[0], seen)
        tip = seen.tip
        decide(
            controller, brakes[0], path, memory, tip[0], tip[1], tip[2], tip[3], seen.hand_force[0],
            seen.hand_force[1], seen.g, seen.mass, current,
        )  # fmt: skip
        if memory[LOCKED] > was_locked:
            found[2] += 1.0
        move(mechanisms, brakes, hand, states, scratches, current, t, 1e-3, 2, 0)
        found[1] = nearest_obstacle(around.edges, around.count, state.tip[0], state.tip[1]).distance
        found[0] = min(found[0], found[1])


class Reached(NamedTuple):
    """What came of a reach; lengths in m."""

    least: float  # distance from the obstacle, negative inside
    last: float  # at the end
    locks: int


def pushed_device(device: Device, tip: tuple[float, float], play: bool = True) -> SimulatedDevice:
    """At rest, held by nobody."""
    simulated = SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    if not play:
        simulated.brakes["play"][0] = 0.0
    return simulated


def guarded(device: Device, obstacle: ObstacleFile, guard: Guard | None, assumed: Assumptions = DEFAULTS) -> Controller:
    """No control beside the guard, which knows how old the assumed sensing is."""
    around = make_around(Around(obstacles=(obstacle,), guard=guard), device.brakes, sensed_age(assumed))
    return make_controller(Preset("", "none"), device.force_normalised_N, around=around)


def run_reach(
    device: SimulatedDevice, controller: Controller, pushes: np.ndarray, adversary: bool = False,
    assumed: Assumptions = DEFAULTS,
) -> Reached:  # fmt: skip
    """Push the device, 0.1 s for each of pushes (n, 2), N, with the assumed sensing."""
    found, sensing = np.zeros(3), new_sensing(device.device, assumed)
    reach(
        controller, PATH, *device.arguments(), sensing, new_memory(), np.ascontiguousarray(pushes, dtype=float),
        int(adversary), np.zeros(4), found,
    )  # fmt: skip
    return Reached(float(found[0]), float(found[1]), int(found[2]))


class Task(NamedTuple):
    """A hand that sets out for an obstacle, more or less."""

    tip: tuple[float, float]
    obstacle: ObstacleFile
    pushes: np.ndarray  # (n, 2) N


def random_task(rng: np.random.Generator, most_N: float, seconds: float = 1.5) -> Task:
    """An obstacle 2 to 8 cm away, and pushes of up to `most_N` within 75 degrees of the way to it."""
    tip = rng.uniform(-0.10, 0.10), rng.uniform(0.34, 0.45)
    towards, distance = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.02, 0.08)
    c, s = math.cos(towards), math.sin(towards)
    x, y = tip[0] + distance * c, tip[1] + distance * s
    kind = rng.integers(3)
    if kind == 0:
        obstacle = ObstacleFile(half_plane_m=(x, y, -c, -s))
    elif kind == 1:
        obstacle = ObstacleFile(disc_m=(x + 0.03 * c, y + 0.03 * s, 0.03))
    else:
        corners = [(-0.04, 0.0), (0.04, 0.0), (0.0, 0.05)]  # to the left of the way, and along it
        obstacle = ObstacleFile(polygon_m=tuple((x - s * a + c * b, y + c * a + s * b) for a, b in corners))
    angles = towards + rng.uniform(-1.3, 1.3, round(10 * seconds))
    sizes = rng.uniform(0.3 * most_N, most_N, len(angles))
    return Task(tip, obstacle, np.column_stack([sizes * np.cos(angles), sizes * np.sin(angles)]))
