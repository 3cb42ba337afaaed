"""`phd export`: the recordings of a data folder for other programs, as BIDS-Motion or as CSV, whole or not at all.

What is damaged, was cut off or has no row in its session's table is left out and named. Practice trials stay behind.

Blind: as long as a session's table holds codes instead of controllers, whatever would give a controller away stays
behind too (what the brakes did, the seed of the plan); export again once the session has been opened.
"""

import contextlib
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

from core.files import InputError
from experiments.analysis.trials_table import TrialRow, row_of
from experiments.export.bids import BidsDataset
from experiments.export.csv import CsvTables
from experiments.export.files import Exported, ExportedTrial
from experiments.recording.atomic_files import refusing, rename
from experiments.recording.reader import PARQUET_SUFFIX, STREAM_SUFFIX, read_recording
from experiments.session.files import HIDDEN, STORED, TABLE, recordings_in, rows_of
from experiments.session.journal import BEGUN, read_events

FORMS: dict[str, type[BidsDataset] | type[CsvTables]] = {"bids": BidsDataset, "csv": CsvTables}
#: What an export shows of a trial while its session is blind.
_SHOWN_WHILE_BLIND = (
    "participant", "run", "block", "configuration", "controller", "segment", "repetition", "start_m", "end_m", "path",
    "protocol", "rules", "hand", "link", "assumed", "status", "reason", "energy_residual_J", "energy_added_max_J",
    "warnings",
)  # fmt: skip


def export(folder: Path, outs: dict[str, Path], progress: Callable[[float], None] = lambda share: None) -> dict:
    """Write a data folder's recordings into new or empty folders, form ("bids", "csv") -> folder; the summary.

    InputError if there is nothing to export or a folder cannot be used; then, and after any error, nothing is left.
    """
    folder = Path(folder)
    homes = sorted(folder.glob("sub-*/ses-*"))
    paths = [path for home in homes for path in recordings_in(home)]
    if not paths:
        raise InputError(f"{folder}: holds no recordings (sub-*/ses-*/trials/run-*)")
    sessions = {home: _session_of(home) for home in homes}
    there = set(paths)
    left_out = [
        f"{(home / row.recording).relative_to(folder).as_posix()} (stands in {TABLE}, but is not there)"
        for home, session in sessions.items()
        for row in session.recorded.values()
        if there.isdisjoint((home / row.recording).with_suffix(suffix) for suffix in (PARQUET_SUFFIX, STREAM_SUFFIX))
    ]
    trials = 0
    with _new_folders(outs) as partial:
        forms = [FORMS[form](place) for form, place in partial.items()]
        for number, path in enumerate(paths, start=1):
            trial = _look_at(path, sessions[path.parent.parent])
            if isinstance(trial, str):
                left_out.append(f"{path.relative_to(folder).as_posix()} ({trial})")
            else:
                trials += 1
                for form in forms:
                    form.add(trial)
            progress(number / len(paths))
        if not trials:
            raise InputError(f"{folder}: none of its recordings can be exported: {'; '.join(left_out)}")
        blind = [home.relative_to(folder).as_posix() for home, session in sessions.items() if session.blind]
        unrecorded = [row for session in sessions.values() for row in session.unrecorded]
        for form in forms:
            form.finish(Exported(folder.resolve().name, left_out, blind, unrecorded, homes))
    summary = {"recordings": len(paths), "trials": trials, "left_out": left_out, "blind": blind}
    return {form: str(out) for form, out in outs.items()} | summary


class _Session(NamedTuple):
    """What the files of a session hold besides its recordings."""

    has_table: bool
    recorded: dict[str, TrialRow]  # by the name of the recording, without suffix
    unrecorded: list[TrialRow]
    blind: bool
    begun: dict[int, str]  # run number -> time of day
    software: str  # what it was recorded with


def _session_of(folder: Path) -> _Session:
    rows = rows_of(folder)
    version = "n/a"
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # damaged: `phd verify` names what is wrong
        version = str(json.loads((folder / STORED).read_text(encoding="utf-8"))["versions"]["phd"])
    return _Session(
        (folder / TABLE).exists(),
        {Path(row.recording).stem: row for row in rows if row.recording},
        [row for row in rows if not row.recording],
        any(isinstance(row.controller, str) for row in rows),
        {entry.about["run"]: entry.time for entry in read_events(folder) if entry.event is BEGUN},
        version,
    )


def _look_at(path: Path, session: _Session) -> ExportedTrial | str:
    """A trial to export, or why it is left out."""
    recording, home = read_recording(path), path.parent.parent
    if not recording.whole:
        return "; ".join(recording.damaged) or "cut off before its end"
    if session.has_table and path.stem not in session.recorded:
        return f"has no row in {TABLE}: the trial is not over, or phd recover has to look at it"
    row = session.recorded[path.stem] if session.has_table else row_of(recording, home)
    about = {**recording.metadata, "controller": row.controller}
    outcome = {**recording.outcome, "status": row.status}  # a trial that was done may have been redone since
    blind = session.blind or isinstance(row.controller, str)  # a code
    if blind:
        about, outcome = ({k: of[k] for k in of if k in _SHOWN_WHILE_BLIND} for of in (about, outcome))
        row = replace(row, **HIDDEN)
    return ExportedTrial(
        home.parent.name, home.name, recording, row, about, outcome, session.begun.get(row.run, ""), session.software,
        blind,
    )  # fmt: skip


@contextlib.contextmanager
def _new_folders(outs: dict[str, Path]) -> Iterator[dict[str, Path]]:
    """Form -> a folder beside its place; they get their names at the end, together, or are removed."""
    places = {form: Path(out).resolve() for form, out in outs.items()}
    for a, b in permutations(places.values(), 2):
        if a == b or b in a.parents:
            raise InputError(f"{a}: two exports need two folders, neither inside the other")
    partial: dict[str, Path] = {}
    try:
        for form, out in places.items():
            partial[form] = _begin(out)
        yield partial
        for form, out in places.items():
            if out.exists():
                out.rmdir()
            rename(partial[form], out)
    except OSError as error:
        reason = f"{error.strerror or error}, so the export was given up"
        raise OSError(error.errno, reason, ", ".join(map(str, outs.values()))) from error
    finally:
        for folder in partial.values():
            shutil.rmtree(folder, ignore_errors=True)


def _begin(out: Path) -> Path:
    """A new folder beside `out`, which must be new or empty; InputError otherwise."""
    partial = out.with_name(f".{out.name}.partial")
    with refusing(out, "cannot be created"):
        if out.exists() and any(out.iterdir()):
            raise InputError(f"{out}: is not empty, an export needs a new or empty folder")
        shutil.rmtree(partial, ignore_errors=True)  # left by a kill
        partial.mkdir(parents=True)
    return partial
