"""The hand of a recorded trial, to be had again: its arm with the target that it had, or its force as it was.

target   the arm (spring-damper and mass) that the recorded hand was, pulled by the recorded target: it gives way to
         another motion as an arm does, and wants what it wanted. What the recorded force has besides (noise, tremor,
         effort) is held over each tick as it was: on the recorded motion the force is the recorded one, to the last
         bit where the arm itself was recorded; recordings of earlier versions lack it, and it is worked out.
force    the recorded force over time, whatever the handle does.
"""

from typing import NamedTuple

import numpy as np

from core.files import InputError
from core.path import CURVATURE, Path, nearest
from core.simulator.hand import Hand, new_hand
from core.simulator.simulated_device import is_start
from core.tick_log import ARM_COLUMNS
from experiments.protocol import MouseHand
from experiments.recording.schema import Recording
from experiments.trial.inputs import INPUTS
from experiments.trial.operator import TICK_S, Person, take_handle, turn_arm

HANDS = ("target", "force")
#: Hands, as a recording calls them, whose target stands in it.
WITH_TARGET = tuple(one.name for one in INPUTS.values() if one.has_target)


class RecordedHand(NamedTuple):
    """A hand for the simulator, and what it wants at each of n ticks (spring-damper hands alone; else n = 0)."""

    hand: Hand
    first: int  # tick of the recording at which it begins
    target: np.ndarray  # (n, 4) m, m/s
    stiffness: np.ndarray  # (n, 3) N/m
    held: np.ndarray  # (n, 2) N
    force_max: np.ndarray  # (n,) N

    def take(self, tick: int) -> None:
        """Want what the recorded hand wanted at a tick of the recording."""
        if len(self.target):
            grip, n = self.hand.grips.view(np.ndarray)[0], tick - self.first
            grip["target"], grip["stiffness"] = self.target[n], self.stiffness[n]
            grip["held"], grip["force_max"] = self.held[n], self.force_max[n]


def force_hand(recording: Recording, first: int) -> RecordedHand:
    """The recorded force from tick `first` on, linear between the ticks. It carries no mass: a sensor read it."""
    force = _columns(recording, first, "hand_fx_N", "hand_fy_N")
    times = (first + np.arange(len(force))) * TICK_S
    empty = np.empty(0)
    return RecordedHand(new_hand(times, force), first, empty, empty, empty, empty)


def has_arm(recording: Recording) -> bool:
    """Whether everything is recorded that makes a simulated device's hand."""
    return "start" in recording.metadata and all(name in recording.columns for name in ARM_COLUMNS)


def has_start(recording: Recording) -> bool:
    """Whether everything is recorded that a trial depends on, as this version has it."""
    return has_arm(recording) and is_start(recording.metadata["start"])


def recorded_arm(recording: Recording, first: int) -> RecordedHand:
    """The recorded arm from tick `first` on, exactly as it was. InputError if a number of it is not finite."""
    target = _columns(recording, first, "target_x_m", "target_y_m", "target_vx_m_s", "target_vy_m_s")
    held = _columns(recording, first, "arm_held_x_N", "arm_held_y_N")
    stiffness = _columns(recording, first, *(f"arm_stiffness_{axes}_N_per_m" for axes in ("xx", "xy", "yy")))
    hand = new_hand()
    for name, value in recording.metadata["start"]["arm"].items():
        hand.grips[name][0] = value
    return RecordedHand(hand, first, target, stiffness, held, recording.column("arm_force_max_N")[first:])


def target_hand(recording: Recording, first: int, path: Path, person: Person | None, mouse: MouseHand) -> RecordedHand:
    """The arm of a recording of an earlier version, and its target, from tick `first` on.

    person: whose arm; None: the mouse's. The target's velocity is not recorded: central differences, for an operator
    (a pointer's counts as zero). Where that is not what it was, and at a bend, where the arm is turned at once, the
    difference goes into what is held.
    InputError for a target or an acceleration that is not finite.
    """
    tip = _columns(recording, first, "tip_x_m", "tip_y_m")
    velocity = _columns(recording, first, "tip_vx_m_s", "tip_vy_m_s")
    acceleration = _columns(recording, first, "tip_ax_m_s2", "tip_ay_m_s2")
    target = np.zeros((len(tip), 4))
    target[:, :2] = _columns(recording, first, "target_x_m", "target_y_m")
    if person is None:
        hand = mouse.hand()
        stiffness = np.tile(hand.grips["stiffness"][0], (len(tip), 1))
    else:
        hand = new_hand()
        take_handle(person, path, hand.grips)
        stiffness = _turned(hand, person, path, target)
        if len(target) > 1:
            target[:, 2:] = np.gradient(target[:, :2], TICK_S, axis=0)
    grip = hand.grips[0]
    force = _columns(recording, first, "hand_fx_N", "hand_fy_N") + grip.mass * acceleration  # of the arm itself
    way, rate = target[:, :2] - tip, target[:, 2:] - velocity
    spring = _times(stiffness, way) + _times(np.tile(grip.damping, (len(tip), 1)), rate)
    held, force_max = what_is_held(force, spring, float(grip.force_max))
    return RecordedHand(hand, first, target, stiffness, held, force_max)


def what_is_held(force: np.ndarray, spring: np.ndarray, clip: float) -> tuple[np.ndarray, np.ndarray]:
    """Splits the arm's force (n, 2), N, into spring-damper and what is held: held (n, 2), and the cap left (n,).

    spring (n, 2): of the spring-damper before its cap. The rule of the operator: both together never exceed `clip`,
    cap = clip - |held|. Below the cap held = force - spring. At it, with u along the spring, force = cap u + held, so
    that G = force - clip u gives |held| = -G.G / (2 G.u).
    """
    size = np.hypot(*spring.T)
    held = np.hypot(*(force - spring).T)
    u = spring / np.where(size > 0.0, size, 1.0)[:, None]
    rest = force - clip * u
    along = np.sum(rest * u, axis=1)
    at_cap = np.where(along < 0.0, np.sum(rest * rest, axis=1) / np.where(along < 0.0, -2.0 * along, 1.0), 0.0)
    held = np.where(size + held <= clip, held, at_cap)
    cap = np.maximum(clip - held, 0.0)
    scale = cap / np.maximum(np.maximum(size, cap), 1e-300)  # 1 below the cap
    return force - scale[:, None] * spring, cap


def _columns(recording: Recording, first: int, *names: str) -> np.ndarray:
    found = np.column_stack([recording.column(name)[first:] for name in names])
    bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if len(bad):
        raise InputError(f"{recording.path}: {', '.join(names)}: tick {first + bad[0]} is missing or not finite")
    return found


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Symmetric matrices (n, 3) as xx, xy, yy times vectors (n, 2)."""
    xx, xy, yy = matrix.T
    x, y = vector.T
    return np.column_stack((xx * x + xy * y, xy * x + yy * y))


def _turned(hand: Hand, person: Person, path: Path, target: np.ndarray) -> np.ndarray:
    """Stiffness (n, 3), N/m, of an arm that is soft along the path where its target is."""
    stiffness = np.tile(hand.grips["stiffness"][0], (len(target), 1))
    if len(path.pieces) > 1 or path.pieces[0, CURVATURE] != 0.0:
        grip = hand.grips[0]
        for i, (x, y, _, _) in enumerate(target):
            _, _, tx, ty = nearest(path, float(x), float(y))
            turn_arm(grip, person.stiffness_along_N_m, person.stiffness_across_N_m, tx, ty)
            stiffness[i] = grip.stiffness
    return stiffness
