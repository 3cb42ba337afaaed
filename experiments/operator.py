"""A simulated operator: a virtual hand that moves along the path with minimum jerk and pulls the handle by an arm.

The arm is a spring-damper with a mass at the handle. The virtual hand drifts off the path (bias, curvature), corrects
what it feels (60 ms late) and sees (130 ms late), trembles, and its force is noisy in proportion to itself. Parameters
are drawn per person from the seed; figures and sources: stiffness, damping, mass from one measured arm and computed
arm models (srep18004; Flash 1987; Selen 2009), minimum jerk (Flash & Hogan 1985), delays (PMC4191878), tremor
(PMC4594250, PMID 11568677), force noise in proportion to force (PMID 10385989, our figure). Bias, curvature, skill
and gains are assumed.
"""

import math
from typing import NamedTuple

import numpy as np

from core.jit import kernel
from core.path import Path
from core.row import APPROACH, HOLD, MOVE
from core.state import new_record

TICK_S = 1e-3
_RING = 256  # ticks of tip history, longer than the longest delay

OPERATOR = np.dtype(
    [
        ("movement_s", "f8"),  # duration of the virtual hand's movement along the path
        ("reaction_s", "f8"),  # from go to the start of the movement
        ("approach_speed", "f8"),  # m/s, mean speed towards the start
        ("bias", "f8"),  # m, lateral offset of the virtual path, this trial
        ("curvature", "f8"),  # m, lateral bow of the virtual path
        ("seen_gain", "f8"),  # 1/s, correction of the seen error
        ("felt_gain", "f8"),  # share of the felt sideways pull that is given up at once
        ("stall_rate", "f8"),  # 1/s, at which a sideways push is given up while the tip stands still
        ("stall_way", "f8"),  # m, the tip stands still when it moved less in the time between felt and seen
        ("seen_ticks", "i8"),  # delay of what is seen
        ("felt_ticks", "i8"),  # delay of what is felt
        ("effort_rate", "f8"),  # N/s, at which a push along the path grows while the tip stands still
        ("effort_max", "f8"),  # N
        ("effort_ease", "f8"),  # 1/s, at which it is given up once the tip moves
        ("dead_zone", "f8"),  # m, seen errors below it are left alone
        ("lead_max", "f8"),  # m, the virtual hand waits for a tip that lags more
        ("noise_share", "f8"),  # force noise, share of the force
        ("noise_rate", "f8"),  # rad/s, corner of the noise
        ("tremor_force", "f8"),  # N, amplitude
        ("tremor_rate", "f8"),  # rad/s
        ("tremor_phase", "f8"),  # rad
        # what changes from tick to tick
        ("progress", "f8"),  # 0 .. 1 of the minimum-jerk movement
        ("origin", "f8", (2,)),  # m, where the approach began
        ("approach_s", "f8"),
        ("effort", "f8"),  # N
        ("offset", "f8", (2,)),  # m, correction learned from what is seen, in x and y
        ("noise", "f8", (2,)),
        ("ring", "f8", (_RING, 2)),  # m, past tip positions
    ]
)


class Person(NamedTuple):
    """One simulated operator's constants."""

    stiffness_along: float  # N/m
    stiffness_across: float  # N/m
    damping: float  # N s/m
    mass: float  # kg, at the handle
    movement_s: float
    bias_m: float
    curvature_m: float
    trial_bias_m: float  # sd from trial to trial
    seen_gain: float
    felt_gain: float
    noise_share: float
    tremor_N: float
    tremor_hz: float
    force_max_N: float = 40.0  # assumed: what a person pushes without strain


def draw_person(generator: np.random.Generator) -> Person:
    """A person at random (assumed ranges; see the module's sources)."""
    uniform, normal = generator.uniform, generator.normal
    return Person(
        stiffness_along=uniform(150.0, 250.0),
        stiffness_across=uniform(250.0, 500.0),
        damping=uniform(10.0, 30.0),
        mass=uniform(0.9, 2.0),
        movement_s=uniform(2.0, 4.0),
        bias_m=normal(0.0, 0.008),
        curvature_m=normal(0.0, 0.006),
        trial_bias_m=0.004,
        seen_gain=uniform(2.0, 4.0),
        felt_gain=uniform(0.2, 0.6),
        noise_share=uniform(0.02, 0.05),
        tremor_N=uniform(0.05, 0.3),
        tremor_hz=uniform(8.0, 10.0),
    )


def steady(person: Person) -> Person:
    """The same person without noise, tremor, or change from trial to trial."""
    return person._replace(noise_share=0.0, tremor_N=0.0, trial_bias_m=0.0)


def new_operator(person: Person, generator: np.random.Generator) -> np.recarray:
    """The operator of one trial; draws what differs between trials (bias, reaction, phase of the tremor)."""
    operator = new_record(OPERATOR)
    fields = dict(
        movement_s=person.movement_s,
        reaction_s=generator.uniform(0.2, 0.35),
        approach_speed=0.15,
        bias=person.bias_m + person.trial_bias_m * generator.standard_normal(),
        curvature=person.curvature_m,
        seen_gain=person.seen_gain,
        felt_gain=person.felt_gain,
        seen_ticks=130,
        felt_ticks=60,
        stall_rate=2.0,
        stall_way=0.0003,
        effort_rate=10.0,
        effort_max=25.0,
        effort_ease=8.0,
        dead_zone=0.001,
        lead_max=0.06,
        noise_share=person.noise_share,
        noise_rate=2.0 * math.pi * 5.0,
        tremor_force=person.tremor_N,
        tremor_rate=2.0 * math.pi * person.tremor_hz,
        tremor_phase=generator.uniform(0.0, 2.0 * math.pi),
    )
    for name, value in fields.items():
        operator[name][0] = value
    return operator


def take_handle(person: Person, path: Path, grips: np.recarray) -> None:
    """Set the arm at the handle: soft along the path, stiff across it."""
    tx, ty = path.tangent_x, path.tangent_y
    along, across = person.stiffness_along, person.stiffness_across
    grips["spring"][0] = 1
    grips["stiffness"][0] = (
        along * tx * tx + across * ty * ty,
        (along - across) * tx * ty,
        along * ty * ty + across * tx * tx,
    )
    grips["damping"][0] = (person.damping, 0.0, person.damping)
    grips["force_max"][0] = person.force_max_N
    grips["mass"][0] = person.mass
    grips["held"][0] = 0.0


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
def begin_approach(operator, x, y, start_x, start_y):
    """The operator sets out for the start from (x, y)."""
    operator.origin[0], operator.origin[1] = x, y
    distance = math.sqrt((start_x - x) * (start_x - x) + (start_y - y) * (start_y - y))
    operator.approach_s = max(0.6, distance / operator.approach_speed)
    operator.progress = 0.0
    operator.offset[0] = operator.offset[1] = operator.effort = 0.0
    operator.noise[0] = operator.noise[1] = 0.0
    for i in range(operator.ring.shape[0]):
        operator.ring[i, 0], operator.ring[i, 1] = x, y


@kernel
def operate(operator, grip, path, phase, tick, phase_tick, x, y, noise):
    """Stage: one tick of the operator; sets the arm's target and the noisy part of its force.

    tick: since the start of the trial; phase_tick: since the start of the phase; noise (n, 2): standard normal draws.
    """
    size = operator.ring.shape[0]
    operator.ring[tick % size, 0], operator.ring[tick % size, 1] = x, y
    seen = (tick - operator.seen_ticks) % size
    felt = (tick - operator.felt_ticks) % size
    seen_x, seen_y = operator.ring[seen, 0], operator.ring[seen, 1]
    if phase == APPROACH or phase == HOLD:
        reach(operator, grip, path, seen_x, seen_y)
    else:
        felt_x, felt_y = operator.ring[felt, 0], operator.ring[felt, 1]
        follow(operator, grip, path, phase, phase_tick, x, y, seen_x, seen_y, felt_x, felt_y)
    tremble(operator, grip, path, x, y, tick, noise[tick % noise.shape[0], 0], noise[tick % noise.shape[0], 1])


@kernel
def reach(operator, grip, path, seen_x, seen_y):
    """Towards the start of the path, then correct what is seen to be missing."""
    operator.progress += TICK_S / operator.approach_s
    share, slope = minimum_jerk(operator.progress)
    way_x, way_y = path.x0 - operator.origin[0], path.y0 - operator.origin[1]
    if operator.progress >= 1.0:
        correct(operator, path.x0 - seen_x, path.y0 - seen_y)
    grip.target[0] = operator.origin[0] + share * way_x + operator.offset[0]
    grip.target[1] = operator.origin[1] + share * way_y + operator.offset[1]
    grip.target[2] = slope * way_x / operator.approach_s
    grip.target[3] = slope * way_y / operator.approach_s


@kernel
def correct(operator, error_x, error_y):
    """Move the virtual hand against a seen error (m) that is above the dead zone."""
    error = math.sqrt(error_x * error_x + error_y * error_y)
    if error > operator.dead_zone:
        rate = operator.seen_gain * TICK_S * (error - operator.dead_zone) / error
        for i, step in ((0, rate * error_x), (1, rate * error_y)):
            operator.offset[i] = min(max(operator.offset[i] + step, -0.1), 0.1)


@kernel
def follow(operator, grip, path, phase, phase_tick, x, y, seen_x, seen_y, felt_x, felt_y):
    """Along the path with minimum jerk, waiting for a tip that lags; corrections across it, and along it at its end."""
    tx, ty = path.tangent_x, path.tangent_y
    if phase == MOVE and phase_tick == 0:
        operator.progress = 0.0
    lead = tx * (grip.target[0] - x) + ty * (grip.target[1] - y)
    moving = phase == MOVE and phase_tick * TICK_S >= operator.reaction_s and lead < operator.lead_max
    share, slope = minimum_jerk(operator.progress)
    if moving and operator.progress < 1.0:
        operator.progress += TICK_S / operator.movement_s
    else:
        slope = 0.0
    seen_across = tx * (seen_y - path.y0) - ty * (seen_x - path.x0)
    felt_across = tx * (felt_y - path.y0) - ty * (felt_x - path.x0)
    missing = 0.0
    if moving and operator.progress >= 1.0:
        missing = path.length - (tx * (seen_x - path.x0) + ty * (seen_y - path.y0))
    correct(operator, missing * tx + seen_across * ty, missing * ty - seen_across * tx)
    wander = 4.0 * share * (1.0 - share)
    across = operator.bias * wander + operator.curvature * math.sin(2.0 * math.pi * share)
    pull = across + tx * operator.offset[1] - ty * operator.offset[0] - felt_across
    across -= operator.felt_gain * pull
    stands = math.hypot(felt_x - seen_x, felt_y - seen_y) < operator.stall_way
    if phase == MOVE and stands and phase_tick * TICK_S > 2.0 * operator.reaction_s:
        give = operator.stall_rate * TICK_S * pull
        operator.offset[0] += give * ty
        operator.offset[1] -= give * tx
        operator.effort = min(operator.effort + operator.effort_rate * TICK_S, operator.effort_max)
    else:
        operator.effort -= operator.effort_ease * TICK_S * operator.effort
    along = share * path.length
    grip.target[0] = path.x0 + along * tx - across * ty + operator.offset[0]
    grip.target[1] = path.y0 + along * ty + across * tx + operator.offset[1]
    speed = slope * path.length / operator.movement_s
    grip.target[2], grip.target[3] = speed * tx, speed * ty


@kernel
def tremble(operator, grip, path, x, y, tick, draw_x, draw_y):
    """The rest of the force: effort, low-passed noise in proportion to the arm's pull, and tremor."""
    decay = math.exp(-operator.noise_rate * TICK_S)
    spread = math.sqrt(1.0 - decay * decay)
    operator.noise[0] = decay * operator.noise[0] + spread * draw_x
    operator.noise[1] = decay * operator.noise[1] + spread * draw_y
    k = grip.stiffness
    dx, dy = grip.target[0] - x, grip.target[1] - y
    fx, fy = k[0] * dx + k[1] * dy, k[1] * dx + k[2] * dy
    pull = operator.noise_share * min(math.sqrt(fx * fx + fy * fy), grip.force_max)
    angle = operator.tremor_phase + operator.tremor_rate * TICK_S * tick
    tremor_x = operator.tremor_force * math.sin(angle)
    tremor_y = operator.tremor_force * math.sin(1.1 * angle + 1.0)
    grip.held[0] = operator.effort * path.tangent_x + pull * operator.noise[0] + tremor_x
    grip.held[1] = operator.effort * path.tangent_y + pull * operator.noise[1] + tremor_y
