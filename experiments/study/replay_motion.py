"""The motion of a replay: the recorded hand once more, tick by tick, as a trial on a simulated device.

The hand is one of two:
target   the recorded arm (spring-damper and mass), pulled by the recorded target: it gives way to another motion as an
         arm does, with the same aim. The other parts of the recorded force (noise, tremor, effort) are held over each
         tick as they were. Recorded of every hand that moved the simulated device.
force    where no target was recorded, as at a device on the bench: the recorded force over time, whatever the handle
         does. Nothing holds the handle near the recorded motion, and it drifts off by millimetres to centimetres.
It is over at the recording's last tick.

On the device of the recording the replay begins with the trial's first tick, the device as the trial before had left it
and the arm as it was at every tick. Through its own controller the trial comes out as it was, in every column and to
the last bit (by the same version of the program on the same kind of machine).

On another device, and where the start was not recorded as this version has it, it begins with the first tick of `move`:
the tip where it was and as fast as it was, each brake as it is without current, and its play where the recorded way to
there leaves it on this device. The trial comes out as it was to rounding, or, where a brake's lag or play was another,
to fractions of a millimetre.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core import tick_log
from core.device import Device
from core.files import InputError
from core.path import Path as PathAhead
from core.path import PathFile, build_path, path_from
from core.simulator.hand import Hand, new_hand
from core.simulator.simulated_device import SimulatedDevice, is_start, start_again
from core.simulator.simulation import start
from core.simulator.solver_numbers import RATE_ROUNDING
from core.tick_log import TICK_S
from core.workspace import arm_pose
from experiments.analysis.movement import check_samples
from experiments.analysis.trials_table import TrialRow, row_of
from experiments.atomic_files import reading_stored
from experiments.plan import PlannedTrial
from experiments.progress import Progress
from experiments.recording import Recording
from experiments.store.journal import journal_summary
from experiments.store.recording import read_recording
from experiments.store.stored import StoredSession, read_stored, refuse_trial
from experiments.trial.trial import Conditions, SimulatedTrial

HAND_ENDED = "hand ended"  # the recorded hand is over and the end of the path was not reached
PROGRESS_EVERY = 500  # ticks


@dataclass(frozen=True)
class Recorded:
    """A recorded trial, with its row, its session and its path."""

    recording: Recording
    row: TrialRow
    stored: StoredSession
    path_file: PathFile
    path: PathAhead
    first: int  # first tick of `move`


def read_recorded(file: Path) -> Recorded:
    """A recorded trial that can be replayed. InputError if it is damaged, was cut off, or never came to `move`."""
    recording = read_recording(file)
    if not recording.whole:
        raise InputError(f"{file}: is not whole ({recording.faults})")
    session = file.resolve().parent.parent
    stored, row = read_stored(session), journal_summary(session).row(row_of(recording, session))
    refuse_trial(row, stored.protocol, str(file))
    move = np.flatnonzero(recording.in_phase("move"))
    if not len(move):
        raise InputError(f"{file}: the trial never came to `move`, there is no hand to replay")
    check_samples(recording)
    where = f"{file}: path"
    path_file = path_from(recording.metadata["path_shape"], where)
    return Recorded(recording, row, stored, path_file, build_path(path_file, where), int(move[0]))


class RecordedHand(NamedTuple):
    """A hand for the simulator, and its target and stiffness at each tick of the recording."""

    hand: Hand
    wants: dict[str, np.ndarray]  # field of the grip -> its value at each tick; empty: a force alone

    @property
    def kind(self) -> str:
        return "target" if self.wants else "force"

    def take(self, tick: int) -> None:
        """Set target and stiffness to those of the recorded hand at a tick."""
        grip = self.hand.grips.view(np.ndarray)[0]
        for name, values in self.wants.items():
            grip[name] = values[tick]


def recorded_hand(recording: Recording, first: int) -> RecordedHand:
    """The recorded arm; where none was recorded, the force from tick `first` on."""
    return recorded_arm(recording) if has_arm(recording) else force_hand(recording, first)


def force_hand(recording: Recording, first: int) -> RecordedHand:
    """The recorded force from tick `first` on, linear between the ticks. It carries no mass: a sensor read it."""
    force = _finite(recording, first, "hand_fx_N", "hand_fy_N")
    return RecordedHand(new_hand((first + np.arange(len(force))) * TICK_S, force), {})


def recorded_arm(recording: Recording) -> RecordedHand:
    """The recorded arm, exactly as it was. InputError if a number of it is none, or not finite."""
    hand = new_hand()
    with reading_stored(recording.path):
        for name, value in recording.metadata["start"]["arm"].items():
            hand.grips[name][0] = value
    wants = {
        "target": _finite(recording, 0, "target_x_m", "target_y_m", "target_vx_m_s", "target_vy_m_s"),
        "stiffness": _finite(recording, 0, *(f"arm_stiffness_{axes}_N_per_m" for axes in ("xx", "xy", "yy"))),
        "held": _finite(recording, 0, "arm_held_x_N", "arm_held_y_N"),
        "force_max": recording.column("arm_force_max_N"),
    }
    return RecordedHand(hand, wants)


def has_arm(recording: Recording) -> bool:
    """Whether everything is recorded that makes a simulated device's hand."""
    return "start" in recording.metadata and all(name in recording.columns for name in tick_log.ARM_COLUMNS)


def has_start(recording: Recording) -> bool:
    """Whether everything is recorded that a trial depends on, as this version has it. InputError if it is damaged."""
    with reading_stored(recording.path):
        return has_arm(recording) and is_start(recording.metadata["start"])


def _finite(recording: Recording, first: int, *names: str) -> np.ndarray:
    """Columns from a tick on (n, columns). InputError where one is missing or not finite."""
    found = np.column_stack([recording.column(name)[first:] for name in names])
    bad = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if len(bad):
        raise InputError(f"{recording.path}: {', '.join(names)}: tick {first + bad[0]} is missing or not finite")
    return found


class ReplayedDevice(SimulatedDevice):
    """Begins its trial where the recording begins, and not where an earlier trial has left it."""

    def __init__(self, trial: Recorded, device: Device, hand: Hand, whole: bool) -> None:
        """whole: from the trial's first tick, on the device that it was recorded on; else from the first of `move`."""
        x, y = (float(trial.recording.column(name)[0 if whole else trial.first]) for name in ("tip_x_m", "tip_y_m"))
        assumed = trial.stored.protocol.assumptions
        super().__init__(assumed.applied_to(device), (x, y), hand)
        self.recorded, self.whole = trial, whole

    def begin(self) -> None:
        """Begin as the trial before had left the device; or as tip and hand of the recorded movement show it."""
        recording, first, body = self.recorded.recording, self.recorded.first, self.body
        if self.whole:
            with reading_stored(recording.path):
                start_again(self, recording.metadata["start"])
        else:
            body["tip"][0, 2:] = [recording.column(name)[first] for name in ("tip_vx_m_s", "tip_vy_m_s")]
            start(self.model, self.data)
            self.braking["play"][0], self.braking["edge"][0] = play_after(recording, first, self.device)
            rate = body["rate"][0]  # each brake slips as it did; one without a rate sticks if it can
            body["sign"][0] = np.where(np.abs(rate) > RATE_ROUNDING, np.sign(rate), 0.0)
            last = max(first - 1, 0)  # the last hand force before the controller's first decision
            body["hand_force"][0] = [recording.column(name)[last] for name in ("hand_fx_N", "hand_fy_N")]
        self._before = self.ledger()


def run_replay(
    trial: Recorded,
    hand: RecordedHand,
    device: Device,
    conditions: Conditions,
    whole: bool,
    progress: Progress,
) -> tuple[np.ndarray, dict[str, Any]]:
    """The replayed ticks (n, tick_log.WIDTH), and how the trial ended, as `Trial.outcome`.

    whole: from the first tick, on the recorded device; else from the first tick of `move`. FloatingPointError if the
    motion is no longer finite.
    """
    recording, row = trial.recording, trial.row
    simulated = ReplayedDevice(trial, device, hand.hand, whole)
    planned = PlannedTrial(row.run, row.block, device.name, row.controller, row.path, row.repetition)
    again = SimulatedTrial(simulated, planned, conditions)
    run, first = again.arguments().run, 0 if whole else trial.first
    if not whole:
        run["phase"][0], run["tick"][0] = tick_log.MOVE, first
    away, stopped = recording.in_phase("approach"), stopped_at(recording)
    rows = np.empty((recording.rows - first, tick_log.WIDTH))
    done = 0
    while done < len(rows):
        tick = first + done
        hand.take(tick)
        run["held"][0], run["stop"][0] = not away[tick], tick >= stopped
        if not again.run(rows[done : done + 1]):
            break
        done += 1
        if done % PROGRESS_EVERY == 0:
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
