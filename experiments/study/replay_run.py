"""A replay's motion: the recorded hand once more, tick by tick.

On the device of the recording: from the first tick of the trial, with the device as the trial before had left it and
the arm as it was at every tick. Through its own controller a trial then comes out as it was, in every column and to
the last bit (with the same version of the program on the same kind of machine).

On another device, and where an earlier version recorded neither start nor arm: from the first tick of `move`. The tip
where it was and as fast as it was, each brake as it is without current, and its play where the recorded way to there
leaves it on this device. Then a trial comes out as it was to rounding, or, where a brake's lag or play was not what it
is taken for, to fractions of a millimetre.

The hand (`replay_hand`) is over at the recording's last tick. With the force as the hand nothing holds the handle near
the recorded motion, and it drifts off by millimetres to centimetres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from core import tick_log
from core.control.controllers import Preset, make_controller
from core.control.velocity_field import new_memory
from core.device import Device
from core.files import InputError
from core.path import Path as PathAhead
from core.path import build_path, path_from
from core.simulator.simulated_device import SimulatedDevice, ledger_warnings, start_again
from core.simulator.simulation import Simulation
from core.simulator.solver_numbers import RATE_ROUNDING
from core.simulator.state import new_record
from core.workspace import arm_pose
from experiments.analysis.metrics import check_samples
from experiments.analysis.trials_table import TrialRow
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session.files import STORED, StoredSession, read_stored
from experiments.session.journal import journal_summary, recorded_row
from experiments.study.replay_hand import RecordedHand
from experiments.trial.operator import OPERATOR
from experiments.trial.tick import STATUSES, new_run, run_ticks
from experiments.trial.trial import plain

HAND_ENDED = "hand ended"  # the recorded hand is over and the end of the path was not reached
PROGRESS_EVERY = 500  # ticks


@dataclass(frozen=True)
class Recorded:
    """A recorded trial, with what its session says of it."""

    recording: Recording
    row: TrialRow
    stored: StoredSession
    path: PathAhead
    first: int  # tick of `move` at which the replay begins

    @property
    def start(self) -> tuple[float, float]:
        """m, of the tip."""
        return float(self.recording.column("tip_x_m")[self.first]), float(self.recording.column("tip_y_m")[self.first])


def read_recorded(file: Path) -> Recorded:
    """A recorded trial that can be replayed. InputError if it is damaged, was cut off, or never came to `move`."""
    recording = read_recording(file)
    if not recording.whole:
        raise InputError(f"{file}: is not whole ({'; '.join(recording.damaged) or 'cut off before its end'})")
    session = file.resolve().parent.parent
    if not (session / STORED).is_file():
        raise InputError(f"{file}: the {STORED} of its session, which holds device and arm, is not at {session}")
    stored, found = read_stored(session), recorded_row(recording, session, journal_summary(session))
    move = np.flatnonzero(recording.in_phase("move"))
    if not len(move):
        raise InputError(f"{file}: the trial never came to `move`, there is no hand to replay")
    check_samples(recording)
    where = f"{file}: path"
    path = build_path(path_from(recording.metadata["path"], where), where)
    return Recorded(recording, found, stored, path, int(move[0]))


def run_replay(
    trial: Recorded,
    hand: RecordedHand,
    device: Device,
    preset: Preset,
    rules: str,
    lead: RecordedHand | None,
    progress: Callable[[float], None] | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """The replayed ticks (n, tick_log.WIDTH), and how it ended: status and the energy stamp.

    lead: the recorded arm from the first tick on, on the recorded device; the hand takes over with `move`. None: the
    replay begins with `move`. FloatingPointError if the motion is no longer finite.
    """
    recording = trial.recording
    s = from_the_start(trial, device, lead) if lead else from_the_movement(trial, device, hand)
    before = s.ledger()
    run = plain(new_run(trial.stored.protocol.trial, s.fidelity, simulated_hand=False))
    first = 0 if lead else trial.first
    if not lead:
        run["phase"][0], run["tick"][0] = tick_log.MOVE, first
    controller, memory = make_controller(preset, device.force_normalised_N, rules), new_memory()
    operator, noise = plain(new_record(OPERATOR)), np.zeros((1, 2))
    mechanism, brakes, state, scratch = (plain(record) for record in (s.mechanism, s.brakes, s.state, s.step_scratch))
    felt = s.hand._replace(grips=plain(s.hand.grips))
    away, stopped = recording.in_phase("approach"), stopped_at(recording)
    rows = np.empty((recording.rows - first, tick_log.WIDTH))
    done = 0
    while done < len(rows):
        tick = first + done
        if tick == trial.first and s.hand is not hand.hand:
            felt, state["settled"][0] = hand.hand._replace(grips=plain(hand.hand.grips)), 0
        (hand if tick >= trial.first or lead is None else lead).take(tick)
        run["held"][0], run["stop"][0] = not away[tick], tick >= stopped
        if not run_ticks(
            trial.path, controller, mechanism, brakes, felt, state, scratch, run, operator, noise, memory,
            rows[done : done + 1],
        ):  # fmt: skip
            break
        done += 1
        if progress and done % PROGRESS_EVERY == 0:
            progress(done / len(rows))
    rows = rows[:done]
    if not np.isfinite(rows[:, : tick_log.SENSED_FY + 1]).all():
        raise FloatingPointError(f"{recording.path}: the replayed motion is no longer finite")
    status, after = STATUSES[int(run["status"][0])], s.ledger()
    return rows, {
        "status": {"running": HAND_ENDED, "aborted": recording.outcome["status"]}.get(status, status),
        "energy_residual_J": after.residual - before.residual,
        "energy_added_max_J": after.added_by_brakes,
        "warnings": ledger_warnings(before, after),
    }


def from_the_start(trial: Recorded, device: Device, arm: RecordedHand) -> Simulation:
    """The recorded device as the trial before had left it."""
    recording = trial.recording
    x, y = (float(recording.column(name)[0]) for name in ("tip_x_m", "tip_y_m"))
    s = SimulatedDevice(device, (x, y), arm.hand)
    start_again(s, recording.metadata["start"])
    return s


def from_the_movement(trial: Recorded, device: Device, hand: RecordedHand) -> Simulation:
    """A device as the recorded movement found it, as far as tip and hand tell."""
    recording, first = trial.recording, trial.first
    velocity = float(recording.column("tip_vx_m_s")[first]), float(recording.column("tip_vy_m_s")[first])
    s = Simulation(device, trial.start, velocity, fidelity="mr", integrator="event", hand=hand.hand)
    s.state["play"][0], s.state["edge"][0] = play_after(recording, first, device)
    rate = s.state["rate"][0]  # each brake slips as it did; one without a rate sticks if it can
    s.state["sign"][0] = np.where(np.abs(rate) > RATE_ROUNDING, np.sign(rate), 0.0)
    last = max(first - 1, 0)  # what the controller knows of the hand before it decides for the first time
    s.state["hand_force"][0] = [recording.column(name)[last] for name in ("hand_fx_N", "hand_fy_N")]
    return s


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
