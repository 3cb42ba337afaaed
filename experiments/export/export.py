"""`phd export`: the recordings of a data folder for other programs, as BIDS-Motion or as CSV, whole or not at all.

What is damaged, was cut off or has no row in its session's table is left out and named. Practice trials stay behind.

Blind: as long as a session's table holds codes instead of controllers, whatever would give a controller away stays
behind too (what the brakes did, the seed of the plan); export again once the session has been opened.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import permutations
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import pyarrow as pa

from core.files import InputError
from experiments.analysis.trials_table import (
    DICTIONARY,
    STATUSES,
    DictionaryEntry,
    TrialRow,
    as_table,
    check_named,
    write_table,
)
from experiments.atomic_files import new_folders
from experiments.export.bids import AS_PROTOCOLS_SAY, BidsDataset, BidsOptions
from experiments.export.files import (
    DECISION_READING,
    PHASE_LEVELS,
    Exported,
    ExportedTrial,
    answers_and_notes,
    controller_levels,
    own_columns_described,
    recording_column,
    write_answers_and_notes,
    write_columns,
    write_json,
)
from experiments.progress import Progress, no_progress
from experiments.recording import TEXT_COLUMNS
from experiments.store.blind import without_telltales
from experiments.store.consent import agreed
from experiments.store.files import lost_recordings, recordings_in, refuse_no_folder, relative_to, rows_of, sessions_in
from experiments.store.journal import BEGUN, read_events
from experiments.store.recording import read_recording
from experiments.store.stored import read_stored

#: What an export shows of a trial while its session is blind.
_SHOWN_WHILE_BLIND = (
    "participant", "run", "block", "configuration", "controller", "path", "repetition", "start_m", "end_m",
    "path_shape", "protocol", "rules", "hand", "link", "assumed", "status", "reason", "energy_residual_J",
    "energy_added_max_J", "warnings",
)  # fmt: skip
_LEVELS = {"phase": PHASE_LEVELS, "status": STATUSES}


def export(
    folder: Path, outs: dict[str, Path], compress: bool = False, bids: BidsOptions = AS_PROTOCOLS_SAY,
    progress: Progress = no_progress,
) -> dict:  # fmt: skip
    """Write a data folder's recordings into new or empty folders, form ("bids", "csv") -> folder; the summary.

    One recording at a time is in memory. compress: the recordings of the CSV by gzip.

    InputError if there is nothing to export or a folder cannot be used; then, and after any error, nothing is left.
    """
    folder = Path(folder)
    refuse_no_folder(folder)
    there = sessions_in(folder)
    homes = there.folders
    paths = [path for home in homes for path in recordings_in(home)]
    if not paths:
        nothing = f"{folder}: holds no recordings (sub-*/ses-*/trials/run-*)"
        raise InputError("; ".join([nothing, *there.sentences(folder)]))
    sessions, left_out = _read_sessions(folder, homes, set(paths))
    left_out += there.sentences(folder)
    trials = 0
    with _new_folders(outs) as partial:
        forms = [
            BidsDataset(place, bids) if form == "bids" else CsvTables(place, compress)
            for form, place in partial.items()
        ]
        for number, path in enumerate(paths, start=1):
            home = path.parent.parent
            trial = (
                _trial_or_reason(path, sessions[home]) if home in sessions
                else "its session cannot be read"
            )  # fmt: skip
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
        consent = [session.agreed for session in sessions.values() if session.agreed is not None]
        unrecorded = [row for session in sessions.values() for row in session.unrecorded]
        for form in forms:
            form.finish(Exported(folder.resolve().name, left_out, blind, unrecorded, list(sessions), consent))
    summary = {"recordings": len(paths), "trials": trials, "left_out": left_out, "blind": blind}
    summary |= {"warnings": lost_recordings(homes)}
    return {form: str(out) for form, out in outs.items()} | summary


def _read_sessions(folder: Path, homes: list[Path], found: set[Path]) -> tuple[dict[Path, "_Session"], list[str]]:
    """Each session that can be read, by its folder; and what of the data folder is left out, and why.

    found: the recordings that are there.
    """
    sessions, left_out = {}, []
    for home in homes:
        try:
            sessions[home] = _session_of(home)
        except InputError as error:  # without its rows a session cannot say what its trials are
            left_out.append(relative_to(folder, str(error)))
            continue
        if sessions[home].agreed is False:
            left_out.append(f"{home.relative_to(folder).as_posix()} (the participant declined to take part)")
    for home, session in sessions.items():
        for row in session.recorded.values():
            path = home / row.recording
            if path not in found:
                left_out.append(f"{path.relative_to(folder).as_posix()} (has a row, but is not in the database)")
    return sessions, left_out


class _Session(NamedTuple):
    """A session without its recordings."""

    recorded: dict[str, TrialRow]  # by the name of the recording, without suffix
    unrecorded: list[TrialRow]
    blind: bool
    begun: dict[int, str]  # run number -> time of day
    software: str  # version of phd that recorded it
    agreed: bool | None  # the participant, to take part; None: not asked


def _session_of(folder: Path) -> _Session:
    rows = rows_of(folder)
    version, answer = "n/a", None
    with contextlib.suppress(InputError):  # `phd verify` names what is wrong
        about = read_stored(folder).about
        version, answer = str(about["versions"]["phd"]), agreed(about)
    return _Session(
        {Path(row.recording).stem: row for row in rows if row.recording},
        [row for row in rows if not row.recording],
        any(isinstance(row.controller, str) for row in rows),
        {entry.about["run"]: entry.time for entry in read_events(folder) if entry.event is BEGUN},
        version,
        answer,
    )


def _trial_or_reason(path: Path, session: _Session) -> ExportedTrial | str:
    """A trial to export, or why it is left out."""
    recording, home = read_recording(path), path.parent.parent
    if not recording.whole:
        return recording.faults
    if path.stem not in session.recorded:
        return "has no row yet"
    row = session.recorded[path.stem]
    try:
        check_named(recording)
    except InputError as error:
        return relative_to(home, str(error))
    about = {**recording.metadata, "controller": row.controller}
    outcome = {**recording.outcome, "status": row.status}  # a trial that was done may have been redone since
    blind = session.blind or isinstance(row.controller, str)  # a code
    if blind:
        about, outcome = ({k: of[k] for k in of if k in _SHOWN_WHILE_BLIND} for of in (about, outcome))
        row = without_telltales(row)
    return ExportedTrial(
        home.parent.name, home.name, recording, row, about, outcome, session.begun.get(row.run, ""), session.software,
        blind,
    )  # fmt: skip


@contextlib.contextmanager
def _new_folders(outs: dict[str, Path]) -> Iterator[dict[str, Path]]:
    """Folders to be filled, by form; see `new_folders`."""
    places = {form: Path(os.path.realpath(out)) for form, out in outs.items()}
    for a, b in permutations(places.values(), 2):
        if a == b or b in a.parents:
            raise InputError(f"{a}: two exports need two folders, neither inside the other")
    try:
        with new_folders(list(places.values()), "an export") as folders:
            yield dict(zip(places, folders, strict=True))
    except OSError as error:
        reason = f"{error.strerror or error}, so the export was given up"
        raise OSError(error.errno, reason, ", ".join(map(str, outs.values()))) from error


class CsvTables:
    """Tidy CSV, in a folder that exists and is empty: a file a recording, a row a tick; and what every column means.

    OUT/README.md
        trials.csv                  as in the data folder; `recording` names the CSV file
        questionnaire.csv           a row for each block that was asked about, if any was
        notes.csv                   the experimenter's notes, if there are any
        columns.json                file -> column -> unit and description
        sub-01/ses-01/run-001.csv   every tick; run-001.csv.gz where that was asked for
                      run-001.json  the trial: its path, rules, gain, how it ended
    """

    def __init__(self, folder: Path, compress: bool) -> None:
        self.folder, self._suffix = folder, ".csv.gz" if compress else ".csv"
        self._rows: list[TrialRow] = []
        self._columns: dict[str, DictionaryEntry] = {}

    def add(self, trial: ExportedTrial) -> None:
        """Write one recording and its metadata."""
        place = PurePosixPath(trial.subject, trial.session, f"run-{trial.row.run:03d}{self._suffix}")
        path = self.folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        recording = trial.recording
        unit = recording.metadata.get("command_unit", "A")
        self._columns |= {name: recording_column(name, unit) for name in trial.names}
        columns = {
            name: pa.array(recording.text(name), pa.string()) if name in TEXT_COLUMNS else recording.column(name)
            for name in trial.names
        }
        write_columns(path, columns, ",", header=True, missing="")
        about = {"trial": trial.about, "outcome": trial.outcome, "begun": trial.begun, "phd": trial.software}
        write_json(path.with_name(f"run-{trial.row.run:03d}.json"), about)
        self._rows.append(replace(trial.row, recording=str(place)))

    def finish(self, exported: Exported) -> None:
        order = sorted((*self._rows, *exported.unrecorded), key=lambda row: (row.participant, row.run))
        write_table(self.folder / "trials.csv", as_table(order))
        tables: dict[str, Mapping[str, DictionaryEntry]] = {
            "trials.csv": {**DICTIONARY, **own_columns_described(exported.sessions)},
            f"sub-*/ses-*/run-*{self._suffix}": self._columns,
        }
        tables |= write_answers_and_notes(self.folder, *answers_and_notes(exported.sessions))
        described = {name: _described(columns) for name, columns in tables.items()}
        for name, levels in controller_levels(order, exported.sessions).items():
            described["trials.csv"][name] |= {"levels": levels} if levels else {}
        write_json(self.folder / "columns.json", described)
        (self.folder / "README.md").write_bytes(exported.readme("csv"))


def _described(columns: Mapping[str, DictionaryEntry]) -> dict[str, dict]:
    entries: dict[str, dict[str, Any]] = {}
    for name, entry in columns.items():
        more = f" ({DECISION_READING})" if name == "decision" else ""
        entries[name] = {"unit": entry.unit, "description": entry.meaning + more}
        entries[name] |= {"levels": _LEVELS[name]} if name in _LEVELS else {}
    return entries
