"""A slave that follows the tip, the master of a teleoperation, and whose force the controller `reflect` shows.

The slave is a point mass in the plane of the tip. A spring-damper pulls it to where the master was `delay_s` ago; a
wall, elastic and one-sided, holds it. What its force sensor reads, the force of the wall on it, comes back after
another `delay_s`, times `force_scale`: it is the tip force that the master is to show. A motor that shows this force
adds energy, the more the later it comes; brakes cannot, at any delay (`core.control.reflect`).

Our choice throughout: the paper names the passive master only as future work, and all numbers are assumed.
"""

import math
from typing import Annotated

import msgspec
import numpy as np

from core.control.velocity_field import WANTED
from core.files import NotNegative, Pair, Positive, Table
from core.kernels import kernel
from core.ranges import Place
from core.tick_log import TICK_S

LONGEST_DELAY_S = 0.5
_RING = 512  # ticks, a power of two above the longest delay
_LAST = _RING - 1
#: Of the slave's fastest oscillation, rad, in a tick: above it the step of the slave is no longer accurate.
MOST_TURN = 0.5


class Slave(Table, frozen=True):
    """`[slave]` of a protocol. The wall is a straight line: behind `wall_at_m`, seen along `wall_normal`."""

    wall_at_m: Place  # a point of the wall that the slave meets
    wall_normal: Pair  # direction to the wall's free side
    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_DELAY_S)] = 0.05  # one way
    force_scale: Positive = 1.0  # times the slave's force
    mass_kg: Positive = 1.0  # of the slave
    stiffness_N_m: Positive = 1000.0  # of the spring by which the slave follows the handle
    damping_N_s_m: NotNegative = 60.0
    wall_stiffness_N_m: Positive = 2000.0  # of the wall
    wall_damping_N_s_m: NotNegative = 20.0

    def __post_init__(self) -> None:
        if not math.hypot(*self.wall_normal) > 0.0:
            raise ValueError("wall_normal must have a direction")
        turn = TICK_S * math.sqrt((self.stiffness_N_m + self.wall_stiffness_N_m) / self.mass_kg)
        damped = TICK_S * (self.damping_N_s_m + self.wall_damping_N_s_m) / self.mass_kg
        if not max(turn, damped) <= MOST_TURN:
            raise ValueError(
                f"mass_kg ({self.mass_kg:g}) is too small for these springs and dampers: at 1 kHz the slave would not "
                "follow them accurately"
            )


#: Of `Slave`, as they stand in its record.
_NUMBERS = ("force_scale", "mass_kg", "stiffness_N_m", "damping_N_s_m", "wall_stiffness_N_m", "wall_damping_N_s_m")
SLAVE = np.dtype(
    [
        ("on", "i8"),  # 0: there is no slave
        ("delay_ticks", "i8"),
        *((name, "f8") for name in _NUMBERS),
        ("wall", "f8", (4,)),  # m: a place of the wall; its unit normal
        # what changes
        ("place", "f8", (4,)),  # m, m/s
        ("sent", "f8", (_RING, 6)),  # tips (x, y, vx, vy) on their way to the slave, forces (N) on their way back
    ]
)


def set_slave(record: np.ndarray, slave: Slave) -> None:
    """Fill the SLAVE record of a trial."""
    record["on"], record["delay_ticks"] = 1, round(slave.delay_s / TICK_S)
    for name in _NUMBERS:
        record[name] = getattr(slave, name)
    length = math.hypot(*slave.wall_normal)
    record["wall"] = *slave.wall_at_m, slave.wall_normal[0] / length, slave.wall_normal[1] / length


@kernel
def wall_force(slave):
    """Force of the wall on the slave (fx, fy), N: a spring and damper that never pull."""
    wall, place = slave.wall, slave.place
    depth = (wall[0] - place[0]) * wall[2] + (wall[1] - place[1]) * wall[3]
    if depth <= 0.0:
        return 0.0, 0.0
    deeper = -(place[2] * wall[2] + place[3] * wall[3])
    force = max(slave.wall_stiffness_N_m * depth + slave.wall_damping_N_s_m * deeper, 0.0)
    return force * wall[2], force * wall[3]


@kernel
def follow_master(slave, tip, tick, memory):
    """Stage: a tick of the slave; the force that arrives at the master now is the one to show, memory[WANTED].

    tip (4,): the master now, m and m/s. At tick 0 the slave stands where the master is.
    """
    if tick == 0:
        slave.place[0], slave.place[1], slave.place[2], slave.place[3] = tip[0], tip[1], 0.0, 0.0
        for n in range(_RING):
            old = slave.sent[n]
            old[0], old[1], old[2], old[3], old[4], old[5] = tip[0], tip[1], 0.0, 0.0, 0.0, 0.0
    place, now = slave.place, slave.sent[tick & _LAST]
    now[0], now[1], now[2], now[3] = tip[0], tip[1], tip[2], tip[3]
    now[4], now[5] = wall_force(slave)
    heard = slave.sent[(tick - slave.delay_ticks) & _LAST]
    memory[WANTED], memory[WANTED + 1] = slave.force_scale * heard[4], slave.force_scale * heard[5]
    for axis in range(2):
        speed = 2 + axis
        pull = slave.stiffness_N_m * (heard[axis] - place[axis]) + slave.damping_N_s_m * (heard[speed] - place[speed])
        place[speed] += TICK_S / slave.mass_kg * (pull + now[4 + axis])
    place[0] += TICK_S * place[2]
    place[1] += TICK_S * place[3]
