"""The tick log: one float64 row a tick, written by the tick kernel, read by recorder and screens.

`COLUMNS` declares every column once: recordings, exports and the data dictionary derive from it. To add one: a place,
its line in `COLUMNS`, and the stage of the tick that writes it.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from core.mechanism import JOINTS

TICK_S = 1e-3  # from one tick of control to the next

PHASES = ("approach", "hold", "move", "end")
APPROACH, HOLD, MOVE, END = range(4)
CHANNELS = range(1, 7)  # of a force sensor

T, PHASE = 0, 1
TIP_X, TIP_Y, TIP_VX, TIP_VY, TIP_AX, TIP_AY = range(2, 8)
HAND_FX, HAND_FY = 8, 9
CURRENT, TORQUE = 10, 14  # four places each, joints A, E, B, C
STUCK, DECISION, LATENESS_US = 18, 19, 20
ENERGY_HAND, ENERGY_BRAKES, ENERGY_KINETIC, ENERGY_STOPS = 21, 22, 23, 24
TARGET_X, TARGET_Y = 25, 26
SENSED_FX, SENSED_FY = 27, 28
TARGET_VX, TARGET_VY = 29, 30
ARM_HELD_X, ARM_HELD_Y, ARM_FORCE_MAX = 31, 32, 33
ARM_STIFFNESS = 34  # three places, xx, xy, yy
PATH_DISTANCE, TRAVEL_SENSE, FORWARD_X, FORWARD_Y, DESIRED_X, DESIRED_Y = range(37, 43)  # of the velocity field
SLAVE_X, SLAVE_Y, WANTED_FX, WANTED_FY, NEAREST_FX, NEAREST_FY, SHOWN_FX, SHOWN_FY = range(43, 51)
OBSTACLE_DISTANCE, GUARD_HOLDS = 51, 52
WIDTH = 53

# Further places in the rows of a device on the bench.
BOARD_US, HOST_S, FILLED = range(WIDTH, WIDTH + 3)
COUNT = FILLED + 1  # four places, encoders of the joints A, E, B, C
FORCE_COUNT = COUNT + 4  # six places, force channels
MEASURED = FORCE_COUNT + 6  # four places, joints A, E, B, C
DECIDED = MEASURED + 4
BENCH_WIDTH = DECIDED + 1

MISSED_US = 1000.0  # a tick so late (`lateness_us`) was missed

#: bits of the `stuck` column -> letters
STUCK_LETTERS = tuple("".join(j for i, j in enumerate(JOINTS) if bits >> i & 1) for bits in range(16))

BOTH, SIMULATED, BENCH = "both", "simulated", "bench"  # whose ticks hold a column


class Column(NamedTuple):
    """One column; or one for each axis {a}, two axes {aa}, joint {J} or force channel {n} that stands in its name."""

    name: str  # in recordings and exports
    place: int  # in a row: its own, or that of the first
    unit: str  # "" for text, counts, and numbers without a unit
    meaning: str
    of: str = BOTH

    def spread(self, joints: Iterable[str] = JOINTS, channels: Iterable[int] = CHANNELS) -> Iterator["Column"]:
        """The single columns that it stands for."""
        values: dict[str, Iterable[tuple[int, object]]] = {  # of a mark: how far its place is, and its word
            "a": enumerate("xy"),
            "aa": enumerate(("xx", "xy", "yy")),
            "J": ((JOINTS.index(joint), joint) for joint in JOINTS if joint in joints),
            "n": ((n - 1, n) for n in channels),
        }
        for mark, spread in values.items():
            if f"{{{mark}}}" in self.name:
                for further, word in spread:
                    name, meaning = (text.format(**{mark: word}) for text in (self.name, self.meaning))
                    yield self._replace(name=name, place=self.place + further, meaning=meaning)
                return
        yield self


#: In the order of a recording. Frame: x to the participant's right, y away from the participant. On the bench the
#: torques, `stuck` and the energies are estimates from sensed force and velocity and the brake model; its raw signals
#: are n/a in a tick whose sample was lost.
COLUMNS = (
    Column("t_s", T, "s", "time since the first tick of the recording"),
    Column("phase", PHASE, "", "part of the trial"),
    Column("tip_x_m", TIP_X, "m", "position of the handle (the tip of the linkage), x"),
    Column("tip_y_m", TIP_Y, "m", "position of the handle, y"),
    Column("tip_v{a}_m_s", TIP_VX, "m/s", "velocity of the handle, {a}"),
    Column("tip_a{a}_m_s2", TIP_AX, "m/s^2", "acceleration of the handle as the simulator or the device gives it, {a}"),
    Column("hand_f{a}_N", HAND_FX, "N", "force of the hand on the handle, {a}"),
    Column("current_{J}_A", CURRENT, "A", "current commanded to the brake at joint {J}"),
    Column("torque_{J}_N_m", TORQUE, "N m", "torque of the brake at joint {J} on that joint, signed"),
    Column("stuck", STUCK, "", "letters of the joints whose brakes are stuck"),  # bits 1 A, 2 E, 4 B, 8 C
    Column("decision", DECISION, "", "what the controller decided at this tick"),
    Column(
        "lateness_us", LATENESS_US, "us",
        "how late the tick began; 0 where the simulated device does not run in real time",
    ),
    Column("energy_hand_J", ENERGY_HAND, "J", "work of the hand on the device so far"),
    Column("energy_brakes_J", ENERGY_BRAKES, "J", "heat in the brakes so far"),
    Column("energy_kinetic_J", ENERGY_KINETIC, "J", "kinetic energy of the device now"),
    Column("energy_stops_J", ENERGY_STOPS, "J", "energy lost in the hard stops so far"),
    Column(
        "target_x_m", TARGET_X, "m",
        "where the hand (the pointer, or a simulated operator's virtual hand) wants to be, x",
    ),
    Column("target_y_m", TARGET_Y, "m", "where the hand wants to be, y"),
    Column("board_us", BOARD_US, "us", "time of the sample by the board's clock", BENCH),
    Column(
        "host_s", HOST_S, "s", "time of the sample by the host's steady clock, by the clock model of the link", BENCH
    ),
    Column(
        "filled", FILLED, "",
        "1 where the sample was lost and position, velocity, acceleration and force are interpolated", BENCH,
    ),
    Column("encoder_{J}_counts", COUNT, "", "counts of the encoder at joint {J}", BENCH),
    Column("force_{n}_counts", FORCE_COUNT, "", "counts of force channel {n}", BENCH),
    Column("measured_{J}_A", MEASURED, "A", "current measured in the brake at joint {J}", BENCH),
    Column("sensed_f{a}_N", SENSED_FX, "N", "force of the hand that the controller decided with at this tick, {a}"),
    Column(
        "decided", DECIDED, "",
        "1 where the controller decided at this tick, 0 where it did not (a newer sample was there)", BENCH,
    ),
    # The arm at the handle, beside its target: force = held + spring-damper up to its cap (`core.simulator.hand.GRIP`).
    Column("target_v{a}_m_s", TARGET_VX, "m/s", "velocity of the target, {a}", SIMULATED),
    Column(
        "arm_held_{a}_N", ARM_HELD_X, "N", "force of the arm beside its spring-damper, held over the tick, {a}",
        SIMULATED,
    ),
    Column("arm_force_max_N", ARM_FORCE_MAX, "N", "cap of the force of the arm's spring-damper", SIMULATED),
    Column("arm_stiffness_{aa}_N_per_m", ARM_STIFFNESS, "N/m", "stiffness of the arm, {aa}", SIMULATED),
    # The velocity field at the handle with which the controller decided; n/a in a tick in which it did not decide.
    Column(
        "path_distance_m", PATH_DISTANCE, "m",
        "distance of the handle from the path during `move`, positive to the left of `forward`; else n/a",
    ),
    Column("travel_sense", TRAVEL_SENSE, "", "1: forward is towards the end of the path; -1: towards its start"),
    Column("forward_{a}", FORWARD_X, "", "tangent of the path in the travel sense at the handle's nearest point, {a}"),
    Column("desired_{a}", DESIRED_X, "", "desired direction of motion (unit vector), {a}"),
    # A force that the controller is to show, a slave's or a virtual wall's; n/a where there is none.
    Column("slave_x_m", SLAVE_X, "m", "position of the slave that follows the handle, x"),
    Column("slave_y_m", SLAVE_Y, "m", "position of the slave, y"),
    Column("wanted_f{a}_N", WANTED_FX, "N", "force on the handle that is to be shown at this tick, {a}"),
    Column("nearest_f{a}_N", NEAREST_FX, "N", "the nearest force that the brakes can exert in steady state, {a}"),
    Column("shown_f{a}_N", SHOWN_FX, "N", "force of the brakes on the handle while a force is to be shown, {a}"),
    Column(
        "obstacle_distance_m", OBSTACLE_DISTANCE, "m",
        "distance of the handle from the nearest obstacle, negative inside; n/a where there is none",
    ),
    Column(
        "guard_holds", GUARD_HOLDS, "",
        "1 where the guard can stop the handle in front of every obstacle, whatever a hand within its push does; 0 "
        "where it cannot be sure; n/a where no guard decided",
    ),
)  # fmt: skip
#: The rest of a simulated device's hand, beside its target: with these a trial is replayed to the last bit.
ARM_COLUMNS = tuple(one.name for column in COLUMNS if column.of == SIMULATED for one in column.spread())
