"""Time-ahead control: move the tip ahead under every pattern of brakes, and take the one that ends nearest the path.

Over the horizon (50 to 100 ms), in STEPS steps h, the tip is a mass M that the hand pushes with its force of now, and
each brake holds up to its torque t_i, off or on. A step is implicit in the velocity,
    v1 = argmin 1/2 (v1 - v0 - h M^-1 F)' M (v1 - v0 - h M^-1 F) + h sum t_i |g_i . v1|,
so brakes that stick do so exactly. Its dual is the force of the zonotope sum [-t_i, t_i] g_i that is nearest to
F + M v0 / h as M^-1 measures, which `reflect` finds by a finite list of cases. Taken is the pattern of least
    |distance from the path at the end| - w (way along it).

Our reconstruction: the look-ahead that the literature of passive displays names is without a text that we could have.
Our choice: rows, mass and hand force stay those of now, the brakes have no lag and the path is straight over the
horizon (the simulator itself needs the state of the brakes, which no controller sees); a brake that is on has the
normalised force, as in `sdof`; without w the path would be kept best by standing still. Each brake that changes must
gain what the velocity's noise may move the end by, the rules' `back_speed` (four times that noise) over the horizon.
"""

import math

from core.brake import current_for_torque, torque_gain
from core.control.algorithm import GAP_M, OWN, Algorithm, Parameter, torque_for_force
from core.control.reflect import nearest_on_edge
from core.control.velocity_field import KEPT
from core.kernels import kernel
from core.mechanism import JOINTS

HORIZON = Parameter("horizon_s", "horizon", "ms", 1e3, 0.06, (50.0, 100.0))
PROGRESS = Parameter("progress_weight", "progress", "", 1.0, 0.2, (0.0, 1.0))
STEPS = 8
LEAST_S = 1e-3  # a tick: no shorter horizon is looked over


@kernel
def step_ahead(ax, ay, most, ux, uy, fx, fy, h):  # noqa: PLR0913
    """Velocity after a step h, in coordinates in which the mass is 1: rows a_i, torques `most` (tuples of four)."""
    wx, wy = ux / h + fx, uy / h + fy
    low = (-most[0], -most[1], -most[2], -most[3])
    edge, way, full, outside = nearest_on_edge(
        ax, ay, low, most, wx + ax[0] * most[0] + ax[1] * most[1] + ax[2] * most[2] + ax[3] * most[3],
        wy + ay[0] * most[0] + ay[1] * most[1] + ay[2] * most[2] + ay[3] * most[3],
    )  # fmt: skip
    if edge < 0:
        return h * wx, h * wy
    if not outside:  # all hold
        return 0.0, 0.0
    size = math.hypot(ax[edge], ay[edge])
    wx -= way * ax[edge] / size
    wy -= way * ay[edge] / size
    for k in range(4):
        torque = most[k] if full >> k & 1 else low[k]
        wx -= ax[k] * torque
        wy -= ay[k] * torque
    return h * wx, h * wy


@kernel
def torque_on(tick, i, force):
    """Torque (N m) of brake i off and at a tip force (N); 0 without a brake."""
    brakes, g = tick.brakes, tick.g
    if brakes.present[i] == 0.0:
        return 0.0, 0.0
    off, largest = torque_gain(brakes, i, 0.0), torque_gain(brakes, i, brakes.current_max[i])
    return off, max(min(torque_for_force(force, g[i, 0], g[i, 1]), largest), off)


@kernel
def decide(controller, field, tick):
    """The pattern of brakes that ends nearest the path."""
    seen, g, mass, present = tick.seen, tick.g, tick.mass, tick.brakes.present
    horizon = max(controller.values[1], LEAST_S)
    h, unsure, last = horizon / STEPS, controller.rules.back_speed * horizon, int(tick.memory[KEPT])
    off0, on0 = torque_on(tick, 0, controller.force_normalised)
    off1, on1 = torque_on(tick, 1, controller.force_normalised)
    off2, on2 = torque_on(tick, 2, controller.force_normalised)
    off3, on3 = torque_on(tick, 3, controller.force_normalised)
    # M = L L': u = L' v has the mass 1, and forces, rows and directions are L^-1 of theirs
    lx = math.sqrt(mass[0])
    cross = mass[1] / lx
    ly = math.sqrt(mass[2] - cross * cross)
    ax = (g[0, 0] / lx, g[1, 0] / lx, g[2, 0] / lx, g[3, 0] / lx)
    ay = (
        (g[0, 1] - cross * ax[0]) / ly,
        (g[1, 1] - cross * ax[1]) / ly,
        (g[2, 1] - cross * ax[2]) / ly,
        (g[3, 1] - cross * ax[3]) / ly,
    )
    fx, nx, tx = seen.fx / lx, field.n_x / lx, field.t_x / lx
    fy, ny, ty = (seen.fy - cross * fx) / ly, (field.n_y - cross * nx) / ly, (field.t_y - cross * tx) / ly
    best, least = 0, math.inf
    for bits in range(16):
        lacking = False
        ended = 0.0
        for i in range(4):
            lacking = lacking or (bits >> i & 1 != 0 and present[i] == 0.0)
            if (bits ^ last) >> i & 1:
                ended += unsure
        if lacking:
            continue
        most = (
            on0 if bits & 1 else off0,
            on1 if bits & 2 else off1,
            on2 if bits & 4 else off2,
            on3 if bits & 8 else off3,
        )
        ux, uy = lx * seen.vx + cross * seen.vy, ly * seen.vy
        across, along = -field.distance, 0.0
        for _ in range(STEPS):
            ux, uy = step_ahead(ax, ay, most, ux, uy, fx, fy, h)
            across += h * (ux * nx + uy * ny)
            along += h * (ux * tx + uy * ty)
        ended += abs(across) - controller.values[2] * along
        if ended < least:
            best, least = bits, ended
    on = (on0, on1, on2, on3)
    for i in range(4):
        if best >> i & 1:
            tick.current[i] = current_for_torque(tick.brakes, i, on[i])
    tick.memory[KEPT] = best
    return OWN + best


def _pattern(bits: int) -> str:
    return "ahead " + ("".join(joint for i, joint in enumerate(JOINTS) if bits >> i & 1) or "no brake")


ALGORITHM = Algorithm("look-ahead", (GAP_M, HORIZON, PROGRESS), tuple(map(_pattern, range(16))), decide)
