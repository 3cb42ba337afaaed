"""Hands that push a device towards an obstacle, tick by tick, compiled: what the guard of obstacles is tried with."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from core.control.algorithm import Tick, release
from core.control.controllers import Controller, Preset, make_controller
from core.control.guard import Around, Guard, keep_out, make_around
from core.control.velocity_field import HOLDS, LOCKED, new_memory, seen_in
from core.device import Device
from core.kernels import kernel
from core.obstacles import ObstacleFile, nearest_obstacle
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice, move, settle
from core.workspace import tip_is_free
from experiments.assumptions import DEFAULTS, Assumptions
from experiments.trial.encoder_sensing import EncoderSensing, new_sensing, see, sensed

#: N, largest pushes: the largest whole ones below half of what a full lock holds near the middle of each workspace; of
#: pter below 40 %, for the guard promises nothing there for a hand of half.
PUSHES_N = {"er-two-brake": 8.0, "three-brake": 11.0, "four-brake": 17.0, "pter": 16.0}

#: Places of what `reach` finds: least and last distance (m), locks, ticks of which the guard is not sure, the first of
#: them, largest speed (m/s).
LEAST, LAST, LOCKS, UNSURE, FIRST_UNSURE, FASTEST, FOUND = range(7)


class Reach(NamedTuple):
    """A hand that pushes a device, tick by tick."""

    controller: Controller
    sensing: EncoderSensing
    memory: np.ndarray  # of the controller
    forces: np.ndarray  # (n, 2) N
    current: np.ndarray  # (4,) A


@kernel
def run_pushes(model, data, reach, found):
    """All ticks of a `Reach`; found (FOUND,)."""
    memory, forces, current, sensing = reach.memory, reach.forces, reach.current, reach.sensing
    around, body, grip = reach.controller.around[0], data.body[0], data.hand.grips[0]
    for i in range(FOUND):
        found[i] = 0.0
    found[LEAST] = found[FIRST_UNSURE] = math.inf
    for n in range(forces.shape[0]):
        t = 1e-3 * n
        was_locked = memory[LOCKED]
        grip.held[0], grip.held[1] = forces[n, 0], forces[n, 1]
        settle(model, data, current, t)
        seen = body
        if sensing.sensors[0].on != 0:
            seen = sensing.seen[0]
            see(model.mechanism[0], body, sensing.sensors[0], seen)
        tick = Tick(seen_in(seen.tip, seen.hand_force), seen.g, seen.mass, model.brakes[0], memory, current)
        release(current)
        if around.guard != 0:  # what `decide` does first
            keep_out(around, tick)
        if memory[LOCKED] > was_locked:
            found[LOCKS] += 1.0
        if memory[HOLDS] == 0.0:
            found[UNSURE] += 1.0
            found[FIRST_UNSURE] = min(found[FIRST_UNSURE], float(n))
        move(model, data, current, t, 1e-3)
        found[LAST] = nearest_obstacle(around.edges, around.count, body.tip[0], body.tip[1]).distance
        found[LEAST] = min(found[LEAST], found[LAST])
        found[FASTEST] = max(found[FASTEST], math.sqrt(body.tip[2] * body.tip[2] + body.tip[3] * body.tip[3]))


class Reached(NamedTuple):
    """What came of a reach; lengths in m."""

    least: float  # distance from the obstacle, negative inside
    last: float  # at the end
    locks: int
    unsure: int  # ticks
    first_unsure: float  # tick; infinite: none
    fastest: float  # m/s


def pushed_device(device: Device, tip: tuple[float, float]) -> SimulatedDevice:
    """At rest, held by nobody."""
    return SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


def guarded(device: Device, obstacle: ObstacleFile, guard: Guard | None, assumed: Assumptions = DEFAULTS) -> Controller:
    """No control beside the guard, which knows how old the assumed sensing is."""
    around = make_around(Around(obstacles=(obstacle,), guard=guard), device, sensed(device, (0.0, 0.4), assumed))
    return make_controller(Preset("", "none"), device.force_normalised_N, around=around)


def run_reach(
    device: SimulatedDevice, controller: Controller, forces: np.ndarray, assumed: Assumptions = DEFAULTS
) -> Reached:
    """Push the device with forces (n, 2), N, one a tick, with the assumed sensing."""
    found, sensing = np.zeros(FOUND), new_sensing(device.device, assumed)
    forces = np.ascontiguousarray(forces, dtype=float)
    pushes = Reach(controller, sensing, new_memory(), forces, np.zeros(4))
    run_pushes(device.model, device.data, pushes, found)
    least, last, locks, unsure, first_unsure, fastest = found.tolist()
    return Reached(least, last, int(locks), int(unsure), first_unsure, fastest)


def held_on(pushes: np.ndarray) -> np.ndarray:
    """Each of pushes (n, 2), N, for 0.1 s, as one a tick."""
    return np.repeat(pushes, 100, axis=0)


class Task(NamedTuple):
    """A hand that sets out for an obstacle, more or less."""

    tip: tuple[float, float]
    obstacle: ObstacleFile
    forces: np.ndarray  # (ticks, 2) N


def obstacle_ahead(tip: tuple[float, float], towards: float, distance: float, kind: int) -> ObstacleFile:
    """A half-plane, disc or polygon (kind 0, 1, 2) so far (m) from the tip in this direction."""
    c, s = math.cos(towards), math.sin(towards)
    x, y = tip[0] + distance * c, tip[1] + distance * s
    if kind == 0:
        return ObstacleFile(half_plane_m=(x, y, -c, -s))
    if kind == 1:
        return ObstacleFile(disc_m=(x + 0.03 * c, y + 0.03 * s, 0.03))
    corners = [(-0.04, 0.0), (0.04, 0.0), (0.0, 0.05)]  # to the left of the way, and along it
    return ObstacleFile(polygon_m=tuple((x - s * a + c * b, y + c * a + s * b) for a, b in corners))


KINDS = ("straight", "run-up", "turning", "rocking", "pushes")
ATTACK_TICKS = 1500


def random_attacks(rng: np.random.Generator, kind: str, device: Device, count: int) -> Iterator[Task]:
    """Hands of this kind that push a device with exactly the force of `PUSHES_N`."""
    while count:
        task = random_attack(rng, kind, device)
        if task is not None:
            count -= 1
            yield task


def random_attack(rng: np.random.Generator, kind: str, device: Device) -> Task | None:
    """One of them; None: the tip cannot be where it begins."""
    obstacle, q = int(rng.integers(3)), rng.random(12)
    tip = -0.25 + 0.5 * q[0], 0.25 + 0.27 * q[1]
    if not tip_is_free(device.mechanism, *tip):
        return None
    towards = 2.0 * math.pi * q[2]
    n = np.arange(ATTACK_TICKS)
    angle, size = np.full(ATTACK_TICKS, towards + 1.2 * (q[4] - 0.5)), np.ones(ATTACK_TICKS)
    until = n < 400 * q[5]
    if kind == "run-up":  # away, then in
        angle = np.where(until, towards + math.pi + 1.2 * (q[6] - 0.5), angle)
    elif kind == "turning":
        angle = np.where(until, towards + 6.0 * (q[6] - 0.5) + 0.06 * (q[7] - 0.5) * n, angle)
    elif kind == "rocking":  # in, then to and fro with a period of 2 to 120 ms
        period = 2.0 + 118.0 * q[6]
        to_and_fro = np.where((n % period) < (0.2 + 0.6 * q[7]) * period, 1.0, -0.1 - 0.9 * q[8])
        size = np.where(until, 1.0, to_and_fro)
    elif kind == "pushes":  # another way every 0.25 s
        angle = towards + 2.6 * (q[6 : 6 + 6] - 0.5)[n // (ATTACK_TICKS // 6)]
    forces = PUSHES_N[device.name] * size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return Task(tip, obstacle_ahead(tip, towards, 0.02 + 0.06 * q[3], obstacle), forces)
