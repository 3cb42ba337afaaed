"""Writing results for print: box plots as PNG, SVG and PDF, tables as CSV, into a new folder, all or nothing.

`main` does it in a process of its own: figures take seconds of Python, which in a thread would hold up the window.
"""

import os
import pickle
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from core.errors import InputError
from experiments.analysis.trials_table import TrialRow, write_table

PARTIAL = ".partial"  # ends the name of a folder that is not complete yet
NICE = 10  # behind everything that keeps time


class Job(NamedTuple):
    """What to write where."""

    rows: tuple[TrialRow, ...]
    data_dir: Path  # where the rows' recordings are relative to
    folder: Path  # must be new
    note: str  # stands on every figure
    devices: tuple[str, ...]
    labels: dict[int, str]  # controller -> what stands under its box
    protocol: str = "paper"  # its name


def new_folder(data_dir: Path) -> Path:
    """DATA/results-1, -2, ..: the first that is not there."""
    number = 1
    while (data_dir / f"results-{number}").exists():
        number += 1
    return data_dir / f"results-{number}"


def partial_of(folder: Path) -> Path:
    """Where the files are until they are all there."""
    return folder.with_name(folder.name + PARTIAL)


def export_results(job: Job, progress: Callable[[float], None] = lambda share: None) -> int:
    """Write figures, trials.csv, and what was answered and noted; how many files. InputError says why not.

    progress: called with the share done.
    """
    from experiments.analysis.boxplots import draw_boxplots  # matplotlib takes its time
    from experiments.export.trial import said_in, write_said

    rows, data_dir, folder, note, devices, labels, protocol = job
    if folder.exists():
        raise InputError(f"{folder}: exists already, the results need a new folder")
    partial = partial_of(folder)
    here = Path(os.path.relpath(data_dir, folder)).as_posix()
    try:
        partial.mkdir(parents=True)
        figures = draw_boxplots(rows, partial, note, devices, labels=labels, progress=progress, protocol=protocol)
        write_table(partial / "trials.csv", [row.seen_from(here) for row in rows])
        people = sorted({row.participant for row in rows})
        said = write_said(partial, said_in(home for who in people for home in data_dir.glob(f"sub-{who}/ses-*")))
        partial.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({(error.strerror or str(error)).lower()})") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return len(figures) + 1 + len(said)


def main() -> None:
    """A pickled Job on stdin; on stdout a line for each step ("share 0.5") and the end ("done ..", "refused ..")."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    job: Job = pickle.load(sys.stdin.buffer)

    try:
        count = export_results(job, lambda share: print("share", share, flush=True))
    except InputError as error:
        print("refused", str(error).replace("\n", " "))
    else:
        print("done", f"{count} files written to {job.folder}")
