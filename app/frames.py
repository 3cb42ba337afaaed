"""Studies, scenes, recordings and replays as pandas frames, with the units of their columns in `attrs["units"]`."""

import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from app.progress import ProgressBar
from core.device import Device
from core.files import InputError
from experiments.analysis.charts import boxes as _boxes
from experiments.analysis.metrics import BY_NAME, Metric
from experiments.analysis.own_measures import own_metrics, recorded_metrics
from experiments.analysis.statistics import NAMED, configurations_of, with_names
from experiments.analysis.statistics import statistics as _statistics
from experiments.analysis.trials_table import DICTIONARY, as_table, complete, names_in, own_columns, read_table
from experiments.export.files import RECORDING, own_columns_described
from experiments.protocol import Protocol, load_protocol, read_protocol
from experiments.simulate.scene import read_scene, scene_file
from experiments.simulate.simulate import ENERGY_COLUMNS, simulate
from experiments.store.files import TABLE, pooled_rows, sessions_in
from experiments.store.own_code import allow_code, unallowed_code
from experiments.store.recording import read_recording
from experiments.study.replay import Replacement
from experiments.study.replay import replay as _replay
from experiments.study.unrecorded import study_in_processes, with_low_gain_found
from experiments.trial.population import USUAL, load_population
from experiments.trial.real_trial import load_kernels


class Frame(pd.DataFrame):
    """A pandas frame that shows all of its columns, each in full."""

    @property
    def _constructor(self) -> type["Frame"]:
        return Frame

    def __repr__(self) -> str:
        with pd.option_context("display.max_columns", None, "display.max_colwidth", None):
            return super().__repr__()

    def _repr_html_(self) -> str | None:
        with pd.option_context("display.max_columns", None, "display.max_colwidth", None):
            return super()._repr_html_()


def run_scene(scene: str | Path, folder: str | Path | None = None) -> pd.DataFrame:
    """Simulate a scene: one row per output interval, as in the CSV of `phd simulate`.

    scene: a shipped name, a file, or the text of one, whose paths are relative to `folder` (default: the current one).
    attrs["summary"]: what `phd simulate` prints. Its warnings are Python warnings.
    """
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary) / "motion.csv"
        text = str(scene) if "\n" in str(scene) else None
        read = read_scene(scene_file(scene)) if text is None else read_scene(Path(folder or ".") / "scene", text)
        summary = simulate(read, out)
        frame = Frame(pd.read_csv(out, keep_default_na=False, na_values={}))
    for warning in summary.pop("warnings"):
        warnings.warn(warning, stacklevel=2)
    units = {name: RECORDING[name].unit if name in RECORDING else "" for name in frame}
    frame.attrs = {"units": units | dict.fromkeys(ENERGY_COLUMNS, "J"), "summary": summary}
    return frame


def run_study(  # noqa: PLR0913 (one call does it all, as in scikit-learn)
    protocol: str | Path | Protocol = "paper",
    operators: int = 3,
    population: str | Path = USUAL,
    devices: Sequence[str | Path | Device] | None = None,
    n_jobs: int = 1,
    progress: bool = False,
    **overrides: Any,
) -> pd.DataFrame:
    """Simulate a study: one row per trial, the numbers of `phd study` without recordings.

    protocol: a shipped name, a file, or what `protocol` returns. devices: shipped names, files, or what `device`
    returns; None: the protocol's. n_jobs: processes, -1: one per core; the results do not depend on it.
    progress: show a bar on stderr. overrides: seed, rules, low_gain, sensing, in place of the protocol's.
    """
    if n_jobs == 0 or n_jobs < -1 or operators < 1:
        raise InputError("n_jobs must be at least 1, or -1 for one a core, and operators at least 1")
    people = load_population(population)
    load_kernels()
    if isinstance(protocol, Protocol):
        asked = read_protocol(protocol.text, Path(), protocol.name, devices, **overrides)
    else:
        asked = load_protocol(protocol, devices=devices, **overrides)
    chosen = with_low_gain_found(asked, people)
    own_metrics(chosen)  # InputError: its own measures cannot be used
    bar = ProgressBar("simulating") if progress else None
    rows = []
    for number, those in enumerate(study_in_processes(chosen, people, operators, n_jobs), start=1):
        rows += those
        if bar is not None:
            bar(number / operators)
    if bar is not None:
        bar.close()
    trials = as_table(rows)
    return _with_units(trials, {metric.name: metric.unit for metric in own_metrics(chosen)})


def load_trials(folder: str | Path) -> pd.DataFrame:
    """Read the trials of a study or of sessions: one row per trial. NaN: no value.

    folder: of a study or of sessions, or a trials.csv.
    """
    path = Path(folder)
    sessions = sessions_in(path).folders if path.is_dir() and not (path / TABLE).exists() else []
    trials = as_table(pooled_rows(path)) if sessions else read_table(path / TABLE if path.is_dir() else path)
    sessions = sorted(path.glob("sub-*/ses-*")) if own_columns(trials) else []
    return _with_units(trials, {name: entry.unit for name, entry in own_columns_described(sessions).items()})


def load_recording(file: str | Path) -> pd.DataFrame:
    """Read the ticks of a recording: one row per millisecond; phase, decision and stuck are categories.

    file: run-*.parquet of a session. attrs: metadata, outcome. InputError: it is damaged or was cut off.
    """
    recording = read_recording(file)
    if not recording.whole:
        raise InputError(f"{file}: {recording.faults}")
    frame = Frame(
        {
            name: pd.Categorical.from_codes(values.astype(int), list(recording.words[name]))
            if name in recording.words
            else values
            for name, values in recording.columns.items()
        }
    )
    units = {name: RECORDING[name].unit for name in frame}
    frame.attrs = {"units": units, "metadata": recording.metadata, "outcome": recording.outcome}
    return frame


def replay(
    file: str | Path, controller: int | str | None = None, device: str | None = None, run_own_code: bool = False
) -> pd.DataFrame:
    """Simulate the hand of a recorded trial again: each measure before and after.

    file: run-*.parquet of a session. controller: name or number; device: shipped name or file; None: as recorded.
    run_own_code: allow, now and later, the folder's own controllers and measures.
    attrs["summary"]: what `phd replay` prints.
    """
    if run_own_code:
        allow_code(unallowed_code(Path(file).absolute().parent.parent).values())
    load_kernels()
    summary = _replay(file, Replacement(controller, device))
    frame = Frame.from_dict(summary["metrics"], orient="index", columns=["before", "after", "change"])
    for warning in summary["warnings"]:
        warnings.warn(warning, stacklevel=2)
    measures = BY_NAME | {metric.name: metric for metric in recorded_metrics(read_recording(file).metadata)}
    frame.attrs = {"units": {name: measures[name].unit for name in frame.index}, "summary": summary}
    return frame


def boxes(trials: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Median, quartiles, whiskers and outliers of a measure: one row per controller and device (`configuration`).

    trials: from `run_study` or `load_trials`. measure: a column, such as "path_error_m".
    """
    trials, metric = complete(trials), _metric(measure, trials)
    found = _boxes(trials, metric, configurations_of(trials))
    index = pd.MultiIndex.from_tuples(list(found), names=["controller", "configuration"])
    frame = Frame([box._asdict() for box in found.values()], index=index).sort_index()
    frame.insert(0, "controller_name", frame.index.get_level_values("controller").map(names_in(trials)))
    numbers = ["median", "q1", "q3", "low", "high"]
    frame[numbers] = frame[numbers] / metric.scale
    frame["outliers"] = [tuple(value / metric.scale for value in values) for values in frame["outliers"]]
    frame.attrs = {"units": dict.fromkeys((*numbers, "outliers"), metric.unit)}
    return frame


def statistics(trials: pd.DataFrame) -> pd.DataFrame:
    """The statistics of `phd analyze`: means, Friedman, each pair of controllers, trends, speed.

    trials: from `run_study` or `load_trials`.
    """
    trials = complete(trials)
    return Frame(with_names(_statistics(trials), names_in(trials)), columns=list(NAMED))


def _metric(name: str, trials: pd.DataFrame) -> Metric:
    known = [*BY_NAME, *own_columns(trials)]
    if name not in known:
        raise InputError(f"there is no measure {name!r}; there are {', '.join(known)}")
    unit = trials.attrs.get("units", {}).get(name, "")
    return BY_NAME.get(name) or Metric(name, unit, name, name, name, lambda _: None, unit)


def _with_units(trials: pd.DataFrame, own: Mapping[str, str]) -> pd.DataFrame:
    """own: unit of each measure of the experiment's own file."""
    frame = Frame(trials)
    frame.attrs = {
        "units": {name: DICTIONARY[name].unit if name in DICTIONARY else own.get(name, "") for name in trials}
    }
    return frame
