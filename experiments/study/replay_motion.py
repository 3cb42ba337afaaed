"""The motion of a replay: the recorded hand once more, tick by tick, as a trial on a simulated device.

The hand is one of two:
target   the recorded arm (spring-damper and mass), pulled by the recorded target: it gives way to another motion as an
         arm does, and wants what it wanted. What the recorded force has besides (noise, tremor, effort) is held over
         each tick as it was. A recording of an earlier version has the target alone: its arm is worked out.
force    the recorded force over time, whatever the handle does. Nothing holds the handle near the recorded motion, and
         it drifts off by millimetres to centimetres.
It is over at the recording's last tick.

On the device of the recording the replay begins with the trial's first tick, the device as the trial before had left it
and the arm as it was at every tick. Through its own controller the trial comes out as it was, in every column and to
the last bit (by the same version of the program on the same kind of machine).

On another device, and where an earlier version recorded neither start nor arm, it begins with the first tick of `move`:
the tip where it was and as fast as it was, each brake as it is without current, and its play where the recorded way to
there leaves it on this device. The trial comes out as it was to rounding, or, where a brake's lag or play was another,
to fractions of a millimetre.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.control.controllers import Preset
from core.device import Device
from core.files import InputError
from core.path import CURVATURE, PathFile, build_path, nearest, path_from
from core.path import Path as PathAhead
from core.simulator.hand import Hand, new_hand
from core.simulator.simulated_device import SimulatedDevice, is_start, start_again
from core.simulator.simulation import start
from core.simulator.solver_numbers import RATE_ROUNDING
from core.workspace import arm_pose
from experiments.analysis.metrics import check_samples
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.protocol import MouseHand
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session.files import STORED, StoredSession, read_stored
from experiments.session.journal import journal_summary, recorded_row
from experiments.trial.operator import TICK_S, Person, take_handle, turn_arm
from experiments.trial.trial import Trial

HAND_ENDED = "hand ended"  # the recorded hand is over and the end of the path was not reached
PROGRESS_EVERY = 500  # ticks


# ------------------------------------------------------------------------------------------------- the recorded trial


@dataclass(frozen=True)
class Recorded:
    """A recorded trial, and what its session knows of it."""

    recording: Recording
    row: TrialRow
    stored: StoredSession
    path_file: PathFile
    path: PathAhead
    first: int  # first tick of `move`

    @property
    def start(self) -> tuple[float, float]:
        """The tip at the first tick of `move`, m."""
        return float(self.recording.column("tip_x_m")[self.first]), float(self.recording.column("tip_y_m")[self.first])


def read_recorded(file: Path) -> Recorded:
    """A recorded trial that can be replayed. InputError if it is damaged, was cut off, or never came to `move`."""
    recording = read_recording(file)
    if not recording.whole:
        raise InputError(f"{file}: is not whole ({'; '.join(recording.damaged) or 'cut off before its end'})")
    session = file.resolve().parent.parent
    if not (session / STORED).is_file():
        raise InputError(f"{file}: the {STORED} of its session, which holds device and arm, is not at {session}")
    stored, row = read_stored(session), recorded_row(recording, session, journal_summary(session))
    move = np.flatnonzero(recording.in_phase("move"))
    if not len(move):
        raise InputError(f"{file}: the trial never came to `move`, there is no hand to replay")
    check_samples(recording)
    where = f"{file}: path"
    path_file = path_from(recording.metadata["path"], where)
    return Recorded(recording, row, stored, path_file, build_path(path_file, where), int(move[0]))


# ------------------------------------------------------------------------------------------------- the recorded hand


class RecordedHand(NamedTuple):
    """A hand for the simulator; of a target, also what the hand wants at each of n ticks."""

    hand: Hand
    first: int = 0  # tick of the recording to which the arrays' first row belongs
    target: np.ndarray | None = None  # (n, 4) m, m/s
    stiffness: np.ndarray | None = None  # (n, 3) N/m
    held: np.ndarray | None = None  # (n, 2) N
    force_max: np.ndarray | None = None  # (n,) N

    def take(self, tick: int) -> None:
        """Want what the recorded hand wanted at a tick of the recording."""
        grip = self.hand.grips.view(np.ndarray)[0]
        for name in ("target", "stiffness", "held", "force_max"):
            wanted = getattr(self, name)
            if wanted is not None:
                grip[name] = wanted[tick - self.first]


def force_hand(recording: Recording, first: int) -> RecordedHand:
    """The recorded force from tick `first` on, linear between the ticks. It carries no mass: a sensor read it."""
    force = _columns(recording, first, "hand_fx_N", "hand_fy_N")
    return RecordedHand(new_hand((first + np.arange(len(force))) * TICK_S, force))


def has_arm(recording: Recording) -> bool:
    """Whether everything is recorded that makes a simulated device's hand."""
    return "start" in recording.metadata and all(name in recording.columns for name in tick_log.ARM_COLUMNS)


def has_start(recording: Recording) -> bool:
    """Whether everything is recorded that a trial depends on, as this version has it."""
    return has_arm(recording) and is_start(recording.metadata["start"])


def recorded_arm(recording: Recording, first: int) -> RecordedHand:
    """The recorded arm from tick `first` on, exactly as it was. InputError if a number of it is not finite."""
    hand = new_hand()
    for name, value in recording.metadata["start"]["arm"].items():
        hand.grips[name][0] = value
    return RecordedHand(
        hand,
        first,
        _columns(recording, first, "target_x_m", "target_y_m", "target_vx_m_s", "target_vy_m_s"),
        _columns(recording, first, *(f"arm_stiffness_{axes}_N_per_m" for axes in ("xx", "xy", "yy"))),
        _columns(recording, first, "arm_held_x_N", "arm_held_y_N"),
        recording.column("arm_force_max_N")[first:],
    )


def target_hand(recording: Recording, first: int, path: PathAhead, person: Person | None,
                mouse: MouseHand) -> RecordedHand:  # fmt: skip
    """The arm and target of an earlier version's recording, from tick `first` on.

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
    hand = mouse.hand() if person is None else new_hand()
    grip = hand.grips[0]
    if person is None:
        stiffness = np.tile(grip.stiffness, (len(tip), 1))
    else:
        take_handle(person, path, hand.grips)
        stiffness = np.tile(grip.stiffness, (len(tip), 1))
        if len(path.pieces) > 1 or path.pieces[0, CURVATURE] != 0.0:  # soft along the path where the target is
            for row, (x, y, _, _) in zip(stiffness, target, strict=True):
                _, _, tx, ty = nearest(path, float(x), float(y))
                turn_arm(grip, person.stiffness_along_N_m, person.stiffness_across_N_m, tx, ty)
                row[:] = grip.stiffness
        if len(target) > 1:
            target[:, 2:] = np.gradient(target[:, :2], TICK_S, axis=0)
    force = _columns(recording, first, "hand_fx_N", "hand_fy_N") + grip.mass * acceleration  # of the arm itself
    damping = np.tile(grip.damping, (len(tip), 1))
    spring = _times(stiffness, target[:, :2] - tip) + _times(damping, target[:, 2:] - velocity)
    return RecordedHand(hand, first, target, stiffness, *what_is_held(force, spring, float(grip.force_max)))


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


# -------------------------------------------------------------------------------------------------- device and run


class ReplayedDevice(SimulatedDevice):
    """Begins its trial where the recording says, and not where an earlier trial has left it."""

    def __init__(self, trial: Recorded, device: Device, hand: Hand, whole: bool) -> None:
        """whole: from the trial's first tick, on the device that it was recorded on; else from the first of `move`."""
        x, y = (float(trial.recording.column(name)[0 if whole else trial.first]) for name in ("tip_x_m", "tip_y_m"))
        super().__init__(device, (x, y), hand)
        self.trial_recorded, self.whole = trial, whole

    def begin(self) -> None:
        """As the trial before had left it; or as the recorded movement found it, as far as tip and hand tell."""
        recording, first, state = self.trial_recorded.recording, self.trial_recorded.first, self.state
        if self.whole:
            start_again(self, recording.metadata["start"])
        else:
            state["tip"][0, 2:] = [recording.column(name)[first] for name in ("tip_vx_m_s", "tip_vy_m_s")]
            start(self.mechanism, self.brakes, state, self.fidelity)
            state["play"][0], state["edge"][0] = play_after(recording, first, self.device)
            rate = state["rate"][0]  # each brake slips as it did; one without a rate sticks if it can
            state["sign"][0] = np.where(np.abs(rate) > RATE_ROUNDING, np.sign(rate), 0.0)
            last = max(first - 1, 0)  # what the controller knows of the hand before it decides for the first time
            state["hand_force"][0] = [recording.column(name)[last] for name in ("hand_fx_N", "hand_fy_N")]
        self._before = self.ledger()


def run_replay(
    trial: Recorded,
    hand: RecordedHand,
    device: Device,
    preset: Preset,
    rules: str,
    lead: RecordedHand | None,
    progress: Callable[[float], None] | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """The replayed ticks (n, tick_log.WIDTH), and how the trial ended, as `Trial.outcome`.

    lead: the recorded arm from the first tick on, on the recorded device; the hand takes over with `move`. None: the
    replay begins with `move`. FloatingPointError if the motion is no longer finite.
    """
    recording, row = trial.recording, trial.row
    simulated = ReplayedDevice(trial, device, (lead or hand).hand, whole=lead is not None)
    planned = PlannedTrial(row.run, row.block, device.name, row.controller, row.segment, row.repetition)
    again = Trial(simulated, planned, trial.path_file, preset, rules, trial.stored.protocol.trial)
    run, first = again.arguments().run, 0
    if lead is None:
        run["phase"][0], run["tick"][0] = tick_log.MOVE, trial.first
        first = trial.first
    away, stopped = recording.in_phase("approach"), stopped_at(recording)
    rows = np.empty((recording.rows - first, tick_log.WIDTH))
    done = 0
    while done < len(rows):
        tick = first + done
        if tick == trial.first and simulated.hand is not hand.hand:
            simulated.hand, simulated.state["settled"][0] = hand.hand, 0
        (hand if tick >= trial.first or lead is None else lead).take(tick)
        run["held"][0], run["stop"][0] = not away[tick], tick >= stopped
        if not again.run(rows[done : done + 1]):
            break
        done += 1
        if progress and done % PROGRESS_EVERY == 0:
            progress(done / len(rows))
    rows = rows[:done]
    if not np.isfinite(rows[:, : tick_log.SENSED_FY + 1]).all():
        raise FloatingPointError(f"{recording.path}: the replayed motion is no longer finite")
    outcome = again.outcome()
    if again.phase != "end":
        outcome["status"] = HAND_ENDED
    elif outcome["status"] == "aborted":
        outcome["status"] = recording.outcome["status"]
    return rows, outcome


def stopped_at(recording: Recording) -> int:
    """The tick at which the experimenter or a fault ended the trial; behind the last where none did."""
    end = np.flatnonzero(recording.in_phase("end"))
    return int(end[0]) if len(end) and recording.outcome.get("status") in ("aborted", "stopped") else recording.rows


def play_after(recording: Recording, ticks: int, device: Device) -> tuple[np.ndarray, np.ndarray]:
    """Play (4,), rad, and edge (4,) of each brake's backlash after the first ticks of a recording, on any device.

    From the middle of the backlash, as a device just switched on. Where the tip went out of this device's reach,
    its joints stand still.
    """
    x, y = (recording.column(name)[: ticks + 1] for name in ("tip_x_m", "tip_y_m"))
    arms = device.mechanism.arm_1, device.mechanism.arm_2
    theta = np.column_stack([angle for arm in arms for angle in arm_pose(arm, x, y).angles()])
    turned = np.diff(theta, axis=0)
    turned = np.nan_to_num(np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi)
    width = device.brakes.play
    play = 0.5 * width
    for step in turned:
        play = np.clip(play + step, 0.0, width)
    return play, np.where(width > 0.0, (play >= width).astype(float) - (play <= 0.0), 0.0)
