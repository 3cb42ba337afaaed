"""A simulated operator: a virtual hand that moves along the path with minimum jerk and pulls the handle by an arm.

    arm         spring-damper and mass at the handle, stiff across the path and soft along it; its force is clipped
    plan        minimum jerk along the path (Flash & Hogan 1985), from corner to corner where it has any, off it by a
                bias and an S of this person
    correction  of the distance to the path: felt (late, at once, in part) and seen (later, little by little)
    stall       a virtual hand does not run away from a handle that stands; the push along the path grows instead
    unrest      noise in proportion to the force (PMID 10385989), and tremor (PMC4594250)

A person's numbers come from a population file (`experiments/trial/population.py`), which gives the source of each.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from core.kernels import kernel
from core.path import CORNER_DEG, CURVATURE, FROM, LENGTH, TURN, Path, follow, on_piece, point_at, size_of
from core.records import new_record
from core.tick_log import APPROACH, HOLD, MOVE, TICK_S
from experiments.trial.normals import Normals

_RING = 256  # ticks of history (a power of two), longer than the longest delay and a glance
_GLANCE = 50  # ticks over which it is felt whether the handle moves
_LAST = _RING - 1  # mask of the ring
_S_HEIGHT = 6.0 * math.sqrt(3.0)  # makes the largest s (1 - s) (1 - 2 s) one
_PACED_M, _TURN_SHARE, _BIASED_M = 0.3, 0.5, 0.2  # of `on_path`
LONGEST_DELAY_S = (_RING - 1 - _GLANCE) * TICK_S


class Person(NamedTuple):
    """One simulated operator, as a population file gives ranges under the same names (SI units; Hz).

    Beside each number its least and most: beyond is a slip of the pen, or the kernels would fail.
    """

    stiffness_along_N_m: Annotated[float, (1.0, 5000.0)]  # of the arm, along the path
    stiffness_across_N_m: Annotated[float, (1.0, 5000.0)]  # across it
    damping_N_s_m: Annotated[float, (0.0, 200.0)]  # of the arm
    mass_kg: Annotated[float, (0.0, 10.0)]  # of the arm at the handle
    force_max_N: Annotated[float, (1.0, 500.0)]  # largest force of the arm
    movement_s: Annotated[float, (0.2, 60.0)]  # duration of the movement
    reaction_s: Annotated[float, (0.0, 5.0)]  # from go to the start of the movement
    reaction_spread_s: Annotated[float, (0.0, 1.0)]  # its sd from trial to trial
    approach_speed_m_s: Annotated[float, (0.01, 1.0)]  # mean speed to the start
    approach_least_s: Annotated[float, (0.1, 10.0)]  # shortest approach
    bias_m: Annotated[float, (-0.05, 0.05)]  # lateral offset of the virtual hand in the middle of the path, + left
    curvature_m: Annotated[float, (-0.05, 0.05)]  # height of the S in the virtual hand's way
    trial_bias_m: Annotated[float, (0.0, 0.05)]  # sd of the bias from trial to trial
    skill: Annotated[float, (0.1, 10.0)]  # divides bias, its change from trial to trial, and curvature
    felt_delay_s: Annotated[float, (1e-3, LONGEST_DELAY_S)]  # until the felt distance to the path acts
    felt_gain: Annotated[float, (0.0, 1.0)]  # share of the felt distance that is corrected
    seen_delay_s: Annotated[float, (1e-3, LONGEST_DELAY_S)]  # until the seen distance acts
    seen_gain_per_s: Annotated[float, (0.0, 10.0)]  # rate at which the seen distance is corrected
    seen_least_m: Annotated[float, (0.0, 0.002)]  # smaller distances are not corrected
    foresight_s: Annotated[float, (0.0, 2.0)]  # a correction waits for a handle that gets there by itself in this time
    settle_speed_m_s: Annotated[float, (1e-3, 10.0)]  # a correction on the approach waits for a handle as fast as this
    correction_max_m: Annotated[float, (0.01, 0.5)]  # largest correction of the virtual hand
    lead_max_m: Annotated[float, (0.001, 0.5)]  # the virtual hand waits for a handle that lags more
    still_speed_m_s: Annotated[float, (1e-6, 0.1)]  # a slower handle is felt to stand
    give_up_per_s: Annotated[float, (0.0, 20.0)]  # rate at which a sideways pull is given up while the handle stands
    effort_N_s: Annotated[float, (0.0, 1000.0)]  # growth of a push along the path while the handle stands
    effort_max_N: Annotated[float, (0.0, 500.0)]  # largest such push
    effort_ease_per_s: Annotated[float, (0.0, 100.0)]  # rate at which the push is given up once the handle moves
    turn_s: Annotated[float, (1e-3, 5.0)]  # in which the virtual hand turns with a bend of the path
    noise_share: Annotated[float, (0.0, 1.0)]  # sd of the force noise per axis, share of the force
    noise_corner_Hz: Annotated[float, (0.1, 100.0)]  # corner of its low-pass filter
    tremor_N: Annotated[float, (0.0, 20.0)]  # rms per axis
    tremor_Hz: Annotated[float, (3.0, 20.0)]  # frequency of the tremor
    tremor_band_Hz: Annotated[float, (0.1, 10.0)]  # width of its peak at half power
    sees_cursor: Annotated[float, (0.0, 1.0)] = 1.0  # share of the distance to the path that is seen on the way
    aims_at_end: Annotated[float, (0.0, 1.0)] = 0.0  # 1: at the end a handle that stands is led on, sideways too


OPERATOR = np.dtype(
    [(name, "f8") for name in Person._fields]  # reaction_s: this trial's
    + [
        # this trial's
        ("bias", "f8"),  # m
        ("curvature", "f8"),  # m
        ("felt_ticks", "i8"),
        ("seen_ticks", "i8"),
        ("noise_keep", "f8"),  # low-pass: noise = keep noise + draw normal
        ("noise_draw", "f8"),
        ("tremor_keep", "f8", (2,)),  # resonance: tremor = keep_0 tremor + keep_1 (tremor before) + draw normal
        ("tremor_draw", "f8"),
        # what changes from tick to tick
        ("progress", "f8"),  # 0 .. 1 of the minimum-jerk movement
        ("piece", "i8"),  # of the path, that the tip has come to
        ("origin", "f8", (2,)),  # m, where the approach began
        ("approach_s", "f8"),
        ("offset", "f8", (2,)),  # m, correction learned from what is seen: x, y on the approach, along, across after
        ("direction", "f8", (2,)),  # of the virtual hand's way
        ("effort", "f8"),  # N
        ("noise", "f8", (2,)),  # of unit variance
        ("tremor", "f8", (2, 2)),  # of unit variance: now, and a tick before
        ("ring", "f8", (_RING, 4)),  # past tips: x, y, progress along the path, distance to its left (m)
    ]
)


def new_operator(person: Person, generator: np.random.Generator | Normals) -> np.ndarray:
    """The operator of one trial; draws what differs between trials (bias, reaction, the tremor's phase)."""
    bias, reaction, *tremor = generator.standard_normal(6)
    keep = math.exp(-2.0 * math.pi * person.noise_corner_Hz * TICK_S)
    fields = person._asdict() | dict(
        bias=(person.bias_m + person.trial_bias_m * bias) / person.skill,
        curvature=person.curvature_m / person.skill,
        reaction_s=max(person.reaction_s + person.reaction_spread_s * reaction, 0.0),
        felt_ticks=round(person.felt_delay_s / TICK_S),
        seen_ticks=round(person.seen_delay_s / TICK_S),
        noise_keep=keep,
        noise_draw=math.sqrt(1.0 - keep * keep),
        direction=(1.0, 0.0),
    )
    operator = new_record(OPERATOR, **fields)
    # A resonance at tremor_Hz whose power falls to half tremor_band_Hz / 2 from it, of unit variance
    radius = math.exp(-math.pi * person.tremor_band_Hz * TICK_S)
    cosine = math.cos(2.0 * math.pi * person.tremor_Hz * TICK_S)
    first, second = 2.0 * radius * cosine, -radius * radius
    correlation = first / (1.0 - second)
    operator["tremor_keep"][0] = first, second
    operator["tremor_draw"][0] = math.sqrt(1.0 - first * correlation - second * (first * correlation + second))
    operator["tremor"][0, 0] = tremor[:2]
    operator["tremor"][0, 1] = correlation * operator["tremor"][0, 0]
    operator["tremor"][0, 1] += math.sqrt(1.0 - correlation * correlation) * np.array(tremor[2:])
    return operator


def on_path(person: Person, path: Path) -> Person:
    """The person as they follow this path.

    Assumed, of a path of several pieces: what lags behind in a bend is off the path, so that the arm is as stiff along
    it as across; a path longer than 30 cm takes longer in proportion (steering law, Accot & Zhai 1997), as does one
    with turns, each full turn half a movement; and what is less than 20 cm in size, as the paper's paths are, is drawn
    as much truer (bias and curvature; a spread in proportion to the amplitude: Schmidt et al. 1979).
    """
    if len(path.pieces) == 1:
        return person
    turned = np.abs(path.pieces[:, TURN]).sum() + np.abs(path.pieces[:, CURVATURE]) @ path.pieces[:, LENGTH]
    longer = max(1.0, path.length / _PACED_M + _TURN_SHARE * float(turned) / (2.0 * math.pi))
    smaller = min(1.0, size_of(path.pieces, (path.x1, path.y1)) / _BIASED_M)
    return person._replace(
        bias_m=smaller * person.bias_m,
        trial_bias_m=smaller * person.trial_bias_m,
        curvature_m=smaller * person.curvature_m,
        movement_s=longer * person.movement_s,
        stiffness_along_N_m=max(person.stiffness_along_N_m, person.stiffness_across_N_m),
    )


def take_handle(person: Person, path: Path, grips: np.ndarray) -> None:
    """Set the arm at the handle: soft along the path's first piece, stiff across it; the kernels turn it."""
    _, _, tx, ty = point_at(path, 0.0)
    grips["spring"][0] = 1
    turn_arm(grips[0], person.stiffness_along_N_m, person.stiffness_across_N_m, tx, ty)
    grips["damping"][0] = (person.damping_N_s_m, 0.0, person.damping_N_s_m)
    grips["force_max"][0] = person.force_max_N
    grips["mass"][0] = person.mass_kg
    grips["held"][0] = 0.0


@kernel
def turn_arm(grip, along, across, tx, ty):
    """Stiffness (N/m) along and across the direction (tx, ty)."""
    grip.stiffness[0] = along * tx * tx + across * ty * ty
    grip.stiffness[1] = (along - across) * tx * ty
    grip.stiffness[2] = along * ty * ty + across * tx * tx


@kernel
def minimum_jerk(r):
    """Minimum-jerk course (Flash & Hogan 1985): share of the way, and its slope, at share r of the time."""
    if r <= 0.0:
        return 0.0, 0.0
    if r >= 1.0:
        return 1.0, 0.0
    square = r * r
    return square * r * (10.0 - 15.0 * r + 6.0 * square), 30.0 * square * (1.0 - 2.0 * r + square)


@kernel
def course(path, r):
    """Share of a path of several pieces at share r of the time, its slope: minimum jerk from each corner to the next.

    Our choice: a hand stops where the path turns by more than `CORNER_DEG`; each stroke takes its share of the time.
    """
    if r <= 0.0 or r >= 1.0:
        return minimum_jerk(r)
    piece, way, begin = path.pieces, r * path.length, 0.0
    for i in range(piece.shape[0]):
        end = piece[i, FROM] + piece[i, LENGTH]
        if i == piece.shape[0] - 1 or abs(piece[i, TURN]) > CORNER_DEG * math.pi / 180.0:
            if way < end or i == piece.shape[0] - 1:
                if end - begin == path.length:
                    break
                share, slope = minimum_jerk((way - begin) / (end - begin))
                return (begin + share * (end - begin)) / path.length, slope
            begin = end
    return minimum_jerk(r)


@kernel
def waits_at_corner(operator, path, tip_progress):
    """Whether the virtual hand is at a corner to which the tip has not come yet, within a quarter of `near`."""
    piece, last = path.pieces, path.pieces.shape[0] - 1
    i = operator.piece
    while i < last and abs(piece[i, TURN]) <= CORNER_DEG * math.pi / 180.0:
        i += 1
    corner, step = piece[i, FROM] + piece[i, LENGTH], TICK_S / operator.movement_s
    at_corner = i < last and (operator.progress + step) * path.length > corner
    return at_corner and tip_progress < corner - 0.25 * path.near


@kernel
def begin_approach(operator, x, y, path):
    """The operator sets out for the start of the path from (x, y)."""
    operator.origin[0], operator.origin[1] = x, y
    distance = math.sqrt((path.x0 - x) * (path.x0 - x) + (path.y0 - y) * (path.y0 - y))
    operator.approach_s = max(operator.approach_least_s, distance / operator.approach_speed_m_s)
    operator.progress, operator.piece = 0.0, 0
    operator.offset[0] = operator.offset[1] = operator.effort = 0.0
    operator.noise[0] = operator.noise[1] = 0.0
    progress, distance, _, _ = on_piece(path, 0, x, y)
    for i in range(operator.ring.shape[0]):
        past = operator.ring[i]
        past[0], past[1], past[2], past[3] = x, y, progress, distance


class Moment(NamedTuple):
    """When in a trial a tick is."""

    phase: int
    tick: int  # since the start of the trial
    phase_tick: int  # since the start of the phase


@kernel
def operate(operator, grip, path, moment, tip, noise):
    """Stage: one tick of the operator; sets the arm's target and the restless part of its force.

    tip: x, y (m); noise (n, 2): standard normal draws.
    """
    tick = moment.tick
    if moment.phase == MOVE:
        operator.piece = follow(path, operator.piece, tip[0], tip[1])
    progress, distance, tx, ty = on_piece(path, operator.piece, tip[0], tip[1])
    now = operator.ring[tick & _LAST]
    now[0], now[1], now[2], now[3] = tip[0], tip[1], progress, distance
    if moment.phase == APPROACH or moment.phase == HOLD:
        reach(operator, grip, path, tick)
    elif moment.phase == MOVE:
        if moment.phase_tick == 0:
            set_out(operator, path)
        move_along(operator, grip, path, tick, moment.phase_tick, progress)
    else:
        grip.target[2] = grip.target[3] = 0.0
        operator.effort -= operator.effort_ease_per_s * TICK_S * operator.effort
    tremble(operator, grip, (tx, ty), tip, tick, noise)


@kernel
def reach(operator, grip, path, tick):
    """Towards the start of the path, then, while the handle is calm, correct what is seen to be missing."""
    operator.progress += TICK_S / operator.approach_s
    share, slope = minimum_jerk(operator.progress)
    way_x, way_y = path.x0 - operator.origin[0], path.y0 - operator.origin[1]
    if operator.progress >= 1.0:
        seen = operator.ring[(tick - operator.seen_ticks) & _LAST]
        moved_x, moved_y = felt_motion(operator, tick, 0)
        calm = max(1.0 - math.sqrt(moved_x * moved_x + moved_y * moved_y) / operator.settle_speed_m_s, 0.0)
        correct(operator, path.x0 - seen[0], path.y0 - seen[1], moved_x, moved_y, calm)
    grip.target[0] = operator.origin[0] + share * way_x + operator.offset[0]
    grip.target[1] = operator.origin[1] + share * way_y + operator.offset[1]
    grip.target[2] = slope * way_x / operator.approach_s
    grip.target[3] = slope * way_y / operator.approach_s


@kernel
def felt_motion(operator, tick, column):
    """Velocity (m/s) that is felt now, of two columns of the ring: 0 in x and y, 2 along and across the path."""
    felt = operator.ring[(tick - operator.felt_ticks) & _LAST]
    before = operator.ring[(tick - operator.felt_ticks - _GLANCE) & _LAST]
    rate = 1.0 / (_GLANCE * TICK_S)
    return rate * (felt[column] - before[column]), rate * (felt[column + 1] - before[column + 1])


@kernel
def correct(operator, error_0, error_1, rate_0, rate_1, calm):
    """Move the virtual hand against a seen error (m) that does not vanish by itself (the tip moves at `rate`, m/s).

    calm (0 .. 1): how far the operator trusts what is seen. Our choice, both foresight and calm: with the handle's and
    the arm's mass on a lightly damped arm, corrections of a late error alone would shake the handle more and more.
    """
    error = math.sqrt(error_0 * error_0 + error_1 * error_1)
    if error <= operator.seen_least_m:
        return
    left = error - operator.seen_least_m - operator.foresight_s * (rate_0 * error_0 + rate_1 * error_1) / error
    if left > 0.0:
        step = operator.seen_gain_per_s * TICK_S * calm * left / error
        most = operator.correction_max_m
        operator.offset[0] = min(max(operator.offset[0] + step * error_0, -most), most)
        operator.offset[1] = min(max(operator.offset[1] + step * error_1, -most), most)


@kernel
def set_out(operator, path):
    """Go: the virtual hand is at the start; its correction, so far in x and y, now counts along and across the path."""
    _, _, tx, ty = point_at(path, 0.0)
    x, y = operator.offset[0], operator.offset[1]
    operator.offset[0], operator.offset[1] = tx * x + ty * y, tx * y - ty * x
    operator.direction[0], operator.direction[1] = tx, ty
    operator.progress = 0.0


@kernel
def move_along(operator, grip, path, tick, phase_tick, tip_progress):
    """Along the path with minimum jerk, waiting for a tip that lags; corrections across it, and along it at its end."""
    seen = operator.ring[(tick - operator.seen_ticks) & _LAST]
    felt = operator.ring[(tick - operator.felt_ticks) & _LAST]
    rate_along, rate_across = felt_motion(operator, tick, 2)
    one_piece = path.pieces.shape[0] == 1
    share, slope = minimum_jerk(operator.progress) if one_piece else course(path, operator.progress)
    lead = share * path.length + operator.offset[0] - tip_progress
    moving = phase_tick * TICK_S >= operator.reaction_s and lead < operator.lead_max_m
    moving = moving and (one_piece or not waits_at_corner(operator, path, tip_progress))
    if moving and operator.progress < 1.0:
        operator.progress += TICK_S / operator.movement_s
    else:
        slope = 0.0
    stands = math.sqrt(rate_along * rate_along + rate_across * rate_across) < operator.still_speed_m_s
    stands = stands and phase_tick * TICK_S > 2.0 * operator.reaction_s
    arriving = moving and operator.progress >= 1.0
    stands = stands and not (arriving and operator.aims_at_end == 1.0)
    missing = path.length - seen[2] if arriving else 0.0
    sight = 1.0 if arriving else operator.sees_cursor  # our choice: the end is found without a cursor, too
    error = 0.0 if stands else -sight * seen[3]
    correct(operator, missing, error, rate_along if missing != 0.0 else 0.0, rate_across, 1.0)

    wander = share * (1.0 - share)
    across = 4.0 * wander * operator.bias + _S_HEIGHT * wander * (1.0 - 2.0 * share) * operator.curvature
    alert = min(phase_tick * TICK_S / max(operator.reaction_s, TICK_S), 1.0)
    across += operator.offset[1] - alert * operator.felt_gain * felt[3]
    if stands:
        operator.offset[1] -= operator.give_up_per_s * TICK_S * (across - felt[3])
        operator.effort = min(operator.effort + operator.effort_N_s * TICK_S, operator.effort_max_N)
    else:
        operator.effort -= operator.effort_ease_per_s * TICK_S * operator.effort
    set_target(operator, grip, path, share * path.length, across, slope * path.length / operator.movement_s)


@kernel
def set_target(operator, grip, path, progress, across, speed):
    """The arm's target: `across` (m) to the left of the point at `progress` (m), moving on at `speed` (m/s)."""
    x, y, tx, ty = point_at(path, progress)
    ux, uy = operator.direction[0], operator.direction[1]
    if ux != tx or uy != ty:  # at a bend
        if ux * tx + uy * ty < 0.0:  # the path turns back: the arm is as stiff the other way
            ux, uy = -ux, -uy
        share = min(TICK_S / operator.turn_s, 1.0)
        ux, uy = ux + share * (tx - ux), uy + share * (ty - uy)
        length = math.sqrt(ux * ux + uy * uy)
        ux, uy = ux / length, uy / length
        operator.direction[0], operator.direction[1] = ux, uy
        turn_arm(grip, operator.stiffness_along_N_m, operator.stiffness_across_N_m, ux, uy)
    grip.target[0] = x + operator.offset[0] * ux - across * uy
    grip.target[1] = y + operator.offset[0] * uy + across * ux
    grip.target[2], grip.target[3] = speed * ux, speed * uy


@kernel
def tremble(operator, grip, forward, tip, tick, noise):
    """The rest of the force: effort along the path, low-passed noise in proportion to the arm's force, and tremor.

    forward: unit tangent of the path.
    """
    n = noise.shape[0]
    place = tick % n
    draw, far = noise[place], noise[place + n // 2 if place < n - n // 2 else place - (n - n // 2)]
    for i in range(2):
        operator.noise[i] = operator.noise_keep * operator.noise[i] + operator.noise_draw * draw[i]
        tremor = operator.tremor_keep[0] * operator.tremor[0, i] + operator.tremor_keep[1] * operator.tremor[1, i]
        operator.tremor[1, i] = operator.tremor[0, i]
        operator.tremor[0, i] = tremor + operator.tremor_draw * far[i]
    k = grip.stiffness
    dx, dy = grip.target[0] - tip[0], grip.target[1] - tip[1]
    push_x, push_y = operator.effort * forward[0], operator.effort * forward[1]
    fx, fy = k[0] * dx + k[1] * dy + push_x, k[1] * dx + k[2] * dy + push_y
    pull = operator.noise_share * min(math.sqrt(fx * fx + fy * fy), operator.force_max_N)
    held_x = push_x + pull * operator.noise[0] + operator.tremor_N * operator.tremor[0, 0]
    held_y = push_y + pull * operator.noise[1] + operator.tremor_N * operator.tremor[0, 1]
    # so that spring, damper and this together never exceed the clip
    held = math.sqrt(held_x * held_x + held_y * held_y)
    if held > operator.force_max_N:
        held_x, held_y = held_x * operator.force_max_N / held, held_y * operator.force_max_N / held
        held = operator.force_max_N
    grip.held[0], grip.held[1] = held_x, held_y
    grip.force_max = operator.force_max_N - held
