"""Whether the order of the controllers depends on how a measure is defined, and how rough each is by which definition.

Definitions that the table holds: path error over progress, over time, at its peak; force over time, over progress;
weighted DFT sum, as the acceleration is cut and without the ramp, weighted rms, SPARC, weighted DFT sum of the exact
acceleration. Definitions that need the recordings (weights of the DFT, its highest frequency, its window, the filter
before differentiation, the source of the acceleration) stand in `SMOOTHNESS`; of force and smoothness also that without
the reaction time, from the tick on at which the tip has moved 1 mm.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from experiments.analysis.metrics import BY_NAME, METRICS
from experiments.analysis.movement import (
    SAMPLE_RATE_HZ,
    amplitude_sum,
    columns,
    tip_acceleration,
    weighted_amplitudes,
    without_ramp,
)
from experiments.analysis.statistics import Result, configurations_of, scores
from experiments.analysis.trials_table import Trials, by_controller, to_compare
from experiments.recording import Recording

Read = Callable[[str], Recording]  # gives the recording of that name in a table
#: Accuracy, force, smoothness -> the measures that define it; the first is the one of the figures.
DEFINITIONS = {
    thing: tuple(metric.name for metric in METRICS if metric.stands_for == thing)
    for thing in dict.fromkeys(metric.stands_for for metric in METRICS if metric.stands_for)
}


MOVED_M = 1e-3  # the reaction is over once the tip is so far from where `move` found it


def as_it_is(acceleration: np.ndarray) -> np.ndarray:
    """No window: cut where `move` begins and ends."""
    return acceleration


def hann(acceleration: np.ndarray) -> np.ndarray:
    """Acceleration (n, 2) less its mean under a Hann window, which keeps the mean square of a steady vibration."""
    n = len(acceleration)
    window = np.hanning(n + 1)[:n, np.newaxis]  # n samples of one period
    return np.sqrt(8.0 / 3.0) * window * (acceleration - acceleration.mean(axis=0))


class Smoothness(NamedTuple):
    """One definition of the weighted DFT sum."""

    cutoff_hz: float | None = 20.0  # of the low-pass on position; None: the simulator's own acceleration, unfiltered
    highest_hz: float = 100.0
    power: float = 1.0  # weight (f / 1 Hz)^power
    window: Callable[[np.ndarray], np.ndarray] = as_it_is
    reaction: bool = True  # from the first tick of `move`; else from the first millimetre on


#: One thing changed at a time, but that the last three are without the ramp besides.
SMOOTHNESS = {
    "dft_sum, no weights": Smoothness(power=0.0),
    "dft_sum, weights f^2": Smoothness(power=2.0),
    "dft_sum, up to 50 Hz": Smoothness(highest_hz=50.0),
    "dft_sum, filter 10 Hz": Smoothness(cutoff_hz=10.0),
    "dft_sum, filter 40 Hz": Smoothness(cutoff_hz=40.0),
    "dft_sum, filter 80 Hz": Smoothness(cutoff_hz=80.0),
    "dft_sum, filter 160 Hz": Smoothness(cutoff_hz=160.0),
    "dft_sum, exact, up to 20 Hz": Smoothness(None, highest_hz=20.0),
    "dft_sum, exact, up to 50 Hz": Smoothness(None, highest_hz=50.0),
    "dft_sum, exact, up to 250 Hz": Smoothness(None, highest_hz=250.0),
    "dft_sum, Hann window": Smoothness(window=hann),
    "dft_sum, from the first mm": Smoothness(reaction=False),
    "dft_sum, exact, ramp removed": Smoothness(None, window=without_ramp),
    "dft_sum, filter 160 Hz, ramp removed": Smoothness(160.0, window=without_ramp),
    "dft_sum, ramp removed, from the first mm": Smoothness(window=without_ramp, reaction=False),
}
DURATION_MOVING, FORCE_MOVING = "duration_s, from the first mm", "mean_tip_force_N, from the first mm"
#: A measure, and the same without the reaction time.
MOVING = {
    "duration_s": DURATION_MOVING,
    "mean_tip_force_N": FORCE_MOVING,
    "acceleration_dft_sum": "dft_sum, from the first mm",
    "acceleration_dft_sum_ramp_removed": "dft_sum, ramp removed, from the first mm",
}


def ticks_moving(recording: Recording) -> np.ndarray:
    """The ticks of `move` from the one on at which the tip is `MOVED_M` from where `move` found it; none: it stays."""
    ticks = np.flatnonzero(recording.in_phase("move"))
    tip = columns(recording, "tip_x_m", "tip_y_m")[ticks]
    away = np.hypot(*(tip - tip[:1]).T) >= MOVED_M
    return ticks[np.argmax(away) :] if away.any() else ticks[:0]


def dft_sum(recording: Recording, definition: Smoothness) -> float | None:
    """`metrics.acceleration_dft_sum` by another definition; None where there is nothing to measure."""
    if definition.cutoff_hz is None:
        acceleration = None if recording.sensors else columns(recording, "tip_ax_m_s2", "tip_ay_m_s2")
    else:
        acceleration = tip_acceleration(columns(recording, "tip_x_m", "tip_y_m"), definition.cutoff_hz)
    ticks = np.flatnonzero(recording.in_phase("move")) if definition.reaction else ticks_moving(recording)
    if acceleration is None or not len(ticks):
        return None
    within = definition.window(acceleration[ticks])
    return amplitude_sum(weighted_amplitudes(within, definition.highest_hz, definition.power))


def _from_recording(recording: Recording) -> dict[str, float | None]:
    """The definitions that need the recording."""
    moving = ticks_moving(recording)
    force = np.hypot(*columns(recording, "hand_fx_N", "hand_fy_N")[moving].T)
    return {
        **{name: dft_sum(recording, definition) for name, definition in SMOOTHNESS.items()},
        FORCE_MOVING: float(np.mean(force)) if len(moving) else None,
        DURATION_MOVING: (len(moving) - 1) / SAMPLE_RATE_HZ if len(moving) else None,
    }


def sensitivity(trials: Trials, read: Read | None = None, timeouts: bool = False, none: int = 1) -> list[Result]:
    """The order of controllers, best first, by each definition, and how well it agrees with the first one's.

    Controllers stand in the order of the mean over participants of their means. `value`: Kendall's tau with the first
    definition's order (1: the same order, -1: reversed). read: gives the recording of that name in the
    table, from which those of `_from_recording` are taken as well. timeouts: trials whose time was up count as well.
    Of smoothness also each controller's median over that of no control (number `none`), by each definition.
    """
    trials = to_compare(trials, timeouts)
    if read:
        trials = _with_definitions(trials, read)
    further = {"smoothness": tuple(SMOOTHNESS), "force": (FORCE_MOVING,)} if read else {}
    results = []
    for thing, named in DEFINITIONS.items():
        definitions = (*named, *further.get(thing, ()))
        for configuration in configurations_of(trials):
            here = trials[trials["configuration"] == configuration]
            people = here["participant"].nunique()
            base = _means(here, definitions[0])
            for definition in definitions:
                means = _means(here, definition)
                common = [controller for controller in base if controller in means]
                if len(common) < 2:
                    continue
                tau = kendall_tau([base[k] for k in common], [means[k] for k in common])
                order, first = (" < ".join(str(k) for k in sorted(of, key=of.__getitem__)) for of in (means, base))
                about = ("order", definition, configuration, order, definitions[0], people, "kendall_tau")
                results.append(Result(*about, tau, differ=len(swapped(first, order))))
                if thing == "smoothness" and not _higher_is_better(definition):
                    results += _roughness(here, definition, configuration, people, none)
    return results + _without_reaction(trials) if read else results


def _with_definitions(trials: Trials, read: Read) -> Trials:
    """The trials with a column for each of `_from_recording`."""
    measured = trials[trials["duration_s"] > 0.0]
    found = {at: _from_recording(read(name)) for at, name in measured["recording"].items()}
    columns = (*SMOOTHNESS, FORCE_MOVING, DURATION_MOVING)
    return trials.assign(**{
        name: np.array([found.get(at, {}).get(name) for at in trials.index], dtype=float) for name in columns
    })  # fmt: skip


def _without_reaction(trials: Trials) -> list[Result]:
    """What leaving the reaction time out does to a trial: the median ratio of all trials on a device."""
    results = []
    for configuration, here in trials.groupby("configuration", sort=False):
        for measure, moving in MOVING.items():
            with_both = here[(here[moving] != 0.0) & (here[measure] != 0.0)].dropna(subset=[moving, measure])
            if len(with_both):
                ratio = float(np.median(with_both[moving] / with_both[measure]))
                about = ("reaction", measure, configuration, "", "", here["participant"].nunique(), "median_ratio")
                results.append(Result(*about, ratio))
    return results


def kendall_tau(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Kendall's tau-b of two rankings of the same things; None where one of them is all ties."""
    tau = float(scipy.stats.kendalltau(first, second).statistic)
    return None if math.isnan(tau) else tau


def _roughness(trials: Trials, definition: str, configuration: str, people: int, none: int) -> Iterator[Result]:
    """How many times as rough as no control each controller is: ratio of the medians of all trials."""
    medians = trials.dropna(subset=definition).groupby("controller")[definition].median()
    uncontrolled = float(medians.get(none, 0.0))
    for controller, median in medians.drop(none, errors="ignore").items() if uncontrolled > 0.0 else ():
        about = ("roughness", definition, configuration, str(controller), str(none), people, "ratio_of_medians")
        yield Result(*about, float(median) / uncontrolled)


def _means(trials: Trials, definition: str) -> dict[int, float]:
    """Controller -> mean over participants of their means; less is better."""
    sign = -1.0 if _higher_is_better(definition) else 1.0
    of_people: dict[int, list[float]] = {}
    for (_, _, controller), mean in scores(trials, definition).items():
        of_people.setdefault(controller, []).append(mean)  # type: ignore[arg-type]
    return {k: sign * float(np.mean(of_people[k])) for k in sorted(of_people, key=by_controller)}


def _higher_is_better(definition: str) -> bool:
    return definition in BY_NAME and BY_NAME[definition].better == "higher"


def swapped(order: str, other: str) -> list[tuple[int, int]]:
    """Pairs of controllers that two orders ("3 < 2 < 1") put the other way round."""
    first, second = ([int(k) for k in text.split(" < ")] for text in (order, other))
    return [
        (min(a, b), max(a, b))
        for i, a in enumerate(first)
        for b in first[i + 1 :]
        if a in second and b in second and second.index(a) > second.index(b)
    ]
