"""`phd analyze`: every number and figure of a study again, from its recordings alone.

What is damaged or was cut off is left out and named; the boxes that it changes are compared with the table in DIR.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from core.errors import InputError
from experiments.boxplots import MEASURES, boxes, draw_boxplots
from experiments.figures import CONTROLLER_LABELS
from experiments.recording import read_recording
from experiments.report import write_report
from experiments.sensitivity import of_recording
from experiments.session import Choices
from experiments.trial_row import row_of
from experiments.trials_table import COUNTED, TrialRow, read_table, write_table


def find_recordings(folder: Path) -> list[Path]:
    """All recordings of a data folder, by session and run; a stream counts where it has no Parquet file yet."""
    found = {}
    for suffix in ("arrows", "parquet"):
        for path in folder.glob(f"sub-*/ses-*/trials/run-*.{suffix}"):
            found[path.with_suffix("")] = path
    return [found[key] for key in sorted(found)]


def analyze(folder: Path, out: Path | None = None, progress: Callable[[float], None] | None = None) -> dict:
    """Write trials.csv, the figures and the report into a new folder (default DIR/analysis-N); the summary.

    A recording that is damaged or was cut off is left out and named, here and on the figures, and `changed` says what
    that does to each box. InputError if there is nothing to analyze.
    """
    folder = Path(folder)
    paths = find_recordings(folder)
    if not paths:
        raise InputError(f"{folder}: holds no recordings (sub-*/ses-*/trials/run-*)")
    out = new_folder(folder, out)
    rows, left_out, notes = [], [], set()
    try:
        for number, path in enumerate(paths, start=1):
            recording = read_recording(path)
            if recording.whole:
                rows.append(row_of(recording, out))
                about = recording.metadata
                choices = Choices(about["seed"], about["rules"], about["low_gain"])
                notes.add(choices.note(about["assumed"]) + f", hand: {about['hand']}")
            else:
                why = "; ".join(recording.damaged) or "cut off before its end"
                left_out.append(f"{path.relative_to(folder)} ({why})")
            if progress:
                progress(number / len(paths))
        write_table(out / "trials.csv", rows)
        if rows:
            without = f", {count_of(left_out, 'recording')} left out" if left_out else ""
            note = " / ".join(sorted(notes)) + without
            draw_boxplots(rows, out / "figures", note)
            if any(row.status in COUNTED for row in rows):
                write_report(rows, out / "report", note, of_recording(out))
    except BaseException:
        if not any(out.iterdir()):
            out.rmdir()
        raise
    return {
        "out": str(out),
        "recordings": len(paths),
        "trials": len(rows),
        "left_out": left_out,
        "changed": changed_boxes(folder / "trials.csv", rows) if left_out else [],
    }


def changed_boxes(table: Path, rows: Sequence[TrialRow]) -> list[str]:
    """How each box of the figures differs from what `table` gives: its count of trials and its median."""
    if not table.exists():
        return [f"{table}: there is no such table, so the figures cannot be compared with it"]
    try:
        before_rows = read_table(table)
    except InputError as error:
        return [f"{error}, so the figures cannot be compared with it"]
    configurations = tuple(dict.fromkeys(row.configuration for row in (*before_rows, *rows)))
    said = []
    for measure in MEASURES:
        before, after = (boxes(r, measure.column, configurations, measure.scale) for r in (before_rows, rows))
        for key in sorted({*before, *after}):
            old, new = before.get(key), after.get(key)
            if old and new and (old.count, old.median) == (new.count, new.median):
                continue
            box = f"{measure.title}, {' '.join(CONTROLLER_LABELS[key[0]].split())}, {key[1]}"
            if old is None or new is None:
                counts = f"{old.count if old else 0} -> {new.count if new else 0} trials"
                said.append(f"{box}: {counts}, {'the box is gone' if old else 'a new box'}")
                continue
            share = f" ({(new.median - old.median) / old.median:+.1%})" if old.median else ""
            said.append(
                f"{box}: {old.count} -> {new.count} trials, "
                f"median {old.median:.4g} -> {new.median:.4g} {measure.unit}{share}"
            )
    return said


def count_of(things: Sequence, word: str) -> str:
    """As "1 recording", "2 recordings"."""
    return f"{len(things)} {word}{'s' if len(things) != 1 else ''}"


def new_folder(folder: Path, out: Path | None) -> Path:
    """The folder for the results: `out`, which must be new or empty, or the first free DIR/analysis-N."""
    try:
        if out is None:
            number = 1
            while (folder / f"analysis-{number}").exists():
                number += 1
            out = folder / f"analysis-{number}"
        out = Path(out)
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise InputError(f"{out}: is not empty, results are never overwritten")
    except OSError as error:
        raise InputError(f"{out}: cannot be created ({(error.strerror or str(error)).lower()})") from None
    return out
