"""`phd analyze`: every number and figure of a study again, from its recordings and the journals beside them.

The journals say what no recording can: which trial was done again later, which was skipped, whether the key of a blind
session was opened. What is damaged or was cut off is left out and named; the boxes that it changes are compared with
the table in DIR.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

from core.control.controllers import Preset
from core.files import InputError
from experiments.analysis.boxplots import DRAWN, boxes, draw_boxplots, in_order
from experiments.analysis.findings import findings, why_no_findings
from experiments.analysis.report import side_by_side, warnings, write_report
from experiments.analysis.sensitivity import of_recording
from experiments.analysis.trials_table import COUNTED, TrialRow, read_table, write_table
from experiments.protocol import label
from experiments.recording.atomic_files import make_empty_folder, write_new_file
from experiments.recording.reader import read_recording
from experiments.session.blind import opened, read_key
from experiments.session.files import TABLE, hold_lock, read_stored, recordings_in
from experiments.session.journal import (
    KEY_OPENED,
    JournalSummary,
    journal_summary,
    recorded_row,
    rows_without_recording,
    write_event,
)
from experiments.session.session import operators_from_json, preset_from_json
from experiments.trial.inputs import OPERATOR


@dataclass
class _Read:
    """What was read."""

    rows: list[TrialRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    notes: set[str] = field(default_factory=set)  # of the report
    labels: set[str] = field(default_factory=set)  # of the figures
    protocols: set[str] = field(default_factory=set)  # names
    presets: dict[int, Preset] = field(default_factory=dict)
    simulated: bool = False  # simulated operators moved the handle, in some trials at least
    keys: dict[str, dict[str, int]] = field(default_factory=dict)  # participant -> key that was opened here


def analyze(
    folder: Path,
    out: Path | None = None,
    progress: Callable[[float], None] | None = None,
    unblind: str = "",
    timeouts: bool = False,
) -> dict:
    """Write trials.csv, the figures and the report into a new folder (default DIR/analysis-N); the summary.

    A recording that is damaged or was cut off is left out and named, here and on the figures, and `changed` gives what
    that does to each box. unblind: who opens the keys of blind sessions, for this analysis alone: it is written into
    their journals, and their own tables stay coded. timeouts: trials whose time was up are in boxes and statistics.
    InputError if there is nothing to analyze.
    """
    folder = Path(folder)
    sessions = {session: recordings_in(session) for session in sorted(folder.glob("sub-*/ses-*"))}
    count = sum(map(len, sessions.values()))
    if not count:
        raise InputError(f"{folder}: holds no recordings (sub-*/ses-*/trials/run-*)")
    out = new_folder(folder, out)
    read = _Read()
    try:
        done = 0
        for session, paths in sessions.items():
            journal = journal_summary(session)
            if unblind and journal.key is None:
                journal = _open_key(session, journal, unblind, out, read)
            if journal.key is not None:  # its recordings cannot name their controllers
                read.presets.update(read_stored(session).protocol.controllers)
            rows = []
            for path in paths:
                _read_one(folder, path, out, journal, rows, read)
                done += 1
                if progress:
                    progress(done / count)
            rows += rows_without_recording(session, journal)
            read.rows += sorted(rows, key=lambda row: row.run)
        write_table(out / "trials.csv", read.rows)
        warned = _conclude(out, read, timeouts) if read.rows else []
    except BaseException:
        if not any(out.iterdir()):
            out.rmdir()
        raise
    return {
        "out": str(out),
        "recordings": count,
        "trials": len(read.rows),
        "coded": sum(isinstance(row.controller, str) for row in read.rows),
        "left_out": read.left_out,
        "changed": changed_boxes(folder / "trials.csv", read.rows, read.keys, _labels(read)) if read.left_out else [],
        "warnings": warned,
    }


def _open_key(session: Path, journal: JournalSummary, who: str, out: Path, read: _Read) -> JournalSummary:
    """The journal with the key of a blind session, once it is journalled that it was opened."""
    about = read_stored(session).about
    if not about.get("blind"):
        return journal
    key = read_key(session, str(about.get("key_sha256")))
    lock = hold_lock(session)
    try:
        write_event(session, KEY_OPENED, who=who, analysis=str(out))
    finally:
        lock.release()
    read.keys[str(about["participant"])] = key
    return replace(journal, key=key)


def _read_one(folder: Path, path: Path, out: Path, journal: JournalSummary, rows: list[TrialRow], read: _Read) -> None:
    recording = read_recording(path)
    if not recording.whole:
        why = "; ".join(recording.damaged) or "cut off before its end"
        read.left_out.append(f"{path.relative_to(folder)} ({why})")
        return
    row = recorded_row(recording, out, journal)
    rows.append(row)
    about = recording.metadata
    operators = operators_from_json(about)
    protocol, hand = about.get("note", "protocol not recorded"), f"hand: {about.get('hand', 'not recorded')}"
    read.labels.add(f"{protocol}, {operators.label if operators else hand}")
    read.notes.add(f"{protocol}, {operators.note if operators else hand}")
    read.simulated |= about.get("hand") == OPERATOR
    read.protocols.add(str(about.get("protocol", "")))
    if isinstance(row.controller, int) and "preset" in about:
        read.presets[row.controller] = preset_from_json(about["preset"])


def _conclude(out: Path, read: _Read, timeouts: bool) -> list[str]:
    """Figures and report; the warnings of the report."""
    without = f", {count_of(read.left_out, 'recording')} left out" if read.left_out else ""
    label, note = (" / ".join(sorted(said)) + without for said in (read.labels, read.notes))
    protocol = " and ".join(sorted(read.protocols))
    rows, labels = told_apart(read.rows), _labels(read)
    draw_boxplots(rows, out / "figures", label, labels=labels, protocol=protocol, timeouts=timeouts)
    if not any(row.status in COUNTED for row in read.rows):
        return []
    controllers = dict(sorted(read.presets.items()))
    write_report(read.rows, out / "report", note, of_recording(out), controllers, read.simulated, timeouts)
    coded = any(isinstance(row.controller, str) for row in read.rows)
    found = [] if why_no_findings(controllers, coded) else findings(read.rows, timeouts)
    return warnings(read.rows, found, read.simulated)


def told_apart(rows: Sequence[TrialRow]) -> list[TrialRow]:
    """Rows whose codes name their participant, if there are several: each blind session has a key of its own."""
    if len({row.participant for row in rows if isinstance(row.controller, str)}) < 2:
        return list(rows)
    return [
        replace(row, controller=f"{row.participant} {row.controller}") if isinstance(row.controller, str) else row
        for row in rows
    ]


def _labels(read: _Read) -> dict[int, str]:
    """Controller -> its name under a box."""
    numbers = {row.controller for row in read.rows if isinstance(row.controller, int)}
    named = {number: label(preset.name) for number, preset in read.presets.items()}
    return {number: named.get(number, f"controller {number}") for number in sorted(numbers)}


def changed_boxes(
    table: Path, rows: Sequence[TrialRow], keys: Mapping[str, Mapping[str, int]], labels: Mapping[int, str]
) -> list[str]:
    """How each box of the figures differs from what `table` gives: its count of trials and its median.

    keys: participant -> key, of sessions that are blind in the table and not in the rows.
    """
    if not table.exists():
        return [f"{table}: there is no such table, so the figures cannot be compared with it"]
    try:
        before_rows = [opened(row, keys.get(row.participant, {})) for row in read_table(table)]
    except InputError as error:
        return [f"{error}, so the figures cannot be compared with it"]
    configurations = tuple(dict.fromkeys(row.configuration for row in (*before_rows, *rows)))
    changes = []
    for metric in DRAWN:
        before, after = (
            boxes(told_apart(r), metric.name, configurations, metric.scale) for r in (before_rows, rows)
        )
        for key in sorted({*before, *after}, key=in_order):
            old, new = before.get(key), after.get(key)
            if old and new and (old.count, old.median) == (new.count, new.median):
                continue
            controller = key[0] if isinstance(key[0], str) else labels.get(key[0], f"controller {key[0]}")
            box = f"{metric.title}, {' '.join(controller.split())}, {key[1]}"
            if old is None or new is None:
                counts = f"{old.count if old else 0} -> {new.count if new else 0} trials"
                changes.append(f"{box}: {counts}, {'the box is gone' if old else 'a new box'}")
                continue
            share = f" ({(new.median - old.median) / old.median:+.1%})" if old.median else ""
            changes.append(
                f"{box}: {old.count} -> {new.count} trials, "
                f"median {old.median:.4g} -> {new.median:.4g} {metric.shown_unit}{share}"
            )
    return changes


def read_studies(folders: Sequence[Path]) -> dict[str, list[TrialRow]]:
    """The trials of several studies, by the names of their folders. InputError if one cannot be compared."""
    studies: dict[str, list[TrialRow]] = {}
    for folder in folders:
        name = folder.resolve().name
        if name in studies:
            raise InputError(f"{folder}: another study of this name is named already, they cannot be told apart")
        rows = read_table(folder / TABLE)
        if not any(row.status in COUNTED for row in rows):
            raise InputError(f"{folder / TABLE}: holds no trial that counts, there is nothing to compare")
        presets = {
            number: preset
            for session in sorted(folder.glob("sub-*/ses-*"))
            for number, preset in read_stored(session).protocol.controllers.items()
        }
        if reason := why_no_findings(presets, any(isinstance(row.controller, str) for row in rows)):
            raise InputError(f"{folder / TABLE}: {reason}")
        studies[name] = rows
    return studies


def write_side_by_side(studies: Mapping[str, Sequence[TrialRow]], out: Path) -> Path:
    """The findings of several studies in one table; where it stands."""
    path = out / "side-by-side.md"
    write_new_file(path, side_by_side(studies).encode())
    return path


def count_of(things: Sequence, word: str) -> str:
    """As "1 recording", "2 recordings"."""
    return f"{len(things)} {word}{'s' if len(things) != 1 else ''}"


def new_folder(folder: Path, out: Path | None) -> Path:
    """The folder for the results: `out`, which must be new or empty, or the first free DIR/analysis-N."""
    if out is None:
        out = next(place for n in count(1) if not (place := folder / f"analysis-{n}").exists())
    make_empty_folder(out, "results are never overwritten")
    return out
