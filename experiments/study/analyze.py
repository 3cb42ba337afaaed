"""`phd analyze`: every number and figure of a study again, from its recordings and the journals beside them.

The journals say what no recording can: which trial was done again later, which was skipped, whether the key of a blind
session was opened. What is damaged or was cut off is left out and named; every box is compared with the
rows in DIR, and those that differ are named.
"""

import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from core.control.controllers import Preset
from core.files import InputError
from experiments.analysis.chart_figures import SCREEN, draw_boxplots
from experiments.analysis.charts import boxes, disambiguate_codes
from experiments.analysis.findings import why_no_findings
from experiments.analysis.metrics import DRAWN, Metric
from experiments.analysis.own_measures import recorded_metrics, why_not_run
from experiments.analysis.report import side_by_side, write_report
from experiments.analysis.simulation_errors import Moved
from experiments.analysis.trials_table import (
    COUNTED,
    StudyData,
    TrialRow,
    Trials,
    as_table,
    by_controller,
    is_coded,
    row_of,
    write_table,
)
from experiments.atomic_files import first_free, make_empty_folder, reading_stored, write_new_file
from experiments.inputs import is_person
from experiments.numbers import percent, significant
from experiments.plan import counted
from experiments.progress import Progress, no_progress
from experiments.store.blind import unblinded
from experiments.store.database import Database
from experiments.store.files import (
    TABLE,
    InUse,
    hold_lock,
    lost_recordings,
    pooled_rows,
    recordings_in,
    refuse_no_folder,
    relative_to,
    rows_of,
    sessions_in,
)
from experiments.store.journal import (
    KEY_OPENED,
    NAME,
    JournalSummary,
    JournalWriter,
    journal_summary,
)
from experiments.store.metadata import operators_from_json, preset_from_json
from experiments.store.recording import read_recording
from experiments.store.repair import RECOVERED
from experiments.store.stored import read_stored
from experiments.study.gap_reading import gap_otherwise_in
from experiments.study.unrecorded import errors_in


@dataclass
class Found:
    """Rows of the recordings read so far, and what figures and report name."""

    rows: list[TrialRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    notes: set[str] = field(default_factory=set)  # of the report
    captions: set[str] = field(default_factory=set)  # of the figures
    protocols: set[str] = field(default_factory=set)  # names
    presets: dict[int, Preset] = field(default_factory=dict)
    own: dict[str, Metric] = field(default_factory=dict)  # measures of the protocols' own files, by name
    simulated: bool = False  # simulated operators moved the handle, in some trials at least
    keys: dict[str, dict[str, int]] = field(default_factory=dict)  # participant -> key that was opened here
    kept: Counter[str] = field(default_factory=Counter)  # why measures are those of the session's row -> trials
    doubts: list[str] = field(default_factory=list)  # faults of the journals, a sentence each

    @property
    def data(self) -> StudyData:
        """The trials, for figures and report, which say how many recordings were left out."""
        left_out = len(self.left_out)
        without = f", {left_out} recording{'s' if left_out != 1 else ''} left out" if left_out else ""
        caption, note = (" / ".join(sorted(named)) + without for named in (self.captions, self.notes))
        presets, protocol = dict(sorted(self.presets.items())), " and ".join(sorted(self.protocols))
        counted = [row for row in self.rows if row.status in COUNTED and isinstance(row.controller, int)]
        failed = tuple(reason for row in counted for reason in row.failed.values())
        own, trials = tuple(self.own.values()), as_table(self.rows)
        return StudyData(trials, presets, protocol, caption, note, self.simulated, own, failed)

    @property
    def coded(self) -> int:
        """Rows whose session is blind."""
        return sum(isinstance(row.controller, str) for row in self.rows)


def analyze(
    folder: Path,
    out: Path | None = None,
    unblind: str = "",
    timeouts: bool = False,
    purpose: str = SCREEN,
    progress: Progress = no_progress,
) -> dict:
    """Write trials.csv, the figures and the report into a new folder (default DIR/analysis-N); the summary.

    A recording that is damaged or was cut off is left out and named, here and on the figures; `changed` gives each box
    that is not what the rows in DIR give. unblind: who opens the keys of blind sessions, for this analysis alone: it
    is written into their journals, and their own tables stay coded. timeouts: trials whose time was up are in boxes and
    statistics.
    purpose: of the figures, as `draw_boxplots` has it.
    InputError if there is nothing to analyze.
    """
    folder = Path(folder)
    refuse_no_folder(folder)
    there = sessions_in(folder)
    sessions = {session: recordings_in(session) for session in there.folders}
    recordings = sum(map(len, sessions.values()))
    if not recordings:
        nothing = f"{folder}: holds no recordings (sub-*/ses-*/trials/run-*)"
        raise InputError("; ".join([nothing, *there.sentences(folder)]))
    out = out or first_free(folder, "analysis")
    make_empty_folder(out, "results are never overwritten")
    found, done = Found(left_out=there.sentences(folder)), 0
    try:
        for session, paths in sessions.items():
            try:
                journal = _journal_of(session, folder, out, unblind, found)
            except InUse:
                raise
            except InputError as error:
                found.left_out.append(relative_to(folder, str(error)))
                continue
            rows: list[TrialRow] = []
            stored = {row.run: row for row in rows_of(session)}
            for path in paths:
                rows += read_one(path, folder, out, (journal, stored), found)
                done += 1
                progress(done / recordings)
            rows += [journal.row(row) for row in stored.values() if not row.recording and row.status != RECOVERED]
            found.rows += sorted(rows, key=lambda row: row.run)
        write_table(out / "trials.csv", as_table(found.rows))
        warned = conclude(folder, out, found, timeouts, purpose) if found.rows else []
    except BaseException:  # an interrupt too: an analysis is there whole or not at all
        _remove_results(out)
        raise
    return {
        "out": str(out),
        "recordings": recordings,
        "trials": len(found.rows),
        "coded": found.coded,
        "left_out": found.left_out,
        "changed": changed_boxes(folder, found, timeouts),
        "warnings": [*lost_recordings(there.folders), *found.doubts, *_kept_measures(found), *warned],
    }


def _kept_measures(found: Found) -> list[str]:
    """A sentence for each file of measures that was not run."""
    return [
        f"{why}: its measures are those that were recorded with the session, in {counted(trials, 'trial')}"
        for why, trials in found.kept.items()
    ]


def _remove_results(out: Path) -> None:
    for folder in (out / "figures", out / "report"):
        shutil.rmtree(folder, ignore_errors=True)
    (out / TABLE).unlink(missing_ok=True)
    if not any(out.iterdir()):
        out.rmdir()


def _journal_of(session: Path, folder: Path, out: Path, unblind: str, found: Found) -> JournalSummary:
    """The journal of a session, whose key is opened if `unblind` says by whom."""
    journal = journal_summary(session)
    name = session.relative_to(folder) / NAME
    found.doubts += [f"{name}: {fault}: what it said is not in this analysis" for fault in journal.faults]
    if unblind and journal.key is None:
        journal = open_key(session, journal, unblind, out, found)
    if journal.key is not None:  # its recordings cannot name their controllers
        try:
            found.presets.update(read_stored(session).protocol.controllers)
        except InputError as error:
            found.doubts.append(relative_to(folder, str(error)))
    return journal


def open_key(session: Path, journal: JournalSummary, who: str, out: Path, found: Found) -> JournalSummary:
    """The journal with the key of a blind session, once it is journalled that it was opened."""
    stored = read_stored(session)
    if not stored.about["blind"]:
        return journal
    with hold_lock(session), Database(session) as database:
        JournalWriter(database).write(KEY_OPENED, who=who, analysis=str(out))
    found.keys[stored.participant] = stored.key
    return replace(journal, key=stored.key)


def read_one(
    path: Path, folder: Path, out: Path, said: tuple[JournalSummary, Mapping[int, TrialRow]], found: Found
) -> list[TrialRow]:
    """The row of a recording, or none; what its figures and report are to name goes into `found`.

    said: the journal of its session, and its rows by run: they have the measures of a file that may not run here.
    """
    journal, stored = said
    recording = read_recording(path)
    if not recording.whole:
        found.left_out.append(f"{path.relative_to(folder)} ({recording.faults})")
        return []
    about = recording.metadata
    try:
        row = row_of(recording, out)
        if why := why_not_run(about):
            own = stored[row.run].own if row.run in stored else {}
            row = replace(row, measures={**row.measures, **own}, failed={})
            found.kept[why] += 1
        row = journal.row(row)
        with reading_stored(path):
            operators = operators_from_json(about)
            preset = preset_from_json(about["preset"]) if "preset" in about else None
            simulated = not is_person(about.get("hand", ""))
    except InputError as error:
        found.left_out.append(relative_to(folder, str(error)))
        return []
    protocol, hand = about.get("note", "protocol not recorded"), f"hand: {about.get('hand', 'not recorded')}"
    found.captions.add(f"{protocol}, {operators.label if operators else hand}")
    found.notes.add(f"{protocol}, {operators.note if operators else hand}")
    found.simulated |= simulated
    found.protocols.add(str(about.get("protocol", "")))
    if isinstance(row.controller, int) and preset is not None:
        found.presets[row.controller] = preset
    if "measure" not in row.failed:
        found.own |= {metric.name: metric for metric in recorded_metrics(about)}
    return [row]


def conclude(folder: Path, out: Path, found: Found, timeouts: bool, purpose: str) -> list[str]:
    """Draw the figures and write the report; its warnings."""
    data = found.data
    draw_boxplots(data, out / "figures", timeouts=timeouts, purpose=purpose)
    if not any(row.status in COUNTED for row in found.rows):
        return []
    moved: list[Moved] = []
    gap = None
    unsure = []
    if found.simulated:
        try:
            moved, gap = errors_in(folder), gap_otherwise_in(folder)
        except InputError as error:  # another version's operator
            unsure = [f"{error}, so the report has no error bars"]
    warned = write_report(data, out / "report", timeouts, moved, lambda name: read_recording(out / name), gap)
    return [*warned, *unsure]


def changed_boxes(folder: Path, found: Found, timeouts: bool) -> list[str]:
    """How each box of the figures differs from what the sessions' rows give: its count of trials and its median.

    timeouts: trials whose time was up are in the boxes.

    Rows of sessions whose key was opened here are blind: they are compared opened.
    """
    try:
        stored = as_table(unblinded(row, found.keys.get(row.participant, {})) for row in pooled_rows(folder))
    except InputError as error:
        return [f"{error}, so the figures cannot be compared with its rows"]
    data = found.data
    configurations = tuple(dict.fromkeys((*stored["configuration"], *data.trials["configuration"])))
    changes, names = [], data.labels
    for metric in (*DRAWN, *found.own.values()):
        before, after = (
            boxes(disambiguate_codes(trials), metric, configurations, timeouts) for trials in (stored, data.trials)
        )
        for key in sorted({*before, *after}, key=lambda cell: (by_controller(cell[0]), cell[1])):
            old, new = before.get(key), after.get(key)
            if old and new and (old.n, old.median) == (new.n, new.median):
                continue
            controller = key[0] if isinstance(key[0], str) else names.get(key[0], f"controller {key[0]}")
            counts = f"{old.n if old else 0} -> {new.n if new else 0} trials"
            if old and new:
                share = f" ({percent((new.median - old.median) / old.median, 1, '+')})" if old.median else ""
                change = (
                    f"median {significant(old.median, 4)} -> {significant(new.median, 4)} {metric.shown_unit}{share}"
                )
            else:
                change = "the box is gone" if old else "a new box"
            changes.append(f"{metric.title}, {' '.join(controller.split())}, {key[1]}: {counts}, {change}")
    return changes


def read_studies(folders: Sequence[Path]) -> dict[str, Trials]:
    """The trials of several studies, by the names of their folders. InputError if one cannot be compared."""
    studies: dict[str, Trials] = {}
    for folder in folders:
        there = sessions_in(folder)
        trials = as_table(pooled_rows(folder))
        name = folder.resolve().name
        if name in studies:
            raise InputError(f"{folder}: another study of this name is named already, they cannot be told apart")
        if not trials["status"].isin(COUNTED).any():
            raise InputError(f"{folder}: holds no trial that counts, there is nothing to compare")
        presets = {
            number: preset
            for session in there.folders
            for number, preset in read_stored(session).protocol.controllers.items()
        }
        if reason := why_no_findings(presets, is_coded(trials)):
            raise InputError(f"{folder}: {reason}")
        studies[name] = trials
    return studies


def write_side_by_side(studies: Mapping[str, Trials], out: Path) -> Path:
    """The findings of several studies in one table; where it stands."""
    path = out / "side-by-side.md"
    write_new_file(path, side_by_side(studies).encode())
    return path
