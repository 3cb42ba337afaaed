"""The performance measures of a trial (Section V-B of the paper, and those that we put beside them).

`METRICS` declares each measure once, with the function of a `Movement` that gives it: columns of trials.csv, the data
dictionary, figures, statistics, sensitivity and replays derive from it. To add one, add its line there. A measure that
has nothing to measure is None, never 0.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from core.control.algorithm import LOCKED, RELEASED
from core.files import InputError
from core.path import Path
from experiments.analysis.movement import (
    Movement,
    amplitude_rms,
    amplitude_sum,
    check_samples,
    distance_to_path,
    mean_over_progress,
    sparc,
    weighted_amplitudes,
    without_ramp,
)

if TYPE_CHECKING:  # the windows import the table, not what reads recordings
    from experiments.recording import Recording

LEAST_PROGRESS_M = 1e-9  # less is rounding: no progress was made


class MeasureFailed(InputError):
    """A measure in a file of one's own gave no number."""


class Metric(NamedTuple):
    """One measure of a trial."""

    name: str  # its column in trials.csv
    unit: str  # of that column; "" for a number without one
    title: str
    short: str  # in a sentence
    meaning: str
    of: Callable[[Movement], float | None]
    shown_unit: str = ""  # in figures and reports
    scale: float = 1.0  # value in `shown_unit` / value in `unit`
    decimals: int = 2  # in reports
    figure: str = ""  # drawn as box plots, in this file: the number is that of the paper's figure
    stands_for: str = ""  # accuracy, force or smoothness; the first that stands for one of them is its definition
    compared: bool = False  # statistics compare the controllers by it
    better: str = "lower"
    needs_progress: bool = True  # None where the tip came no way along the path: there was no movement to judge
    tells_controller: bool = False  # hidden while a session is blind

    def __reduce__(self) -> Any:
        """A shipped one goes to other processes by its name: its function cannot be sent."""
        shipped = BY_NAME.get(self.name)
        return (_shipped, (self.name,)) if shipped is self else (Metric, tuple(self))


def _shipped(name: str) -> Metric:
    return BY_NAME[name]


METRICS = (
    Metric(
        "path_error_m", "m", "Path error", "path error",
        "distance to the path, averaged over progress along the path",
        lambda m: mean_over_progress(m.deviation, m.progress),
        shown_unit="mm", scale=1e3, figure="fig16_path_error", stands_for="accuracy", compared=True,
    ),
    Metric(
        "path_error_time_m", "m", "Path error over time", "path error over time",
        "distance to the path, beyond an end to that end, averaged over time",
        lambda m: float(np.mean(distance_to_path(m.tip, m.path))),
        shown_unit="mm", scale=1e3, stands_for="accuracy",
    ),
    Metric(
        "mean_tip_force_N", "N", "Mean tip force", "mean tip force", "magnitude of the hand force, averaged over time",
        lambda m: float(np.mean(m.force)),
        shown_unit="N", figure="fig17_tip_force", stands_for="force", compared=True, needs_progress=False,
    ),
    Metric(
        "acceleration_dft_sum", "m/s^2", "DFT of acceleration", "DFT of acceleration",
        "sum over the frequencies up to 100 Hz of (f / 1 Hz) times the amplitude of the acceleration, which comes from "
        "positions filtered at 20 Hz: it sees little above that",
        lambda m: amplitude_sum(m.weighted),
        shown_unit="m/s²", decimals=1, figure="fig18_acceleration_dft_sum", stands_for="smoothness", compared=True,
    ),
    Metric(
        "acceleration_weighted_rms_m_s2", "m/s^2", "Acceleration, weighted rms", "acceleration rms",
        "the same spectrum as a root mean square: free of duration",
        lambda m: amplitude_rms(m.weighted),
        shown_unit="m/s²", decimals=1, stands_for="smoothness", compared=True,
    ),
    Metric(
        "force_over_progress_N", "N", "Tip force over progress", "force over progress",
        "magnitude of the hand force, averaged over progress along the path",
        lambda m: mean_over_progress(m.force, m.progress),
        shown_unit="N", stands_for="force", compared=True,
    ),
    Metric(
        "duration_s", "s", "Duration", "duration", "from the first tick of the movement to its last",
        lambda m: m.duration_s,
        shown_unit="s", compared=True, needs_progress=False,
    ),
    Metric(
        "peak_error_m", "m", "Peak error", "peak error", "largest distance to the path",
        lambda m: float(np.max(m.deviation)),
        shown_unit="mm", scale=1e3, stands_for="accuracy",
    ),
    Metric(
        "path_length_ratio", "", "Path length ratio", "path length ratio", "travel of the handle / length of the path",
        lambda m: float(np.sum(np.hypot(*np.diff(m.tip, axis=0).T))) / m.path.length,
    ),
    Metric(
        "sparc", "", "SPARC", "SPARC", "spectral arc length of the speed; nearer 0 is smoother",
        lambda m: sparc(m.speed),
        stands_for="smoothness", better="higher",
    ),
    Metric(
        "switches_per_s", "1/s", "Switches", "switches",
        "ticks at which the set of brakes with current changes, per second",
        Movement.switches_per_second,
        shown_unit="1/s", needs_progress=False, tells_controller=True,
    ),
    Metric(
        "unreachable_share", "", "Unreachable share", "unreachable share",
        "share of the ticks with a felt hand in which no brake was valid or selected; none without control",
        Movement.unreachable_share,
        needs_progress=False, tells_controller=True,
    ),
    Metric(
        "slave_error_m", "m", "Slave error", "slave error",
        "distance between the slave and the handle, averaged over time; none without a slave",
        Movement.slave_error,
        shown_unit="mm", scale=1e3, needs_progress=False,
    ),
    Metric(
        "force_shown_share", "", "Force shown", "share of the force shown",
        "force of the brakes along the force to be shown / that force; none where no force is to be shown",
        Movement.force_shown_share,
        better="higher", needs_progress=False, tells_controller=True,
    ),
    Metric(
        "force_unavailable_share", "", "Force that cannot be had", "share of the force that cannot be had",
        "what the nearest force that passive brakes can exert misses of the force to be shown / that force",
        Movement.force_unavailable_share,
        needs_progress=False, tells_controller=True,
    ),
    Metric(
        "least_clearance_m", "m", "Least clearance", "least clearance",
        "least distance of the handle from the nearest obstacle, 0 inside; none without obstacles",
        lambda m: None if m.least_distance is None else max(m.least_distance, 0.0),
        shown_unit="mm", scale=1e3, needs_progress=False, better="higher",
    ),
    Metric(
        "deepest_entry_m", "m", "Deepest entry", "deepest entry",
        "how deep the handle came into an obstacle; none without obstacles",
        lambda m: None if m.least_distance is None else max(-m.least_distance, 0.0),
        shown_unit="mm", scale=1e3, needs_progress=False,
    ),
    Metric(
        "guarded_share", "", "Time locked by the guard", "share of time locked by the guard",
        "share of the movement in which the guard of obstacles had locked all brakes; none without obstacles",
        Movement.guarded_share,
        needs_progress=False,
    ),
    Metric(
        "acceleration_exact_dft_sum", "m/s^2", "DFT of acceleration to 100 Hz", "DFT of acceleration to 100 Hz",
        "acceleration_dft_sum of the simulator's own acceleration: it sees vibration up to 100 Hz, which the filter of "
        "20 Hz on position hides; none on a real device, which has no accelerometer",
        lambda m: amplitude_sum(weighted_amplitudes(m.exact_acceleration)),
        shown_unit="m/s²", decimals=1, figure="fig18_acceleration_to_100_Hz", stands_for="smoothness", compared=True,
    ),
    Metric(
        "locked_share", "", "Locked share", "share locked",
        "share of the ticks in which the rules put full current on all brakes; none without control",
        lambda m: m.share_of_ticks(LOCKED),
        needs_progress=False, tells_controller=True,
    ),
    Metric(
        "released_share", "", "Released share", "share released",
        "share of the ticks in which no brake was valid or selected and the rules took all current off; none without "
        "control",
        lambda m: m.share_of_ticks(RELEASED),
        needs_progress=False, tells_controller=True,
    ),
    Metric(
        "acceleration_dft_sum_ramp_removed", "m/s^2", "DFT of acceleration, ramp removed",
        "DFT of acceleration, ramp removed",
        "acceleration_dft_sum less the straight line between the first and the last sample of the acceleration: "
        "without the jump from the end of the movement to its start, which the DFT takes for vibration",
        lambda m: amplitude_sum(weighted_amplitudes(without_ramp(m.acceleration))),
        shown_unit="m/s²", decimals=1, figure="fig18_acceleration_ramp_removed", stands_for="smoothness", compared=True,
    ),
    Metric(
        "hand_energy_per_metre_J_m", "J/m", "Energy of the hand per metre", "energy per metre",
        "work of the hand on the handle / progress along the path",
        Movement.hand_energy_per_metre,
        shown_unit="J/m",
    ),
    Metric(
        "chatter_per_s", "1/s", "Chatter", "chatter",
        "changes of a brake's current by more than 0.05 A from one tick to the next, per second, over all brakes; 0 "
        "where the controller never braked, none without control",
        Movement.chatter,
        shown_unit="1/s", decimals=1, needs_progress=False, tells_controller=True,
    ),
    Metric(
        "steerable_share", "", "Steerable", "share steerable",
        "share of the ticks of a moving tip in which the brakes can, with the hand's force, give its motion the "
        "curvature that leads onto the desired direction a blend width ahead",
        Movement.steerable_share,
        better="higher", needs_progress=False, tells_controller=True,
    ),
    Metric(
        "push_held_share", "", "Push away held", "share of the push away that is held",
        "force of the brakes towards the path / push of the hand away from it, over the ticks in which it is felt",
        Movement.push_held_share,
        better="higher", needs_progress=False, tells_controller=True,
    ),
)  # fmt: skip
BY_NAME = {metric.name: metric for metric in METRICS}
FIGURES = tuple(metric for metric in METRICS if metric.figure)
#: Figs. 16, 17 and 18: the definition of accuracy, force and smoothness.
DRAWN = tuple(
    next(metric for metric in FIGURES if metric.stands_for == thing) for thing in ("accuracy", "force", "smoothness")
)
#: The same three, and the sum without the ramp: the paper's statements are judged by either sum.
JUDGED = (*DRAWN, BY_NAME["acceleration_dft_sum_ramp_removed"])


Metrics = dict[str, float | None]  # the measures of one trial, by name


def trial_metrics(
    recording: "Recording", path: Path, metrics: Sequence[Metric] = METRICS, failed: dict[str, str] | None = None
) -> Metrics:
    """These measures of one trial, over its phase `move`; of a trial timed out, over the progress made.

    Our choice: without any progress there was no movement to judge, and its measures (errors, smoothness, travel,
    everything over progress) are None; duration, mean force, switches and unreachable share remain. A trial that
    never came to `move` has none. InputError for uneven or missing samples.
    failed: takes why a measure in a file of one's own gave no number, by name; without it MeasureFailed is raised.
    """
    check_samples(recording)
    if not recording.in_phase("move").any():
        return {metric.name: None for metric in metrics}
    m = Movement(recording, path)
    moved = m.progress[-1] - m.progress[0] >= LEAST_PROGRESS_M
    found: Metrics = {}
    for metric in metrics:
        try:
            found[metric.name] = metric.of(m) if moved or not metric.needs_progress else None
        except MeasureFailed as error:
            if failed is None:
                raise
            found[metric.name], failed[metric.name] = None, str(error)
    return found
