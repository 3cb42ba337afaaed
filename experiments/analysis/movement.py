"""The movement of a trial, the phase `move` of its recording, and the arrays and numbers that measures are made of.

Pure functions on arrays sampled at 1 kHz: positions (n, 2) in m, forces (n, 2) in N, n ticks of `move`.
"""

import math
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from core.control.algorithm import BY_GUARD, GAP, NONE, UNREACHABLE
from core.control.controllers import DECISIONS
from core.control.rule_sets import SETTLED
from core.files import InputError
from core.path import Path, track
from core.workspace import brake_rows
from experiments.analysis import steering

if TYPE_CHECKING:  # the windows import the table, not what reads recordings
    from experiments.recording import Recording

SAMPLE_RATE_HZ = 1000.0
TIME_TOLERANCE_S = 1e-9  # of a tick's time from the uniform grid
POSITION_CUTOFF_HZ = 20.0  # of the low-pass before differentiation: at 100 Hz, steps of 20 um are all one sees
DFT_HIGHEST_HZ = 100.0  # our choice: the paper gives neither weights nor range
FELT_FORCE_N = 0.5  # a weaker force does not count as a hand that wants to go somewhere
CHANGE_A = 0.05  # our choice: a smaller change of current in a tick is a brake that follows, not one that chatters
SPARC_CUTOFF_HZ, SPARC_THRESHOLD, SPARC_PAD_LEVEL = 10.0, 0.05, 4


def along_path(tip: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Furthest way along the path so far (n,), clipped to its ends, and distance |d| from it (n,), m; tip (n, 2).

    Both of the nearest point, which is followed from the start of the path on: beyond an end it is the distance from
    the straight line on. A tip that cuts a corner leaps ahead in progress; the leap counts with its own length.
    """
    way, across = _tracked(tip, path)
    return np.maximum.accumulate(np.clip(way, 0.0, path.length)), np.abs(across)


def distance_to_path(tip: np.ndarray, path: Path) -> np.ndarray:
    """Distance (n,) of the tip (n, 2) from the path, m: beyond an end from the end itself."""
    way, across = _tracked(tip, path)
    return np.hypot(across, way - np.clip(way, 0.0, path.length))


def _tracked(tip: np.ndarray, path: Path) -> np.ndarray:
    """Way along the path and signed distance across it (2, n), m, on the straight line on beyond an end."""
    found = np.empty((len(tip), 2))
    track(path, np.ascontiguousarray(tip), found)
    return found.T


def mean_over_progress(values: np.ndarray, progress: np.ndarray) -> float:
    """Mean of `values` (n,) over path progress (n,), which must be made, by trapezoids.

    Dwelling and going back have no weight.
    """
    return float(np.trapezoid(values, progress) / (progress[-1] - progress[0]))


def tip_acceleration(tip: np.ndarray, cutoff_hz: float = POSITION_CUTOFF_HZ) -> np.ndarray | None:
    """Acceleration (m, 2) of the tip (m, 2) over a whole recording, m/s2; None for fewer than 20 ticks.

    The one definition for simulated and real devices: position under a 4th-order Butterworth low-pass of 20 Hz,
    forward and backward, then two central differences (one-sided at the two ends of the recording).
    """
    if len(tip) < 20:  # shorter than the filter's own padding
        return None
    sections = scipy.signal.butter(4, cutoff_hz, fs=SAMPLE_RATE_HZ, output="sos")
    smooth = scipy.signal.sosfiltfilt(sections, tip.T, axis=1)
    velocity = np.gradient(smooth, 1.0 / SAMPLE_RATE_HZ, axis=1)
    return np.gradient(velocity, 1.0 / SAMPLE_RATE_HZ, axis=1).T


def without_ramp(acceleration: np.ndarray) -> np.ndarray:
    """Acceleration (n, 2) less the straight line from its first sample to its last.

    Our choice: the paper names no window. `move` begins at rest and is cut while the hand still moves, and the DFT
    takes its input for one period of something that repeats. A jump da from the end to the start of the period
    has the amplitude da / (pi k) at its k-th frequency, whatever happened between: weighted and summed (100 / pi) da.
    """
    share = np.linspace(0.0, 1.0, len(acceleration))[:, np.newaxis]
    return acceleration - share * (acceleration[-1:] - acceleration[:1])


def weighted_amplitudes(acceleration: np.ndarray, highest_hz: float = DFT_HIGHEST_HZ, power: float = 1.0) -> np.ndarray:
    """(f / 1 Hz)^power times the amplitude at each f from 1/T to the highest, m/s2; acceleration (n, 2).

    Single-sided amplitudes 2/N of both components together, sqrt(|Ax|^2 + |Ay|^2); mean removed (our choice).
    """
    n = len(acceleration)
    last = math.floor(n * highest_hz / SAMPLE_RATE_HZ * (1.0 + 1e-12))
    if last < 1:
        return np.empty(0)
    spectrum = np.fft.rfft((acceleration - acceleration.mean(axis=0)).T, axis=1)[:, 1 : last + 1]
    amplitude = 2.0 / n * np.sqrt(np.sum(spectrum.real**2 + spectrum.imag**2, axis=0))
    return (np.arange(1, last + 1) * (SAMPLE_RATE_HZ / n)) ** power * amplitude


def amplitude_sum(weighted: np.ndarray) -> float | None:
    """Sum of `weighted_amplitudes`, m/s2. Noise makes it grow as the root of duration."""
    return float(np.sum(weighted)) if len(weighted) else None


def amplitude_rms(weighted: np.ndarray) -> float | None:
    """The same spectrum as a root mean square, m/s2: sqrt(1/2 sum (weighted amplitude)^2). Free of length."""
    return math.sqrt(0.5 * float(np.sum(weighted**2))) if len(weighted) else None


def sparc(speed: np.ndarray) -> float | None:
    """Spectral arc length of a speed profile (n,); nearer 0 is smoother (Balasubramanian et al. 2015).

    Cut-off 10 Hz, threshold 0.05, pad level 4. None if nothing moved. A speed is nowhere negative.
    """
    if not len(speed) or not np.any(speed):
        return None
    padded = 2 ** (math.ceil(math.log2(len(speed))) + SPARC_PAD_LEVEL)
    magnitude = np.abs(np.fft.rfft(speed, padded)[: math.floor(SPARC_CUTOFF_HZ / SAMPLE_RATE_HZ * padded) + 1])
    magnitude /= magnitude.max()  # at 0 Hz
    above = np.flatnonzero(magnitude >= SPARC_THRESHOLD)
    if not len(above) or above[-1] == above[0]:
        return None
    arc = magnitude[above[0] : above[-1] + 1]
    return -float(np.sum(np.hypot(1.0 / (len(arc) - 1), np.diff(arc))))


def check_samples(recording: "Recording") -> None:
    """InputError unless the ticks lie 1 ms apart and every sample that a metric reads is a finite number."""
    if not recording.rows:
        raise InputError(f"{recording.path}: there are no ticks to measure")
    t = recording.column("t_s")
    grid = t[0] + np.arange(len(t)) / SAMPLE_RATE_HZ
    on = np.abs(t - grid) <= TIME_TOLERANCE_S
    if not on.all():
        tick = np.argmin(on)
        raise InputError(f"{recording.path}: t_s: tick {tick} is off the 1 ms grid, ticks are missing or uneven")
    for name in recording.columns:
        if name.startswith(("tip_x", "tip_y", "tip_v", "hand_f", "current_")):
            finite = np.isfinite(recording.columns[name])
            if not finite.all():
                tick = np.argmin(finite)
                raise InputError(f"{recording.path}: {name}: the sample of tick {tick} is missing or not finite")


def columns(recording: "Recording", *names: str) -> np.ndarray:
    """Columns of a recording side by side (n, columns)."""
    return np.column_stack([recording.column(name) for name in names])


class Movement:
    """The phase `move` of a recording: n ticks, 1 ms apart."""

    def __init__(self, recording: "Recording", path: Path) -> None:
        """A recording that `check_samples` has passed and that came to `move`; InputError if it was interrupted."""
        ticks = np.flatnonzero(recording.in_phase("move"))
        if ticks[-1] - ticks[0] != len(ticks) - 1:
            raise InputError(f"{recording.path}: phase: `move` is interrupted, there is no single movement to measure")
        self.path = path
        self._recording, self._rows = recording, slice(ticks[0], ticks[-1] + 1)
        self.duration_s = (len(ticks) - 1) / SAMPLE_RATE_HZ  # from the first tick of `move` to the last
        self.tip = self._columns("tip_x_m", "tip_y_m")  # (n, 2) m
        self.progress, self.deviation = along_path(self.tip, path)  # (n,) m

    @cached_property
    def force(self) -> np.ndarray:
        """Magnitude of the hand force (n,), N."""
        return np.hypot(*self._hand_force.T)

    @cached_property
    def _hand_force(self) -> np.ndarray:
        return self._columns("hand_fx_N", "hand_fy_N")

    @cached_property
    def speed(self) -> np.ndarray:
        """Speed of the tip (n,), m/s."""
        return np.hypot(self._column("tip_vx_m_s"), self._column("tip_vy_m_s"))

    @cached_property
    def acceleration(self) -> np.ndarray:
        """Acceleration of the tip (n, 2), m/s2; (0, 2) of a recording that is too short to filter."""
        whole = tip_acceleration(columns(self._recording, "tip_x_m", "tip_y_m"))
        return np.empty((0, 2)) if whole is None else whole[self._rows]

    @cached_property
    def exact_acceleration(self) -> np.ndarray:
        """Acceleration of the tip (n, 2), m/s2, as the simulator has it, unfiltered; (0, 2) of a real device.

        No board has an accelerometer yet: its column is a parabola through 15 ms of encoder counts, which sees no
        vibration of 100 Hz.
        """
        if self._recording.sensors:
            return np.empty((0, 2))
        return self._columns("tip_ax_m_s2", "tip_ay_m_s2")

    @cached_property
    def weighted(self) -> np.ndarray:
        """`weighted_amplitudes` of the acceleration."""
        return weighted_amplitudes(self.acceleration)

    # Measures of `METRICS` that take more than a line; their meaning stands there. None: there is nothing to measure.

    def switches_per_second(self) -> float | None:
        if self.duration_s <= 0.0:
            return None
        on = np.zeros(len(self.tip), dtype=np.int8)  # a bit for each brake
        for bit, joint in enumerate(self._recording.braked):
            on |= (self._column(f"current_{joint}_A") > 0.0).astype(np.int8) << bit
        return int(np.count_nonzero(on[1:] != on[:-1])) / self.duration_s

    def hand_energy_per_metre(self) -> float | None:
        """The ledger of the hand from the first tick of `move` to its last, over the progress made."""
        spent = self._columns_or_nan("energy_hand_J")[:, 0]
        way = float(self.progress[-1] - self.progress[0])
        return None if np.isnan(spent).any() else float(spent[-1] - spent[0]) / way

    def chatter(self) -> float | None:
        if self.duration_s <= 0.0 or not self._controlled:
            return None
        currents = self._columns(*(f"current_{joint}_A" for joint in self._recording.braked))
        return int(np.count_nonzero(np.abs(np.diff(currents, axis=0)) > CHANGE_A)) / self.duration_s

    def unreachable_share(self) -> float | None:
        outside = ~self._decided(GAP)  # of the ticks in the gap no brake is asked
        if not self._controlled or not outside.any():
            return None
        lacking = self._decided(UNREACHABLE) & outside & (self.force > FELT_FORCE_N)
        return int(np.count_nonzero(lacking)) / int(np.count_nonzero(outside))

    def share_of_ticks(self, decisions: frozenset[int]) -> float | None:
        """Share of the ticks with one of these decisions; None without a controller."""
        return float(np.mean(self._decided(decisions))) if self._controlled else None

    def slave_error(self) -> float | None:
        apart = self._columns_or_nan("slave_x_m", "slave_y_m") - self.tip
        return None if np.isnan(apart).any() else float(np.mean(np.hypot(*apart.T)))

    def force_shown_share(self) -> float | None:
        wanted, size = self._wanted
        asked = size > FELT_FORCE_N
        if not asked.any():
            return None
        shown = self._columns_or_nan("shown_fx_N", "shown_fy_N")
        along = np.sum(wanted[asked] * shown[asked], axis=1) / size[asked]
        return float(np.sum(along) / np.sum(size[asked]))

    def force_unavailable_share(self) -> float | None:
        wanted, size = self._wanted
        if not np.any(size > FELT_FORCE_N):
            return None
        nearest = self._columns_or_nan("nearest_fx_N", "nearest_fy_N")
        asked = (size > FELT_FORCE_N) & np.isfinite(nearest[:, 0])
        missed = np.hypot(*(wanted - nearest)[asked].T)
        return float(np.sum(missed) / np.sum(size[asked])) if asked.any() else None

    def steerable_share(self) -> float | None:
        desired = self._columns_or_nan("desired_x", "desired_y")
        judged = np.isfinite(desired[:, 0]) & (self.speed > SETTLED.rest_speed)
        if (braking := steering.from_metadata(self._recording.metadata)) is None or not judged.any():
            return None
        velocity = self._columns("tip_vx_m_s", "tip_vy_m_s")[judged]
        least, most = steering.across_range(braking, self.tip[judged], velocity, self._hand_force[judged])
        wanted = steering.wanted_across(velocity, desired[judged], self.path.blend_width)
        return float(np.mean((least <= wanted) & (wanted <= most)))

    def push_held_share(self) -> float | None:
        forward_x, forward_y, distance = self._columns_or_nan("forward_x", "forward_y", "path_distance_m").T
        inward = np.sign(distance) * np.array([forward_y, -forward_x])  # (2, n)
        pushed = -np.sum(inward * self._hand_force.T, axis=0)
        felt = pushed > FELT_FORCE_N
        if (braking := steering.from_metadata(self._recording.metadata)) is None or not felt.any():
            return None
        torques = self._columns(*(f"torque_{joint}_N_m" for joint in self._recording.braked))[felt]
        rows = brake_rows(braking.mechanism, *self.tip[felt].T)[list(braking.present)]
        held = np.einsum("kin,nk,in->n", rows, torques, inward[:, felt])
        return float(np.sum(held) / np.sum(pushed[felt]))

    def guarded_share(self) -> float | None:
        if self.least_distance is None:
            return None
        return float(np.mean(self._decided(BY_GUARD)))

    @cached_property
    def least_distance(self) -> float | None:
        """Least distance from the nearest obstacle, m, negative inside; None without one."""
        distance = self._columns_or_nan("obstacle_distance_m")
        return None if np.isnan(distance).any() else float(distance.min())

    @cached_property
    def _wanted(self) -> tuple[np.ndarray, np.ndarray]:
        """The force to be shown (n, 2) and its size (n,), N; NaN where there is none."""
        wanted = self._columns_or_nan("wanted_fx_N", "wanted_fy_N")
        return wanted, np.hypot(*wanted.T)

    def _columns_or_nan(self, *names: str) -> np.ndarray:
        """Columns (n, columns); NaN where an earlier version recorded the trial, without them."""
        if not all(name in self._recording.columns for name in names):
            return np.full((len(self.tip), len(names)), math.nan)
        return self._columns(*names)

    @cached_property
    def _controlled(self) -> bool:
        """Whether a controller, or the guard of obstacles, could act.

        The recording of a blind session does not name its controller: there one that never acted counts as none.
        """
        kind = self._recording.metadata.get("preset", {}).get("kind", "none")
        return kind != "none" or not self._decided(frozenset({NONE})).all()

    def _decided(self, codes: frozenset[int]) -> np.ndarray:
        """True (n,) at the ticks whose decision is one of `codes` of this version, found by its words."""
        return _words_of(codes, self._recording.words["decision"])[self._column("decision")]

    def column(self, name: str) -> np.ndarray:
        """A column of the recording (n,); of texts (phase, decision, stuck) the words. InputError if it has none."""
        if name not in self._recording.columns:
            raise InputError(f"a recording has no column {name!r}; it has {', '.join(self._recording.columns)}")
        if name in self._recording.words:
            return np.array(self._recording.words[name])[self._column(name).astype(int)]
        return self._column(name).copy()

    def _column(self, name: str) -> np.ndarray:
        return self._recording.column(name)[self._rows]

    def _columns(self, *names: str) -> np.ndarray:
        return np.column_stack([self._column(name) for name in names])


@cache
def _words_of(codes: frozenset[int], words: tuple[str, ...]) -> np.ndarray:
    """True (n,) at the words (n,) of a recording that are those of decisions of this version."""
    wanted = {DECISIONS[code] for code in codes}
    return np.array([word in wanted for word in words])
