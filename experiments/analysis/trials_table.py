"""trials.csv: one row a trial, from its recording: its place in the plan, its status and its measures.

UTF-8, comma, line feed, a header; numbers in the shortest form that reads back to the same double; an empty cell
where there was nothing to measure. The same rows give the same bytes.
"""

import csv
import io
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from core.files import InputError
from core.path import build_path, path_from
from experiments.analysis.metrics import BY_NAME, METRICS, NO_METRICS, Metric, Metrics, trial_metrics
from experiments.recording.atomic_files import give_new_name, refuse_existing_files, refusing, written_beside

if TYPE_CHECKING:  # the windows import the table, not what reads recordings
    from experiments.recording.schema import Recording

STATUSES = ("done", "timeout", "aborted", "redone", "recovered", "skipped", "stopped", "excluded")
#: Trials that ran until the end of the path or the end of their time: they have measures and are counted.
COUNTED = ("done", "timeout")
#: Trials that settle their cell of the plan: after any other the cell is run again. Aborted: the experimenter
#: ended it and gave a reason; stopped: the brakes-off, a fault or the end of the app cut it short; excluded: the
#: experimenter took it out of every result, for a reason.
SETTLED = ("done", "timeout", "aborted", "skipped", "excluded")


@dataclass(frozen=True)
class _Planned:
    """Which trial of the plan it was, and how it ended."""

    participant: str  # label, "01"
    run: int
    block: int
    configuration: str  # name of the device
    controller: int | str  # its number in the protocol, as in Table I; a code, "K3", while the session is blind
    segment: int
    repetition: int
    status: str  # one of STATUSES


def _measured(name: str, metrics: Sequence[Metric], base: type) -> type:
    columns = [(metric.name, float | None, None) for metric in metrics]
    return make_dataclass(name, columns, bases=(base,), frozen=True)


_FIRST = METRICS[: METRICS.index(BY_NAME["unreachable_share"]) + 1]  # of the first version


@dataclass(frozen=True)
class _Recorded(_measured("_Measured", _FIRST, _Planned)):
    """What came of it."""

    recording: str = ""  # path relative to the file that the row stands in, with "/"; empty: nothing could be kept
    energy_residual_J: float | None = None  # what the ledger leaves unexplained
    energy_added_max_J: float | None = None  # the most that any brake added in a step: must be none


@dataclass(frozen=True)
class TrialRow(_measured("_MeasuredSince", METRICS[len(_FIRST) :], _Recorded)):
    """One row; the fields are the columns, in order: the trial's place in the plan, its measures, its recording.

    Measures that came later stand at the end: a table of an earlier version lacks them, and is read all the same.
    """

    def with_metrics(self, metrics: Metrics) -> "TrialRow":
        """The same row with the measures of its trial."""
        return replace(self, **metrics._asdict())

    def seen_from(self, folder: str) -> "TrialRow":
        """The row for a table further up: `folder` (as "sub-01/ses-01") is where this one's table stands."""
        return replace(self, recording=str(PurePosixPath(folder) / self.recording)) if self.recording else self


def to_compare(rows: Iterable[TrialRow], timeouts: bool = False) -> list[TrialRow]:
    """The trials that boxes and statistics are made of: those that reached the end of the path.

    Our choice: what was measured until the time was up is not a measure of the whole path, so such a trial is counted
    and shown, and stays out unless `timeouts` asks for it. The paper reports none.
    """
    return [row for row in rows if row.status == "done" or timeouts and row.status == "timeout"]


COLUMNS = tuple(column.name for column in fields(TrialRow))
_FIRST_COLUMNS = COLUMNS[: COLUMNS.index("recording") + 1]  # the least that a table has: later ones came later
_KINDS = {column.name: column.type for column in fields(TrialRow)}


def is_code(cell: str) -> bool:
    """Whether this is the code of a controller in a blind session: K1, K2, .."""
    return re.fullmatch(r"K[1-9]\d*", cell) is not None


def by_controller(controller: int | str) -> tuple[bool, int, int | str]:
    """Sorts controllers: numbers first, then codes, each in their order."""
    return (True, len(controller), controller) if isinstance(controller, str) else (False, 0, controller)


def _cell(column: str, value: object) -> str:
    kind = _KINDS[column]
    if value is None and kind == float | None:
        return ""
    if kind == float | None and isinstance(value, int | float | np.number) and np.isfinite(value):
        return repr(float(value))
    if kind == int | str and isinstance(value, str) and is_code(value):
        return value
    if kind in (int, int | str) and isinstance(value, int | np.integer) and not isinstance(value, bool):
        return str(int(value))
    if kind is str and isinstance(value, str):
        return value
    raise ValueError(f"trials table: {column} cannot be {value!r}")


def table_bytes(rows: Iterable[TrialRow], header: bool = True) -> bytes:
    """The rows as they stand in the file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if header:
        writer.writerow(COLUMNS)
    for row in rows:
        if row.status not in STATUSES:
            raise ValueError(f"trials table: status {row.status!r} is not one of {', '.join(STATUSES)}")
        writer.writerow([_cell(column, getattr(row, column)) for column in COLUMNS])
    return text.getvalue().encode()


def write_table(path: str | Path, rows: Iterable[TrialRow], replacing: bool = False) -> None:
    """Write a whole table in one step: a reader finds the old one or the new one, after a crash too.

    InputError if the file exists, unless `replacing`, or cannot be there; OSError if the disk takes no more.
    """
    path = Path(path)
    data = table_bytes(rows)
    if not replacing:
        refuse_existing_files([path])
    with refusing(path, "the table cannot be written"), written_beside(path, data) as partial:
        if replacing:
            partial.replace(path)
        else:
            give_new_name(partial, path)


def append_row(path: str | Path, row: TrialRow) -> None:
    """Add a row at the end, making the table if there is none; the rows before are kept as they are."""
    path = Path(path)
    before = read_table(path) if path.exists() else []
    if before and path.read_bytes() != table_bytes(before):
        raise InputError(f"{path}: was changed by hand or by another version, adding a row would lose something")
    write_table(path, [*before, row], replacing=True)


def read_table(path: str | Path) -> list[TrialRow]:
    """The rows of a table, with their types; columns after the known ones are passed over. InputError if none."""
    path = Path(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the table cannot be read: {error}") from None
    known = min(len(lines[0]), len(COLUMNS)) if lines else 0
    if known < len(_FIRST_COLUMNS) or tuple(lines[0][:known]) != COLUMNS[:known]:
        raise InputError(f"{path}: the first line does not name the columns of a trials table")
    return [_row(path, number, lines[0], cells) for number, cells in enumerate(lines[1:], start=2)]


def _row(path: Path, number: int, header: Sequence[str], cells: Sequence[str]) -> TrialRow:
    if len(cells) != len(header):
        raise InputError(f"{path}: line {number} has {len(cells)} cells, not {len(header)}")
    values: dict[str, object] = {}
    for column, cell in zip(COLUMNS, cells, strict=False):  # an older table lacks the later columns
        kind = _KINDS[column]
        try:
            if kind is str:
                values[column] = cell
            elif kind is int or kind == int | str and not is_code(cell):
                values[column] = int(cell)
            elif kind == int | str:
                values[column] = cell
            else:
                values[column] = float(cell) if cell else None
        except ValueError:
            raise InputError(f"{path}: line {number}: {column} = {cell!r} is not a number") from None
    if values["status"] not in STATUSES:
        raise InputError(f"{path}: line {number}: status {cells[COLUMNS.index('status')]!r} is none of {STATUSES}")
    return TrialRow(**values)  # type: ignore[arg-type]


#: What a recording must say of its trial.
NEEDED = (
    "participant", "run", "block", "configuration", "controller", "segment", "repetition", "path",
)  # fmt: skip


def row_of(recording: "Recording", folder: Path) -> TrialRow:
    """A trial's row, from its recording alone; `folder`: where the table that gets it stands.

    InputError: the recording does not say which trial it is of, or cannot be measured. A trial that does not count (it
    was cut short, say by a force that is not a number) then has a row without measures.
    """
    about, outcome = recording.metadata, recording.outcome
    for key in NEEDED:
        if key not in about:
            raise InputError(f"{recording.path}: the metadata lack {key}")
    if "status" not in outcome:
        raise InputError(f"{recording.path}: the end record lacks the status")
    where = f"{recording.path}: path"
    path = build_path(path_from(about["path"], where), where)
    metrics = NO_METRICS
    if recording.in_phase("move").any():
        try:
            metrics = trial_metrics(recording, path)
        except InputError:  # ticks are missing, or a sample is no number: then nothing can be measured
            if outcome["status"] in COUNTED:
                raise
    place = os.path.relpath(recording.path, folder).replace(os.sep, "/")
    return TrialRow(
        about["participant"], about["run"], about["block"], about["configuration"], about["controller"],
        about["segment"], about["repetition"], outcome["status"], recording=place,
        energy_residual_J=outcome.get("energy_residual_J"), energy_added_max_J=outcome.get("energy_added_max_J"),
    ).with_metrics(metrics)  # fmt: skip
