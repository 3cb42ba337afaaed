"""What a bench records of a hand, made ready to fit an arm to it: motion and force, smoothed alike, along the path.

Nothing else of a recording is read: a simulated hand's target and arm stay unread, as no bench knows a person's.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.files import InputError
from core.path import Segment, build_path
from core.tick_log import APPROACH, END, HOLD, MOVE, PHASES, TICK_S
from experiments.analysis.movement import check_samples
from experiments.inputs import OPERATOR, SENSOR
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording
from experiments.session.files import TABLE, recordings_in, rows_of, sessions_in
from experiments.session.playback import way_of

STRIDE = 10  # ticks from one sample to the next, and over which each of three means is taken
SAMPLE_S = STRIDE * TICK_S
LEAST_TRIALS = 8  # fewer give no interval


class Motion(NamedTuple):
    """One trial as n samples; x, v, a, jerk and force (n, 2): along the path, and to its left, from its start."""

    length: float  # m, of the path
    phase: np.ndarray  # (n,) code of `core.tick_log`
    x: np.ndarray  # m
    v: np.ndarray  # m/s
    a: np.ndarray  # m/s2
    jerk: np.ndarray  # m/s3
    force: np.ndarray  # N, of the hand on the handle

    @property
    def speed(self) -> np.ndarray:
        """m/s (n,)."""
        return np.hypot(self.v[:, 0], self.v[:, 1])

    @property
    def moving(self) -> np.ndarray:
        """Samples of the movement."""
        return np.flatnonzero(self.phase == MOVE)

    @property
    def ended(self) -> np.ndarray:
        """Samples after the end."""
        return np.flatnonzero(self.phase == END)

    @property
    def waiting(self) -> np.ndarray:
        """True (n,) before the movement."""
        return (self.phase == APPROACH) | (self.phase == HOLD)


def read_motions(folder: Path, participant: str | None = None) -> dict[str, list[Motion]]:
    """Participant -> the trials that reached the end of a straight path, of one participant or all in the folder.

    InputError: no such trial or too few, a damaged recording, or a hand that no force sensor felt.
    """
    found: dict[str, list[Motion]] = {}
    for session in sessions_in(folder):
        if recordings_in(session) and not (session / TABLE).exists():
            raise InputError(
                f"{session}: has no {TABLE}, which says how its trials ended and whose they are; phd recover writes it "
                "again from the recordings"
            )
        for row in rows_of(session):
            if row.status == "done" and participant in (None, row.participant):
                recording = read_recording(session / row.recording)
                if recording.damaged:
                    raise InputError(f"{recording.path}: {recording.damaged[0]}; a person is fitted to whole trials")
                trials = found.setdefault(row.participant, [])
                if isinstance(way := way_of(recording), Segment):
                    trials.append(motion_of(recording, way))
    if not found:
        whose = f" of participant {participant}" if participant else ""
        raise InputError(f"{folder}: holds no trial{whose} that reached the end of its path")
    for label, trials in found.items():
        if len(trials) < LEAST_TRIALS:
            raise InputError(
                f"{folder}: participant {label} has {len(trials)} whole trials on straight paths, a fit takes "
                f"{LEAST_TRIALS}"
            )
    return found


def motion_of(recording: Recording, way: Segment) -> Motion:
    """A recorded trial along its straight path. InputError: its hand's force was not felt, or samples are missing."""
    hand = recording.metadata.get("hand", OPERATOR)
    if hand not in (OPERATOR, SENSOR):
        raise InputError(f"{recording.path}: the hand moved the handle by {hand}, no force sensor felt its arm")
    check_samples(recording)
    path = build_path(way, "path")
    ahead = np.array([path.x1 - path.x0, path.y1 - path.y0]) / path.length
    turn = np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
    tip = (np.column_stack([recording.column("tip_x_m"), recording.column("tip_y_m")]) - (path.x0, path.y0)) @ turn
    force = np.column_stack([recording.column("hand_fx_N"), recording.column("hand_fy_N")]) @ turn
    codes = np.array([PHASES.index(word) for word in recording.words["phase"]])
    phase = codes[recording.column("phase")][3 * STRIDE // 2 :]
    smooth = (
        mean(mean(mean(tip))), mean(mean(slope(tip))), mean(slope(slope(tip))), slope(slope(slope(tip))),
        mean(mean(mean(force))),
    )  # fmt: skip
    return Motion(path.length, phase[: len(smooth[0])][::STRIDE], *(samples[::STRIDE] for samples in smooth))


def mean(z: np.ndarray) -> np.ndarray:
    """Mean over STRIDE ticks, (n - STRIDE, 2).

    Three means, or slopes in place of some, smooth force and motion alike, so that what relates them still does.
    """
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (z[1:] + z[:-1]), axis=0)])
    return (total[STRIDE:] - total[:-STRIDE]) / STRIDE


def slope(z: np.ndarray) -> np.ndarray:
    """Mean of the derivative over STRIDE ticks."""
    return (z[STRIDE:] - z[:-STRIDE]) / SAMPLE_S


def kernel() -> np.ndarray:
    """Weights (3 STRIDE + 1,) of the three means."""
    box = np.r_[0.5, np.ones(STRIDE - 1), 0.5] / STRIDE
    return np.convolve(np.convolve(box, box), box)
