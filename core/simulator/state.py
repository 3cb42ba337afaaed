"""The state of a simulated device: what moves, what the brakes do, and a ledger.

Each is a record that kernels change in place (a pointer to them, not an object): the arguments of a kernel say which of
them it needs.
"""

from typing import Any, NamedTuple

import numpy as np

from core.mechanism import PLACES, Arm, Brakes, Mechanism, no_brakes
from core.records import new_record
from core.simulator.hand import Hand
from core.simulator.stick_slip import FREE, STILL

#: The motion of a body or of a tried step. Joints in the order of the places of core/mechanism.py.
MOTION = [
    ("tip", "f8", (4,)),  # m, m/s: x, y, vx, vy
    ("acceleration", "f8", (2,)),  # m/s2
    ("hand_force", "f8", (2,)),  # N, what a sensor between handle and hand reads
    ("mass", "f8", (3,)),  # kg, tip mass matrix xx, xy, yy of the device
    ("bias_force", "f8", (2,)),  # N, velocity terms b
    ("g", "f8", (PLACES, 2)),  # 1/m, rows of the joints at the tip
    ("rate", "f8", (PLACES,)),  # rad/s
    ("bias", "f8", (PLACES,)),  # rad/s2, gdot . v
    ("held", "i8"),  # STILL, FREE or the joint that is stuck (in a tried step of `stepping` alone)
    ("sign", "f8", (PLACES,)),  # sense in which each joint slips, 0 while it is held (tried steps: as `held`)
    ("line_torque", "f8"),  # N m, what holds the stuck joint on its own rate, brakes and stop together
]

#: What moves, and what holds it to a held joint's path or to a stop, from step to step.
BODY = np.dtype(
    [
        *MOTION,
        ("carry", "f8", (2,)),  # m/s, `stepping`: what the turn of a held joint's path took from the velocity
        # m: centre and radius of the SDOF path while one joint is stuck; if that is no circle, a coupling's angle (rad)
        ("circle", "f8", (3,)),
        ("contact", "f8", (PLACES,)),  # hard stop: -1 at the low one, +1 at the high one, 0 away from both
        ("distal_side", "f8"),  # sign of the sine between the distal links, fixed at the start
        ("delta_omega", "f8"),  # rad/s, band of Eq. (6) (`karnopp` only); constant in a run
        ("tolerance", "f8"),  # share of the error bounds in solver_numbers.py that a step must keep (`event`); likewise
        ("settled", "i8"),  # 1: pattern, acceleration and torques of a moving tip are those at the end of the last step
    ]
)

#: What the brakes do and can do.
BRAKING = np.dtype(
    [
        ("torque", "f8", (PLACES,)),  # N m, signed, what each brake does
        ("torque_yield", "f8", (4,)),  # N m, what each brake can hold now (outside the backlash)
        ("edge", "f8", (4,)),  # backlash: +1 at the upper edge of the play, -1 at the lower, 0 inside
        ("play", "f8", (4,)),  # rad, position in the backlash
        # what each joint holds now, from its yield, backlash and stop: `set_costs` fills it before it is read
        ("cost_plus", "f8", (PLACES,)),  # N m, what a joint holds against + motion
        ("cost_minus", "f8", (PLACES,)),  # N m, against - motion
        ("active", "i8", (PLACES,)),  # 1: the joint carries a brake or touches a stop
    ]
)
_FILLED_ANEW = ("cost_plus", "cost_minus", "active")

#: Sums since the start: energies, J, and counts. Nothing here changes the motion.
LEDGER = np.dtype(
    [
        ("work_hand", "f8"),
        ("heat", "f8", (4,)),  # dissipated in each brake
        ("lost_at_stops", "f8"),
        ("kinetic_start", "f8"),
        ("added_by_brakes", "f8"),  # the largest energy that any brake added in a step: must be none
        ("steps", "i8"),
        ("events", "i8"),
        ("fallbacks", "i8"),  # steps (or rests of steps) that `event` gave to `stepping`
        ("shortened", "i8"),  # steps cut because a stage left the region where the linkage closes
        ("refined", "i8"),  # steps cut because their error estimate was too large
    ]
)

#: Fields that a device keeps between trials, and their shapes: all that is not filled before it is read.
CARRIED = {
    name: record[name].shape
    for record in (BODY, BRAKING, LEDGER)
    for name in record.names or ()
    if name not in _FILLED_ANEW
}

ARM = np.dtype([(name, "f8") for name in Arm._fields])
MECHANISM = np.dtype(
    [
        ("arm_1", ARM),
        ("arm_2", ARM),
        ("tip_mass", "f8"),
        ("coaxial", "i8"),
        ("margin", "f8"),
        ("theta_low", "f8", (4,)),
        ("theta_high", "f8", (4,)),
        ("has_theta_stops", "i8"),
        ("coupled", "i8"),
        ("combination", "f8", (4, 2)),
        ("coupling", "f8"),
        ("lines", "i8"),
    ]
)
BRAKES = np.dtype([(name, "f8", np.shape(value)) for name, value in no_brakes()._asdict().items()])


FIDELITIES = ("ideal", "static", "mr")
IDEAL, STATIC, MR = range(3)

#: Python holds a record as an array of one, with which a call takes a microsecond, not ten. A kernel that Python calls
#: begins by putting the records themselves in the places of the arrays.
Record = Any


class Model(NamedTuple):
    """The constant part of a simulated device."""

    mechanism: Record  # MECHANISM
    brakes: Record  # BRAKES
    fidelity: int  # place in `FIDELITIES`
    integrator: int  # place in `simulation.INTEGRATORS`


class Data(NamedTuple):
    """The changing part of a simulated device."""

    hand: Hand
    body: Record  # BODY
    braking: Record  # BRAKING
    ledger: Record  # LEDGER
    scratch: Record  # STEP_SCRATCH


def pack_mechanism(mechanism: Mechanism) -> np.ndarray:
    """The mechanism's constants as the record that kernels read by name."""
    arms = {"arm_1": tuple(mechanism.arm_1), "arm_2": tuple(mechanism.arm_2)}
    return new_record(MECHANISM, **mechanism._asdict() | arms)


def pack_brakes(brakes: Brakes, backlash: bool) -> np.ndarray:
    """The brakes' constants as a record; without `backlash` the play is left out."""
    return new_record(BRAKES, **brakes._asdict() | ({} if backlash else {"play": 0.0}))


def new_body(x: float, y: float, vx: float = 0.0, vy: float = 0.0) -> np.ndarray:
    """A body with the tip at (x, y), m, moving at (vx, vy), m/s; the simulator adds what follows from that."""
    held = STILL if vx == 0.0 and vy == 0.0 else FREE
    return new_record(BODY, tip=(x, y, vx, vy), tolerance=1.0, held=held)


def carried(data: Data) -> dict[str, np.ndarray]:
    """The fields of `CARRIED` in a device's records, by name."""
    fields = {name: record[name] for record in (data.body, data.braking, data.ledger) for name in record.dtype.names}
    return {name: fields[name] for name in CARRIED}
