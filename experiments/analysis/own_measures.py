"""Measures in a file of one's own: `measure = "my_measure.py"` in a protocol, beside the shipped ones everywhere.

The file declares `MEASURES`, each a `Measure` with a plain function of a `Movement` and its arrays. The text of the
file travels with every recording. Where a function raises an error or answers no finite number the trial stays, its
cell is empty, and the sentence that says so stands in `TrialRow.failed`.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from core.control.controllers import PARAMETERS
from core.files import InputError
from core.own_files import NAME, run_own, what_failed
from experiments.analysis.metrics import BY_NAME, MeasureFailed, Metric
from experiments.analysis.movement import Movement
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol

BETTER = ("lower", "higher")
#: Columns that tables with measures have besides: a measure of such a name would be taken for it.
TAKEN = {
    *BY_NAME, *PlannedTrial._fields, *PARAMETERS, "participant", "status", "recording", "energy_residual_J",
    "energy_added_max_J", "controller_name", "population", "rules", "kind", "operator", "filename", "acq_time",
}  # fmt: skip


class Measure(NamedTuple):
    """One measure, as a file declares it."""

    name: str  # its column in trials.csv; by custom the unit is its end: "overshoot_m"
    title: str
    unit: str  # "" for a number without one
    of: Callable[[Movement], float | None]  # None: there is nothing to measure in this trial
    meaning: str = ""
    decimals: int = 2  # in reports
    better: str = "lower"  # or "higher"


@dataclass(frozen=True)
class InFile:
    """The function of a measure; sent to another process, it is found there in the text of its file."""

    file: str  # without ".py"
    text: str
    name: str

    def __call__(self, movement: Movement) -> float | None:
        """Its answer. MeasureFailed, one sentence, if it gives none."""
        (measure,) = (measure for measure in _declared(self.file, self.text) if measure.name == self.name)
        module = run_own(self.file, self.text).__name__
        try:
            value = measure.of(movement)
            number = _number(value)
        except (Exception, SystemExit) as error:  # whatever the file does wrong
            raise MeasureFailed(f"{self.file}.py: {self.name}: {what_failed(error, module)}") from None
        if value is None:
            return None
        if number is None:
            words = " ".join(f"{type(value).__name__} {value!r}".split())[:60]
            raise MeasureFailed(f"{self.file}.py: {self.name}: answered no number ({words})")
        if not math.isfinite(number):
            raise MeasureFailed(f"{self.file}.py: {self.name}: answered {number}, which is no finite number")
        return number


def _number(value: object) -> float | None:
    """An answer as a float; None: it is no number. A truth is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    return float(value)


@functools.cache
def _declared(file: str, text: str) -> tuple[Measure, ...]:
    """InputError, one sentence, for a file that declares no measures."""
    where, measures = f"{file}.py", getattr(run_own(file, text), "MEASURES", None)
    if not isinstance(measures, Sequence) or not measures or not all(isinstance(each, Measure) for each in measures):
        raise InputError(f"{where}: must have MEASURES = (Measure(..),), as docs/examples/protocols/my_measure.py has")
    for measure in measures:
        name = measure.name
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise InputError(f"{where}: a measure's name must be of letters (a to z), digits and _, not {name!r}")
        if name in TAKEN:
            raise InputError(f"{where}: {name} is a column that tables have already: give the measure another name")
        texts = measure.title, measure.unit, measure.meaning
        if not all(isinstance(text, str) and text.isprintable() for text in texts) or not measure.title:
            raise InputError(f"{where}: {name}: title, unit and meaning must be text, in one line")
        if not isinstance(measure.decimals, int) or not 0 <= measure.decimals <= 9:
            raise InputError(f"{where}: {name}: decimals must be a whole number from 0 to 9, not {measure.decimals!r}")
        if measure.better not in BETTER:
            raise InputError(f"{where}: {name}: better must be one of {', '.join(BETTER)}, not {measure.better!r}")
        if not callable(measure.of):
            raise InputError(f"{where}: {name}: of must be a function of a movement")
    if len({measure.name for measure in measures}) < len(measures):
        raise InputError(f"{where}: two measures have the same name")
    return tuple(measures)


def metrics_in(file: str, text: str) -> tuple[Metric, ...]:
    """The measures of a file, as the shipped ones are. InputError, one sentence, if it declares none that can be."""
    return tuple(
        Metric(
            own.name, own.unit, own.title, own.title, own.meaning or own.title, InFile(file, text, own.name),
            shown_unit=own.unit, decimals=own.decimals, figure=f"file_own_{own.name}", compared=True, better=own.better,
        )
        for own in _declared(file, text)
    )  # fmt: skip


def own_metrics(protocol: Protocol) -> tuple[Metric, ...]:
    """The measures of a protocol's own file. InputError as `metrics_in`."""
    return metrics_in(protocol.measure.removesuffix(".py"), protocol.code[protocol.measure]) if protocol.measure else ()


def recorded_metrics(about: Mapping[str, Any]) -> tuple[Metric, ...]:
    """Those of the file that a recording's metadata hold. InputError as `metrics_in`."""
    kept = about.get("measure")
    if kept is None:
        return ()
    if not isinstance(kept, Mapping) or not all(isinstance(kept.get(key), str) for key in ("name", "text")):
        raise InputError("the metadata's measure must be a table with a name and a text")
    return metrics_in(kept["name"], kept["text"])
