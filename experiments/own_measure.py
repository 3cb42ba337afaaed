"""A measure as a file of one's own declares it, and the declaration as it is stored; see `analysis.own_measures`."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from core.files import InputError
from core.own_files import NAME, OwnFile, declared_by, run_own

KIND = "measures"  # of what a file declares
BETTER = ("lower", "higher")


class Measure(NamedTuple):
    """One measure, as a file declares it."""

    name: str  # its column in trials.csv; by custom the unit is its end: "overshoot_m"
    title: str
    unit: str  # "" for a number without one
    of: Callable[[Any], float | None]  # of a `Movement`; None: there is nothing to measure in this trial
    meaning: str = ""
    decimals: int = 2  # in reports
    better: str = "lower"  # or "higher"


def declared_measures(name: str, text: str) -> dict[str, Any]:
    """What the file of this name and text declares. InputError, one sentence, if it has no measures that can be."""
    return declared_by(name, text, declare)


def declare(name: str, text: str) -> dict[str, Any]:
    """Run the file: what it declares, as JSON holds it, without functions. InputError as `declared_measures`."""
    return {KIND: [[*measure[:3], *measure[4:]] for measure in run_measures(name, text)]}


def run_measures(name: str, text: str) -> tuple[Measure, ...]:
    """The measures of a file, which is run. InputError as `declared_measures`."""
    where, measures = f"{name}.py", getattr(run_own(name, text), "MEASURES", None)
    if not isinstance(measures, Sequence) or not measures or not all(isinstance(each, Measure) for each in measures):
        raise InputError(f"{where}: must have MEASURES = (Measure(..),), as docs/examples/protocols/my_measure.py has")
    _check(where, measures)
    for measure in measures:
        if not callable(measure.of):
            raise InputError(f"{where}: {measure.name}: of must be a function of a movement")
    return tuple(measures)


@functools.cache
def measures_in(own: OwnFile) -> tuple[Measure, ...]:
    """The measures that a file declares; it is not run. InputError: what is stored of it is damaged."""
    where = f"{own.name}.py"
    try:
        measures = tuple(
            Measure(name, title, unit, _not_here, *about) for name, title, unit, *about in own.declaration(KIND)
        )
        _check(where, measures)
    except (TypeError, ValueError, LookupError) as error:
        raise InputError(f"{where}: what it declares is damaged ({error})") from None
    return measures


def _not_here(_: object) -> float | None:
    raise TypeError("the declaration of a file has no code")


def _check(where: str, measures: Sequence[Measure]) -> None:
    """InputError unless tables, charts and reports can show all of them."""
    for measure in measures:
        name = measure.name
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise InputError(f"{where}: a measure's name must be of letters (a to z), digits and _, not {name!r}")
        texts = measure.title, measure.unit, measure.meaning
        if not all(isinstance(text, str) and text.isprintable() for text in texts) or not measure.title:
            raise InputError(f"{where}: {name}: title, unit and meaning must be text, in one line")
        if not isinstance(measure.decimals, int) or not 0 <= measure.decimals <= 9:
            raise InputError(f"{where}: {name}: decimals must be a whole number from 0 to 9, not {measure.decimals!r}")
        if measure.better not in BETTER:
            raise InputError(f"{where}: {name}: better must be one of {', '.join(BETTER)}, not {measure.better!r}")
    if len({measure.name for measure in measures}) < len(measures):
        raise InputError(f"{where}: two measures have the same name")
