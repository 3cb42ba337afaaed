"""What brakes can do to a moving tip: how sharply they can turn it, and what they hold of a push off the path.

Steerability asks whether brakes can redirect the instantaneous motion (Gao and Book, 2006, "Steerability for planar
dissipative passive haptic interfaces", known to us by its abstract). Here: M(p) a + b(p, v) = F + sum g_i torque_i, and
each brake that is turned opposes its joint with a torque from K(0) to K(current_max). Every pattern of brakes off and
full gives an acceleration across the motion; a curvature k is within reach where k |v|^2 lies between the least and the
largest of them. That is exact at the patterns, and between them where all joints turn, since a is then linear in the
torques.

Our choice: the curvature that is wanted is that of the arc from the tip, tangent to its motion, to the point that lies
a blend width ahead along the desired direction, 2 sin(e) / width, e the angle between the two (pure pursuit). A joint
slower than `still_rate` of the settled rules is held if its brake can; of several the slowest.
"""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from core.control.rule_sets import SETTLED
from core.device import Device
from core.files import InputError
from core.mechanism import JOINTS, Arm, Mechanism
from core.workspace import Array, tip_motion

#: Of the sine between two rows: they are one line.
ROUNDING = 1e-9
#: Of the metadata of a recording.
KEY = "brakes_and_linkage"


class Braking(NamedTuple):
    """A device as far as its brakes' force at the tip goes."""

    mechanism: Mechanism
    present: tuple[int, ...]  # places of the brakes
    low: Array  # (4,) N m, without current
    high: Array  # (4,) N m, at the largest


def to_metadata(device: Device) -> dict[str, Any]:
    """What `from_metadata` needs of a device, in numbers."""
    mechanism = device.mechanism
    brakes = [(JOINTS.index(joint), device.brake_files[joint]) for joint in device.braked]
    return {
        "arm_1": mechanism.arm_1, "arm_2": mechanism.arm_2, "tip_mass": mechanism.tip_mass,
        "coupled": mechanism.coupled, "combination": mechanism.combination.tolist(), "coupling": mechanism.coupling,
        "torque_N_m": [(i, brake.torque_gain(0.0), brake.torque_gain(brake.current_max_A)) for i, brake in brakes],
    }  # fmt: skip


def from_metadata(metadata: Mapping[str, Any]) -> Braking | None:
    """The device of a recording; None: an earlier version recorded it. InputError: damaged."""
    if not (about := metadata.get(KEY)):
        return None
    low, high, free = np.zeros(4), np.zeros(4), np.full(4, np.inf)
    try:
        present = tuple(i for i, _, _ in about["torque_N_m"])
        for i, least, most in about["torque_N_m"]:
            low[i], high[i] = least, most
        mechanism = Mechanism(
            Arm(*about["arm_1"]), Arm(*about["arm_2"]), about["tip_mass"], False, 0.0, -free, free, False,
            about["coupled"], np.array(about["combination"], dtype=float), about["coupling"], 0,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"the metadata's {KEY} is damaged ({type(error).__name__}: {error})") from None
    return Braking(mechanism, present, low, high) if present else None


def across_range(braking: Braking, tip: Array, velocity: Array, force: Array) -> tuple[Array, Array]:
    """The least and the largest acceleration (n,), m/s2, to the left of the motion, over all patterns of brakes.

    tip, velocity, force of the hand: (n, 2), m, m/s (not 0), N.
    """
    g, turn, mass, bias = tip_motion(braking.mechanism, tip, velocity)
    inverse = np.array([[mass[1, 1], -mass[0, 1]], [-mass[0, 1], mass[0, 0]]])
    inverse /= mass[0, 0] * mass[1, 1] - mass[0, 1] ** 2
    left = np.array([-velocity[:, 1], velocity[:, 0]]) / np.hypot(*velocity.T)
    places = list(braking.present)
    g, turn, low, high = g[places], turn[places], braking.low[places], braking.high[places]
    rates = (g * velocity.T).sum(axis=1)  # (brakes, n)
    pull = np.einsum("ijn,kjn->kin", inverse, g)  # acceleration for each N m of a brake
    free = np.einsum("ijn,jn->in", inverse, force.T - bias)
    each, slowest = np.arange(len(tip)), np.abs(rates).argmin(axis=0)
    still = np.abs(rates[slowest, each]) < SETTLED.still_rate
    row, own_turn, own_pull = g[slowest, :, each].T, turn[slowest, each], pull[slowest, :, each].T
    # brakes on one line hold it together: what each has of it, in torques of the still joint
    beside = np.abs(g[:, 0] * row[1] - g[:, 1] * row[0]) <= ROUNDING * np.hypot(*row) * np.hypot(g[:, 0], g[:, 1])
    holds = np.where(still & beside, np.hypot(g[:, 0], g[:, 1]) / np.hypot(*row), 0.0)
    sense = np.where(holds > 0.0, 0.0, -np.sign(rates))
    least, largest = np.full(len(tip), np.inf), np.full(len(tip), -np.inf)
    for pattern in itertools.product((False, True), repeat=len(places)):
        torque = np.where(pattern, high, low)[:, None]
        acceleration = free + np.einsum("kin,kn->in", pull, sense * torque)
        holding = -(own_turn + (row * acceleration).sum(axis=0)) / (row * own_pull).sum(axis=0)
        most = (holds * torque).sum(axis=0)
        across = (left * (acceleration + own_pull * np.clip(holding, -most, most))).sum(axis=0)
        least, largest = np.minimum(least, across), np.maximum(largest, across)
    return least, largest


def wanted_across(velocity: Array, desired: Array, ahead_m: float) -> Array:
    """The acceleration (n,), m/s2, to the left of the motion, of the arc to the point so far ahead.

    velocity (n, 2), m/s; desired (n, 2), unit vectors.
    """
    sine = (velocity[:, 0] * desired[:, 1] - velocity[:, 1] * desired[:, 0]) / np.hypot(*velocity.T)
    return np.asarray(2.0 * sine / ahead_m * (velocity**2).sum(axis=1))
