"""The table of trials: what its columns are, trials.csv and back, and what is said of trials.

A trial as it is closed is a `TrialRow`; a table of them is a pandas frame, which has every column of `DICTIONARY`, then
the measures of files of one's own: whole numbers, numbers (NaN: nothing was measured) and texts. pandas takes half a
second to load, so it is loaded where the first table is made.

trials.csv: UTF-8, comma, line feed, a header; numbers in the shortest form that reads back to the same double; an empty
cell where there is nothing. The same trials give the same bytes.
"""

import csv
import io
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from core import tick_log
from core.control.controllers import Preset
from core.files import InputError, refuse_no_file
from core.own_files import NAME
from core.path import Path as PathAhead
from core.path import build_path, path_from
from experiments.analysis.metrics import BY_NAME, METRICS, Metric, trial_metrics
from experiments.analysis.own_measures import runnable_metrics
from experiments.analysis.punctuality import Punctuality
from experiments.atomic_files import reason_of, replace_file, write_new_file
from experiments.protocol import label

if TYPE_CHECKING:  # the windows import the table, not what reads recordings
    import pandas as pd

    from experiments.recording import Recording

#: How a trial ended.
STATUSES = {
    "done": "the end of the path was reached",
    "timeout": "the time was up before the end; measures cover the progress made",
    "aborted": "ended by the experimenter, or a simulated operator could not go on; counts as not finished",
    "redone": "run again later, for a stated reason; kept, does not count",
    "recovered": "cut off by a crash and rescued; does not count",
    "skipped": "not run, for a stated reason",
    "stopped": "cut short by a fault, by brakes off or with the app; does not count, is run again",
    "excluded": "taken out of every result by the experimenter, for a stated reason; kept",
}
#: Trials that ran until the end of the path or the end of their time: they have measures and are counted.
COUNTED = ("done", "timeout")
#: Trials that could have reached the end. An aborted one counts as one that failed: who aborts it for a reason that is
#: not the participant's or the device's repeats or excludes it (our choice).
TRIED = (*COUNTED, "aborted")
#: Statuses after which a cell of the plan is not run again.
FINISHED = ("done", "timeout", "aborted", "skipped", "excluded")

_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?", re.ASCII)
_WHOLE_NUMBER = re.compile(r"-?\d{1,18}", re.ASCII)
CLIPPED = 0.999  # of the largest force of the hand's spring
LEAST_CLIPPED_S = 0.05  # a shorter time at it is not worth a word

Controller = int | str  # a code, "K3", while the session is blind
Trials: TypeAlias = "pd.DataFrame"  # a table of trials


@dataclass(frozen=True)
class TrialRow:
    """One row: the trial's place in the plan, how it ended, and its measures. What a column means: `DICTIONARY`."""

    participant: str  # "01"
    run: int
    block: int
    configuration: str
    controller: Controller
    path: int
    repetition: int
    status: str  # one of STATUSES
    recording: str = ""  # empty: nothing could be kept
    controller_name: str | None = None  # None: in a table of a version that had no such column
    #: Column -> value of those that have one: of `METRICS`, of a file of one's own, of the trial's energy ledger.
    measures: Mapping[str, float] = field(default_factory=dict, hash=False)
    #: Why measures of one's own file have no value: known where the trial has just been measured, in no table.
    failed: Mapping[str, str] = field(default_factory=dict, compare=False)

    def value(self, column: str) -> Any:
        """The value of a column; None where there is none."""
        return getattr(self, column) if column in _PLACES else self.measures.get(column)

    @property
    def own(self) -> dict[str, float]:
        """The measures of a file of one's own."""
        return {name: value for name, value in self.measures.items() if name not in DICTIONARY}

    def in_folder(self, folder: str) -> "TrialRow":
        """The row for a table further up: `folder` (as "sub-01/ses-01") is where this one's table stands."""
        return replace(self, recording=str(PurePosixPath(folder) / self.recording)) if self.recording else self


def to_compare(trials: Trials, timeouts: bool = False) -> Trials:
    """The trials that boxes and statistics are made of: those that reached the end of the path.

    Our choice: a trial that ran out of time has not been measured over the whole path, so it is counted and shown, and
    stays out unless `timeouts` asks for it. The paper reports none.
    """
    return trials[trials["status"].isin(COUNTED if timeouts else ("done",))]


class StudyData(NamedTuple):
    """The trials of a study or of sessions, with their controllers, protocol and notes."""

    trials: Trials
    controllers: Mapping[int, Preset]  # of the protocol
    protocol: str  # its name
    caption: str  # on every figure: "settled rules, low gain 5 N s/m, parameters assumed"
    note: str  # likewise, in the report
    simulated: bool  # operators, not people, moved the handle
    own: tuple[Metric, ...] = ()  # measures of the protocol's own file
    failed: tuple[str, ...] = ()  # why these have no value, once for each trial of which that is known

    @property
    def labels(self) -> dict[Controller, str]:
        """Controller of the rows -> its name in lines that fit under a box; a code has none."""
        numbers = sorted(k for k in controllers_of(self.trials) if isinstance(k, int))
        known = {number: label(preset.name) for number, preset in self.controllers.items()}
        return {number: known.get(number, f"controller {number}") for number in numbers}


class DictionaryEntry(NamedTuple):
    """The meaning of a column of a table."""

    meaning: str
    unit: str = ""  # "" for text, counts, and numbers without a unit
    kind: type = float  # of its cells; a controller may be a code in place of a whole number


_MEASURED = [(metric.name, DictionaryEntry(metric.meaning, metric.unit)) for metric in METRICS]
_FIRST = list(BY_NAME).index("unreachable_share") + 1  # measures that came later stand at the end
#: The columns, in their order. Measures are taken over the phase `move`; an empty cell: there was nothing to measure.
DICTIONARY: Mapping[str, DictionaryEntry] = {
    "participant": DictionaryEntry("label of the participant", kind=str),
    "run": DictionaryEntry("number of the trial in its session", kind=int),
    "block": DictionaryEntry("block within the configuration", kind=int),
    "configuration": DictionaryEntry("name of the device", kind=str),
    "controller": DictionaryEntry(
        "controller by its number in the protocol, or by its code while the session is blind", kind=int
    ),
    "path": DictionaryEntry("number of the path", kind=int),
    "repetition": DictionaryEntry("how often this cell of the plan has come, from 1", kind=int),
    "status": DictionaryEntry("how the trial ended", kind=str),
    **dict(_MEASURED[:_FIRST]),
    "recording": DictionaryEntry("file of the recording, relative to this file", kind=str),
    "energy_residual_J": DictionaryEntry("what the energy ledger of the trial leaves unexplained", "J"),
    "energy_added_max_J": DictionaryEntry("the most energy that any brake added in a step: must be none", "J"),
    **dict(_MEASURED[_FIRST:]),
    "controller_name": DictionaryEntry(
        "controller by its name in the protocol, or by its code while the session is blind", kind=str
    ),
}
COLUMNS = tuple(DICTIONARY)
_PLACES = tuple(name for name, entry in DICTIONARY.items() if entry.kind is not float)  # fields of a row
_LEDGER = ("energy_residual_J", "energy_added_max_J")
_FIRST_VERSION = COLUMNS[: COLUMNS.index("recording") + 1]  # the columns of the first version: any table has them
_ALWAYS_WRITTEN = COLUMNS[: COLUMNS.index(_LEDGER[-1]) + 1]  # any later one: only where some trial has a value


def with_name(row: TrialRow, names: Mapping[int, str]) -> TrialRow:
    """The row with its controller's name where it has none; a code is its own name."""
    if row.controller_name is not None:
        return row
    which = row.controller
    return replace(row, controller_name=which if isinstance(which, str) else names.get(which))


def is_code(cell: object) -> bool:
    """Whether this is the code of a controller in a blind session: K1, K2, .."""
    return isinstance(cell, str) and re.fullmatch(r"K[1-9]\d*", cell) is not None


def by_controller(controller: int | str) -> tuple[bool, int, int | str]:
    """Sorts controllers: numbers first, then codes, each in their order."""
    return (True, len(controller), controller) if isinstance(controller, str) else (False, 0, controller)


def _check(column: str, value: object) -> None:
    """ValueError for a value that the column cannot have."""
    kind = DICTIONARY[column].kind if column in DICTIONARY else float
    if kind is str or column == "controller" and is_code(value):
        fits = isinstance(value, str) or column == "controller_name" and value is None
    elif kind is int:
        is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        fits = is_whole and _WHOLE_NUMBER.fullmatch(str(value)) is not None
    else:
        fits = value is None or isinstance(value, int | float | np.number) and bool(np.isfinite(value))
    if not fits or column == "status" and value not in STATUSES:
        raise ValueError(f"trials table: {column} cannot be {value!r}")


def as_table(rows: Iterable[TrialRow]) -> Trials:
    """Rows as a table. ValueError for one that no table can hold."""
    rows = list(rows)
    for row in rows:
        for column, value in {**{name: row.value(name) for name in _PLACES}, **row.measures}.items():
            _check(column, value)
    own = sorted({name for row in rows for name in row.own})
    return _typed({name: [row.value(name) for row in rows] for name in (*COLUMNS, *own)})


def as_rows(trials: Trials) -> list[TrialRow]:
    """A table as rows."""
    places = [each.name for each in fields(TrialRow) if each.name in _PLACES]
    numbers = [name for name in trials if name not in _PLACES]

    def cells(names: Sequence[str]) -> Iterator[dict[str, Any]]:
        rows = zip(*(trials[name].tolist() for name in names), strict=True)
        return (dict(zip(names, row, strict=True)) for row in rows)

    rows = []
    for place, measured in zip(cells(places), cells(numbers), strict=True):
        place |= {name: None for name, value in place.items() if value != value}
        rows.append(TrialRow(**place, measures={name: value for name, value in measured.items() if value == value}))
    return rows


def _typed(columns: Mapping[str, Sequence]) -> Trials:
    """Columns with the types of `DICTIONARY`; those that are not there hold nothing."""
    import pandas as pd

    frame = {}
    for name, values in columns.items():
        kind = DICTIONARY[name].kind if name in DICTIONARY else float
        is_coded = kind is int and any(isinstance(value, str) for value in values)
        frame[name] = pd.Series(values, dtype=object if is_coded else kind)
    return complete(pd.DataFrame(frame))


def complete(trials: Trials) -> Trials:
    """The table with every column of `DICTIONARY`, first and in their order; those that it lacks hold nothing."""
    return trials.reindex(columns=[*COLUMNS, *(name for name in trials if name not in DICTIONARY)])


def table_bytes(trials: Trials) -> bytes:
    """The table as it stands in the file: a later measure has a column where some trial has it."""
    later = [name for name in COLUMNS[len(_ALWAYS_WRITTEN) :] if trials[name].notna().any()]
    return frame_bytes(trials[[*_ALWAYS_WRITTEN, *later, *own_columns(trials)]])


def own_columns(trials: Trials) -> list[str]:
    """The measures of files of one's own that some trial has."""
    own = [name for name in trials.select_dtypes("number") if name not in DICTIONARY]
    return sorted(name for name in own if trials[name].notna().any())


def controllers_of(trials: Trials) -> list[Controller]:
    """The controllers and codes, in their order."""
    return sorted(dict.fromkeys(trials["controller"].tolist()), key=by_controller)


def names_in(trials: Trials) -> dict[Controller, str]:
    """Controller or code -> its name, where the table has it."""
    named = trials.dropna(subset="controller_name")
    return dict(zip(named["controller"], named["controller_name"], strict=True))


def is_coded(trials: Trials) -> bool:
    """Whether some trial is of a blind session."""
    return any(isinstance(controller, str) for controller in controllers_of(trials))


def csv_bytes(lines: Iterable[Sequence[object]], delimiter: str = ",") -> bytes:
    """Lines of cells as a table's file holds them."""
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter, lineterminator="\n").writerows(lines)
    return text.getvalue().encode()


def frame_bytes(frame: "pd.DataFrame") -> bytes:
    """A frame as a table's file holds it."""
    return frame.to_csv(index=False, lineterminator="\n").encode()


def write_table(path: str | Path, trials: Trials, replacing: bool = False, sync: bool = True) -> None:
    """Write a whole table in one step: a reader finds the old one or the new one, after a crash too.

    InputError if the file exists, unless `replacing`, or cannot be there; OSError if the disk takes no more.
    """
    write = replace_file if replacing else write_new_file
    write(Path(path), table_bytes(trials), sync)


def read_table(path: str | Path) -> Trials:
    """The table of a file. InputError if there is none, or for a cell that is none of its column.

    A column of numbers that is not known is a measure of a file of one's own; any other that is not is passed over.
    """
    path = Path(path)
    refuse_no_file(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            lines = list(csv.reader(file))
    except OSError as error:
        raise InputError(f"{path}: the table cannot be read: {reason_of(error)}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: the table cannot be read: {error}") from None
    if not lines or tuple(lines[0][: len(_FIRST_VERSION)]) != _FIRST_VERSION:
        raise InputError(f"{path}: the first line does not name the columns of a trials table")
    header, *rows = lines
    for number, cells in enumerate(rows, start=2):
        if len(cells) != len(header):
            raise InputError(f"{path}: line {number} has {len(cells)} cells, not {len(header)}")
    table: dict[str, list] = {}
    for name, *cells in zip(*lines, strict=True):
        values = [_value(name, cell) for cell in cells]
        if name in DICTIONARY and _WRONG in values:
            wrong = values.index(_WRONG)
            kind = f"none of {', '.join(STATUSES)}" if name == "status" else "not a number"
            raise InputError(f"{path}: line {wrong + 2}: {name} = {cells[wrong]!r} is {kind}")
        if name in DICTIONARY or NAME.fullmatch(name) and any(cells) and _WRONG not in values:
            table[name] = values
    return _typed(table)


_WRONG = object()


def _value(column: str, cell: str) -> object:
    """The value of a cell; None where there is none, `_WRONG` for one that no table has there."""
    kind = DICTIONARY[column].kind if column in DICTIONARY else float
    if kind is str or column == "controller" and is_code(cell):
        return cell if column != "status" or cell in STATUSES else _WRONG
    if kind is int:
        return int(cell) if _WHOLE_NUMBER.fullmatch(cell) else _WRONG
    if not cell:
        return None
    return float(cell) if _NUMBER.fullmatch(cell) and np.isfinite(float(cell)) else _WRONG


#: What the metadata of a recording must hold: its place in the plan, in the order of a row, and the shape of its path.
NEEDED = (*COLUMNS[: COLUMNS.index("status")], "path_shape")


def row_of(recording: "Recording", folder: Path) -> TrialRow:
    """A trial's row, from its recording alone; `folder`: where the table that gets it stands.

    InputError: the recording does not name its trial, or cannot be measured. A trial that does not count (it was cut
    short, as by a force that is not a number) then has a row without measures.
    """
    about, outcome = recording.metadata, recording.outcome
    check_named(recording)
    where = f"{recording.path}: path_shape"
    path = build_path(path_from(about["path_shape"], where), where)
    measures: dict[str, float] = {}
    failed: dict[str, str] = {}
    if recording.in_phase("move").any():
        try:
            measures, failed = measure(recording, path)
        except InputError:  # ticks are missing, or a sample is no number: then nothing can be measured
            if outcome["status"] in COUNTED:
                raise
    row = TrialRow(
        **{key: about[key] for key in NEEDED[:-1]},
        status=outcome["status"],
        recording=os.path.relpath(recording.path, folder).replace(os.sep, "/") if recording.rows else "",
        controller_name=about.get("preset", {}).get("name"),
        measures=measures | ledger_of(outcome),
        failed=failed,
    )
    return with_name(row, {})


def ledger_of(outcome: Mapping[str, Any]) -> dict[str, float]:
    """The columns that come from a trial's energy ledger."""
    return {name: outcome[name] for name in _LEDGER if outcome.get(name) is not None}


def measure(
    recording: "Recording", path: PathAhead, metrics: Sequence[Metric] = METRICS, own: Sequence[Metric] | None = None
) -> tuple[dict[str, float], dict[str, str]]:
    """The measures of a trial that have a value, and why some of one's own file gave none, by name.

    own: of a file of one's own, None: that the recording names, if it may run.
    """
    failed: dict[str, str] = {}
    if own is None:
        try:
            own = runnable_metrics(recording.metadata)
        except InputError as error:  # as where a library is missing that the file needs
            own, failed = (), {"measure": str(error)}
    found = trial_metrics(recording, path, (*metrics, *own), failed)
    return {name: value for name, value in found.items() if value is not None}, failed


def without_value(trials: Trials, own: Iterable[Metric], failed: Iterable[str] = ()) -> list[str]:
    """A sentence for each measure that some trial that counts lacks, then the reasons that are known.

    Trials of blind sessions are left out: their tables hold no such measure. failed: a reason for each trial.
    """
    is_blind = trials["controller"].map(lambda controller: isinstance(controller, str)).astype(bool)
    counted = trials[trials["status"].isin(COUNTED) & ~is_blind]
    lacking = {m.title: int(counted[m.name].isna().sum()) if m.name in counted else len(counted) for m in own}
    of = f"of {len(counted)} trials that count"
    sentences = [f"{title} has no value in {n} {of}." for title, n in lacking.items() if n]
    return [*sentences, *(f"{why}, in {n} trial{'s' if n != 1 else ''}." for why, n in Counter(failed).items())]


def check_named(recording: "Recording") -> None:
    """InputError if a recording does not name its trial and its end, or by something that no row can hold."""
    about, outcome = recording.metadata, recording.outcome
    for key in NEEDED:
        if key not in about:
            raise InputError(f"{recording.path}: the metadata lack {key}")
    preset = about.get("preset", {})
    if not isinstance(preset, Mapping) or not isinstance(preset.get("name", ""), str):
        raise InputError(f"{recording.path}: the metadata's preset must be a table with a name")
    if "status" not in outcome:
        raise InputError(f"{recording.path}: the end record lacks the status")
    values = [(key, about[key]) for key in NEEDED[:-1]]
    values += [(name, outcome[name]) for name in _LEDGER if name in outcome]
    for column, value in values:
        try:
            _check(column, value)
        except (ValueError, TypeError, OverflowError):
            raise InputError(f"{recording.path}: {column} cannot be {value!r}") from None
    if outcome["status"] not in list(STATUSES):  # it may be anything
        known = ", ".join(STATUSES)
        raise InputError(f"{recording.path}: status {outcome['status']!r} is none of {known}")


def trial_flags(row: TrialRow, ticks: np.ndarray | None) -> list[str]:
    """What the experimenter should know of a trial before it is kept, as sentences; none: nothing is amiss.

    ticks: (n, tick_log.WIDTH), where they are at hand.
    """
    flags = [f"{reason}: the trial has no such measure" for reason in row.failed.values()]
    if row.status == "timeout":
        flags.append("Time ran out before the end was reached")
    if row.status == "aborted":
        flags.append("The trial was aborted")
    if ticks is None or not len(ticks):
        return flags
    move = ticks[ticks[:, tick_log.PHASE] == tick_log.MOVE]
    late = Punctuality().plus(ticks)
    if not late.usable:
        flags.append(late.words)
    most = move[:, tick_log.ARM_FORCE_MAX]
    force = np.hypot(move[:, tick_log.HAND_FX], move[:, tick_log.HAND_FY])
    left = int(np.count_nonzero((most[:-1] > 0.0) & (most[1:] == 0.0)))
    if left:
        often = "once" if left == 1 else f"{left} times"
        flags.append(f"The pointer left the picture {often}, and the hand let the handle go")
    clipped = 1e-3 * np.count_nonzero((most > 0.0) & np.isfinite(most) & (force >= CLIPPED * most))
    if clipped >= LEAST_CLIPPED_S:
        flags.append(f"The hand force was at its limit for {clipped:.2f} s")
    return flags
