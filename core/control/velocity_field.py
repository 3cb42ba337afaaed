"""The field of desired directions around the path (Section IV-A, Fig. 12), and which way along it is forward.

t is the tangent in the travel sense, n the inward normal (towards the path), beta the desired direction. The field is
that of the piece which the tip has come to along the path (`core.path.follow`).
"""

import math
from typing import NamedTuple

import numpy as np

from core.kernels import kernel
from core.path import Path, follow, measure, on_piece

#: Places in the memory: travel sense (+1 to the end), side of the path (+1 left; 0 not yet known), piece of the path
#: that the tip has come to. Then, of one tick, the tip force that the controller is to show (two places, N; NaN:
#: none), and the nearest one that its brakes can exert (two places, NaN: it showed none). Then the travel sense round
#: an obstacle.
TRAVEL, SIDE, PIECE, WANTED, NEAREST, ROUND = 0, 1, 2, 3, 5, 7
#: The guard's (`core.control.guard`): whether it has locked the brakes, what each brake holds at least (four places,
#: N m), the sense in which each joint turned when the lock began, how far joints have turned back since (in plays),
#: whether the guard was sure at the last tick, and whether it is at this one (NaN: it did not decide).
LOCKED, HELD, SENSE, BACK, SURE, HOLDS = 8, 9, 13, 17, 18, 19
#: What a controller in a file of its own keeps from tick to tick (four places; 0 at first), whatever it means by it.
KEPT = 20


class Seen(NamedTuple):
    """What a controller sees of the tip and of the hand that holds it."""

    x: float  # m
    y: float
    vx: float  # m/s
    vy: float
    fx: float  # N, of the hand
    fy: float


@kernel
def seen_in(tip, hand_force):
    """`Seen` in a state: tip (4,), m, m/s; hand_force (2,), N."""
    return Seen(tip[0], tip[1], tip[2], tip[3], hand_force[0], hand_force[1])


class Field(NamedTuple):
    """The field at the tip: unit vectors in tip coordinates (`field_around`: at many places, each part (n,))."""

    distance: float  # m, >= 0
    t_x: float
    t_y: float
    n_x: float
    n_y: float
    beta_x: float
    beta_y: float


NO_FIELD = Field(*[math.nan] * 7)  # without a tip, velocity and force there is none


def new_memory() -> np.ndarray:
    """What a controller remembers between ticks, (24,), at the start of a trial: towards the end, on no side."""
    return np.array([1.0, 0.0, 0.0, *[math.nan] * 4, 1.0, *[0.0] * 11, math.nan, *[0.0] * 4])


@kernel
def travel_sense(last, force_along, speed_along, rules):
    """+1 where forward is towards the path's end, -1 towards its start.

    The sign of the hand force along the path; kept while that force is too weak (turn_force) or the tip moves
    against it (turn_speed). Force and speed are along the path's own tangent.
    """
    if force_along > rules.turn_force and speed_along >= -rules.turn_speed:
        return 1.0
    if force_along < -rules.turn_force and speed_along <= rules.turn_speed:
        return -1.0
    return last


@kernel
def sense_along(tx, ty, last, seen, rules):
    """`travel_sense` along a tangent (tx, ty)."""
    return travel_sense(last, tx * seen.fx + ty * seen.fy, tx * seen.vx + ty * seen.vy, rules)


@kernel
def side_of_path(last, distance, sense, rules):
    """+1 left of the path's own tangent, -1 right of it; on the path the last side, at first the left of t.

    Our choice, in both rule sets: the paper leaves open on which side a tip on the path is.
    """
    if distance > rules.on_path:
        return 1.0
    if distance < -rules.on_path:
        return -1.0
    return last if last != 0.0 else sense


@kernel
def desired_direction(distance, n_x, n_y, t_x, t_y, blend_width):
    """Unit vector beta at a distance >= 0 (m): n from blend_width on, inside its angle linearly blended to t."""
    if distance >= blend_width:
        return n_x, n_y
    angle = 0.5 * math.pi * distance / blend_width  # from t; n and t are at right angles
    c, s = math.cos(angle), math.sin(angle)
    return c * t_x + s * n_x, c * t_y + s * n_y


@kernel
def field_at(path, memory, seen, rules):
    """The field at the tip for its velocity and the hand force (`Seen`); updates memory."""
    piece = follow(path, int(memory[PIECE]), seen.x, seen.y)
    memory[PIECE] = piece
    _, distance, tx, ty = on_piece(path, piece, seen.x, seen.y)
    sense = sense_along(tx, ty, memory[TRAVEL], seen, rules)
    side = side_of_path(memory[SIDE], distance, sense, rules)
    memory[TRAVEL] = sense
    memory[SIDE] = side
    t_x, t_y = sense * tx, sense * ty
    n_x, n_y = side * ty, -side * tx
    beta_x, beta_y = desired_direction(abs(distance), n_x, n_y, t_x, t_y, path.blend_width)
    return Field(abs(distance), t_x, t_y, n_x, n_y, beta_x, beta_y)


@kernel
def field_at_obstacle(near, distance, memory, seen, blend_width, rules):
    """The field beside the nearest obstacle; updates the memory of the travel sense round it.

    t runs along its edge in the sense of the hand, n outward; beta turns from t, blend_width (m) away, to n at the edge
    and inside. distance (m): from the path, by which the error of control is still measured.
    """
    tx, ty = near.n_y, -near.n_x
    sense = sense_along(tx, ty, memory[ROUND], seen, rules)
    memory[ROUND] = sense
    t_x, t_y = sense * tx, sense * ty
    inwards = max(blend_width - near.distance, 0.0)
    beta_x, beta_y = desired_direction(inwards, near.n_x, near.n_y, t_x, t_y, blend_width)
    return Field(distance, t_x, t_y, near.n_x, near.n_y, beta_x, beta_y)


def field_around(path: Path, places: np.ndarray, sense: float) -> Field:
    """The field at places (n, 2), m, with this travel sense (+1, -1), each of the nearest piece of all; parts (n,).

    For drawings, in numpy: it compiles no kernel of control. On the path itself n is to the right of t.
    """
    found = np.empty((len(places), 4))
    measure(path, np.ascontiguousarray(places), found)
    distance, (t_x, t_y) = sense * found[:, 1], sense * found[:, 2:].T
    side = np.where(distance < 0.0, -1.0, 1.0)  # of the tip, as seen along t
    n_x, n_y = side * t_y, -side * t_x
    angle = 0.5 * np.pi * np.minimum(np.abs(distance) / path.blend_width, 1.0)
    c, s = np.cos(angle), np.sin(angle)
    return Field(np.abs(distance), t_x, t_y, n_x, n_y, c * t_x + s * n_x, c * t_y + s * n_y)  # type: ignore[arg-type]
