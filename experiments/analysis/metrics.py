"""The performance measures of a trial (Section V-B of the paper, and those that we put beside them).

Pure functions on arrays sampled at 1 kHz: positions (n, 2) in m, forces (n, 2) in N, n ticks of the phase `move`.
`trial_metrics` applies them to a recording. A measure that has nothing to measure is None, never 0.

scipy.signal and scipy.fft are imported where they are used: they take seconds, and whoever begins a session has none.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from core.control.algorithm import GAP, NONE, UNREACHABLE
from core.control.controllers import DECISIONS
from core.errors import InputError
from core.path import Path, measure
from experiments.recording.schema import Recording

SAMPLE_RATE_HZ = 1000.0
TIME_TOLERANCE_S = 1e-9  # of a tick's time from the uniform grid
LEAST_PROGRESS_M = 1e-9  # less is rounding: no progress was made
POSITION_CUTOFF_HZ = 20.0  # of the low-pass before differentiation: at 100 Hz, steps of 20 um are all one sees
POSITION_FILTER_ORDER = 4
DFT_HIGHEST_HZ = 100.0  # our choice: the paper gives neither weights nor range
FELT_FORCE_N = 0.5  # a weaker force does not count as a hand that wants to go somewhere
SPARC_CUTOFF_HZ, SPARC_THRESHOLD, SPARC_PAD_LEVEL = 10.0, 0.05, 4


class Metrics(NamedTuple):
    """The measures of one trial, named as in trials.csv; None where there is nothing to measure."""

    path_error_m: float | None  # |d| over path progress
    path_error_time_m: float | None  # |d| over time
    mean_tip_force_N: float | None  # |hand force| over time
    acceleration_dft_sum: float | None  # m/s2
    acceleration_weighted_rms_m_s2: float | None
    force_over_progress_N: float | None  # |hand force| over path progress
    duration_s: float | None
    peak_error_m: float | None
    path_length_ratio: float | None  # tip travel / path length
    sparc: float | None  # nearer 0 is smoother
    switches_per_s: float | None
    unreachable_share: float | None  # None without a controller


NO_METRICS = Metrics(*[None] * len(Metrics._fields))


def along_path(tip: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Furthest way along the path so far (n,), clipped to its ends, and distance |d| from it (n,), m; tip (n, 2).

    Both of the nearest point, tick by tick: distance beyond an end is that from the straight line on, and whoever cuts
    a corner leaps ahead in progress; the leap counts with its own length.
    """
    progress, distance = np.empty(len(tip)), np.empty(len(tip))
    measure(path, np.ascontiguousarray(tip), progress, distance)
    return np.maximum.accumulate(np.clip(progress, 0.0, path.length)), np.abs(distance)


def mean_over_progress(values: np.ndarray, progress: np.ndarray) -> float | None:
    """Mean of `values` (n,) over path progress (n,), by trapezoids: dwelling and going back have no weight."""
    steps = np.diff(progress)
    made = float(progress[-1] - progress[0]) if len(progress) else 0.0
    if made < LEAST_PROGRESS_M:
        return None
    return float(np.dot(steps, 0.5 * (values[1:] + values[:-1])) / made)


@cache
def _position_filter() -> np.ndarray:
    from scipy.signal import butter

    return butter(POSITION_FILTER_ORDER, POSITION_CUTOFF_HZ, fs=SAMPLE_RATE_HZ, output="sos")


def tip_acceleration(tip: np.ndarray) -> np.ndarray | None:
    """Acceleration (m, 2) of the tip (m, 2) over a whole recording, m/s2; None for fewer than 20 ticks.

    The one definition for simulated and real devices: position under a 4th-order Butterworth low-pass of 20 Hz,
    forward and backward, then two central differences (one-sided at the two ends of the recording).
    """
    if len(tip) < 20:  # shorter than the filter's own padding
        return None
    from scipy.signal import sosfiltfilt

    smooth = sosfiltfilt(_position_filter(), np.ascontiguousarray(tip.T), axis=1)
    velocity = np.gradient(smooth, 1.0 / SAMPLE_RATE_HZ, axis=1)
    return np.gradient(velocity, 1.0 / SAMPLE_RATE_HZ, axis=1).T


def weighted_amplitudes(acceleration: np.ndarray) -> np.ndarray:
    """(f / 1 Hz) times the amplitude at each f from 1/T to 100 Hz, m/s2; acceleration (n, 2).

    Single-sided amplitudes 2/N of both components together, sqrt(|Ax|^2 + |Ay|^2); mean removed (our choice).
    """
    n = len(acceleration)
    last = math.floor(n * DFT_HIGHEST_HZ / SAMPLE_RATE_HZ * (1.0 + 1e-12))
    if last < 1:
        return np.empty(0)
    from scipy.fft import rfft

    spectrum = rfft((acceleration - acceleration.mean(axis=0)).T, axis=1)[:, 1 : last + 1]
    amplitude = 2.0 / n * np.sqrt(np.sum(spectrum.real**2 + spectrum.imag**2, axis=0))
    return np.arange(1, last + 1) * (SAMPLE_RATE_HZ / n) * amplitude


def acceleration_dft_sum(acceleration: np.ndarray) -> float | None:
    """Weighted sum of the DFT of the acceleration (n, 2), m/s2. Noise makes it grow as the root of duration."""
    weighted = weighted_amplitudes(acceleration)
    return float(np.sum(weighted)) if len(weighted) else None


def acceleration_weighted_rms(acceleration: np.ndarray) -> float | None:
    """The same spectrum as a root mean square, m/s2: sqrt(1/2 sum (weighted amplitude)^2). Free of length."""
    weighted = weighted_amplitudes(acceleration)
    return math.sqrt(0.5 * float(np.dot(weighted, weighted))) if len(weighted) else None


def sparc(speed: np.ndarray) -> float | None:
    """Spectral arc length of a speed profile (n,); nearer 0 is smoother (Balasubramanian et al. 2015).

    Cut-off 10 Hz, threshold 0.05, pad level 4. None if nothing moved.
    """
    if not len(speed) or not np.any(speed):
        return None
    padded = 2 ** (math.ceil(math.log2(len(speed))) + SPARC_PAD_LEVEL)
    from scipy.fft import rfft

    magnitude = np.abs(rfft(speed, padded))
    magnitude /= magnitude.max()
    frequency = np.arange(len(magnitude)) * (SAMPLE_RATE_HZ / padded)
    magnitude = magnitude[frequency <= SPARC_CUTOFF_HZ]
    above = np.flatnonzero(magnitude >= SPARC_THRESHOLD)
    if not len(above) or above[-1] == above[0]:
        return None
    arc = magnitude[above[0] : above[-1] + 1]
    return -float(np.sum(np.hypot(1.0 / (len(arc) - 1), np.diff(arc))))


def switches_per_second(currents: np.ndarray, duration_s: float) -> float | None:
    """Ticks at which the set of brakes with current > 0 changes, per second; currents (n, brakes), A."""
    if duration_s <= 0.0:
        return None
    on = currents > 0.0
    return int(np.count_nonzero(np.any(on[1:] != on[:-1], axis=1))) / duration_s


def unreachable_share(hand_force: np.ndarray, unreachable: np.ndarray, in_gap: np.ndarray) -> float | None:
    """Share of ticks with a felt hand and no valid or selected brake, of all ticks outside the gap.

    hand_force (n,) its magnitude, N; unreachable, in_gap (n,) bool. None if every tick is in the gap.
    """
    counted = int(np.count_nonzero(~in_gap))
    if not counted:
        return None
    return int(np.count_nonzero(unreachable & ~in_gap & (hand_force > FELT_FORCE_N))) / counted


def check_samples(recording: Recording) -> None:
    """InputError unless the ticks lie 1 ms apart and every sample that a metric reads is a finite number."""
    if not recording.rows:
        raise InputError(f"{recording.path}: there are no ticks to measure")
    t = recording.column("t_s")
    grid = t[0] + np.arange(len(t)) / SAMPLE_RATE_HZ
    off = np.flatnonzero(~(np.abs(t - grid) <= TIME_TOLERANCE_S))
    if len(off):
        raise InputError(f"{recording.path}: t_s: tick {off[0]} is off the 1 ms grid, ticks are missing or uneven")
    for name in recording.columns:
        if name.startswith(("tip_x", "tip_y", "tip_v", "hand_f", "current_")):
            bad = np.flatnonzero(~np.isfinite(recording.columns[name]))
            if len(bad):
                raise InputError(f"{recording.path}: {name}: the sample of tick {bad[0]} is missing or not finite")


def _columns(recording: Recording, *names: str) -> np.ndarray:
    return np.column_stack([recording.column(name) for name in names])


def _said(recording: Recording, codes: frozenset[int]) -> np.ndarray:
    """True (rows,) at the ticks whose decision is one of `codes` of this program, found by its words."""
    wanted = {DECISIONS[code] for code in codes}
    table = np.array([word in wanted for word in recording.words["decision"]])
    return table[recording.column("decision")]


def trial_metrics(recording: Recording, path: Path) -> Metrics:
    """Every measure of one trial, over its phase `move`; for a trial timed out, over the progress made.

    Our choice: without any progress there was no movement to judge, and its measures (errors, smoothness, travel,
    everything over progress) are None; duration, mean force, switches and unreachable share remain. A trial that
    never came to `move` has none. InputError for uneven or missing samples.
    """
    check_samples(recording)
    move = recording.in_phase("move")
    ticks = np.flatnonzero(move)
    if not len(ticks):
        return NO_METRICS
    if ticks[-1] - ticks[0] != len(ticks) - 1:
        raise InputError(f"{recording.path}: phase: `move` is interrupted, there is no single movement to measure")
    rows = slice(ticks[0], ticks[-1] + 1)

    duration = (len(ticks) - 1) / SAMPLE_RATE_HZ  # from the first tick of `move` to the last
    force = np.hypot(recording.column("hand_fx_N")[rows], recording.column("hand_fy_N")[rows])
    currents = _columns(recording, *(f"current_{joint}_A" for joint in recording.braked))[rows]
    unreachable = None
    if not _said(recording, frozenset({NONE}))[rows].all():
        unreachable = unreachable_share(
            force, _said(recording, UNREACHABLE)[rows], _said(recording, GAP)[rows]
        )
    metrics = NO_METRICS._replace(
        mean_tip_force_N=float(np.mean(force)),
        duration_s=duration,
        switches_per_s=switches_per_second(currents, duration),
        unreachable_share=unreachable,
    )

    whole_tip = _columns(recording, "tip_x_m", "tip_y_m")
    tip = whole_tip[rows]
    progress, deviation = along_path(tip, path)
    path_error = mean_over_progress(deviation, progress)
    if path_error is None:
        return metrics
    speed = np.hypot(recording.column("tip_vx_m_s")[rows], recording.column("tip_vy_m_s")[rows])
    travel = float(np.sum(np.hypot(*np.diff(tip, axis=0).T)))
    whole_acceleration = tip_acceleration(whole_tip)
    acceleration = whole_acceleration[rows] if whole_acceleration is not None else np.empty((0, 2))
    return metrics._replace(
        path_error_m=path_error,
        path_error_time_m=float(np.mean(deviation)),
        acceleration_dft_sum=acceleration_dft_sum(acceleration),
        acceleration_weighted_rms_m_s2=acceleration_weighted_rms(acceleration),
        force_over_progress_N=mean_over_progress(force, progress),
        peak_error_m=float(np.max(deviation)),
        path_length_ratio=travel / path.length,
        sparc=sparc(speed),
    )
