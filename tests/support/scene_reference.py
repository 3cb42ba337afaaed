"""An independent solution of a scene: nothing of the simulator is used, neither its equations nor its solver.

- Mechanics by the principle of virtual work over the bodies (links, point masses, rotors), each with its own velocity:
  J(x_m)^T D (J(x_1) v_1 - J(x_0) v_0) = h Q: no mass matrix in tip coordinates, no Coriolis terms.
- Time by the implicit midpoint rule: one step against two half steps, cut at changes of sign,
  play edges and stops.
- Stick and slip by trying every case: the tip rests, moves along each line on which a joint rests, or slips everywhere
  with each choice of signs. The case of least energy is the answer (the problem is strictly convex).
- Eqs. (1), (2), (4) and the backlash, the lag on the yield (docs/decisions/02), a state of its own; stops are plastic.

`solve_scene` runs twice, with two tolerances; how far the runs differ is its estimate of its own error.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np

JOINTS = "AEBC"
SIDES = {"out": (1.0, -1.0), "in": (-1.0, 1.0), "left": (1.0, 1.0), "right": (-1.0, -1.0)}
IDEAL, STATIC, MR = range(3)
FIDELITIES = ("ideal", "static", "mr")
RPM = 60.0 / (2.0 * math.pi)

ROWS = 22  # generalised velocities: tip 2, and for each arm elbow 2, com 2, turn 1, com 2, turn 1, rotors 2
LINES = 9  # four brakes, then the stops at A, E, B, C, D
#: s; an event is at a step no longer than this. rad/s; slower is at rest. m or rad; nearer is at a stop or play edge.
SHORTEST, RESTING, TOUCHING, EDGE = 1e-10, 1e-12, 1e-7, 1e-10
#: Steps after which a scene is given up: chatter that never ends.
MOST_STEPS = 1_000_000

njit = numba.njit(cache=True)


@njit
def pose(arms, x, y, e):
    """Both links of each arm, e[k] = proximal x, y, distal x, y. False: out of reach."""
    for k in range(2):
        rx, ry = x - arms[k, 0], y - arms[k, 1]
        l1, l2 = arms[k, 2], arms[k, 3]
        r = math.hypot(rx, ry)
        if not (r < l1 + l2 and r > abs(l1 - l2)):
            return False
        cosine = (l1 * l1 + r * r - l2 * l2) / (2.0 * l1 * r)
        # Heron's form: exact near the stretched and the folded arm
        area = (l1 + l2 + r) * (l1 + l2 - r) * (r + l1 - l2) * (r - l1 + l2)
        if not area > 0.0:
            return False
        sine = arms[k, 4] * math.sqrt(area) / (2.0 * l1 * r)
        e[k, 0] = l1 * (rx * cosine - ry * sine) / r
        e[k, 1] = l1 * (ry * cosine + rx * sine) / r
        e[k, 2], e[k, 3] = rx - e[k, 0], ry - e[k, 1]
    return True


@njit
def velocities(arms, tip_mass, e, jac, g):
    """Velocities of all bodies per tip velocity, times the root of their mass: jac (ROWS, 2); rates g (5, 2)."""
    jac[:] = 0.0
    jac[0, 0] = jac[1, 1] = math.sqrt(tip_mass)
    turn = np.zeros((4, 2))
    for k in range(2):
        px, py, dx, dy = e[k]
        cross = px * dy - py * dx
        w1, w2 = turn[2 * k], turn[2 * k + 1]
        w1[0], w1[1] = dx / cross, dy / cross
        w2[0], w2[1] = -px / cross, -py / cross
        m1, c1, i1, m2, c2, i2, elbow, base_rotor, elbow_rotor = arms[k, 5:14]
        f1, f2, r = c1 / arms[k, 2], c2 / arms[k, 3], 2 + 10 * k
        for j in range(2):
            jac[r, j] = math.sqrt(elbow) * -py * w1[j]
            jac[r + 1, j] = math.sqrt(elbow) * px * w1[j]
            jac[r + 2, j] = math.sqrt(m1) * f1 * -py * w1[j]
            jac[r + 3, j] = math.sqrt(m1) * f1 * px * w1[j]
            jac[r + 4, j] = math.sqrt(i1) * w1[j]
            jac[r + 5, j] = math.sqrt(m2) * (-py * w1[j] - f2 * dy * w2[j])
            jac[r + 6, j] = math.sqrt(m2) * (px * w1[j] + f2 * dx * w2[j])
            jac[r + 7, j] = math.sqrt(i2) * w2[j]
            jac[r + 8, j] = math.sqrt(base_rotor) * w1[j]
            jac[r + 9, j] = math.sqrt(elbow_rotor) * (w2[j] - w1[j])
    for j in range(2):
        g[0, j], g[1, j] = turn[0, j], turn[1, j] - turn[0, j]
        g[2, j], g[3, j] = turn[2, j], turn[3, j] - turn[2, j]
        g[4, j] = turn[3, j] - turn[1, j]


@njit
def stops(arms, limits, e, gap, sense):
    """Distance to the nearest stop of A, E, B, C, D, and the sense of rate (+1, -1) that moves away from it.

    limits: margin, sign of the distal angle, then low and high of each theta (infinite: none).
    """
    gap[:], sense[:] = 1e9, 0.0
    for k in range(2):
        px, py, dx, dy = e[k]
        size = arms[k, 2] * arms[k, 3]
        angle = math.atan2(px * dy - py * dx, px * dx + py * dy)
        gap[1 + 2 * k] = abs(px * dy - py * dx) / size - limits[0]
        sense[1 + 2 * k] = math.copysign(1.0, angle) if abs(angle) < 0.5 * math.pi else -math.copysign(1.0, angle)
        for j, theta in ((2 * k, math.atan2(py, px)), (2 * k + 1, angle)):
            low, high = limits[2 + 2 * j], limits[3 + 2 * j]
            if math.isinf(low):
                continue
            theta -= 2.0 * math.pi * math.floor((theta - 0.5 * (low + high)) / (2.0 * math.pi) + 0.5)
            if theta - low < gap[j]:
                gap[j], sense[j] = theta - low, 1.0
            if high - theta < gap[j]:
                gap[j], sense[j] = high - theta, -1.0
    cross, dot = e[0, 2] * e[1, 3] - e[0, 3] * e[1, 2], e[0, 2] * e[1, 2] + e[0, 3] * e[1, 3]
    gap[4] = limits[1] * cross / (arms[0, 3] * arms[1, 3]) - limits[0]
    sense[4] = limits[1] if dot > 0.0 else -limits[1]


@njit
def choose(m, b, g, plus, minus, touching, sense, sign):
    """The u of least 1/2 u.M u - b.u + brakes, with every touched stop kept; sign (4,) of the brakes at it.

    Returns ux, uy and the line that it lies on: 0..8, -1 none (slips everywhere), -2 it rests.
    """
    det = m[0] * m[2] - m[1] * m[1]
    best, bx, by, line = 0.0, 0.0, 0.0, -2
    for way in range(2 * LINES):  # the lines on which a joint rests
        i = way // 2
        row = i if i < 4 else i - 4
        if (i < 4 and plus[i] + minus[i] == 0.0) or (i >= 4 and not touching[row]):
            continue
        size = math.hypot(g[row, 0], g[row, 1])
        dx, dy = -g[row, 1] / size, g[row, 0] / size
        if way % 2:
            dx, dy = -dx, -dy
        push = b[0] * dx + b[1] * dy
        allowed = True
        for j in range(5):
            rate = g[j, 0] * dx + g[j, 1] * dy
            if abs(rate) < 1e-9 * math.hypot(g[j, 0], g[j, 1]):
                continue
            if j < 4:
                push -= plus[j] * rate if rate > 0.0 else -minus[j] * rate
            if touching[j] and sense[j] * rate < 0.0:
                allowed = False
        inertia = m[0] * dx * dx + 2.0 * m[1] * dx * dy + m[2] * dy * dy
        if allowed and push > 0.0 and push * push / inertia > best:
            best, line = push * push / inertia, i
            bx, by = dx * push / inertia, dy * push / inertia
    for choice in range(16):  # every brake slips, each in one of two senses
        fx, fy = b[0], b[1]
        twice = False
        for i in range(4):
            s = 1.0 if choice >> i & 1 else -1.0
            if plus[i] + minus[i] == 0.0 and s < 0.0:
                twice = True
            cost = plus[i] if s > 0.0 else minus[i]
            fx -= s * cost * g[i, 0]
            fy -= s * cost * g[i, 1]
        if twice:
            continue
        ux, uy = (m[2] * fx - m[1] * fy) / det, (m[0] * fy - m[1] * fx) / det
        agrees = True
        for i in range(5):
            rate = g[i, 0] * ux + g[i, 1] * uy
            if i < 4 and plus[i] + minus[i] > 0.0 and rate * (1.0 if choice >> i & 1 else -1.0) <= 0.0:
                agrees = False
            if touching[i] and sense[i] * rate < 0.0:
                agrees = False
        energy = m[0] * ux * ux + 2.0 * m[1] * ux * uy + m[2] * uy * uy
        if agrees and energy > best:
            best, bx, by, line = energy, ux, uy, -1
    for i in range(4):
        rate = g[i, 0] * bx + g[i, 1] * by
        at_rest = abs(rate) < 1e-9 * math.hypot(g[i, 0], g[i, 1]) * math.hypot(bx, by) or line == -2
        sign[i] = 0.0 if at_rest or plus[i] + minus[i] == 0.0 else math.copysign(1.0, rate)
    return bx, by, line


@njit
def project(m, gx, gy, vx, vy):
    """The velocity nearest to v (in the metric of M) with no rate along g."""
    det = m[0] * m[2] - m[1] * m[1]
    ix, iy = (m[2] * gx - m[1] * gy) / det, (m[0] * gy - m[1] * gx) / det
    rate = (gx * vx + gy * vy) / (gx * ix + gy * iy)
    return vx - rate * ix, vy - rate * iy


@njit
def moves(g, vx, vy):
    """Sense (+1, -1) of a rate g . v, 0 where it is nothing but rounding."""
    rate = g[0] * vx + g[1] * vy
    if abs(rate) <= RESTING + 1e-12 * math.hypot(g[0], g[1]) * math.hypot(vx, vy):
        return 0.0
    return math.copysign(1.0, rate)


@njit
def inertia_of(jac, m):
    """M in tip coordinates."""
    m[:] = 0.0
    for r in range(ROWS):
        m[0] += jac[r, 0] * jac[r, 0]
        m[1] += jac[r, 0] * jac[r, 1]
        m[2] += jac[r, 1] * jac[r, 1]


@njit
def gain(brake, current):
    """Eq. (2)."""
    if current < brake[5]:
        return brake[0] * current + brake[1]
    return brake[2] * current * current + brake[3] * current + brake[4]


@njit
def constant(brake, current, rate, rising):
    """Eq. (4). brake: k1..k5, knee, omega_0, floor (rpm), rise (7), fall (7), play."""
    table = brake[8:15] if rising else brake[15:22]
    rpm = abs(rate) * RPM
    if rpm >= brake[6]:
        return table[0]
    w = math.log2(max(rpm, brake[7]))
    return (
        table[1] * current
        + table[2] * w
        + table[3] * current * w
        + table[4] * w * w
        + table[5] * current * w * w
        + table[6]
    )


@njit
def one_step(arms, tip_mass, limits, brakes, braked, mr, command, z, fx, fy, h, out, modes):
    """z = x, y, vx, vy, yields 4, plays 4, carried over h under the force of the step's middle.

    modes (5,): signs of the four brakes at the middle and the line. Returns the share of h up to the first event
    (1: none), or 0 where the step cannot be taken (out of reach, no convergence).
    """
    e, mid, end = np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4))
    jac0, jac1, jac2 = np.empty((ROWS, 2)), np.empty((ROWS, 2)), np.empty((ROWS, 2))
    g0, g1, g2, m, b = np.empty((5, 2)), np.empty((5, 2)), np.empty((5, 2)), np.empty(3), np.empty(2)
    gap, sense, sign = np.empty(5), np.empty(5), np.zeros(4)
    touching, plus, minus = np.zeros(5, np.bool_), np.zeros(4), np.zeros(4)
    if not pose(arms, z[0], z[1], e):
        return 0.0
    velocities(arms, tip_mass, e, jac0, g0)
    stops(arms, limits, e, gap, sense)
    for j in range(5):
        touching[j] = gap[j] < TOUCHING
    sense0 = sense.copy()
    vx, vy = z[2], z[3]
    ux, uy, line = vx, vy, -1
    for _ in range(60):
        if not pose(arms, z[0] + 0.5 * h * ux, z[1] + 0.5 * h * uy, mid):
            return 0.0
        if not pose(arms, z[0] + h * ux, z[1] + h * uy, end):
            return 0.0
        velocities(arms, tip_mass, mid, jac1, g1)
        velocities(arms, tip_mass, end, jac2, g2)
        inertia_of(jac1, m)
        wx, wy = 2.0 * ux - vx, 2.0 * uy - vy
        b[0] = m[0] * vx + m[1] * vy + 0.5 * h * fx
        b[1] = m[1] * vx + m[2] * vy + 0.5 * h * fy
        for r in range(ROWS):
            change = (jac2[r, 0] - jac1[r, 0]) * wx + (jac2[r, 1] - jac1[r, 1]) * wy
            change -= (jac0[r, 0] - jac1[r, 0]) * vx + (jac0[r, 1] - jac1[r, 1]) * vy
            b[0] -= 0.5 * jac1[r, 0] * change
            b[1] -= 0.5 * jac1[r, 1] * change
        for i in range(4):
            out[4 + i] = z[4 + i]
            if not braked[i]:
                continue
            strong, weak = z[4 + i], z[4 + i]
            if mr:
                goal = gain(brakes[i], command[i])
                a = constant(brakes[i], command[i], g1[i, 0] * ux + g1[i, 1] * uy, goal > z[4 + i])
                strong = goal + (z[4 + i] - goal) * math.exp(-0.5 * h / a)
                out[4 + i] = goal + (z[4 + i] - goal) * math.exp(-h / a)
                weak = brakes[i, 1] if brakes[i, 22] > 0.0 else strong
            plus[i] = 0.5 * h * (strong if z[8 + i] >= brakes[i, 22] - EDGE else weak)
            minus[i] = 0.5 * h * (strong if z[8 + i] <= EDGE else weak)
        lastx, lasty = ux, uy
        ux, uy, line = choose(m, b, g1, plus, minus, touching, sense0, sign)
        if not (abs(ux) < 1e6 and abs(uy) < 1e6):
            return 0.0
        if abs(ux - lastx) + abs(uy - lasty) <= 1e-13 * (1.0 + abs(ux) + abs(uy)):
            break
    else:  # at an event two cases may answer in turn: joints whose lines are parallel for an instant
        if abs(ux - lastx) + abs(uy - lasty) > (1e-10 if h > SHORTEST else 1e-7) * (1.0 + abs(ux) + abs(uy)):
            return 0.0
    if not pose(arms, z[0] + h * ux, z[1] + h * uy, end):
        return 0.0
    velocities(arms, tip_mass, end, jac2, g2)
    inertia_of(jac2, m)
    wx, wy = 2.0 * ux - vx, 2.0 * uy - vy
    if line == -2:
        wx = wy = 0.0
    elif line >= 0:
        row = line if line < 4 else line - 4
        wx, wy = project(m, g2[row, 0], g2[row, 1], wx, wy)
    share = 1.0
    for i in range(4):
        modes[i] = sign[i]
        if plus[i] + minus[i] == 0.0:
            continue
        before, after = moves(g0[i], vx, vy), moves(g2[i], wx, wy)
        if (before != 0.0 and before != sign[i]) or (sign[i] != 0.0 and after == -sign[i]):
            share = 0.5
    modes[4] = line
    out[0], out[1], out[2], out[3] = z[0] + h * ux, z[1] + h * uy, wx, wy
    for i in range(4):
        out[8 + i] = z[8 + i]
        if braked[i] and mr and brakes[i, 22] > 0.0:
            turned = h * (g1[i, 0] * ux + g1[i, 1] * uy) if sign[i] != 0.0 else 0.0
            width = brakes[i, 22]
            p = z[8 + i] + turned
            if p > width + EDGE and z[8 + i] < width - EDGE:
                share = min(share, max((width - z[8 + i]) / turned, 0.01))
            if p < -EDGE and z[8 + i] > EDGE:
                share = min(share, max(z[8 + i] / -turned, 0.01))
            out[8 + i] = min(max(p, 0.0), width)
    stops(arms, limits, end, gap, sense)
    for j in range(5):
        if gap[j] < TOUCHING:
            if gap[j] < 0.0 and not touching[j]:
                share = min(share, 0.5)
            if moves(g2[j], out[2], out[3]) == -sense[j]:
                out[2], out[3] = project(m, g2[j, 0], g2[j, 1], out[2], out[3])
                for other in range(5):
                    into = moves(g2[other], out[2], out[3]) == -sense[other]
                    if other != j and gap[other] < TOUCHING and into:
                        out[2] = out[3] = 0.0
    return share


@njit
def advance(arms, tip_mass, limits, brakes, braked, mr, command, z, force, t0, t1, h, longest, tolerance, steps):
    """Carry z from t0 to t1 under a force that runs linearly from force[0] to force[1]. Returns the step to go on with.

    Negative: given up (-1 too many steps, -2 the smallest step cannot be taken).
    """
    one, half, two = np.empty(12), np.empty(12), np.empty(12)
    modes, modes1, modes2 = np.empty(5), np.empty(5), np.empty(5)
    t = t0
    while t < t1:
        steps[0] += 1
        if steps[0] > MOST_STEPS:
            return -1.0
        h = min(h, longest)
        ends = t + h >= t1 * (1.0 - 1e-15)
        step = t1 - t if ends else h
        if step <= 0.0:
            break

        def fx(s):
            return force[0, 0] + (force[1, 0] - force[0, 0]) * (s - t0) / (t1 - t0)

        def fy(s):
            return force[0, 1] + (force[1, 1] - force[0, 1]) * (s - t0) / (t1 - t0)

        s = t + 0.5 * step
        share = one_step(arms, tip_mass, limits, brakes, braked, mr, command, z, fx(s), fy(s), step, one, modes)
        if share < 1.0 and step > SHORTEST:
            h = step * (share if share > 0.0 else 0.25)
            continue
        if share == 0.0:
            return -2.0
        if share < 1.0:
            z[:] = one
            t = t1 if ends else t + step
            h = 4.0 * step
            continue
        s = t + 0.25 * step
        share = one_step(arms, tip_mass, limits, brakes, braked, mr, command, z, fx(s), fy(s), 0.5 * step, half, modes1)
        if share == 1.0:
            s = t + 0.75 * step
            share = one_step(
                arms, tip_mass, limits, brakes, braked, mr, command, half, fx(s), fy(s), 0.5 * step, two, modes2
            )
        if share < 1.0 and step > SHORTEST:
            h = 0.5 * step
            continue
        if share < 1.0:
            two[:] = one
        error = 0.0
        for i in range(4):
            error = max(error, abs(two[i] - one[i]) * (1.0 if i < 2 else 0.1))
            error = max(error, abs(two[4 + i] - one[4 + i]) * 0.01)
        if error > tolerance and step > SHORTEST:
            h = step * max(0.2, 0.9 * (tolerance / error) ** (1.0 / 3.0))
            continue
        same = True
        for i in range(5):
            same = same and modes[i] == modes1[i] == modes2[i]
        if same and modes[4] == -1.0:
            for i in range(4):
                two[i] += (two[i] - one[i]) / 3.0
        z[:] = two
        t = t1 if ends else t + step
        if not ends or step >= 0.9 * h:
            h = step * (3.0 if error == 0.0 else min(3.0, max(0.3, 0.9 * (tolerance / error) ** (1.0 / 3.0))))
        h = max(h, SHORTEST)
    return h


@dataclass
class Reference:
    """Tips (n, 2) at the asked times, and how far two tolerances differ up to each time, m. NaN: given up."""

    tips: np.ndarray
    error: np.ndarray
    steps: int


def pack_arms(device: dict) -> np.ndarray:
    """Both arms: base, lengths, side, masses and inertias, rotors (2, 14)."""
    g, mass, arms = device["geometry"], device["mass"], np.zeros((2, 14))
    for k, (base, first, second, elbow) in enumerate((("A", "AE", "ED", "E"), ("B", "BC", "CD", "C"))):
        lengths = g[f"L_{first}_m"], g[f"L_{second}_m"]
        arms[k, :5] = (*g[f"base_{base}_m"], *lengths, SIDES[g["elbows"]][k])
        for j, (link, length) in enumerate(zip((first, second), lengths, strict=True)):
            m = mass[link]["mass_kg"]
            arms[k, 5 + 3 * j : 8 + 3 * j] = (
                m,
                mass[link].get("com_m", 0.5 * length),
                mass[link].get("inertia_kg_m2", m * length**2 / 12.0),
            )
        arms[k, 11] = mass.get(f"joint_{elbow}_kg", 0.0)
        rotor = mass.get("rotor_inertia_kg_m2", 0.0)
        arms[k, 12:] = [rotor if joint in device["brakes"] else 0.0 for joint in (base, elbow)]
    return arms


def pack_limits(device: dict, tip) -> np.ndarray:
    """Margin, sign of the distal angle at a tip, theta stops; see `stops`."""
    limits = device.get("limits", {})
    e = np.empty((2, 4))
    if not pose(pack_arms(device), *tip, e):
        raise ValueError(f"the tip {tip} is out of reach")
    packed = [limits.get("margin", 0.3), math.copysign(1.0, e[0, 2] * e[1, 3] - e[0, 3] * e[1, 2])]
    for joint in JOINTS:
        packed += limits.get(f"theta_{joint}_rad", (-math.inf, math.inf))
    return np.array(packed)


def pack_brakes(device: dict, files: dict[str, dict]) -> np.ndarray:
    """Eqs. (2), (4) and the play of each joint (4, 23); see `constant`."""
    brakes = np.zeros((4, 23))
    for joint, name in device["brakes"].items():
        f = files[name]
        brakes[JOINTS.index(joint)] = [
            *f["k"], f["knee_A"], f["omega_0_rpm"], f["floor_rpm"],
            f["rise"]["a_avg_s"], *f["rise"]["a"], f["fall"]["a_avg_s"], *f["fall"]["a"],
            math.radians(f["backlash_deg"]),
        ]  # fmt: skip
    return brakes


def distances(device: dict, x: float, y: float, tip=None) -> np.ndarray | None:
    """Distance (5,) of A, E, B, C, D to the nearest stop at (x, y); None: out of reach."""
    arms, e, gap, sense = pack_arms(device), np.empty((2, 4)), np.empty(5), np.empty(5)
    if not pose(arms, x, y, e):
        return None
    stops(arms, pack_limits(device, tip or (x, y)), e, gap, sense)
    return gap


def run(device, brake_files, scene, times, tolerance, longest) -> tuple[np.ndarray, int]:
    """Tips (n, 2) at `times`, rising from 0. scene: fidelity, tip, velocity, schedule (t, 4 values), force (t, 2)."""
    arms, tip_mass = pack_arms(device), float(device["mass"]["tip_kg"])
    limits, brakes = pack_limits(device, scene["tip"]), pack_brakes(device, brake_files)
    fidelity = FIDELITIES.index(scene["fidelity"])
    braked = np.array([joint in device["brakes"] for joint in JOINTS])
    z = np.zeros(12)
    z[:4] = (*scene["tip"], *scene["velocity"])
    z[8:] = 0.5 * brakes[:, 22]
    if fidelity == MR:
        z[4:8] = brakes[:, 1]
    else:
        brakes[:, 22] = z[8:] = 0.0
    schedule, force = np.array(scene["schedule"]), np.array(scene["force"])
    edges = np.unique(np.concatenate([times, schedule[:, 0], force[:, 0]]))
    edges = edges[(edges >= 0.0) & (edges <= times[-1])]
    tips, steps, h = np.full((len(times), 2), np.nan), np.zeros(1, np.int64), 1e-6
    tips[0] = z[:2]
    for t0, t1 in zip(edges, edges[1:], strict=False):
        command = schedule[np.flatnonzero(schedule[:, 0] <= t0)[-1], 1:]
        if fidelity == IDEAL:
            z[4:8] = command
        elif fidelity == STATIC:
            z[4:8] = [gain(brakes[i], command[i]) if braked[i] else 0.0 for i in range(4)]
        ends = np.array([[np.interp(t, force[:, 0], force[:, 1 + i]) for i in range(2)] for t in (t0, t1)])
        h = advance(
            arms, tip_mass, limits, brakes, braked, fidelity == MR, command, z, ends, t0, t1, max(h, 1e-6), longest,
            tolerance, steps,
        )  # fmt: skip
        if h < 0.0:
            break
        at = np.flatnonzero(times == t1)
        tips[at] = z[:2]
    return tips, int(steps[0])


def solve_scene(device, brake_files, scene, times, fine=1e-9) -> Reference:
    """The tips at `times`, from two runs: tolerance `fine` and 30 times as much with longer steps."""
    coarse, _ = run(device, brake_files, scene, times, 30.0 * fine, 1e-3)
    tips, steps = run(device, brake_files, scene, times, fine, 4e-4)
    return Reference(tips, np.maximum.accumulate(np.hypot(*(tips - coarse).T)), steps)
