"""The columns of the tick log: one float64 row a tick, written by the tick kernel, read by recorder and screens."""

from core.mechanism import JOINTS

PHASES = ("approach", "hold", "move", "end")
APPROACH, HOLD, MOVE, END = range(4)

T = 0
PHASE = 1
TIP_X, TIP_Y = 2, 3
TIP_VX, TIP_VY = 4, 5
TIP_AX, TIP_AY = 6, 7
HAND_FX, HAND_FY = 8, 9
CURRENT = 10  # four columns, joints A, E, B, C
TORQUE = 14  # four columns, joints A, E, B, C
STUCK = 18  # bits 1 A, 2 E, 4 B, 8 C
DECISION = 19
LATENESS_US = 20
ENERGY_HAND, ENERGY_BRAKES, ENERGY_KINETIC, ENERGY_STOPS = 21, 22, 23, 24
TARGET_X, TARGET_Y = 25, 26  # where the hand (pointer or virtual) wants to be
SENSED_FX, SENSED_FY = 27, 28  # hand force that the controller decided with: the newest that was sensed at t
# The rest of the hand (`core.hand.GRIP`) during the tick; not on the bench, where the hand is a person's.
TARGET_VX, TARGET_VY = 29, 30  # velocity of the target
ARM_HELD_X, ARM_HELD_Y = 31, 32  # force that is held over the tick, beside the spring-damper
ARM_FORCE_MAX = 33  # cap of the spring-damper
ARM_STIFFNESS = 34  # three columns, xx, xy, yy
WIDTH = 37

#: Further columns of a device on the bench: as the sensors said it, and when. NaN in a tick whose sample was lost.
BOARD_US, HOST_S = 37, 38  # the board's clock; the host's, by the clock model
FILLED = 39  # 1: the sample of this tick was lost, what was sensed is interpolated
COUNT = 40  # four columns, encoders of the joints A, E, B, C
FORCE_COUNT = 44  # six columns, force channels
MEASURED = 50  # four columns, A, currents that the board measures, joints A, E, B, C
DECIDED = 54  # 1: the controller decided in this tick; 0: brakes off, or a newer sample was there already
BENCH_WIDTH = 55

#: bits of the `stuck` column -> letters
STUCK_LETTERS = tuple("".join(j for i, j in enumerate(JOINTS) if bits >> i & 1) for bits in range(16))
