"""The levers of the brakes in every direction in which the tip may move, at all places within a circle.

Joint i turns through |g_i . u| for each metre of the tip in the direction u (unit vector), its lever. What
`core.control.stopping` minimises over u is concave between directions at right angles to a row g_k, so those alone are
kept: at the tip, and at places on and in the circle that it cannot leave. `MARGIN` is for the places between (law:
`tests/core/test_stopping.py`).
"""

import math

import numpy as np

from core.dynamics import combined, motion
from core.kernels import kernel
from core.mechanism import Brakes, Mechanism
from core.records import new_record
from core.simulator.state import MECHANISM, pack_mechanism

#: Places on the circle that the tip cannot leave at which levers are taken; half as many on half the radius, where that
#: is more than `NEAR_M`.
ANGLES, NEAR_M = 12, 0.045
TRIES, NEARER = 10, 0.08  # places in turn on a ray, each so much of the radius nearer, until the linkage reaches one
ROWS = 4 * (1 + ANGLES + ANGLES // 2)  # directions at right angles to a row
#: Share by which levers count as smaller, and rates as larger, for the places in between: a constant, what is added for
#: each metre beyond `NEAR_M`, and the most.
MARGIN, MARGIN_PER_M, MARGIN_MOST = 0.01, 1.0, 0.15
#: Of an elbow's |sin|, as a share of the hard stop's: levers are also taken at places so far beyond the stops.
BEYOND = 0.8
SLOWEST = 0.25  # least progress u . n of a direction that is counted: smaller ones count as this much

LEVERS = np.dtype(
    [
        ("mechanism", MECHANISM),
        ("present", "f8", (4,)),
        ("angles", "i8"),  # `ANGLES` and `TRIES`: with constant counts the compiler takes a minute longer
        ("tries", "i8"),
        # of the circle
        ("rows", "i8"),  # directions kept
        ("u", "f8", (ROWS, 2)),
        ("per_way", "f8", (ROWS,)),  # 1 / u . n
        ("lever", "f8", (4, ROWS)),  # 1/m, |g_i . u|
        ("swift", "f8", (4,)),  # rad2/s2/J, the largest g_i . M^-1 g_i: a joint's rate^2 is at most this times 2 E
        ("g", "f8", (4, 2)),  # 1/m, of one place: work space
    ]
)


def make_levers(mechanism: Mechanism, brakes: Brakes) -> np.ndarray:
    """A device as the kernels here read it; one record."""
    record = new_record(LEVERS, present=brakes.present, angles=ANGLES, tries=TRIES)
    record["mechanism"][0] = pack_mechanism(mechanism)[0]
    return record


@kernel
def take_places(levers, x, y, radius):
    """Take levers and masses at the tip (m) and, unless the radius (m) is 0, at places within it."""
    levers.rows = 0
    for i in range(4):
        levers.swift[i] = 0.0
    certain = 1.0 - min(MARGIN + MARGIN_PER_M * max(radius - NEAR_M, 0.0), MARGIN_MOST)
    take_place(levers, x, y, certain)
    if radius > 0.0:
        for k in range(levers.angles):
            take_place_along(levers, x, y, radius, 2.0 * math.pi * k / ANGLES, certain)
        if radius > NEAR_M:
            for k in range(levers.angles // 2):
                take_place_along(levers, x, y, 0.5 * radius, 2.0 * math.pi * (2 * k + 1) / ANGLES, certain)


@kernel
def take_place_along(levers, x, y, radius, angle, certain):
    """Add the rows of the place at this radius (m) and angle (rad), or of the first nearer one that is in reach."""
    for n in range(levers.tries):
        r = radius * (1.0 - NEARER * n)
        if take_place(levers, x + r * math.cos(angle), y + r * math.sin(angle), certain):
            break


@kernel
def take_place(levers, x, y, certain):
    """Add the rows of a place (m), levers times the share `certain`, rates over it; False: it is out of reach."""
    mechanism, g = levers.mechanism, levers.g
    one, two, least = mechanism.arm_1, mechanism.arm_2, BEYOND * mechanism.margin
    q = motion(mechanism, x, y, 0.0, 0.0)
    p, r = q.arm_1, q.arm_2
    if not (abs(p.s) >= least * one.length_1 * one.length_2 and abs(r.s) >= least * two.length_1 * two.length_2):
        return False
    g[0, 0], g[0, 1], g[1, 0], g[1, 1] = p.base_x, p.base_y, p.elbow_x, p.elbow_y
    g[2, 0], g[2, 1], g[3, 0], g[3, 1] = r.base_x, r.base_y, r.elbow_x, r.elbow_y
    for i in range(4):
        if mechanism.coupled >> i & 1 != 0:
            g[i, 0], g[i, 1], _, _ = combined(mechanism, i, q)
    xx, xy, yy = q.mass_xx, q.mass_xy, q.mass_yy
    determinant = xx * yy - xy * xy
    for k in range(4):
        if levers.present[k] == 0.0:
            continue
        a, b, n = g[k, 0], g[k, 1], levers.rows
        swift = (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (determinant * certain * certain)
        levers.swift[k] = max(levers.swift[k], swift)
        length = math.sqrt(a * a + b * b)
        levers.u[n, 0], levers.u[n, 1] = -b / length, a / length
        for i in range(4):
            levers.lever[i, n] = certain * levers.present[i] * abs(g[i, 1] * a - g[i, 0] * b) / length
        levers.rows = n + 1
    return True


@kernel
def set_direction(levers, n_x, n_y):
    """Count as progress only what leads along n (unit vector); (0, 0): motion in any direction."""
    for k in range(levers.rows):
        along = abs(levers.u[k, 0] * n_x + levers.u[k, 1] * n_y)
        levers.per_way[k] = 1.0 if n_x == 0.0 and n_y == 0.0 else 1.0 / max(along, SLOWEST)
