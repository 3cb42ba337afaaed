"""Export of results beside the window: started, watched, cancelled."""

import os
import pickle
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from PySide6.QtCore import QObject, Signal

from app.ipc.process import start_python
from core.files import InputError
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
    from experiments.export.answers import answers_and_notes, write_answers_and_notes

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
        sessions = (session for who in people for session in data_dir.glob(f"sub-{who}/ses-*"))
        said = write_answers_and_notes(partial, answers_and_notes(sessions))
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


CANCELLED = "The export was cancelled, nothing was written."
DIED = "The export ended before it was complete, nothing was written."


class Export(QObject):
    """One export at a time, in a process of its own with a thread that listens to it."""

    progressed = Signal(float)  # the share done
    ended = Signal(str)  # what was written, or why nothing was, in a sentence

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        """Whether one is running."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, job: Job) -> None:
        """Begin to write; a signal tells the end."""
        self._cancelled = False
        self._process = start_python("app.window.export", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._thread = threading.Thread(target=self._listen, args=(self._process, job), name="export")
        self._thread.start()

    def cancel(self) -> None:
        """Stop now; nothing is left behind."""
        if self._process is not None and self.busy:
            self._cancelled = True
            self._process.terminate()

    def wait(self) -> None:
        """Until what runs has ended."""
        if self._thread is not None:
            self._thread.join()

    def _listen(self, process: subprocess.Popen, job: Job) -> None:
        end = ""
        with process:  # closes its pipes, waits for its end
            try:
                pickle.dump(job, process.stdin)
                process.stdin.close()
            except OSError:
                pass  # it has ended already: said below
            for line in process.stdout:
                kind, _, what = line.decode().strip().partition(" ")
                if kind == "share":
                    self.progressed.emit(float(what))
                else:
                    end = what
        if not end and job.folder.exists():  # killed when all was written
            end = f"The results are in {job.folder}"
        if not end:  # killed: what it had begun is removed in its place
            shutil.rmtree(partial_of(job.folder), ignore_errors=True)
        self.ended.emit(end or (CANCELLED if self._cancelled else DIED))
