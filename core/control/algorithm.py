"""What all control algorithms share: their declaration, the decisions open to each, and the commands to brakes.

An algorithm is a file beside this one, with a kernel `decide` and its `Algorithm`, and a line in
`controllers.ALGORITHMS`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from core.brake import current_for_torque
from core.control.rule_sets import Rules
from core.control.velocity_field import Seen
from core.kernels import kernel
from core.mechanism import JOINTS


class Parameter(NamedTuple):
    """One number of an algorithm."""

    name: str  # in protocols, sweeps and recordings
    word: str  # in a sentence
    unit: str  # shown
    scale: float  # value in `unit` / value in SI
    default: float | None  # None: it must be given, and be positive
    #: least and most that a slider offers, in `unit`; a logarithmic one where the least is not 0
    slider: tuple[float, float]


class Algorithm(NamedTuple):
    """A way to control, as protocols name it."""

    kind: str  # its word
    parameters: tuple[Parameter, ...]
    own: tuple[str, ...]  # words of its own decisions; those with {J} make four, one for each joint
    decide: Callable[..., int]  # kernel (controller, field, tick): writes the tick's currents; the decision

    @property
    def decisions(self) -> tuple[str, ...]:
        """Its own decisions, in the order of the codes from OWN on by which its kernel answers."""
        return tuple(
            words.replace("{J}", joint) for words in self.own for joint in (JOINTS if "{J}" in words else JOINTS[:1])
        )


class Tick(NamedTuple):
    """One tick of control: what the controller sees and remembers, and the currents that it writes."""

    seen: Seen
    g: np.ndarray  # (4, 2) 1/m, rows of the joints: omega_i = g_i . v
    mass: np.ndarray  # (3,) kg, M_xx, M_xy, M_yy of the tip
    brakes: np.record  # as `core.simulator.state.pack_brakes` has them
    memory: np.ndarray  # (24,), places as in `velocity_field`
    current: np.ndarray  # (4,) A


class Controller(NamedTuple):
    """A controller for a device, as the kernels read it."""

    algorithm: int  # its number in `controllers.ALGORITHMS`; one past the last: a file of its own, at `address`
    gap_m: float  # half-width (our reading) of the band around the path without control
    values: tuple[float, ...]  # of its parameters, in their order
    force_normalised: float  # N, the most that is commanded of any brake
    rules: Rules
    address: int  # of the kernel of an algorithm in a file of its own (`core.kernels.by_address`); else 0
    around: np.ndarray  # one record: the obstacles of the trial, their guide and guard (`core.control.guard.AROUND`)

    def __reduce__(self) -> tuple:
        """An address means nothing in another process (`controllers.with_address`)."""
        return Controller, tuple(self._replace(address=0))


GAP_M = Parameter("gap_m", "gap", "mm", 1e3, 0.0, (0.0, 20.0))

# Decisions that are open to every algorithm: one code a tick.
NONE = 0  # no control
OFF = 1  # brakes off outside the movement; never an answer of `decide`
NOT_FINITE = 2
IN_GAP = 3
RELEASE_NO_VALID = 4
RELEASE_NONE_SELECTED = 5
LOCK_NO_VALID = 6
LOCK_NONE_SELECTED = 7
LOCK_BACK = 8
LOCK_BACK_NONE_SELECTED = 9
LOCK_OBSTACLE = 10
LOCK_TOO_LATE = 11  # as LOCK_OBSTACLE, but the guard cannot promise that the tip stops
OWN = 12  # from here on: an algorithm's own decisions

SHARED: tuple[str, ...] = (
    "none",
    "off",
    "off: input not finite",
    "gap",
    "release: no valid brake",
    "release: none selected",
    "lock: no valid brake, pushed away",
    "lock: none selected, pushed away",
    "lock: moving back",
    "lock: moving back, none selected",
    "lock: obstacle",
    "lock: obstacle, too late to be sure",
)

#: ticks without control on purpose, near the path
GAP = frozenset({IN_GAP})
#: ticks in which no brake was valid (SDOF) or selected (proportional)
UNREACHABLE = frozenset(
    {RELEASE_NO_VALID, RELEASE_NONE_SELECTED, LOCK_NO_VALID, LOCK_NONE_SELECTED, LOCK_BACK_NONE_SELECTED}
)
#: of them, those in which the rules take all current off the brakes
RELEASED = frozenset({RELEASE_NO_VALID, RELEASE_NONE_SELECTED})
#: ticks with full current on all brakes
BY_GUARD = frozenset({LOCK_OBSTACLE, LOCK_TOO_LATE})
LOCKED = BY_GUARD | {LOCK_NO_VALID, LOCK_NONE_SELECTED, LOCK_BACK, LOCK_BACK_NONE_SELECTED}


@kernel
def release(current):
    """No current on any brake; current (4,) A."""
    for i in range(4):
        current[i] = 0.0


@kernel
def lock(tick):
    """Full current on every brake."""
    for i in range(4):
        tick.current[i] = tick.brakes.current_max[i] if tick.brakes.present[i] != 0.0 else 0.0


@kernel
def limit(tick):
    """Limit each current to 0 .. the brake's largest; 0 without a brake."""
    brakes, current = tick.brakes, tick.current
    for i in range(4):
        most = brakes.current_max[i] if brakes.present[i] != 0.0 else 0.0
        current[i] = min(current[i], most) if current[i] > 0.0 else 0.0


@kernel
def torque_for_force(force, g_x, g_y):
    """Joint torque (N m) whose tip force has the magnitude `force` (N), Eq. (11): |tau_i| = |F_i| / |J_i|."""
    length = math.sqrt(g_x * g_x + g_y * g_y)
    return force / length if length > 0.0 else 0.0


@kernel
def actuate(tick, i, force):
    """Current on brake i for a tip force (N); the others stay as they are."""
    if not 0 <= i < 4:
        raise IndexError("actuate: there is no such brake")
    torque = torque_for_force(force, tick.g[i, 0], tick.g[i, 1])
    tick.current[i] = current_for_torque(tick.brakes, i, torque)


@kernel
def pushes_away(seen, field, rules):
    """Whether the hand force points away from the path, by both thresholds of the rule set."""
    fx, fy = seen.fx, seen.fy
    outward = -(fx * field.n_x + fy * field.n_y)
    return outward > rules.away_force and outward > rules.away_share * math.sqrt(fx * fx + fy * fy)
