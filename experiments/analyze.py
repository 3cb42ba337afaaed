"""`phd analyze`: every number and figure of a study again, from its recordings alone."""

from collections.abc import Callable
from pathlib import Path

from core.errors import InputError
from experiments.boxplots import draw_boxplots
from experiments.recording import read_recording
from experiments.session import Choices, row_of
from experiments.trials_table import write_table


def find_recordings(folder: Path) -> list[Path]:
    """All recordings of a data folder, by session and run; a stream counts where it has no Parquet file yet."""
    found = {}
    for suffix in ("arrows", "parquet"):
        for path in folder.glob(f"sub-*/ses-*/trials/run-*.{suffix}"):
            found[path.with_suffix("")] = path
    return [found[key] for key in sorted(found)]


def analyze(folder: Path, out: Path | None = None, progress: Callable[[float], None] | None = None) -> dict:
    """Write trials.csv and the figures into a new folder (default DIR/analysis-N); the summary.

    A recording that is damaged or was cut off is left out and named. InputError if there is nothing to analyze.
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
            draw_boxplots(rows, out / "figures", " / ".join(sorted(notes)))
    except BaseException:
        if not any(out.iterdir()):
            out.rmdir()
        raise
    return {
        "out": str(out),
        "recordings": len(paths),
        "trials": len(rows),
        "left_out": left_out,
    }


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
