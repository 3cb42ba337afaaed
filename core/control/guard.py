"""The guard of obstacles: all brakes lock when the tip could otherwise not be stopped in front of one.

A tick after which the tip can be stopped, whatever a hand within its push does (`core.control.stopping`), may pass with
the brakes free. So every tick begins where a lock still stops it: that is the promise, and it holds as long as a
movement begins there. Where it does not hold the guard locks all the same, and says so: `HOLDS`, a column of the log.

Sensed motion is old, and encoders have steps: energy and way are counted as large as they can have become since.

Of brakes with play no guard can promise this for ever: a hand that works to and fro inside the play of a full lock
gains speed at every turn, and a little way with it (docs/obstacles.md). There is room for `turns` of them; once a joint
turns back the guard asks anew whether it is sure.
"""

import math
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from core.brake import inverse, time_constant
from core.control.algorithm import LOCK_OBSTACLE, LOCK_TOO_LATE, NONE, Tick, lock
from core.control.stopping import STOPPING, furthest, leash, look_towards, make_stopping, suppose
from core.control.velocity_field import BACK, HELD, HOLDS, LOCKED, SENSE, SURE, Seen, new_memory
from core.device import Device
from core.files import Table, choice
from core.kernels import kernel
from core.mechanism import Brakes, Mechanism
from core.obstacles import MOST_EDGES, ObstacleFile, away_from, build_obstacles, nearest_obstacle, next_obstacle
from core.ranges import Push, SmallLength
from core.simulator.state import new_record, new_state, pack_brakes, pack_mechanism
from core.simulator.stick_slip_mode import update_kinematics
from core.tick_log import TICK_S
from core.workspace import brake_rows, held_in_any_direction

STANDS_M_S = 0.001  # slower towards the obstacle counts as standing
RELEASE_SHARE = 0.8
STEPS = 60  # of a tenth each, by which a stopping distance is found
BACK_SHARE = 0.05  # of a play
ROUNDING = 1e-9

#: A trial's obstacles, and what they do to its control: guide (`velocity_field.field_round`) and guard.
AROUND = np.dtype(
    [
        ("count", "i8"),  # of edges
        ("edges", "f8", (MOST_EDGES, 7)),  # as in core.obstacles
        ("guide", "i8"),  # 1: near an obstacle its field counts in place of the path's
        ("guard", "i8"),
        ("keep", "f8"),  # m: stop so far before the edge
        ("turns", "f8"),
        ("let_go_force", "f8"),  # N, a pull away from the obstacle that releases; infinite: none does
        ("tip_age", "f8"),  # s, as in `Sensed`
        ("velocity_age", "f8"),
        ("tip_error", "f8"),
        ("velocity_error", "f8"),
        ("after", "f8", (4,)),  # N m, work space: yields
        ("stopping", STOPPING),
    ]
)


class Guard(Table, frozen=True):
    """`[guard]` of a protocol or scene. All assumed."""

    push_N: Push = 10.0  # the largest push of a hand that it allows for
    keep_m: SmallLength = 0.0  # it stops the tip so far before the edge
    release: Annotated[str, choice("pull", "clear")] = "pull"  # also by a pull, or only once the tip can be stopped
    pull_N: Push = 2.0  # a pull away from the obstacle that releases
    turns: Annotated[int, msgspec.Meta(ge=0, le=100)] = 1  # of a joint inside its play that it keeps room for


class Around(Table, frozen=True):
    """The obstacles of a protocol's trials, and how its controllers keep off them."""

    obstacles: tuple[ObstacleFile, ...] = ()
    guide: bool = True
    guard: Guard | None = None


NOTHING = Around()


class Sensed(NamedTuple):
    """The largest errors of what a controller sees of the tip."""

    tip_age: float = 0.0  # s
    velocity_age: float = 0.0  # s, of the oldest motion that has a part in it
    tip_error: float = 0.0  # m
    velocity_error: float = 0.0  # m/s


EXACT = Sensed()


class MovedOn(NamedTuple):
    """How far the tip can have moved on since it was sensed, under the largest push."""

    energy: float  # J, kinetic
    ahead: float  # m, from where it was seen


def make_around(how: Around, device: Device, sensed: Sensed = EXACT) -> np.ndarray:
    """A trial's obstacles as the kernels read them; one record."""
    edges, guard = build_obstacles(how.obstacles), how.guard
    around = new_record(AROUND, count=len(edges), guide=int(how.guide), **sensed._asdict())
    around["edges"][0, : len(edges)] = edges
    if guard is not None:
        around["guard"], around["keep"], around["turns"] = 1, guard.keep_m, guard.turns
        around["let_go_force"] = guard.pull_N if guard.release == "pull" else math.inf
        around["stopping"][0] = make_stopping(device.mechanism, device.brakes, guard.push_N)[0]
    return around


NO_OBSTACLE = new_record(AROUND)


def least_held(mechanism: Mechanism, brakes: Brakes, places: np.ndarray) -> float:
    """The force (N) that a full lock holds in any direction, at the worst of places (n, 2), m."""
    present = brakes.present > 0.0
    full = make_stopping(mechanism, brakes, 1.0)["full"][0]
    return float(held_in_any_direction(brake_rows(mechanism, *places.T)[present], full[present]).min())


def why_no_guard(how: Around, name: str, device: Device, places: np.ndarray, there: str) -> str:
    """Why a device cannot be guarded at places (n, 2), m, as the end of a sentence; "": it can. there: the places."""
    if how.guard is None:
        return ""
    if not how.obstacles:
        return "there is no obstacle to guard"
    if not device.brakes.present.any():
        return f"{name} has no brakes to lock"
    if (held := least_held(device.mechanism, device.brakes, places)) <= how.guard.push_N:
        return f"push_N ({how.guard.push_N:g}) must be less than the {held:.1f} N that {name} holds {there}"
    return ""


def locks_at_rest(how: Around, device: Device, tip: tuple[float, float]) -> bool:
    """Whether the guard locks a device that stands at `tip` (m)."""
    return bool(keep_out(make_around(how, device)[0], tick_at(device, tip)) != NONE)


def tick_at(device: Device, tip: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Tick:
    """The first tick of control at a tip (m) with a velocity (m/s), and no hand."""
    state, seen = new_state(*tip, *velocity), Seen(*tip, *velocity, 0.0, 0.0)
    update_kinematics(pack_mechanism(device.mechanism)[0], state[0])
    brakes = pack_brakes(device.brakes, backlash=True)[0]
    return Tick(seen, state["g"][0, :4], state["mass"][0], brakes, new_memory(), np.zeros(4))


@kernel
def stopping_distance(around, tick):
    """How far (m) any hand within the push can bring the tip in the direction in which it moves; infinite: not known.

    From brakes without current, a tick of it free: the room that the guard asks of a tip that moves so.
    """
    seen = tick.seen
    suppose(around.stopping, around.stopping.drag, around.turns)
    motion = as_it_can_be(around, tick, TICK_S)
    radius = leash(around.stopping, seen.x, seen.y, motion.energy)
    speed = math.sqrt(seen.vx * seen.vx + seen.vy * seen.vy)
    if radius == math.inf or speed == 0.0:
        return radius + motion.ahead
    look_towards(around.stopping, seen.vx / speed, seen.vy / speed)
    way = radius
    for _ in range(STEPS):
        nearer = furthest(around.stopping, motion.energy, 0.9 * way)
        if not nearer < 0.9 * way:
            break
        way *= 0.9
    return way + motion.ahead


@kernel
def keep_out(around, tick):
    """Lock all brakes where the tip could not be stopped in front of an obstacle; the decision, NONE: they are free.

    They stay locked until the tip could be stopped in `RELEASE_SHARE` of the room, and with as much more energy, by
    brakes that begin anew (so a lock does not end in the next one). For a hand that pulls away what the brakes hold
    already counts, too: it is let go where a lock a tick later would still do, and where a lock does not help any more.
    """
    stopping, memory, seen = around.stopping, tick.memory, tick.seen
    was_locked = memory[LOCKED] != 0.0
    age_yields(around, tick, was_locked)
    pulled = pulls_away(around, seen)
    if pulled:
        suppose(stopping, around.after, 0.0)
    else:
        suppose(stopping, stopping.drag, around.turns)
    motion = as_it_can_be(around, tick, TICK_S)
    if was_locked:
        motion = MovedOn(motion.energy / RELEASE_SHARE, motion.ahead)
    radius = leash(stopping, seen.x, seen.y, motion.energy)
    share = RELEASE_SHARE if was_locked and not pulled else 1.0
    free = holds = can_be_stopped(around, seen, motion, radius, share)
    if not free:
        within = seen.fx * seen.fx + seen.fy * seen.fy <= stopping.push * stopping.push * (1.0 + ROUNDING)
        holds = memory[SURE] != 0.0 and not turned_back(around, tick, was_locked) and within
        if not holds:
            for i in range(4):
                around.after[i] = memory[HELD + i]
            suppose(stopping, around.after, 0.0)
            motion = as_it_can_be(around, tick, 0.0)
            if radius == math.inf:
                radius = leash(stopping, seen.x, seen.y, motion.energy)
            holds = can_be_stopped(around, seen, motion, radius, 1.0)
            memory[BACK] = 0.0
        # nobody has to fight the brakes to get away; but a tip that is too fast to be stopped is slowed first
        free = pulled and not holds and radius < math.inf
    memory[SURE] = memory[HOLDS] = 1.0 if holds else 0.0
    memory[LOCKED] = 0.0 if free else 1.0
    if free:
        return NONE
    lock(tick)
    return LOCK_OBSTACLE if holds else LOCK_TOO_LATE


@kernel
def turned_back(around, tick, was_locked):
    """Whether a joint has turned back, since the lock began, by more than `BACK_SHARE` of its play in all.

    Until then what was sure when the lock began is sure: the bound is one for all time.
    """
    memory = tick.memory
    if not was_locked:
        memory[BACK] = 0.0
    for i in range(4):
        rate = tick.g[i, 0] * tick.seen.vx + tick.g[i, 1] * tick.seen.vy
        if not was_locked or memory[SENSE + i] == 0.0:
            memory[SENSE + i] = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
        elif rate * memory[SENSE + i] < 0.0 and around.stopping.width[i] > 0.0:
            memory[BACK] += TICK_S * abs(rate) / around.stopping.width[i]
    return memory[BACK] > BACK_SHARE


@kernel
def age_yields(around, tick, was_locked):
    """What each brake holds at least now, into the memory; into `after`, what it holds at least after a tick of none.

    It has risen at half the joint's rate at least, Eq. (4); where the rate is sensed late, as if the joint rested.
    """
    stopping, memory, brakes = around.stopping, tick.memory, tick.brakes
    for i in range(4):
        drag, held = stopping.drag[i], max(memory[HELD + i], stopping.drag[i])
        if was_locked:
            rising = stopping.rising[i]
            if around.velocity_age == 0.0 and stopping.present[i] != 0.0:
                rate = 0.5 * (tick.g[i, 0] * tick.seen.vx + tick.g[i, 1] * tick.seen.vy)
                rising = 1.0 - math.exp(-TICK_S * inverse(time_constant(brakes, i, brakes.current_max[i], rate, True)))
            held += rising * (stopping.full[i] - held)
        else:
            held -= stopping.falling[i] * (held - drag)
        memory[HELD + i] = held
        around.after[i] = held - stopping.falling[i] * (held - drag)


@kernel
def pulls_away(around, seen):
    """Whether the hand pulls away from the nearest obstacle by more than releases, and the tip does not approach it."""
    near = nearest_obstacle(around.edges, around.count, seen.x, seen.y)
    pull, away = seen.fx * near.n_x + seen.fy * near.n_y, seen.vx * near.n_x + seen.vy * near.n_y
    return pull > around.let_go_force and away >= -STANDS_M_S


@kernel
def as_it_can_be(around, tick, later):
    """The most that the tip can have of energy and way `later` (s) than its newest sample reached the guard."""
    seen, xx, xy, yy = tick.seen, tick.mass[0], tick.mass[1], tick.mass[2]
    middle, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    light, heavy = math.sqrt(middle - half), math.sqrt(middle + half)
    # sqrt(2 E): a push adds to it at most by push / light a second
    speed = math.sqrt(max(xx * seen.vx * seen.vx + 2.0 * xy * seen.vx * seen.vy + yy * seen.vy * seen.vy, 0.0))
    speed += around.stopping.push / light * (around.velocity_age + later) + heavy * around.velocity_error
    return MovedOn(0.5 * speed * speed, speed / light * (around.tip_age + later) + around.tip_error)


@kernel
def can_be_stopped(around, seen, motion, radius, share):
    """Whether a lock stops the tip in this share of the room to every obstacle; radius (m): that of its `leash`."""
    first = 0
    while first < around.count:
        after = next_obstacle(around.edges, around.count, first)
        near = away_from(around.edges, first, after, seen.x, seen.y)
        room = share * (near.distance - around.keep) - motion.ahead
        if room <= 0.0 or radius == math.inf:
            return False
        if room < radius:
            look_towards(around.stopping, near.n_x, near.n_y)
            if not furthest(around.stopping, motion.energy, room) < room:
                return False
        first = after
    return True
