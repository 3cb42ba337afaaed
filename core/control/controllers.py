"""The controllers (Section IV, Table I): from tip, velocity and hand force to brake currents and a decision code.

Three algorithms; a protocol's controllers are presets of them (Table I: experiments/protocols/paper.toml). They decide
only: no device, no screen. All decide the same way: where is the tip in the velocity field, which brake, which torque,
which current.
"""

import math
from typing import NamedTuple

import numpy as np

from core.brake import current_for_torque
from core.control.proportional import best_brake, commanded_force, decision_velocity, impending_direction, in_beta
from core.control.rule_sets import Rules, rule_set
from core.control.sdof import nearest_valid_brake
from core.control.velocity_field import BLEND_WIDTH, Field, field_at
from core.control.velocity_field import new_memory as new_memory
from core.errors import InputError
from core.kernel import kernel
from core.mechanism import JOINTS, Brakes
from core.path import Path

NO_CONTROL, SDOF, PROPORTIONAL = range(3)


#: Algorithms by the word that a protocol uses.
KINDS = {"none": NO_CONTROL, "sdof": SDOF, "proportional": PROPORTIONAL}


class Preset(NamedTuple):
    """One row of Table I, or of a protocol's own table of controllers."""

    name: str
    algorithm: int
    gap_m: float  # half-width (our reading) of the band around the path without control
    gain: float  # K_y, N s/m


class Controller(NamedTuple):
    """A preset made ready for a device, as the kernels read it."""

    algorithm: int  # NO_CONTROL, SDOF, PROPORTIONAL
    gap_m: float
    gain: float  # K_y, N s/m
    force_normalised: float  # N, the most that is commanded of any brake
    blend_width: float  # m
    rules: Rules


def make_controller(
    preset: Preset,
    device_force_normalised: float,
    rules: str = "settled",
    blend_width: float = BLEND_WIDTH,
    velocity_noise: float = 0.0,
) -> Controller:
    """A preset made ready for a device of this normalised force (N). InputError for numbers that cannot be.

    rules: "settled" or "literal"; velocity_noise (m/s, rms) of the device's sensing widens one threshold of `settled`.
    """
    if preset.algorithm not in KINDS.values():
        raise InputError(f"controller {preset.name}: algorithm {preset.algorithm!r} is none of {', '.join(KINDS)}")
    for value, what in ((preset.gap_m, "gap"), (preset.gain, "gain")):
        if not 0.0 <= value < math.inf:
            raise InputError(f"controller {preset.name}: {what} {value!r} must be finite and not negative")
    if not 0.0 < device_force_normalised < math.inf:
        raise InputError(
            f"controller: normalised force {device_force_normalised!r} must be positive and finite, in N"
        )
    if not 0.0 < blend_width < math.inf:
        raise InputError(f"controller: blend width {blend_width!r} must be positive and finite, in m")
    return Controller(
        int(preset.algorithm),
        float(preset.gap_m),
        float(preset.gain),
        float(device_force_normalised),
        float(blend_width),
        rule_set(rules, velocity_noise),
    )


# Decisions: one code a tick. The last sixteen count the brake: code + joint index.
NONE = 0  # no control
OFF = 1  # brakes off outside the movement; `decide` itself never says so
NOT_FINITE = 2
IN_GAP = 3
RELEASE_NO_VALID = 4
RELEASE_NONE_SELECTED = 5
LOCK_NO_VALID = 6
LOCK_NONE_SELECTED = 7
LOCK_BACK = 8
LOCK_BACK_NONE_SELECTED = 9
USE_SDOF = 10
USE_PROPORTIONAL = 14
USE_CAPPED = 18
USE_BELOW_DRAG = 22

DECISIONS: tuple[str, ...] = (
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
    *(f"sdof {joint}" for joint in JOINTS),
    *(f"prop {joint}" for joint in JOINTS),
    *(f"prop {joint}, at normalised force" for joint in JOINTS),
    # selected, but the brake does more than asked without current
    *(f"prop {joint}, below off-state drag" for joint in JOINTS),
)

#: ticks without control on purpose, near the path
GAP = frozenset({IN_GAP})
#: ticks in which no brake was valid (SDOF) or selected (proportional), whatever was then done
UNREACHABLE = frozenset(
    {RELEASE_NO_VALID, RELEASE_NONE_SELECTED, LOCK_NO_VALID, LOCK_NONE_SELECTED, LOCK_BACK_NONE_SELECTED}
)
#: ticks with full current on all brakes
LOCKED = frozenset({LOCK_NO_VALID, LOCK_NONE_SELECTED, LOCK_BACK, LOCK_BACK_NONE_SELECTED})


@kernel
def release(current: np.ndarray) -> None:
    """No current on any brake; current (4,) A."""
    for i in range(4):
        current[i] = 0.0


@kernel
def lock(brakes: Brakes, current: np.ndarray) -> None:
    """Full current on every brake; current (4,) A."""
    for i in range(4):
        current[i] = brakes.current_max[i] if brakes.present[i] != 0.0 else 0.0


@kernel
def torque_for_force(force: float, g_x: float, g_y: float) -> float:
    """Joint torque (N m) whose tip force has the magnitude `force` (N), Eq. (11): |tau_i| = |F_i| / |J_i|."""
    length = math.sqrt(g_x * g_x + g_y * g_y)
    return force / length if length > 0.0 else 0.0


@kernel
def actuate(brakes: Brakes, i: int, force: float, g: np.ndarray, current: np.ndarray) -> None:
    """Current on brake i for a tip force (N); the others stay as they are. g (4, 2), current (4,) A."""
    current[i] = current_for_torque(brakes, i, torque_for_force(force, g[i, 0], g[i, 1]))


@kernel
def pushes_away(fx: float, fy: float, field: Field, rules: Rules) -> bool:
    """Whether the hand force points away from the path, by both thresholds of the rule set."""
    outward = -(fx * field.n_x + fy * field.n_y)
    return outward > rules.away_force and outward > rules.away_share * math.sqrt(fx * fx + fy * fy)


@kernel
def decide_sdof(
    controller: Controller, brakes: Brakes, field: Field, fx: float, fy: float, g: np.ndarray, current: np.ndarray
) -> int:
    """SDOF velocity control (Section IV-B): the normalised force on the brake with the nearest valid path."""
    i = nearest_valid_brake(brakes, g, field, controller.rules)
    if i < 0:
        if pushes_away(fx, fy, field, controller.rules):
            lock(brakes, current)
            return LOCK_NO_VALID
        return RELEASE_NO_VALID
    actuate(brakes, i, controller.force_normalised, g, current)
    return USE_SDOF + i


@kernel
def decide_proportional(
    controller: Controller,
    brakes: Brakes,
    field: Field,
    vx: float,
    vy: float,
    fx: float,
    fy: float,
    g: np.ndarray,
    mass: np.ndarray,
    current: np.ndarray,
) -> int:
    """Proportional velocity control (Section IV-C): K_y |v_beta_y| on the best brake, locks included."""
    rules = controller.rules
    felt = fx * fx + fy * fy > rules.felt_force * rules.felt_force
    push_x, push_y = impending_direction(fx, fy, mass)
    vx, vy = decision_velocity(vx, vy, push_x, push_y, felt, rules.rest_speed)
    v_beta_x, v_beta_y = in_beta(vx, vy, field)
    i = best_brake(brakes, g, field, vx, vy, push_x, push_y, felt, rules)

    if i < 0 and pushes_away(fx, fy, field, rules):
        lock(brakes, current)
        return LOCK_NONE_SELECTED
    if v_beta_x < -rules.back_speed:
        lock(brakes, current)
        return LOCK_BACK_NONE_SELECTED if i < 0 else LOCK_BACK
    if i < 0:
        return RELEASE_NONE_SELECTED
    force = commanded_force(controller.gain, v_beta_y, controller.force_normalised)
    actuate(brakes, i, force, g, current)
    if current[i] == 0.0:
        return USE_BELOW_DRAG + i
    return USE_CAPPED + i if force == controller.force_normalised else USE_PROPORTIONAL + i


@kernel
def decide(
    controller: Controller,
    brakes: Brakes,
    path: Path,
    memory: np.ndarray,
    x: float,
    y: float,
    vx: float,
    vy: float,
    fx: float,
    fy: float,
    g: np.ndarray,
    mass: np.ndarray,
    current: np.ndarray,
) -> int:
    """One tick of control: writes current (4,) A, updates memory (3,), returns the decision code.

    Tip (x, y) m, its velocity m/s, hand force N; g (4, 2) with omega_i = g_i . v; mass (3,) = M_xx, M_xy, M_yy of
    the tip, kg. Input that is not finite releases the brakes and leaves the memory alone.
    """
    release(current)
    if controller.algorithm == NO_CONTROL:
        return NONE
    if not math.isfinite(x + y + vx + vy + fx + fy):
        return NOT_FINITE
    field = field_at(path, memory, x, y, vx, vy, fx, fy, controller.blend_width, controller.rules)
    if field.distance < controller.gap_m:
        return IN_GAP
    if controller.algorithm == SDOF:
        return decide_sdof(controller, brakes, field, fx, fy, g, current)
    return decide_proportional(controller, brakes, field, vx, vy, fx, fy, g, mass, current)
