"""Whether the order of the controllers depends on how a measure is defined, and how rough each is by which definition.

Definitions that the table holds: path error over progress, over time, at its peak; force over time, over progress;
weighted DFT sum, weighted rms, SPARC, weighted DFT sum of the exact acceleration. Definitions that need the recordings
(weights of the DFT, its highest frequency, the filter before differentiation, the source of the acceleration) stand in
`SMOOTHNESS`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.analysis.metrics import BY_NAME, METRICS, amplitude_sum, columns, tip_acceleration, weighted_amplitudes
from experiments.analysis.statistics import Result, configurations_of
from experiments.analysis.trials_table import TrialRow, to_compare
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording

#: What stands for one thing; the first is the definition that the figures use.
DEFINITIONS = {
    thing: tuple(metric.name for metric in METRICS if metric.stands_for == thing)
    for thing in dict.fromkeys(metric.stands_for for metric in METRICS if metric.stands_for)
}


class Smoothness(NamedTuple):
    """One definition of the weighted DFT sum."""

    cutoff_hz: float | None = 20.0  # of the low-pass on position; None: the simulator's own acceleration, unfiltered
    highest_hz: float = 100.0
    power: float = 1.0  # weight (f / 1 Hz)^power


#: One thing changed at a time.
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
}


def dft_sum(recording: Recording, how: Smoothness) -> float | None:
    """`metrics.acceleration_dft_sum` by another definition; None where there is nothing to measure."""
    if how.cutoff_hz is None:
        acceleration = None if recording.sensors else columns(recording, "tip_ax_m_s2", "tip_ay_m_s2")
    else:
        acceleration = tip_acceleration(columns(recording, "tip_x_m", "tip_y_m"), how.cutoff_hz)
    if acceleration is None:
        return None
    return amplitude_sum(weighted_amplitudes(acceleration[recording.in_phase("move")], how.highest_hz, how.power))


def sensitivity(
    rows: Sequence[TrialRow], folder: Path | None = None, timeouts: bool = False, none: int = 1
) -> list[Result]:
    """The order of controllers, best first, by each definition, and how well it agrees with the first one's.

    Controllers stand in the order of the mean over participants of their means. `value`: Kendall's tau with the first
    definition's order (1: the same order, -1: reversed). folder: rows name their recordings relative to it, from which
    the definitions of `SMOOTHNESS` are taken as well. timeouts: trials whose time was up count as well.
    Of smoothness also each controller's median over that of no control (number `none`), by each definition.
    """
    rows = to_compare(rows, timeouts)
    values = [dict(vars(row)) for row in rows]
    for row, of_row in zip(rows, values, strict=True):
        if folder and row.duration_s:
            recording = read_recording(folder / row.recording)
            of_row |= {name: dft_sum(recording, how) for name, how in SMOOTHNESS.items()}
    results = []
    for thing, named in DEFINITIONS.items():
        definitions = (*named, *SMOOTHNESS) if thing == "smoothness" and folder else named
        for configuration in configurations_of(rows):
            here = [of_row for of_row in values if of_row["configuration"] == configuration]
            people = len({of_row["participant"] for of_row in here})
            base = _means(here, definitions[0])
            for definition in definitions:
                means = _means(here, definition)
                common = [controller for controller in base if controller in means]
                if len(common) < 2:
                    continue
                tau = kendall_tau([base[k] for k in common], [means[k] for k in common])
                order = " < ".join(str(k) for k in sorted(means, key=means.__getitem__))
                about = ("order", definition, configuration, order, definitions[0], people, "kendall_tau")
                results.append(Result(*about, tau))
                if thing == "smoothness" and not _higher_is_better(definition):
                    results += _roughness(here, definition, configuration, people, none)
    return results


def kendall_tau(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Kendall's tau-b of two rankings of the same things; None where one of them is all ties."""
    i, j = np.triu_indices(len(first), 1)
    a, b = (np.sign(values[i] - values[j]) for values in (np.asarray(first), np.asarray(second)))
    untied = np.count_nonzero(a), np.count_nonzero(b)
    return float(a @ b / np.sqrt(untied[0]) / np.sqrt(untied[1])) if all(untied) else None


def _roughness(
    values: Sequence[Mapping], definition: str, configuration: str, people: int, none: int
) -> Iterator[Result]:
    """How many times as rough as no control each controller is: ratio of the medians of all trials."""
    cells: dict[int, list[float]] = {}
    for of_row in values:
        if of_row.get(definition) is not None:
            cells.setdefault(of_row["controller"], []).append(of_row[definition])
    uncontrolled = float(np.median(cells.pop(none, [0.0])))
    for controller in sorted(cells) if uncontrolled > 0.0 else ():
        about = ("roughness", definition, configuration, str(controller), str(none), people, "ratio_of_medians")
        yield Result(*about, float(np.median(cells[controller])) / uncontrolled)


def _means(values: Sequence[Mapping], definition: str) -> dict[int, float]:
    """Controller -> mean over participants of their means; less is better."""
    cells: dict[tuple[int, str], list[float]] = {}
    for of_row in values:
        if of_row.get(definition) is not None:
            cells.setdefault((of_row["controller"], of_row["participant"]), []).append(of_row[definition])
    sign = -1.0 if _higher_is_better(definition) else 1.0
    controllers = sorted({controller for controller, _ in cells})
    return {k: sign * float(np.mean([np.mean(v) for (j, _), v in cells.items() if j == k])) for k in controllers}


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
