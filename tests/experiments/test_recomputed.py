"""Three measures again, from an exported CSV and from the words of their definitions alone.

Nothing of ours computes here: csv, json, plain Python, numpy arrays and SciPy's filter. Ours is only asked at the end.
"""

import json
import math

import numpy as np
import pytest
from exports import rows as csv_rows
from protocols import short
from scipy import signal
from sessions import new_session, run_trials

from experiments.export.export import export


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Three trials of a simulated operator as CSV."""
    data = tmp_path_factory.mktemp("recomputed") / "study"
    session = new_session(data, protocol=short())
    run_trials(session, 3)
    session.close()
    export(data, {"csv": data.parent / "csv"})
    return data.parent / "csv"


def movement(folder, trial):
    """Ticks, numbers of the ticks of `move`, start and end of the path."""
    path = folder / trial["recording"]
    ticks = csv_rows(path)
    about = json.loads(path.with_suffix(".json").read_text())["trial"]
    move = [i for i, tick in enumerate(ticks) if tick["phase"] == "move"]
    return ticks, move, about["start_m"], about["end_m"]


def numbers(ticks, *names):
    return np.array([[float(tick[name]) for name in names] for tick in ticks])


def path_error(ticks, move, start, end):
    """|d| averaged over path progress: trapezoids over the running maximum of the projection, clipped to the ends."""
    length = math.dist(start, end)
    along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length]
    furthest, area, before = -math.inf, 0.0, None
    for i in move:
        x, y = float(ticks[i]["tip_x_m"]) - start[0], float(ticks[i]["tip_y_m"]) - start[1]
        distance = abs(along[0] * y - along[1] * x)
        furthest = max(furthest, min(max(along[0] * x + along[1] * y, 0.0), length))
        if before is None:
            first = furthest
        else:
            area += 0.5 * (distance + before[1]) * (furthest - before[0])
        before = furthest, distance
    return area / (furthest - first)


def mean_tip_force(ticks, move, *_):
    """Time mean of |hand force|."""
    return math.fsum(math.hypot(float(ticks[i]["hand_fx_N"]), float(ticks[i]["hand_fy_N"])) for i in move) / len(move)


def acceleration_dft_sum(ticks, move, *_):
    """Sum over f up to 100 Hz of (f / 1 Hz) sqrt(|Ax|^2 + |Ay|^2), single-sided amplitudes 2/N, mean removed.

    Acceleration: tip position under a 4th-order Butterworth low-pass of 20 Hz, forward and backward, over the whole
    recording at 1 kHz, two central differences, then the ticks of `move`. The DFT is summed term by term.
    """
    low_pass = signal.butter(4, 20.0, fs=1000.0, output="sos")
    x = signal.sosfiltfilt(low_pass, numbers(ticks, "tip_x_m", "tip_y_m"), axis=0)
    i = np.array(move)
    a = (x[i + 2] - 2.0 * x[i] + x[i - 2]) / (2.0 * 0.001) ** 2
    a = a - a.sum(axis=0) / len(a)
    n, total = len(a), 0.0
    for k in range(1, n):
        f = k * 1000.0 / n
        if f > 100.0:
            break
        turn = np.exp(-2j * np.pi * ((k * np.arange(n)) % n) / n)
        total += f * 2.0 / n * math.sqrt(abs(turn @ a[:, 0]) ** 2 + abs(turn @ a[:, 1]) ** 2)
    return total


@pytest.mark.parametrize(
    ("column", "again", "rounding"),
    [
        ("path_error_m", path_error, 1e-12),
        ("mean_tip_force_N", mean_tip_force, 1e-13),
        ("acceleration_dft_sum", acceleration_dft_sum, 1e-11),
    ],
)
def test_every_trial_has_the_measure_that_its_ticks_give(out, column, again, rounding):
    trials = csv_rows(out / "trials.csv")
    assert len(trials) == 3
    for trial in trials:
        assert again(*movement(out, trial)) == pytest.approx(float(trial[column]), rel=rounding), trial["recording"]
