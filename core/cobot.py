"""Cobots: castors that are steered, where a brake would slip, up to three on a body.

A castor rolls along its axis and never sideways, so all castors together leave the body one way to go: the twist whose
centre of rotation lies on every axle. A servo turns each castor about its hub, which moves nothing: the wheels' force
is at right angles to the motion, and the hand alone supplies energy. The state is that one twist B, in the body and of
unit kinetic measure (m Bx^2 + m By^2 + J Bw^2 = 1), and the speed u along it: kinetic energy u^2 / 2.

    free caster   the castors follow the motion that the free body would have under the hand's force (m, J and nothing
                  else), so the device feels like one
    steered       towards a wanted twist: along a path (`path_goal`), or along a wall (`advance_at_wall`)

A servo turns at most `rate_max` rad/s. All castors must agree on one centre, so the slowest servo sets the pace: the
twist goes only so far towards the wanted one. **Flips**: near a hub the centre of rotation turns that castor by up to
half a turn at once. A castor has no front, so where the centre passes right through the hub it rolls on backwards and
nothing turns; where it passes beside the hub the motion waits for the castor (`limited` names it), up to half a turn at
`rate_max`; a castor whose hub stands still turns in place. The wheels never disagree, and nothing is hidden.

A step holds the hand's force; positions follow the mean of the velocities before and after it. Then the hand's work is
the change of u^2 / 2 to rounding, and a free caster is the free body to rounding. Wheels do not skid: `side_force` is
what they had to hold.
"""

import math
from typing import Annotated

import msgspec
import numpy as np

from core.files import Table
from core.kernels import kernel
from core.ranges import CobotInertia, CobotMass, Place, Rate
from core.records import new_record

MOST_WHEELS = 3
LEFT = 0.5  # share of its force along the path that a hand keeps where it pushes away from the path
PARALLEL = 1e-9  # sine to the wall below which a motion counts as along it

COBOT = np.dtype(
    [
        ("wheels", "i8"),
        ("hub", "f8", (MOST_WHEELS, 2)),  # m, in the body, from its centre of mass
        ("mass", "f8"),  # kg
        ("inertia", "f8"),  # kg m2 about the centre of mass; without effect where no torque acts on one wheel there
        ("rate_max", "f8"),  # rad/s of every steering servo
        # what changes
        ("pose", "f8", (3,)),  # m, rad: centre of mass and heading
        ("twist", "f8", (3,)),  # B: 1/sqrt(kg), rad/(sqrt(kg) m)
        ("speed", "f8"),  # u, sqrt(J)
        ("axis", "f8", (MOST_WHEELS, 2)),  # unit vector along which each castor rolls, in the body; no sign
        ("work", "f8"),  # J, of the hand
        ("side_force", "f8"),  # N, most that all wheels together held
        ("limited", "i8"),  # bit i: servo i set the pace in this step
    ]
)

UNSTEERED = (0.0, 0.0, 0.0)  # in place of a goal


class CobotFile(Table, frozen=True):
    """The keys of a cobot file."""

    name: Annotated[str, msgspec.Meta(min_length=1)]  # in the summary
    mass_kg: CobotMass  # of the body
    inertia_kg_m2: CobotInertia
    hubs_m: Annotated[tuple[Place, ...], msgspec.Meta(min_length=1, max_length=MOST_WHEELS)]  # castors, [x, y] each
    steering_rate_max_rad_s: Rate  # of a castor's servo
    provenance: str = ""  # where the numbers come from

    def __post_init__(self) -> None:
        if len(set(self.hubs_m)) < len(self.hubs_m):
            raise ValueError("hubs_m: two castors have the same hub")
        if len(self.hubs_m) == 1 and self.hubs_m[0] != (0.0, 0.0):
            raise ValueError("hubs_m: a single castor must stand at the centre of mass, [0, 0]")


def new_cobot(file: CobotFile, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """A cobot at rest at a pose (m, rad), its castors along the body's x axis."""
    record = new_record(COBOT)
    wheels = len(file.hubs_m)
    record["wheels"], record["mass"], record["inertia"] = wheels, file.mass_kg, file.inertia_kg_m2
    record["rate_max"], record["pose"] = file.steering_rate_max_rad_s, pose
    record["hub"][0, :wheels] = file.hubs_m
    record["twist"], record["axis"] = (1.0 / math.sqrt(file.mass_kg), 0.0, 0.0), (1.0, 0.0)
    return record


@kernel
def in_world(twist, heading):
    """A twist of the body (3,), in the world."""
    c, s = math.cos(heading), math.sin(heading)
    return c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]


@kernel
def velocity(cobot):
    """Velocity of the centre of mass and rate (vx, vy, w), m/s and rad/s."""
    (x, y, w), u = in_world(cobot.twist, cobot.pose[2]), cobot.speed
    return u * x, u * y, u * w


@kernel
def reachable_share(cobot, i, gx, gy, gw, tangent):
    """How far (0 to 1) the twist can go from B to G in this step for castor i; G in the body.

    The hub's velocity h goes along a straight line, and the castor's axis e follows it by at most the angle whose
    tangent is given, the shorter way round: |e x h| <= tangent |e . h|.
    """
    hub, axis, twist = cobot.hub[i], cobot.axis[i], cobot.twist
    before_x, before_y = twist[0] - twist[2] * hub[1], twist[1] + twist[2] * hub[0]
    after_x, after_y = gx - gw * hub[1], gy + gw * hub[0]
    across = axis[0] * after_y - axis[1] * after_x
    along = axis[0] * after_x + axis[1] * after_y
    if abs(across) <= tangent * abs(along):
        return 1.0  # also through the hub: the castor rolls on backwards
    start = axis[0] * before_x + axis[1] * before_y
    change = (along - start) if start >= 0.0 else (start - along)
    growth = abs(across) - tangent * change
    return min(tangent * abs(start) / growth, 1.0) if growth > 0.0 else 1.0


@kernel
def turn_castor(cobot, i, gx, gy, gw, tangent):
    """Castor i takes the direction of its hub; where the hub stands still, it turns in place towards that under G."""
    hub, axis, twist = cobot.hub[i], cobot.axis[i], cobot.twist
    hx, hy = twist[0] - twist[2] * hub[1], twist[1] + twist[2] * hub[0]
    size = math.hypot(hx, hy)
    rounding = 1e-12 * math.sqrt(1.0 / cobot.mass)
    if size > rounding:
        axis[0], axis[1] = hx / size, hy / size
        return
    hx, hy = gx - gw * hub[1], gy + gw * hub[0]
    along, across = axis[0] * hx + axis[1] * hy, axis[0] * hy - axis[1] * hx
    turn = across / along if abs(across) <= tangent * abs(along) and along != 0.0 else 0.0
    if abs(across) > tangent * abs(along):
        turn = math.copysign(tangent, across if along >= 0.0 else -across)
    size = math.sqrt(1.0 + turn * turn)
    axis[0], axis[1] = (axis[0] - turn * axis[1]) / size, (axis[1] + turn * axis[0]) / size


@kernel
def unit_twist(cobot, goal, heading):
    """A twist (3,) in the world as one of the body at a heading (gx, gy, gw), of unit measure, and its measure.

    Of its two senses the one nearer to B; the measure has the sign of that. B itself where the twist is zero.
    """
    goal_x, goal_y, goal_w = goal
    mass, inertia, twist = cobot.mass, cobot.inertia, cobot.twist
    c, s = math.cos(heading), math.sin(heading)
    size = math.sqrt(mass * (goal_x * goal_x + goal_y * goal_y) + inertia * goal_w * goal_w)
    gx, gy, gw = twist[0], twist[1], twist[2]
    if size > 0.0:
        gx, gy, gw = (c * goal_x + s * goal_y) / size, (c * goal_y - s * goal_x) / size, goal_w / size
    if mass * (gx * twist[0] + gy * twist[1]) + inertia * gw * twist[2] < 0.0:
        gx, gy, gw, size = -gx, -gy, -gw, -size
    return gx, gy, gw, size


@kernel
def steer(cobot, gx, gy, gw, step):
    """Turn the twist from B towards G, as far as every servo can follow in a step (s), and the castors with it.

    Returns the share of the way from B to G.
    """
    mass, inertia, twist = cobot.mass, cobot.inertia, cobot.twist
    tangent, share = math.tan(min(cobot.rate_max * step, 1.5)), 1.0
    cobot.limited = 0
    for i in range(cobot.wheels):
        own = reachable_share(cobot, i, gx, gy, gw, tangent)
        if own < 1.0:
            cobot.limited |= 1 << i
        share = min(share, own)
    for k in range(3):
        target = gx if k == 0 else (gy if k == 1 else gw)
        twist[k] += share * (target - twist[k])
    unit = 1.0 / math.sqrt(mass * (twist[0] * twist[0] + twist[1] * twist[1]) + inertia * twist[2] * twist[2])
    for k in range(3):
        twist[k] *= unit
    for i in range(cobot.wheels):
        turn_castor(cobot, i, gx, gy, gw, tangent)
    return share


@kernel
def advance(cobot, force, steered, goal, step):
    """Move the cobot by a step (s) under the hand's force (3,) at the centre of mass (N, N, N m), held over the step.

    steered: 0: a free caster; 1: steered towards the twist goal (3,), in the world, of any length and either sign.
    """
    (fx, fy, torque), mass, pose, u = force, cobot.mass, cobot.pose, cobot.speed
    vx, vy, w = velocity(cobot)
    free = vx + step * fx / mass, vy + step * fy / mass, w + step * torque / cobot.inertia
    heading = pose[2] + 0.5 * step * (w + free[2])  # after the step; exact for a free caster
    gx, gy, gw, size = unit_twist(cobot, free if steered == 0 else goal, heading)
    before_x, before_y, before_w = in_world(cobot.twist, pose[2])
    share = steer(cobot, gx, gy, gw, step)
    after_x, after_y, after_w = in_world(cobot.twist, heading)
    push_before = fx * before_x + fy * before_y + torque * before_w
    push_after = fx * after_x + fy * after_y + torque * after_w
    part_before, part_after = 0.5 * step, 0.5 * step  # s: displacement = part_before u B_before + part_after u' B_after
    if steered == 0 and share == 1.0:
        cobot.speed = size  # free: signed length of the free velocity
    elif u * (u + step * push_before) < 0.0:  # it comes to rest within the step
        part_before, part_after, cobot.speed = -0.5 * u / push_before, 0.0, 0.0
    else:  # u'^2 - u^2 = step (u push_before + u' push_after): the hand's work
        b = step * push_after
        root = math.sqrt(b * b + 4.0 * u * (u + step * push_before))
        cobot.speed = 0.5 * (b + math.copysign(root, u if u != 0.0 else b))
    moved_x = part_before * u * before_x + part_after * cobot.speed * after_x
    moved_y = part_before * u * before_y + part_after * cobot.speed * after_y
    turned = part_before * u * before_w + part_after * cobot.speed * after_w
    pose[0] += moved_x
    pose[1] += moved_y
    pose[2] += turned
    cobot.work += fx * moved_x + fy * moved_y + torque * turned
    new_x, new_y, _ = velocity(cobot)
    held = math.hypot(mass * (new_x - vx) / step - fx, mass * (new_y - vy) / step - fy)
    cobot.side_force = max(cobot.side_force, held)


@kernel
def path_goal(cobot, field, force, heading, within, step):
    """Twist (3,) along beta that brings the heading (rad) of a body near in about `within` metres of way.

    field: of which beta and the tangent t count. Our choice, for a castor cannot lock a hand that pushes away: the body
    is steered between t and beta, as near to beta as leaves the hand half of its force along t (`LEFT`) to move it on
    by; and along t where it would else roll back, away from the path.
    """
    fx, fy, beta_x, beta_y, t_x, t_y = force[0], force[1], field.beta_x, field.beta_y, field.t_x, field.t_y
    vx, vy, _ = velocity(cobot)
    vx, vy = vx + step * fx / cobot.mass, vy + step * fy / cobot.mass
    gx, gy = beta_x, beta_y
    along_t, along_beta = fx * t_x + fy * t_y, fx * beta_x + fy * beta_y
    if along_t > 0.0 and along_beta < LEFT * along_t:
        share = (LEFT * along_t - along_beta) / (along_t - along_beta)
        gx, gy = gx + share * (t_x - gx), gy + share * (t_y - gy)
        size = math.hypot(gx, gy)
        gx, gy = gx / size, gy / size
    if vx * gx + vy * gy < 0.0:
        gx, gy = t_x, t_y
    if cobot.wheels == 1:
        return gx, gy, 0.0
    rate = (heading - cobot.pose[2]) / within
    return gx, gy, rate if vx * gx + vy * gy >= 0.0 else -rate


@kernel
def advance_along(cobot, wall, force, step):
    """Move the cobot by a step towards the motion of the free body, less its part into the wall.

    wall (4,): a place of the straight wall (m), and its unit normal to the free side.
    """
    vx, vy, w = velocity(cobot)
    gx, gy = vx + step * force[0] / cobot.mass, vy + step * force[1] / cobot.mass
    gw = w + step * force[2] / cobot.inertia
    into = min(gx * wall[2] + gy * wall[3], 0.0)
    gx, gy = gx - into * wall[2], gy - into * wall[3]
    if gx == 0.0 and gy == 0.0 and gw == 0.0:
        gx, gy = -wall[3], wall[2]
    advance(cobot, force, 1, (gx, gy, gw), step)


@kernel
def stops_short(cobot, wall, push, step, most):
    """Whether castors steered along the wall from now on keep the centre of mass on its free side.

    It moves the cobot by up to `most` steps under the worst push (N): along the motion, or from rest into the wall.
    """
    for _ in range(most):
        if (cobot.pose[0] - wall[0]) * wall[2] + (cobot.pose[1] - wall[1]) * wall[3] < 0.0:
            return False
        bx, by, _ = in_world(cobot.twist, cobot.pose[2])
        size = math.hypot(bx, by)
        outward = bx * wall[2] + by * wall[3]
        if abs(outward) <= PARALLEL * size or cobot.speed * outward > 0.0:
            return True
        way = -math.copysign(1.0, outward)  # into the wall
        advance_along(cobot, wall, (way * push * bx / size, way * push * by / size, 0.0), step)
    return False


@kernel
def advance_at_wall(cobots, wall, push, force, step, most):
    """Move cobots[0] by a step as a free caster, or along the wall if it could not be stopped after a free step.

    cobots[1]: work space for the trial step. A hand of at most `push` N without a torque cannot bring the centre of
    mass through the wall from any state from which it can be held; a stronger one, or one that turns the body, may.
    """
    cobots[1] = cobots[0]
    advance(cobots[1], force, 0, UNSTEERED, step)
    if stops_short(cobots[1], wall, push, step, most):
        advance(cobots[0], force, 0, UNSTEERED, step)
    else:
        advance_along(cobots[0], wall, force, step)
