"""Measures in a file of one's own: `measure = "my_measure.py"` in a protocol, beside the shipped ones everywhere.

The file declares `MEASURES`, each a `Measure` with a plain function of a `Movement` and its arrays. The text of the
file travels with every recording. Its functions run in a process beside this one (`core.own_process`). Where one raises
an error, answers no finite number, takes a minute or ends its process the trial stays, its cell is empty, and the
sentence that says so stands in `TrialRow.failed`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from core.control.controllers import PARAMETERS
from core.files import InputError
from core.own_consent import NotAllowed, refuse_unallowed
from core.own_files import OwnFile, run_own, what_failed
from core.own_process import OwnCodeFailed, call_apart
from experiments.analysis.metrics import BY_NAME, MeasureFailed, Metric
from experiments.analysis.movement import Movement
from experiments.own_measure import Measure, measures_in, run_measures
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol

__all__ = ["Measure", "metrics_in", "own_metrics", "recorded_metrics", "runnable_metrics", "why_not_run"]

#: Columns that tables with measures have besides: a measure of such a name would be taken for it.
TAKEN = {
    *BY_NAME, *PlannedTrial._fields, *PARAMETERS, "participant", "status", "recording", "energy_residual_J",
    "energy_added_max_J", "controller_name", "population", "rules", "kind", "filename", "acq_time",
}  # fmt: skip


@dataclass(frozen=True)
class InFile:
    """The function of a measure."""

    file: str  # without ".py"
    text: str
    name: str

    def __call__(self, movement: Movement) -> float | None:
        """Its answer. MeasureFailed, one sentence, if it gives none."""
        where = f"{self.file}.py: {self.name}"
        try:
            refuse_unallowed(f"{self.file}.py", self.text)
            found = call_apart(where, answer_of, self, movement)
        except (OwnCodeFailed, NotAllowed) as error:
            raise MeasureFailed(str(error)) from None
        return None if found is None else float(found)


def answer_of(measure: InFile, movement: Movement) -> float | None:
    """In the process beside this one: what the function answers. InputError, one sentence, if it is no number."""
    where, module = f"{measure.file}.py: {measure.name}", run_own(measure.file, measure.text).__name__
    (declared,) = (own for own in run_measures(measure.file, measure.text) if own.name == measure.name)
    try:
        value = declared.of(movement)
        number = _number(value)
    except BaseException as error:  # whatever the file does wrong
        raise InputError(f"{where}: {what_failed(error, module)}") from None
    if value is None:
        return None
    if number is None:
        words = " ".join(f"{type(value).__name__} {value!r}".split())[:60]
        raise InputError(f"{where}: answered no number ({words})")
    if not math.isfinite(number):
        raise InputError(f"{where}: answered {number}, which is no finite number")
    return number


def _number(value: object) -> float | None:
    """An answer as a float; None: it is no number. A truth is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    return float(value)


def metrics_in(own: OwnFile) -> tuple[Metric, ...]:
    """The measures of a file, as the shipped ones are. InputError, one sentence, if one cannot be."""
    for measure in measures_in(own):
        if measure.name in TAKEN:
            raise InputError(
                f"{own.name}.py: {measure.name} is a column that tables have already: give the measure another name"
            )
    return tuple(
        Metric(
            of.name, of.unit, of.title, of.title, of.meaning or of.title, InFile(own.name, own.text, of.name),
            shown_unit=of.unit, decimals=of.decimals, figure=f"file_own_{of.name}", compared=True, better=of.better,
        )
        for of in measures_in(own)
    )  # fmt: skip


def own_metrics(protocol: Protocol) -> tuple[Metric, ...]:
    """The measures of a protocol's own file. InputError as `metrics_in`."""
    return metrics_in(protocol.code[protocol.measure]) if protocol.measure else ()


def recorded_metrics(about: Mapping[str, Any]) -> tuple[Metric, ...]:
    """Those of the file that a recording's metadata hold. InputError as `metrics_in`."""
    kept = about.get("measure")
    if kept is None:
        return ()
    if not isinstance(kept, Mapping) or not all(isinstance(kept.get(key), str) for key in OwnFile._fields):
        raise InputError("the metadata's measure must be a table with a name, a text and what it declares")
    return metrics_in(OwnFile(kept["name"], kept["text"], kept["declared"]))


def runnable_metrics(about: Mapping[str, Any]) -> tuple[Metric, ...]:
    """The same, to be measured. NotAllowed: their file came out of a session's folder and may not run."""
    metrics = recorded_metrics(about)
    for metric in metrics[:1]:
        assert isinstance(metric.of, InFile)
        refuse_unallowed(f"{metric.of.file}.py", metric.of.text)
    return metrics


def why_not_run(about: Mapping[str, Any]) -> str:
    """Why the measures that a recording names may not be measured here; "": they may, or there are none."""
    try:
        runnable_metrics(about)
    except NotAllowed as refusal:
        return str(refusal)
    except InputError:  # said when they are measured
        return ""
    return ""
