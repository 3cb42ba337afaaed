"""The guard of obstacles: all brakes lock when the tip could otherwise not be stopped in front of one.

The brakes stay free for a tick only if the tip can still be stopped after it, whatever a hand within its push does
(`core.control.stopping`). So every tick begins where a lock still stops the tip: the guard promises this for a movement
that begins so. Where it cannot promise it, it locks as well, and says so in the log (`HOLDS`).

Sensed motion is old, and encoders have steps: the guard takes the largest energy and way that are possible by now.

For brakes with play no guard can promise this for ever: a hand that works to and fro inside the play of a full lock
gains speed at every turn, and a little way with it (docs/bench.md). The guard leaves room for `turns` of them, and
computes again once a joint turns back.
"""

import math
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from core.brake import inverse, time_constant
from core.control.algorithm import LOCK_OBSTACLE, LOCK_TOO_LATE, NONE, Tick, lock
from core.control.levers import set_direction
from core.control.stopping import STOPPING, assume_brakes, furthest, make_stopping, safe_radius
from core.control.velocity_field import BACK, HELD, HOLDS, LOCKED, SENSE, SURE, Seen, new_memory
from core.device import Device
from core.files import Table, choice
from core.kernels import kernel
from core.mechanism import Brakes, Mechanism
from core.obstacles import MOST_EDGES, ObstacleFile, away_from, build_obstacles, nearest_obstacle, next_obstacle
from core.ranges import Push, SmallLength
from core.records import new_record
from core.simulator.state import new_body, pack_brakes, pack_mechanism
from core.simulator.stick_slip_mode import update_kinematics
from core.tick_log import TICK_S
from core.workspace import brake_rows, held_in_any_direction

STANDS_M_S = 0.001  # slower towards the obstacle counts as standing
RELEASE_SHARE = 0.8  # of the room, in which the tip must be stoppable before a lock ends
STEPS = 60  # of a tenth each, to find a stopping distance
BACK_SHARE = 0.05  # of a play, by which joints may turn back during a lock
ROUNDING = 1e-9

#: A trial's obstacles, and what they do to its control: guide (`velocity_field.field_at_obstacle`) and guard.
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

    push_N: Push = 10.0  # the largest push of the hand that it allows for
    keep_m: SmallLength = 0.0  # it stops the tip this far before the edge
    release: Annotated[str, choice("pull", "clear")] = "pull"  # "pull": a pull away ends the lock, too; or "clear"
    pull_N: Push = 2.0  # that pull
    turns: Annotated[int, msgspec.Meta(ge=0, le=100)] = 1  # reversals inside the backlash for which it leaves room


class Around(Table, frozen=True):
    """The obstacles of a protocol's trials, and how its controllers keep off them."""

    obstacles: tuple[ObstacleFile, ...] = ()
    guide: bool = True
    guard: Guard | None = None


NOTHING = Around()


class Sensed(NamedTuple):
    """The largest errors of the sensed motion of the tip."""

    tip_age: float = 0.0  # s
    velocity_age: float = 0.0  # s, of the oldest motion that has a part in it
    tip_error: float = 0.0  # m
    velocity_error: float = 0.0  # m/s


EXACT = Sensed()


class WorstMotion(NamedTuple):
    """The most energy and way that the tip can have since it was sensed, under the largest push."""

    energy: float  # J, kinetic
    ahead: float  # m, from its sensed place


def make_around(settings: Around, device: Device, sensed: Sensed = EXACT) -> np.ndarray:
    """A trial's obstacles as the kernels read them; one record."""
    edges, guard = build_obstacles(settings.obstacles), settings.guard
    around = new_record(AROUND, count=len(edges), guide=int(settings.guide), **sensed._asdict())
    around["edges"][0, : len(edges)] = edges
    if guard is not None:
        around["guard"], around["keep"], around["turns"] = 1, guard.keep_m, guard.turns
        around["let_go_force"] = guard.pull_N if guard.release == "pull" else math.inf
        around["stopping"][0] = make_stopping(device.mechanism, device.brakes, guard.push_N)[0]
    return around


NO_OBSTACLE = new_record(AROUND)


def least_held(mechanism: Mechanism, brakes: Brakes, places: np.ndarray) -> float:
    """The force (N) that a full lock holds in every direction at every one of the places (n, 2), m."""
    present = brakes.present > 0.0
    full = make_stopping(mechanism, brakes, 1.0)["full"][0]
    return float(held_in_any_direction(brake_rows(mechanism, *places.T)[present], full[present]).min())


def why_no_guard(settings: Around, name: str, device: Device, places: np.ndarray, at: str) -> str:
    """Why a device cannot be guarded at places (n, 2), m, as the end of a sentence that says `at`; "": it can."""
    if settings.guard is None:
        return ""
    if not settings.obstacles:
        return "there is no obstacle to guard"
    if (held := least_held(device.mechanism, device.brakes, places)) <= settings.guard.push_N:
        return f"push_N ({settings.guard.push_N:g}) must be less than the {held:.1f} N that {name} holds {at}"
    return ""


def locks_at_rest(settings: Around, device: Device, tip: tuple[float, float]) -> bool:
    """Whether the guard locks a device that stands at `tip` (m)."""
    return bool(keep_out(make_around(settings, device)[0], tick_at(device, tip)) != NONE)


def tick_at(device: Device, tip: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Tick:
    """The first tick of control at a tip (m) with a velocity (m/s), and no hand."""
    body, seen = new_body(*tip, *velocity), Seen(*tip, *velocity, 0.0, 0.0)
    update_kinematics(pack_mechanism(device.mechanism)[0], body[0])
    brakes = pack_brakes(device.brakes, backlash=True)[0]
    return Tick(seen, body["g"][0, :4], body["mass"][0], brakes, new_memory(), np.zeros(4))


@kernel
def stopping_distance(around, tick):
    """How far (m) any hand within the push can bring the tip in its direction of motion; infinite: no bound is known.

    The brakes begin without current and are locked after a tick: it is the room that the guard needs for this motion.
    """
    seen = tick.seen
    assume_brakes(around.stopping, around.stopping.drag, around.turns)
    motion = worst_motion(around, tick, TICK_S)
    radius = safe_radius(around.stopping, seen.x, seen.y, motion.energy)
    speed = math.sqrt(seen.vx * seen.vx + seen.vy * seen.vy)
    if radius == math.inf or speed == 0.0:
        return radius + motion.ahead
    set_direction(around.stopping.levers, seen.vx / speed, seen.vy / speed)
    way = radius
    for _ in range(STEPS):
        nearer = furthest(around.stopping, motion.energy, 0.9 * way)
        if not nearer < 0.9 * way:
            break
        way *= 0.9
    return way + motion.ahead


@kernel
def keep_out(around, tick):
    """Lock all brakes if the tip could not be stopped in front of an obstacle; the decision, NONE: they are free.

    They stay locked until brakes that begin without current could stop the tip in `RELEASE_SHARE` of the room, with as
    much more energy: so no lock follows at once. If the hand pulls away, the torque that the brakes hold already counts
    as well: they are released where a lock a tick later would do, and where a lock no longer helps.
    """
    stopping, memory, seen = around.stopping, tick.memory, tick.seen
    was_locked = memory[LOCKED] != 0.0
    age_yields(around, tick, was_locked)
    pulled = pulls_away(around, seen)
    if pulled:
        assume_brakes(stopping, around.after, 0.0)
    else:
        assume_brakes(stopping, stopping.drag, around.turns)
    motion = worst_motion(around, tick, TICK_S)
    if was_locked:
        motion = WorstMotion(motion.energy / RELEASE_SHARE, motion.ahead)
    radius = safe_radius(stopping, seen.x, seen.y, motion.energy)
    share = RELEASE_SHARE if was_locked and not pulled else 1.0
    free = holds = can_be_stopped(around, seen, motion, radius, share)
    if not free:
        within = seen.fx * seen.fx + seen.fy * seen.fy <= stopping.push * stopping.push * (1.0 + ROUNDING)
        holds = memory[SURE] != 0.0 and not turned_back(around, tick, was_locked) and within
        if not holds:
            for i in range(4):
                around.after[i] = memory[HELD + i]
            assume_brakes(stopping, around.after, 0.0)
            motion = worst_motion(around, tick, 0.0)
            if radius == math.inf:
                radius = safe_radius(stopping, seen.x, seen.y, motion.energy)
            holds = can_be_stopped(around, seen, motion, radius, 1.0)
            memory[BACK] = 0.0
        # the hand need not fight the brakes to get away; but a tip that is too fast to be stopped is slowed first
        free = pulled and not holds and radius < math.inf
    memory[SURE] = memory[HOLDS] = 1.0 if holds else 0.0
    memory[LOCKED] = 0.0 if free else 1.0
    if free:
        return NONE
    lock(tick)
    return LOCK_OBSTACLE if holds else LOCK_TOO_LATE


@kernel
def turned_back(around, tick, was_locked):
    """Whether joints have turned back, since the lock began, by more than `BACK_SHARE` of their play in all.

    Until then the promise made when the lock began holds: its bound is one for all time.
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
    """Put the least torque (N m) that each brake holds into the memory, that after a tick without current into `after`.

    It has risen at half the joint's rate at least, Eq. (4); where the rate is sensed late, as if the joint rested.
    """
    stopping, memory, brakes = around.stopping, tick.memory, tick.brakes
    for i in range(4):
        drag, held = stopping.drag[i], max(memory[HELD + i], stopping.drag[i])
        if was_locked:
            rising = stopping.rising[i]
            if around.velocity_age == 0.0 and stopping.levers.present[i] != 0.0:
                rate = 0.5 * (tick.g[i, 0] * tick.seen.vx + tick.g[i, 1] * tick.seen.vy)
                rising = 1.0 - math.exp(-TICK_S * inverse(time_constant(brakes, i, brakes.current_max[i], rate, True)))
            held += rising * (stopping.full[i] - held)
        else:
            held -= stopping.falling[i] * (held - drag)
        memory[HELD + i] = held
        around.after[i] = held - stopping.falling[i] * (held - drag)


@kernel
def pulls_away(around, seen):
    """Whether the hand pulls away from the nearest obstacle hard enough for a release, and the tip does not near it."""
    near = nearest_obstacle(around.edges, around.count, seen.x, seen.y)
    pull, away = seen.fx * near.n_x + seen.fy * near.n_y, seen.vx * near.n_x + seen.vy * near.n_y
    return pull > around.let_go_force and away >= -STANDS_M_S


@kernel
def worst_motion(around, tick, later):
    """The most energy and way that the tip can have `later` (s) than its newest sample reached the guard."""
    seen, xx, xy, yy = tick.seen, tick.mass[0], tick.mass[1], tick.mass[2]
    middle, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    light, heavy = math.sqrt(middle - half), math.sqrt(middle + half)
    # sqrt(2 E): a push adds to it at most by push / light a second
    speed = math.sqrt(max(xx * seen.vx * seen.vx + 2.0 * xy * seen.vx * seen.vy + yy * seen.vy * seen.vy, 0.0))
    speed += around.stopping.push / light * (around.velocity_age + later) + heavy * around.velocity_error
    return WorstMotion(0.5 * speed * speed, speed / light * (around.tip_age + later) + around.tip_error)


@kernel
def can_be_stopped(around, seen, motion, radius, share):
    """Whether a lock stops the tip within this share of the room to every obstacle; radius (m): its `safe_radius`."""
    first = 0
    while first < around.count:
        after = next_obstacle(around.edges, around.count, first)
        near = away_from(around.edges, first, after, seen.x, seen.y)
        room = share * (near.distance - around.keep) - motion.ahead
        if room <= 0.0 or radius == math.inf:
            return False
        if room < radius:
            set_direction(around.stopping.levers, near.n_x, near.n_y)
            if not furthest(around.stopping, motion.energy, room) < room:
                return False
        first = after
    return True
