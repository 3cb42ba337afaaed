"""Reflected force: the brakes show a wanted tip force as the nearest one that they can exert.

A brake pushes only against the motion of its joint, with a torque from K(0) (it drags without current) to
K(current_max), Eq. (2). So the possible tip forces are a zonotope, and the nearest one to the wanted force f is
    min |sum g_i tau_i - f|^2   over   tau_i = -sense_i u_i,  K_i(0) <= u_i <= K_i(current_max),
solved exactly by a finite list of cases (`nearest_passive_force`). A force along the motion is impossible, and so is a
spring that pushes back while it relaxes: the hand alone supplies energy.

The wanted force is that of a slave (experiments/slave.py: the device is the passive master of a teleoperation), or,
with `wall_N_m`, that of a virtual spring: wall_N_m times the distance beyond the gap, towards the path.

The "coercive force approximation" of later work (Cho, Song, Kim 2005; read by its abstract) shows on a redundant brake
display a force that it cannot have by one that it can, for smooth wall-following. That is this function with another
wanted force (direct_force.py of the arena); the nearest force is unique, so a smooth f is shown smoothly.
"""

import math

from core.brake import current_for_torque, torque_gain
from core.control.algorithm import GAP_M, NONE, OWN, Algorithm, Parameter
from core.control.proportional import push_of, sense_of
from core.control.velocity_field import NEAREST, WANTED
from core.kernels import kernel

WALL_N_M = Parameter("wall_N_m", "wall stiffness", "N/m", 1.0, 0.0, (0.0, 2000.0))
WALL = 1  # its place among the values
WHOLE, IN_PART = OWN, OWN + 4
#: N. A wanted force that is missed by less counts as shown whole: far below what a hand feels
MISSED_N = 1e-6
#: Share of a brake's range by which a case may be outside it by rounding
ROUNDING = 1e-9
#: 1/m2. The force of a brake whose row has a smaller square is rounding
NO_ROW = 1e-200


@kernel
def nearest_passive_force(ax, ay, low, high, fx, fy, torque):  # noqa: PLR0913
    """Fill torque (4,), N m, low_i <= torque_i <= high_i, so that sum a_i torque_i is nearest to f; returns that (N).

    ax, ay, low, high: tuples of four; a_i, 1/m, is the tip force of brake i for each N m; a brake with low = high has
    that torque. The nearest force is unique. Of several ways to have it the one of least sum of shares
    (torque_i - low_i) / (high_i - low_i) is taken (our choice: the least braking that shows the force).
    """
    base_x, base_y = 0.0, 0.0
    for i in range(4):
        base_x += ax[i] * low[i]
        base_y += ay[i] * low[i]
    wx, wy = fx - base_x, fy - base_y
    # what brakes i and j add to their low torques; bit k of `full`: brake k adds all it can
    edge, way, full, outside = nearest_on_edge(ax, ay, low, high, wx, wy)
    i, j, add_i, add_j = -1, -1, 0.0, 0.0
    if not outside:
        i, j, add_i, add_j, others = inside(ax, ay, low, high, wx, wy)
        full = others if i >= 0 else full
    if i < 0 and edge >= 0:
        i, add_i, on_line = shared_on_line(ax, ay, low, high, edge, way)
        full |= on_line
    shown_x, shown_y = 0.0, 0.0
    for k in range(4):
        torque[k] = high[k] if full >> k & 1 else low[k]
        if k == i:
            torque[k] = low[k] + add_i
        elif k == j:
            torque[k] = low[k] + add_j
        shown_x += ax[k] * torque[k]
        shown_y += ay[k] * torque[k]
    return shown_x, shown_y


@kernel
def nearest_on_edge(ax, ay, low, high, wx, wy):
    """The boundary's point nearest to w: (brake whose line the edge lies along, way along it (N), full ones, outside).

    Each line gives two edges: on either side the brakes that push to that side are full, the others low. All brakes on
    the line make the edge together, also those that push against one another; the way counts from where they add
    nothing. outside: w lies beyond an edge. Brake -1: no brake can add anything.
    """
    brake, found, full, outside, least = -1, 0.0, 0, False, math.inf
    for j in range(4):
        square = ax[j] * ax[j] + ay[j] * ay[j]
        if not (high[j] > low[j] and square > NO_ROW):
            continue
        size = math.sqrt(square)
        ux, uy = ax[j] / size, ay[j] / size
        # w and the line's brakes as seen along and across the line; what the others add on either side of it
        along_w, off_w = ux * wx + uy * wy, ux * wy - uy * wx
        back = ahead = left_along = left_off = right_along = right_off = 0.0
        left = right = 0
        for k in range(4):
            room = high[k] - low[k]
            along, across = (ux * ax[k] + uy * ay[k]) * room, (ux * ay[k] - uy * ax[k]) * room
            if abs(across) <= ROUNDING * abs(along):  # on the line
                back, ahead = back + min(along, 0.0), ahead + max(along, 0.0)
            elif across > 0.0:
                left_along, left_off, left = left_along + along, left_off + across, left | 1 << k
            else:
                right_along, right_off, right = right_along + along, right_off + across, right | 1 << k
        outside = outside or off_w > left_off or off_w < right_off
        for side_along, side_off, others in ((left_along, left_off, left), (right_along, right_off, right)):
            way = min(max(along_w - side_along, back), ahead)
            missed, beside = along_w - side_along - way, off_w - side_off
            distance = missed * missed + beside * beside
            if distance < least:
                brake, found, full, least = j, way, others, distance
    return brake, found, full, outside


@kernel
def shared_on_line(ax, ay, low, high, j, way):
    """Share a way (N) along the line of brake j among those on it: (brake in between, what it adds, full ones).

    Those that push that way come in one after the other, the strongest first: the least sum of shares. Brake -1: none
    is in between.
    """
    size = math.hypot(ax[j], ay[j])
    ux, uy = ax[j] / size, ay[j] / size
    sense, rest, full = math.copysign(1.0, way), abs(way), 0
    for _ in range(4):
        brake, most = -1, 0.0
        for k in range(4):
            push, along = ux * ay[k] - uy * ax[k], ux * ax[k] + uy * ay[k]
            force = sense * along * (high[k] - low[k])
            if abs(push) <= ROUNDING * abs(along) and force > most and not full >> k & 1:
                brake, most = k, force
        if brake >= 0 and rest < most:
            return brake, (high[brake] - low[brake]) * (rest / most), full
        if brake >= 0:
            full |= 1 << brake
            rest -= most
    return -1, 0.0, full


@kernel
def inside(ax, ay, low, high, wx, wy):
    """Two brakes (i, j) that have w exactly, each other one low or full (bits): (i, j, what they add, full ones).

    Of all such the one of least sum of shares: a vertex of that linear programme has at most two brakes in between.
    i is -1 where no two brakes have w.
    """
    best, found_i, found_j, found_add_i, found_add_j, full = math.inf, -1, -1, 0.0, 0.0, 0
    for i in range(3):
        room_i = high[i] - low[i]
        for j in range(i + 1, 4):
            room_j = high[j] - low[j]
            sine = ax[i] * ay[j] - ay[i] * ax[j]
            least = ROUNDING * (abs(ax[i]) + abs(ay[i])) * (abs(ax[j]) + abs(ay[j]))  # below: parallel
            if not (room_i > 0.0 and room_j > 0.0 and abs(sine) > least):
                continue
            for bits in range(16):
                if bits >> i & 1 or bits >> j & 1:
                    continue
                rx, ry, shares, possible = wx, wy, 0.0, True
                for k in range(4):
                    if bits >> k & 1:
                        room = high[k] - low[k]
                        possible = possible and room > 0.0
                        rx -= ax[k] * room
                        ry -= ay[k] * room
                        shares += 1.0
                add_i, add_j = (rx * ay[j] - ry * ax[j]) / sine, (ax[i] * ry - ay[i] * rx) / sine
                possible = possible and -ROUNDING * room_i <= add_i <= (1.0 + ROUNDING) * room_i
                possible = possible and -ROUNDING * room_j <= add_j <= (1.0 + ROUNDING) * room_j
                shares += add_i / room_i + add_j / room_j
                if possible and shares < best:
                    best, found_i, found_j, full = shares, i, j, bits
                    found_add_i, found_add_j = min(max(add_i, 0.0), room_i), min(max(add_j, 0.0), room_j)
    return found_i, found_j, found_add_i, found_add_j, full


@kernel
def opposing(tick, i, push, still_rate):
    """The effect of brake i on the tip: its force for each N m (1/m), its least and its largest torque (N m).

    All zero without a brake, and where its joint neither turns nor is about to: then it has no side to push to.
    """
    brakes, g = tick.brakes, tick.g
    if brakes.present[i] == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    sense = sense_of(g, i, (tick.seen.vx, tick.seen.vy), push, still_rate)
    if sense == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    low, high = torque_gain(brakes, i, 0.0), torque_gain(brakes, i, brakes.current_max[i])
    return -sense * g[i, 0], -sense * g[i, 1], low, high


@kernel
def shown_by(current, ax, ay, brakes):
    """Replace the torques (4,), N m, in `current` by currents (A); returns the brake with the largest tip force."""
    most, brake = -math.inf, 0
    for i in range(4):
        force = current[i] * math.hypot(ax[i], ay[i])
        if brakes.present[i] != 0.0 and force > most:
            most, brake = force, i
        current[i] = current_for_torque(brakes, i, current[i])
    return brake


@kernel
def available(tick, rules):
    """`opposing` of the four brakes: (ax, ay, low, high), each a tuple of four."""
    push, still = push_of(tick, rules), rules.still_rate
    ax0, ay0, low0, high0 = opposing(tick, 0, push, still)
    ax1, ay1, low1, high1 = opposing(tick, 1, push, still)
    ax2, ay2, low2, high2 = opposing(tick, 2, push, still)
    ax3, ay3, low3, high3 = opposing(tick, 3, push, still)
    return (ax0, ax1, ax2, ax3), (ay0, ay1, ay2, ay3), (low0, low1, low2, low3), (high0, high1, high2, high3)


@kernel
def show(tick, rules):
    """Show the wanted force of the memory, and put the nearest possible one (N, in steady state) there."""
    memory, current = tick.memory, tick.current
    wanted_x, wanted_y = memory[WANTED], memory[WANTED + 1]
    square = wanted_x * wanted_x + wanted_y * wanted_y
    if not square > rules.least_shown * rules.least_shown:  # nor where there is no wanted force (NaN)
        return NONE
    ax, ay, low, high = available(tick, rules)
    near_x, near_y = nearest_passive_force(ax, ay, low, high, wanted_x, wanted_y, current)
    memory[NEAREST], memory[NEAREST + 1] = near_x, near_y
    missed = math.hypot(wanted_x - near_x, wanted_y - near_y)
    return (WHOLE if missed < MISSED_N else IN_PART) + shown_by(current, ax, ay, tick.brakes)


@kernel
def decide(controller, field, tick):
    """Show the wanted force: the slave's, or with a wall along the path that of its spring."""
    stiffness, memory = controller.values[WALL], tick.memory
    if stiffness > 0.0:
        force = stiffness * (field.distance - controller.gap_m)
        memory[WANTED], memory[WANTED + 1] = force * field.n_x, force * field.n_y
    return show(tick, controller.rules)


ALGORITHM = Algorithm(
    "reflect",
    (GAP_M, WALL_N_M),
    ("show {J}", "show {J}, in part"),  # J: the brake that exerts most of it
    decide,
)
